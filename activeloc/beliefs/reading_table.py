"""How probable each reading is in each cell and direction: P(z in bin | cell, direction).

Averaged deterministically over the cell's open sub-poses and over the width of a heading bin, on
the map's own resolution. Averaging the *probability* (not the expected range) keeps both answers
where half of a cell sees past a door post. States with one distribution share one row, so that
weighing a scan is two look-ups and an addition per state and beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.lanes import N_LANES
from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.beliefs.profiles import Profiles
from activeloc.beliefs.sweep import Sweep
from activeloc.sensors import ExpectedRangeSensor, RangeSensor, ReadingBins

ANGLES = 3  # Directions probed across a heading bin.
PER_BIN = 2  # Expected ranges are told apart this much more finely than readings.


@dataclass(frozen=True, eq=False)
class ReadingTable:
    """Rows of reading probabilities and which row each cell and direction has.

    Attributes:
        bins: What the readings are sorted into, Z bins.
        rows: ``(P * per_heading * (K + LANES) + LANES,)``; for each place and *phase* (a direction
            modulo ``per_heading``) the rows of that phase's K directions, and the first LANES
            again. Directions divide the circle evenly from the first heading bin's centre, so
            direction ``per_heading * k`` is heading bin k's.
        place: ``(C,)``; place of each cell.
        n_directions: D.
        log_p: ``(Z, R)`` of float32; log P(z | row). Each column is a distribution.
        offsets: ``(B,)``; beam b of a robot heading along bin k looks along direction
            ``(per_heading * k + offsets[b]) mod D``.
        per_heading: Directions per heading bin.
    """

    bins: ReadingBins
    rows: NDArray[np.unsignedinteger]
    place: NDArray[np.int32]
    n_directions: int
    log_p: NDArray[np.float32]
    offsets: NDArray[np.int32]
    per_heading: int

    def rows_of(
        self, cell: NDArray[np.integer], heading: NDArray[np.integer]
    ) -> NDArray[np.unsignedinteger]:
        """``(N, B)``; row of each beam from states of cells ``(N,)`` and heading bins ``(N,)``."""
        direction = heading[:, None].astype(np.int64) * self.per_heading + self.offsets
        k, phase = np.divmod(direction % self.n_directions, self.per_heading)
        return self._by_phase[self.place[cell, None], phase, k]

    @property
    def _by_phase(self) -> NDArray[np.unsignedinteger]:
        """``(P, per_heading, K + LANES)``."""
        stretch = self.n_directions // self.per_heading + N_LANES
        n = len(self.rows) - N_LANES
        return self.rows[:n].reshape(-1, self.per_heading, stretch)

    @cached_property
    def row(self) -> NDArray[np.unsignedinteger]:
        """``(C, D)``; row of each cell and direction."""
        by_phase = self._by_phase[self.place, :, :-N_LANES]
        return by_phase.transpose(0, 2, 1).reshape(len(self.place), -1)


def directions(bearings: NDArray[np.float64], bin_width: float) -> tuple[int, NDArray[np.int32]]:
    """Directions per heading bin, and the offset of each beam in directions.

    As few as put every beam within a sixteenth of a bin of its direction, at most 4.
    """
    per_heading = 1
    while per_heading < 4:
        exact = bearings / bin_width * per_heading
        if np.abs(exact - np.round(exact)).max() <= per_heading / 16.0:
            break
        per_heading *= 2
    return per_heading, np.round(bearings / bin_width * per_heading).astype(np.int32)


def _expected_range_rows(
    grid: PoseGrid, sensor: ExpectedRangeSensor, bins: ReadingBins, angles: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Row of each direction and place, and the rows' probabilities, from expected ranges alone."""
    layout, world = GridLayout(grid), grid.terrain.grid
    n_ranges = PER_BIN * (len(bins) - 1)
    # A range on the edge of a class (a wall met at 60 degrees) goes up in every like room, however
    # its coordinates were rounded.
    limits = (np.arange(1, n_ranges + 1) - 1e-9) / n_ranges
    limits[-1] = 1.0
    sweep = Sweep(grid, world, limits * (sensor.z_max / world.resolution))
    classes = np.empty((angles.shape[1], SUB * SUB, layout.size), dtype=sweep.dtype)
    row = np.zeros((len(angles), layout.size), dtype=np.int32)
    profiles = Profiles(n_ranges + 1, grid.is_open, layout)
    for d, across in enumerate(angles):
        for a, angle in enumerate(across):
            sweep.along(angle + sensor.cone, classes[a])
        profiles.assign(classes, row[d])
    middles = (np.arange(n_ranges) + 0.5) * sensor.z_max / n_ranges
    masses = sensor.masses(np.append(middles, sensor.z_max), bins)
    return row, profiles.shares @ masses


def _sampled_rows(
    grid: PoseGrid, sensor: RangeSensor, bins: ReadingBins, angles: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Row of each direction and place, a row for each cell, for a sensor of any kind."""
    sub_poses = grid.sub_poses()
    n_cells, n_directions = len(grid.cells), len(angles)
    rows = np.zeros((n_cells, n_directions, len(bins)))
    weight = grid.is_open / grid.is_open.sum(axis=-1, keepdims=True) / angles.shape[1]
    for d in range(n_directions):
        for angle in angles[d]:
            rays = np.concatenate([sub_poses, np.full((*sub_poses.shape[:-1], 1), angle)], axis=-1)
            p = sensor.bin_probabilities(grid.terrain.grid, rays, bins)
            rows[:, d] += np.einsum("csz,cs->cz", p, weight)
    layout = GridLayout(grid)
    row = np.zeros((n_directions, layout.size), dtype=np.int32)
    row[:, layout.place] = np.arange(n_cells * n_directions).reshape(n_cells, n_directions).T
    return row, rows.reshape(-1, len(bins))


def _by_use(
    row: NDArray[np.int32], p: NDArray[np.float64], place: NDArray[np.int32]
) -> tuple[NDArray[np.unsignedinteger], NDArray[np.float64]]:
    """The same with the rows that are used most first, where one finds them in the fastest memory.

    Args:
        row: ``(D, P)``.
        p: ``(R, Z)``.
        place: ``(C,)``; where ``row`` counts.
    """
    used = np.bincount(row[:, place].ravel(), minlength=len(p))
    order = np.argsort(-used, kind="stable")
    rank = np.empty(len(p), dtype=np.uint16 if len(p) <= 2**16 else np.uint32)
    rank[order] = np.arange(len(p))
    ranks: NDArray[Any] = rank[row]
    return ranks, p[order]


def _phase_rows(row: NDArray[np.unsignedinteger], per_heading: int) -> NDArray[Any]:
    """:attr:`ReadingTable.rows` from rows ``(D, P)``."""
    headings = len(row) // per_heading
    by_phase = row.reshape(headings, per_heading, -1).transpose(2, 1, 0)
    rows = by_phase[:, :, np.arange(headings + N_LANES) % headings]
    # The last ones are asked for eight at a time.
    return np.append(rows, np.zeros(N_LANES, dtype=row.dtype))


def build_reading_table(grid: PoseGrid, sensor: RangeSensor, reading_bin: float) -> ReadingTable:
    """Tabulate a sensor over a pose grid.

    Args:
        grid: Cells and headings.
        sensor: What the filter assumes.
        reading_bin: Greatest width of a reading bin [m].
    """
    bins = ReadingBins(sensor.z_max, reading_bin)
    per_heading, offsets = directions(sensor.bearings, grid.bin_width)
    step = grid.bin_width / per_heading
    centres = grid.thetas[0] + np.arange(per_heading * grid.headings) * step
    across = ((np.arange(ANGLES) + 0.5) / ANGLES - 0.5) * grid.bin_width
    angles = centres[:, None] + across
    if isinstance(sensor, ExpectedRangeSensor):
        row, p = _expected_range_rows(grid, sensor, bins, angles)
    else:
        row, p = _sampled_rows(grid, sensor, bins, angles)
    place = GridLayout(grid).place
    ranks, p = _by_use(row, p, place)
    with np.errstate(divide="ignore"):
        log_p = np.log(p).astype(np.float32)
    log_p = np.ascontiguousarray(log_p.T)
    rows = _phase_rows(ranks, per_heading)
    return ReadingTable(bins, rows, place, len(centres), log_p, offsets, per_heading)
