"""Kernels that weigh particles by a scan of a likelihood field."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import unit
from activeloc.grid import OccupancyGrid
from activeloc.range_table import POINT, cell_of, directions_of
from activeloc.sensors import LikelihoodField
from activeloc.sensors.field_table import BIAS, OFFSET, SIZE, FieldTable, sum_along


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
    ahead: int,
    offset: NDArray[np.int64],
    which: NDArray[np.int64],
    law: NDArray[np.float32],
) -> float:
    """Sum of a pose's log-likelihoods; NaN if a total has not been summed yet.

    Args:
        flat: The padded map's nearness.
        cells: ``(B,)``; see :func:`end_cells`.
        totals: ``(D,)``; a block's row of the table.
        ahead: The heading; see :func:`directions_of`.
        offset: ``(B,)``; of the beams.
        which: ``(B,)``; where each beam's law begins, with the offset of its places.
        law: The laws, one after another.
    """
    circle, result = totals.shape[0] << POINT, 0.0
    for b in range(cells.shape[0]):
        turned = ahead + offset[b]
        turned -= circle if turned >= circle else 0
        total = np.int64(totals[np.uint64(turned >> POINT)])
        # Unsigned, for numba looks after negative indices.
        result += law[np.uint64(which[b] + np.int64(flat[np.uint64(cells[b])]) - total)]
    return result


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
    circle, flat = n_directions << POINT, near.reshape(-1)
    per_radian, half = n_directions / (2.0 * np.pi) * (1 << POINT), (1 << POINT) // 2
    offset, cells = np.empty(n_beams, dtype=np.int64), np.empty(n_beams, dtype=np.int32)
    own = np.empty(n_directions, dtype=np.uint16)
    directions_of(bearings - np.pi, n_directions, offset)
    by_block = np.array([frame[0], frame[1], frame[2] / side])
    for i in range(poses.shape[0]):
        col, row = (poses[i, 0] - frame[0]) * frame[2], (poses[i, 1] - frame[1]) * frame[2]
        end_cells(col + 1.0, row + 1.0, unit(poses[i, 2]), ends, near.shape, cells)
        ahead = int((poses[i, 2] + np.pi) * per_radian) + half
        ahead -= circle if ahead >= circle else 0
        block, block_row, block_col = cell_of(index, by_block, poses[i, 0], poses[i, 1])
        if block < 0:  # Nowhere in the table: summed from where it stands, and forgotten.
            own[:] = 0
            totals = own
        else:
            totals = total[np.uint64(block)]
            col, row = (block_col + 0.5) * side, (block_row + 0.5) * side
        added = add_up(flat, cells, totals, ahead, offset, which, law)
        if np.isnan(added):
            for b in range(n_beams):
                turned = ahead + offset[b]
                direction = (turned - circle if turned >= circle else turned) >> POINT
                if totals[direction] == 0:
                    theta = direction * (2.0 * np.pi / n_directions)
                    totals[direction] = BIAS + sum_along(near, nearness, col, row, theta, reach)
            added = add_up(flat, cells, totals, ahead, offset, which, law)
        log_w[i] += added


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
        counts = (readings >= 0) & (weights > 0.0)
        if not counts.any():
            return
        of_beam = weights[counts].tolist()
        each = {weight: k for k, weight in enumerate(dict.fromkeys(of_beam))}
        is_max = readings[counts] == len(table.reach)
        reach = self._reach[readings[counts]]
        ends = np.stack([*(reach * self._headings[:, counts]), ~is_max]).astype(np.float32)
        which = is_max * SIZE + OFFSET
        if len(each) > 1:
            which += 2 * SIZE * np.array([each[weight] for weight in of_beam])
        weigh_by_field(
            table.near, table.nearness, table.index, table.side, table.total, table.reach,
            table.frame, poses, self._bearings[counts], ends, which, self._law(tuple(each)), log_w,
        )  # fmt: skip


@lru_cache(maxsize=8)
def field_weigher(grid: OccupancyGrid, sensor: LikelihoodField, power: float) -> FieldWeigher:
    """Of a map, shared, and kept for the 8 used last."""
    return FieldWeigher(FieldTable(grid, sensor), power)
