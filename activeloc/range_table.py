"""Expected ranges looked up instead of cast: a table over cells and absolute directions.

A range from a map's cell is kept as one byte, in steps of ``z_max / 255``; it is cast from the
cell's centre when it is first asked for, so a table costs no more than the rays it answers and a
new map costs nothing. Against the exact range from where the robot stands in its cell the error is
of the order of half a cell plus half a direction: a few centimetres at a few metres. Filters that
widen their sensor, or average over a cell anyhow, do not notice; the simulator never uses it.

Source: Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 6.3.4, pre-cached ranges.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_ray

LEVELS = 255  # Level q of a range is kept as the byte q + 1; 0 has not been cast yet.


@njit(cache=True, nogil=True)
def cast_level(
    squares: NDArray[np.uint8], row: int, col: int, heading: NDArray[np.float64], reach: float
) -> int:
    """Byte of the range from a cell's centre: 1 ... LEVELS, the last if nothing is in range."""
    z = cast_ray(squares, col + 0.5, row + 0.5, heading[0], heading[1], reach)
    if z >= reach:
        return LEVELS
    return min(LEVELS - 1, 1 + int(z / reach * (LEVELS - 1)))


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
    bearings: NDArray[np.float64], n_directions: int, out: NDArray[np.float64]
) -> None:
    """Bearings as fractions of the table's circle, in [0, D)."""
    for b in range(bearings.shape[0]):
        turns = bearings[b] / (2.0 * np.pi)
        out[b] = (turns - np.floor(turns)) * n_directions


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
    n_directions = table.shape[1]
    offset = np.empty(bearings.shape[0])
    directions_of(bearings, n_directions, offset)
    for i in range(poses.shape[0]):
        cell, row, col = cell_of(index, frame, poses[i, 0], poses[i, 1])
        turns = poses[i, 2] / (2.0 * np.pi)
        ahead = (turns - np.floor(turns)) * n_directions + 0.5
        for b in range(bearings.shape[0]):
            if cell < 0:
                out[i, b] = 0
                continue
            direction = int(ahead + offset[b])
            while direction >= n_directions:
                direction -= n_directions
            level = table[cell, direction]
            if level == 0:
                level = cast_level(squares, row, col, headings[direction], reach)
                table[cell, direction] = level
            out[i, b] = level - 1


def level_ranges(z_max: float) -> NDArray[np.float64]:
    """``(LEVELS,)``; the range that each level stands for, the last ``z_max`` [m]."""
    steps = LEVELS - 1
    return np.append((np.arange(steps) + 0.5) * (z_max / steps), z_max)


def levels_of(z: NDArray[np.float64], z_max: float) -> NDArray[np.int32]:
    """Level of each range in [0, z_max] [m]: an array like ``z``."""
    level = np.minimum(z / z_max * (LEVELS - 1), LEVELS - 2).astype(np.int32)
    return np.where(z >= z_max, LEVELS - 1, level).astype(np.int32)


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
        out = np.empty((len(poses), len(bearings)), dtype=np.int32)
        look_up_beams(
            self.table,
            self.index,
            self.squares,
            self.headings,
            poses,
            bearings,
            self.frame,
            self.reach,
            out,
        )
        return out


@lru_cache(maxsize=8)
def range_table(grid: OccupancyGrid, z_max: float, directions: int = 180) -> RangeTable:
    """The table of a map, shared, and kept for the 8 used last."""
    return RangeTable(grid, z_max, directions)
