"""Expected ranges looked up instead of cast: a table over cells and absolute directions.

A range from a map's cell is kept as one byte, in steps of ``z_max / 255``; it is cast from the
cell's centre when it is first asked for, so a table costs no more than the rays it answers and a
new map costs nothing. Where so much is asked at once that all cells together are cheaper
(:mod:`activeloc.tracing`), all are filled; their ranges are the same. Against the exact range from
where the robot stands in its cell the error is of the order of half a cell plus half a direction: a
few centimetres at a few metres. Filters that widen their sensor, or average over a cell anyhow, do
not notice; the simulator never uses it.

Source: Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 6.3.4, pre-cached ranges.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import OccupancyGrid
from activeloc.range_levels import cast_level, fill_all

POINT = 19  # Bits behind the point of a direction: twice 3,600 directions fill a word of 32 bits.
# What a ray costs, and a cell that is laid under many: a matter of their ratio [ns].
RAY, LAID = 100.0, 0.06


@njit(cache=True, nogil=True)
def cell_of(
    index: NDArray[np.int32], frame: NDArray[np.float64], x: float, y: float
) -> tuple[int, int, int]:
    """Row of the table, row and column of the map at a place [m]; -1 where it is not free."""
    col_f, row_f = (x - frame[0]) * frame[2], (y - frame[1]) * frame[2]
    if not (0.0 <= col_f < index.shape[1] and 0.0 <= row_f < index.shape[0]):
        return -1, 0, 0
    col, row = int(col_f), int(row_f)
    return index[np.uint64(row), np.uint64(col)], row, col


@njit(cache=True, nogil=True)
def directions_of(
    bearings: NDArray[np.float64], n_directions: int, out: NDArray[np.uint32]
) -> None:
    """Bearings ``(B,)`` as directions of the table with ``POINT`` bits behind the point.

    In fixed point, for integers are added and cut sooner than numbers are rounded, eight at once.
    """
    circle = n_directions << POINT
    for b in range(bearings.shape[0]):
        turns = bearings[b] / (2.0 * np.pi)
        out[b] = min(int((turns - np.floor(turns)) * n_directions * (1 << POINT)), circle - 1)


@njit(cache=True, nogil=True)
def heading_of(theta: float, n_directions: int) -> np.uint32:
    """A heading, and half a direction, so that the sum with a bearing's is rounded by cutting."""
    turns = theta / (2.0 * np.pi)
    circle = n_directions << POINT
    ahead = int(((turns - np.floor(turns)) * n_directions + 0.5) * (1 << POINT))
    return np.uint32(ahead - (circle if ahead >= circle else 0))


@njit(cache=True, nogil=True)
def ahead_of(theta: float, per_radian: float, circle: np.uint32) -> np.uint32:
    """:func:`heading_of` for many: a heading in [-pi, pi), counted from -pi.

    Args:
        theta: [rad].
        per_radian: Directions in fixed point.
        circle: All of them.
    """
    ahead = np.uint32(int((theta + np.pi) * per_radian) + (1 << (POINT - 1)))
    return np.uint32(min(ahead, np.uint32(ahead - circle)))


@njit(cache=True, nogil=True)
def direction_of(ahead: np.uint32, offset: np.uint32, circle: np.uint32) -> np.uint32:
    """The direction of a beam: heading and bearing added; see :func:`directions_of`."""
    turned = np.uint32(ahead + offset)
    # Without a branch: less than a circle less a circle is very large, without its sign.
    return np.uint32(min(turned, np.uint32(turned - circle)) >> np.uint32(POINT))


@njit(cache=True, nogil=True)
def cast_missing(
    table: NDArray[np.uint8],
    squares: NDArray[np.uint8],
    headings: NDArray[np.float64],
    place: tuple[int, int, int],
    ahead: np.uint32,
    offset: NDArray[np.uint32],
    reach: float,
) -> None:
    """Cast those beams of a pose that the table does not have yet.

    Args:
        table: ``(C, D)``, overwritten there.
        squares: See :func:`look_up_beams`.
        headings: ``(D, 2)``.
        place: Of the pose; see :func:`cell_of`.
        ahead: Its heading; see :func:`directions_of`.
        offset: ``(B,)``; of the beams.
        reach: [cell].
    """
    circle = np.uint32(table.shape[1] << POINT)
    for b in range(offset.shape[0]):
        direction = direction_of(ahead, offset[b], circle)
        if table[place[0], direction] == 0:
            table[place[0], direction] = cast_level(
                squares, place[1], place[2], headings[direction], reach
            )


@njit(cache=True, nogil=True, inline="always")
def read_levels(
    ranges: NDArray[np.uint8], ahead: np.uint32, offset: NDArray[np.uint32], out: NDArray[np.int32]
) -> int:
    """Fill ``out (B,)`` with a pose's levels; returns a negative number if one is not cast yet.

    Args:
        ranges: ``(D,)``; a cell's row of the table.
        ahead: The heading; see :func:`directions_of`.
        offset: ``(B,)``; of the beams.
        out: Overwritten; -1 for what is not cast yet.
    """
    circle, signs = np.uint32(ranges.shape[0] << POINT), 0
    for b in range(offset.shape[0]):
        out[b] = direction_of(ahead, offset[b], circle)
    for b in range(offset.shape[0]):
        # Unsigned, for numba looks after negative indices.
        out[b] = np.int32(ranges[np.uint64(out[b])]) - np.int32(1)
    for b in range(offset.shape[0]):
        signs |= out[b]
    return signs


@njit(cache=True, nogil=True)
def look_up_beams(
    table: NDArray[np.uint8],
    index: NDArray[np.int32],
    squares: NDArray[np.uint8],
    headings: NDArray[np.float64],
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    frame: NDArray[np.float64],
    reach: float,
    out: NDArray[np.int32],
) -> None:
    """Fill ``out[i, b]`` with the level of beam b from pose i.

    Args:
        table: ``(C, D)``.
        index: ``(H, W)``.
        squares: ``(4, H + 2, W + 2)``; see :func:`activeloc.raycast.cast_ray`.
        headings: ``(D, 2)``; cosine and sine of each direction.
        poses: ``(N, 3)`` of x, y [m] and theta [rad].
        bearings: ``(B,)`` [rad].
        frame: x and y of the map's corner [m], and cells per metre.
        reach: Longest range [cell].
        out: ``(N, B)``, overwritten.
    """
    n_directions, n_lacking = table.shape[1], 0
    offset = np.empty(len(bearings), dtype=np.uint32)
    lacking, headed = np.empty(len(poses), np.int64), np.empty(len(poses), np.uint32)
    directions_of(bearings, n_directions, offset)
    for i in range(poses.shape[0]):
        row, levels = cell_of(index, frame, poses[i, 0], poses[i, 1])[0], out[i]
        if row < 0:
            levels[:] = 0
            continue
        headed[i] = heading_of(poses[i, 2], n_directions)
        if read_levels(table[np.uint64(row)], headed[i], offset, levels) < 0:
            lacking[n_lacking] = i
            n_lacking += 1
    # Apart from the look-ups, which are the rule.
    for i in lacking[:n_lacking]:
        place = cell_of(index, frame, poses[i, 0], poses[i, 1])
        cast_missing(table, squares, headings, place, headed[i], offset, reach)
        read_levels(table[place[0]], headed[i], offset, out[i])


class RangeTable:
    """The ranges of one map, filled in as they are used.

    Args:
        grid: The map.
        z_max: Longest range [m].
        directions: Of the circle.

    Raises:
        ConfigError: If a number is out of its range.
    """

    def __init__(self, grid: OccupancyGrid, z_max: float, directions: int = 180) -> None:
        checks.number("range table z_max", z_max, 0.0, 1e4, above_low=True)
        checks.integer("range table directions", directions, 4, 3600)
        self.grid = grid
        self.z_max = z_max
        self.squares = grid.squares
        angles = 2.0 * np.pi * np.arange(directions) / directions
        self.headings = np.column_stack([np.cos(angles), np.sin(angles)])
        free = ~grid.blocked
        self.index = np.full(grid.shape, -1, dtype=np.int32)
        self.index[free] = np.arange(int(free.sum()), dtype=np.int32)
        # Pages of zeros are not taken from the machine before they are written.
        self.table = np.zeros((int(free.sum()), directions), dtype=np.uint8)
        self.frame = np.array([*grid.origin, 1.0 / grid.resolution])
        self.reach = z_max / grid.resolution
        self._margin = int(self.reach) + 2
        laid = grid.shape[0] * (grid.shape[1] + 2.0 * self._margin)
        self._costs = LAID * directions * 1.3 * self.reach * laid
        self._is_full = False

    def __reduce__(self) -> tuple[Any, ...]:
        """What it has cast stays behind: whoever reads it back takes the map's shared table."""
        return range_table, (self.grid, self.z_max, len(self.headings))

    def expect(self, n: int) -> None:
        """Fill the whole table if that is cheaper than n rays, which are about to be asked for."""
        if not self._is_full and n * RAY > self._costs:
            free = np.pad(np.where(self.grid.blocked, 0, 255).astype(np.uint8), self._margin)
            fill_all(free, self._margin, self.index, self.headings, self.reach, self.table)
            self._is_full = True

    @property
    def filled(self) -> float:
        """Share of the table that has been cast."""
        return float(np.count_nonzero(self.table) / self.table.size)

    def levels(
        self, poses: NDArray[np.float64], bearings: NDArray[np.float64]
    ) -> NDArray[np.int32]:
        """Level of each beam ``(N, B)`` from poses ``(N, 3)``; off the free cells it is 0."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        bearings = np.ascontiguousarray(bearings, dtype=np.float64)
        self.expect(len(poses) * len(bearings))
        out = np.empty((len(poses), len(bearings)), dtype=np.int32)
        look_up_beams(
            self.table, self.index, self.squares, self.headings, poses, bearings, self.frame,
            self.reach, out,
        )  # fmt: skip
        return out


@lru_cache(maxsize=8)
def range_table(grid: OccupancyGrid, z_max: float, directions: int = 180) -> RangeTable:
    """The table of a map, shared, and kept for the 8 used last."""
    return RangeTable(grid, z_max, directions)
