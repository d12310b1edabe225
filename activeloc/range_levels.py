"""Ranges in steps of ``z_max / 255``, from the centres of a map's cells.

Level q of a range is kept as the byte q + 1; the byte 0 has not been cast yet.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.raycast import cast_ray
from activeloc.tracing import lay, trace

LEVELS = 255
TOGETHER = 8  # Directions that are filled at once.


def level_ranges(z_max: float) -> NDArray[np.float64]:
    """``(LEVELS,)``; the range that each level stands for, the last ``z_max`` [m]."""
    steps = LEVELS - 1
    return np.append((np.arange(steps) + 0.5) * (z_max / steps), z_max)


def levels_of(z: NDArray[np.float64], z_max: float) -> NDArray[np.int32]:
    """Level of each range in [0, z_max] [m]: an array like ``z``."""
    level = np.minimum(z / z_max * (LEVELS - 1), LEVELS - 2).astype(np.int32)
    return np.where(z >= z_max, LEVELS - 1, level).astype(np.int32)


@njit(cache=True, nogil=True)
def level_byte(z: float, reach: float) -> int:
    """Byte of a range: 1 ... LEVELS, the last if nothing is in reach."""
    return LEVELS if z >= reach else min(LEVELS - 1, 1 + int(z / reach * (LEVELS - 1)))


@njit(cache=True, nogil=True)
def cast_level(
    squares: NDArray[np.uint8], row: int, col: int, heading: NDArray[np.float64], reach: float
) -> int:
    """:func:`level_byte` of the range from a cell's centre."""
    z = cast_ray(squares, col + 0.5, row + 0.5, heading[0], heading[1], reach)
    return level_byte(z, reach)


@njit(cache=True, nogil=True)
def fill_all(
    free: NDArray[np.uint8],
    margin: int,
    index: NDArray[np.int32],
    headings: NDArray[np.float64],
    reach: float,
    out: NDArray[np.uint8],
) -> None:
    """Fill the whole table, a few directions at a time: the bytes of :func:`cast_level`.

    Args:
        free: ``(H + 2 margin, W + 2 margin)``; see :func:`activeloc.tracing.lay`.
        margin: Above ``reach + 1`` [cell].
        index: ``(H, W)``.
        headings: ``(D, 2)``.
        reach: [cell].
        out: ``(C, D)``, overwritten.
    """
    (height, width), cols, longest = index.shape, free.shape[1], 6 * (int(reach) + 4)
    cells, ranges = np.empty((longest, 2), dtype=np.int32), np.empty(longest)
    crossed, levels = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=np.uint8)
    flat, laid = free.reshape(-1), np.empty((TOGETHER, (height - 1) * cols + width), dtype=np.uint8)
    for first in range(0, headings.shape[0], TOGETHER):
        n = min(TOGETHER, headings.shape[0] - first)
        for k in range(n):
            dx, dy = headings[first + k]
            touched = trace(0.5, 0.5, dx, dy, reach, cells, ranges)
            for i in range(touched):
                farthest = touched - 1 - i
                crossed[farthest] = (margin + cells[i, 0]) * cols + margin + cells[i, 1]
                levels[farthest] = level_byte(ranges[i], reach)
            laid[k] = LEVELS
            lay(flat, crossed[:touched], levels[:touched], laid[k])
        for row in range(height):
            for col in range(width):
                cell = index[row, col]
                if cell >= 0:
                    for k in range(n):
                        out[cell, first + k] = laid[k, row * cols + col]
