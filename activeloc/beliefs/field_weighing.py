"""Kernels that weigh particles by a scan of a likelihood field."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import unit
from activeloc.grid import OccupancyGrid
from activeloc.range_table import POINT, ahead_of, cell_of, direction_of, directions_of
from activeloc.sensors import LikelihoodField
from activeloc.sensors.field_table import BIAS, OFFSET, SIZE, FieldTable, sum_along

TILES = 16  # Blocks along a square of them whose places are told apart.


@njit(cache=True, nogil=True)
def end_cells(
    col: float,
    row: float,
    heading: tuple[float, float],
    ends: NDArray[np.float32],
    shape: tuple[int, int],
    out: NDArray[np.int32],
) -> None:
    """Fill ``out (B,)`` with the flat cells that a pose's readings end in; on the rim if outside.

    Args:
        col: Of the pose in the padded map [cell].
        row: [cell].
        heading: Cosine and sine.
        ends: ``(3, B)``; along and across the heading [cell], and 0 for the map's corner instead.
        shape: Of the padded map.
        out: Overwritten.
    """
    cos, sin = np.float32(heading[0]), np.float32(heading[1])
    x, y, width, nought = np.float32(col), np.float32(row), np.int32(shape[1]), np.float32(0.0)
    right, top = np.float32(shape[1] - 0.5), np.float32(shape[0] - 0.5)
    for b in range(out.shape[0]):
        end_x = min(max(x + cos * ends[0, b] - sin * ends[1, b], nought), right)
        end_y = min(max(y + sin * ends[0, b] + cos * ends[1, b], nought), top)
        counts = np.int32(ends[2, b])
        out[b] = (np.int32(end_y) * width + np.int32(end_x)) * counts


@njit(cache=True, nogil=True)
def add_up(
    flat: NDArray[np.int16],
    cells: NDArray[np.int32],
    totals: NDArray[np.uint16],
    directions: NDArray[np.uint32],
    which: NDArray[np.int64],
    law: NDArray[np.float32],
) -> float:
    """Sum of a pose's log-likelihoods; NaN if a total has not been summed yet.

    Args:
        flat: The padded map's nearness.
        cells: ``(B,)``; see :func:`end_cells`.
        totals: ``(D,)``; a block's row of the table.
        directions: ``(B,)``; of the beams.
        which: ``(B,)``; where each beam's law begins, with the offset of its places.
        law: The laws, one after another.
    """
    result = 0.0
    for b in range(cells.shape[0]):
        total = np.int64(totals[np.uint64(directions[b])])
        # Unsigned, for numba looks after negative indices.
        result += law[np.uint64(which[b] + np.int64(flat[np.uint64(cells[b])]) - total)]
    return result


@njit(cache=True, nogil=True)
def by_place(
    index: NDArray[np.int32], by_block: NDArray[np.float64], poses: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Row of the table of each pose ``(N,)``, and an order in which neighbours come together.

    What one pose looks up is in the cache for the next. Blocks ``TILES`` apart count as one.

    Args:
        index: ``(rows, cols)``.
        by_block: x and y of the map's corner [m], and blocks per metre.
        poses: ``(N, 3)``.
    """
    n = poses.shape[0]
    blocks, drawers = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.uint8)
    begin, order = np.zeros(TILES * TILES + 1, dtype=np.int32), np.empty(n, dtype=np.int32)
    for i in range(n):
        blocks[i], row, col = cell_of(index, by_block, poses[i, 0], poses[i, 1])
        drawers[i] = (row % TILES) * TILES + col % TILES
        begin[np.uint64(drawers[i]) + np.uint64(1)] += 1
    for drawer in range(TILES * TILES):
        begin[drawer + 1] += begin[drawer]
    for i in range(n):
        its = np.uint64(drawers[i])
        order[np.uint64(begin[its])] = i
        begin[its] += 1
    return blocks, order


@njit(cache=True, nogil=True)
def weigh_by_field(
    near: NDArray[np.int16],
    nearness: NDArray[np.float64],
    index: NDArray[np.int32],
    side: int,
    total: NDArray[np.uint16],
    reach: NDArray[np.float64],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    ends: NDArray[np.float32],
    which: NDArray[np.int64],
    law: NDArray[np.float32],
    log_w: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        near: See :class:`activeloc.sensors.field_table.FieldTable` for these seven.
        nearness: Of each step.
        index: ``(rows, cols)``.
        side: Of a block [cell].
        total: ``(blocks, D)``, overwritten where it has not been summed yet.
        reach: ``(Z - 1,)``.
        frame: ``(3,)``.
        poses: ``(N, 3)``.
        bearings: ``(B,)`` of the readings that count [rad].
        ends: ``(3, B)``; see :func:`end_cells`.
        which: ``(B,)``; see :func:`add_up`.
        law: See :func:`add_up`.
        log_w: ``(N,)``, overwritten.
    """
    n_directions, n_beams = total.shape[1], bearings.shape[0]
    circle, flat = np.uint32(n_directions << POINT), near.reshape(-1)
    per_radian = n_directions / (2.0 * np.pi) * (1 << POINT)
    offset, cells = np.empty(n_beams, dtype=np.uint32), np.empty(n_beams, dtype=np.int32)
    directions = np.empty(n_beams, dtype=np.uint32)
    own = np.empty(n_directions, dtype=np.uint16)
    directions_of(bearings - np.pi, n_directions, offset)
    by_block = np.array([frame[0], frame[1], frame[2] / side])
    blocks, order = by_place(index, by_block, poses)
    for each in order:
        i = np.uint64(each)
        col, row = (poses[i, 0] - frame[0]) * frame[2], (poses[i, 1] - frame[1]) * frame[2]
        end_cells(col + 1.0, row + 1.0, unit(poses[i, 2]), ends, near.shape, cells)
        ahead = ahead_of(poses[i, 2], per_radian, circle)
        for b in range(n_beams):
            directions[b] = direction_of(ahead, offset[b], circle)
        block = blocks[i]
        if block < 0:  # Nowhere in the table: summed from where it stands, and forgotten.
            own[:] = 0
            totals = own
        else:
            totals = total[np.uint64(block)]
        added = add_up(flat, cells, totals, directions, which, law)
        if np.isnan(added):
            if block >= 0:
                _, block_row, block_col = cell_of(index, by_block, poses[i, 0], poses[i, 1])
                col, row = (block_col + 0.5) * side, (block_row + 0.5) * side
            for direction in directions:
                if totals[direction] == 0:
                    theta = direction * (2.0 * np.pi / n_directions)
                    totals[direction] = BIAS + sum_along(near, nearness, col, row, theta, reach)
            added = add_up(flat, cells, totals, directions, which, law)
        log_w[i] += added


@njit(cache=True, nogil=True)
def aim(
    beams: NDArray[np.intp],
    readings: NDArray[np.int32],
    kinds: NDArray[np.intp],
    reach: NDArray[np.float64],
    headings: NDArray[np.float64],
    ends: NDArray[np.float32],
    which: NDArray[np.int64],
) -> None:
    """Where the readings that count end, and where their laws begin.

    Args:
        beams: ``(n,)`` of those that count.
        readings: ``(B,)`` of bins.
        kinds: ``(n,)``; number of each beam's weight among those that differ.
        reach: ``(Z,)``; the readings, a maximum-range one being 0 [cell].
        headings: ``(2, B)``; cosines and sines of the bearings.
        ends: ``(3, n)``, overwritten; see :func:`end_cells`.
        which: ``(n,)``, overwritten; see :func:`add_up`.
    """
    for b in range(beams.shape[0]):
        beam, reading = beams[b], readings[beams[b]]
        is_max = reading == reach.shape[0] - 1
        ends[0, b] = reach[reading] * headings[0, beam]
        ends[1, b] = reach[reading] * headings[1, beam]
        ends[2, b] = 0.0 if is_max else 1.0
        which[b] = (2 * kinds[b] + is_max) * SIZE + OFFSET


class FieldWeigher:
    """Weighs particles on one map by a likelihood field.

    Args:
        table: Of the map.
        power: Exponent on each reading's likelihood.
    """

    def __init__(self, table: FieldTable, power: float) -> None:
        self.table, self.power = table, power
        self._bearings = table.sensor.bearings
        self._headings = np.array([np.cos(self._bearings), np.sin(self._bearings)])
        self._reach = np.append(table.reach, 0.0)
        self._laws: dict[tuple[float, ...], NDArray[np.float32]] = {}

    def _law(self, weights: tuple[float, ...]) -> NDArray[np.float32]:
        """Laws of readings of each weight, then of maximum-range ones of it, in one array."""
        if weights not in self._laws:
            if len(self._laws) >= 16:
                self._laws.clear()
            powers = self.power * np.repeat(weights, 2)
            laws = [self.table.law(power, k % 2 == 1) for k, power in enumerate(powers)]
            self._laws[weights] = np.concatenate(laws)
        return self._laws[weights]

    def weigh(
        self,
        poses: NDArray[np.float64],
        readings: NDArray[np.int32],
        weights: NDArray[np.float64],
        log_w: NDArray[np.float64],
    ) -> None:
        """Add a scan's weighted log-likelihood at poses ``(N, 3)`` to ``log_w (N,)``, in place.

        Args:
            poses: Headings in [-pi, pi).
            readings: ``(B,)`` of bins; -1 for no reading.
            weights: ``(B,)``; how much each reading counts.
            log_w: Overwritten.
        """
        table = self.table
        beams = np.flatnonzero((readings >= 0) & (weights > 0.0))
        n = len(beams)
        if not n:
            return
        of_beam = weights[beams].tolist()
        each = {weight: k for k, weight in enumerate(dict.fromkeys(of_beam))}
        kinds = np.array([each[weight] for weight in of_beam], dtype=np.intp)
        ends, which = np.empty((3, n), dtype=np.float32), np.empty(n, dtype=np.int64)
        aim(beams, readings, kinds, self._reach, self._headings, ends, which)
        weigh_by_field(
            table.near, table.nearness, table.index, table.side, table.total, table.reach,
            table.frame, poses, self._bearings[beams], ends, which, self._law(tuple(each)), log_w,
        )  # fmt: skip


@lru_cache(maxsize=8)
def field_weigher(grid: OccupancyGrid, sensor: LikelihoodField, power: float) -> FieldWeigher:
    """Of a map, shared, and kept for the 8 used last."""
    return FieldWeigher(FieldTable(grid, sensor), power)
