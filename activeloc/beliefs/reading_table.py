"""How probable each reading is in each cell and direction: P(z in bin | cell, direction).

Averaged deterministically over the cell's open sub-poses and over the width of a heading bin, on
the map's own resolution. Averaging the *probability* (not the expected range) keeps both answers
where half of a cell sees past a door post. States with one distribution share one row, so that
weighing a scan is two look-ups and an addition per state and beam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.raycast import cast_ray
from activeloc.sensors import ExpectedRangeSensor, RangeSensor, ReadingBins

ANGLES = 3  # Directions probed across a heading bin.
LEVELS = 32  # Shares of a cell's rays are rounded to multiples of 1 / LEVELS.
PER_BIN = 2  # Expected ranges are told apart this much more finely than readings.
CHUNK = 256  # Cells handled at once while building.


@dataclass(frozen=True, eq=False)
class ReadingTable:
    """Rows of reading probabilities and which row each cell and direction has.

    Attributes:
        bins: What the readings are sorted into, Z bins.
        row: ``(C, D)``; directions divide the circle evenly from the first
            heading bin's centre, so direction ``per_heading * k`` is heading bin k's.
        log_p: ``(Z, R)`` of float32; log P(z | row). Each column is a distribution.
        offsets: ``(B,)``; beam b of a robot heading along bin k looks along direction
            ``(per_heading * k + offsets[b]) mod D``.
        per_heading: Directions per heading bin.
    """

    bins: ReadingBins
    row: NDArray[np.int32]
    log_p: NDArray[np.float32]
    offsets: NDArray[np.int32]
    per_heading: int


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


@njit(cache=True, nogil=True)
def _count_ranges(
    squares: NDArray[np.uint8],
    sub_poses: NDArray[np.float64],
    is_open: NDArray[np.bool_],
    angles: NDArray[np.float64],
    cone: NDArray[np.float64],
    z_max: float,
    counts: NDArray[np.int32],
) -> None:
    """Count, for each cell and direction, the expected ranges of its rays by quantised range.

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`cast_ray`.
        sub_poses: ``(C, S, 2)`` of column and row [cell].
        is_open: ``(C, S)``.
        angles: ``(D, ANGLES)`` [rad].
        cone: ``(R,)`` of directions about each angle [rad]; the nearest range is the expected one.
        z_max: [cell].
        counts: ``(C, D, Q + 1)``, zeros; the last class is "nothing in range".
    """
    n_ranges = counts.shape[2] - 1
    for d in range(angles.shape[0]):
        for a in range(angles.shape[1]):
            dx, dy = np.cos(angles[d, a] + cone), np.sin(angles[d, a] + cone)
            for c in range(sub_poses.shape[0]):
                for s in range(sub_poses.shape[1]):
                    if is_open[c, s]:
                        x, y, z = sub_poses[c, s, 0], sub_poses[c, s, 1], z_max
                        for r in range(cone.shape[0]):
                            z = cast_ray(squares, x, y, dx[r], dy[r], z)
                        # A range on the edge of a class (a wall met at 60 degrees) goes up in
                        # every like room, however its coordinates were rounded.
                        q = n_ranges if z >= z_max else int(z / z_max * n_ranges + 1e-9)
                        counts[c, d, q] += 1


@njit(cache=True, nogil=True)
def _round_to_levels(counts: NDArray[np.int32], levels: int) -> None:
    """Scale each row ``counts[n]`` to integers that sum to ``levels``, by largest remainder."""
    for n in range(counts.shape[0]):
        total = counts[n].sum()
        given = 0
        remainder = np.empty(counts.shape[1])
        for q in range(counts.shape[1]):
            exact = counts[n, q] * levels / total
            counts[n, q] = int(exact)
            remainder[q] = exact - counts[n, q]
            given += counts[n, q]
        for _ in range(levels - given):
            best = remainder.argmax()
            counts[n, best] += 1
            remainder[best] = -1.0


def _distinct(
    rows: NDArray[np.int32],
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Distinct rows and which of them each row is; rows are told apart by a 64-bit hash."""
    keys = np.random.default_rng(0).integers(0, 2**63, rows.shape[1], dtype=np.uint64)
    hashes = (rows.astype(np.uint64) * (2 * keys + 1)).sum(axis=1, dtype=np.uint64)
    _, first, inverse = np.unique(hashes, return_index=True, return_inverse=True)
    return rows[first], inverse


def _expected_range_rows(
    grid: PoseGrid, sensor: ExpectedRangeSensor, bins: ReadingBins, angles: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Row of each cell and direction, and the rows' probabilities, from expected ranges alone."""
    world = grid.terrain.grid
    n_ranges = PER_BIN * (len(bins) - 1)
    sub_poses = world.to_cells(grid.sub_poses())
    row = np.empty((len(grid.cells), len(angles)), dtype=np.int32)
    profiles = np.empty((0, n_ranges + 1), dtype=np.int32)
    for start in range(0, len(grid.cells), CHUNK):
        part = slice(start, start + CHUNK)
        counts = np.zeros((len(sub_poses[part]), len(angles), n_ranges + 1), dtype=np.int32)
        _count_ranges(
            world.squares,
            sub_poses[part],
            grid.is_open[part],
            angles,
            sensor.cone,
            sensor.z_max / world.resolution,
            counts,
        )
        flat = counts.reshape(-1, n_ranges + 1)
        _round_to_levels(flat, LEVELS)
        known = len(profiles)
        profiles, which = _distinct(np.concatenate([profiles, flat]))
        row[:start] = which[row[:start]]
        row[part] = which[known:].reshape(-1, len(angles))
    middles = (np.arange(n_ranges) + 0.5) * sensor.z_max / n_ranges
    masses = sensor.masses(np.append(middles, sensor.z_max), bins)
    return row, (profiles / LEVELS) @ masses


def _sampled_rows(
    grid: PoseGrid, sensor: RangeSensor, bins: ReadingBins, angles: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Row of each cell and direction, one row each, for a sensor of any kind."""
    sub_poses = grid.sub_poses()
    n_cells, n_directions = len(grid.cells), len(angles)
    rows = np.zeros((n_cells, n_directions, len(bins)))
    weight = grid.is_open / grid.is_open.sum(axis=-1, keepdims=True) / angles.shape[1]
    for d in range(n_directions):
        for angle in angles[d]:
            rays = np.concatenate([sub_poses, np.full((*sub_poses.shape[:-1], 1), angle)], axis=-1)
            p = sensor.bin_probabilities(grid.terrain.grid, rays, bins)
            rows[:, d] += np.einsum("csz,cs->cz", p, weight)
    which = np.arange(n_cells * n_directions, dtype=np.int32).reshape(n_cells, n_directions)
    return which, rows.reshape(-1, len(bins))


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
    with np.errstate(divide="ignore"):
        log_p = np.log(p).astype(np.float32)
    return ReadingTable(bins, row, np.ascontiguousarray(log_p.T), offsets, per_heading)
