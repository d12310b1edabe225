"""How far a beam may leap: the largest free square ahead of every cell.

A beam whose directions along the columns and the rows have given signs sees only what lies in one
quadrant of its cell. Whatever it does inside a free square there is no obstacle, so it may be
followed from the square's one corner to where it leaves it in one step.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

LONGEST = 255
"""Longest side of a square; it is kept in a byte."""


@njit(cache=True, nogil=True)
def _fill(blocked: NDArray[np.bool_], row_step: int, col_step: int, out: NDArray[np.uint8]) -> None:
    """Fill one quadrant's ``out (H + 2, W + 2)``, zeros, from the far corner to the near one."""
    height, width = blocked.shape
    for i in range(height):
        row = height - i if row_step > 0 else i + 1
        for j in range(width):
            col = width - j if col_step > 0 else j + 1
            if not blocked[row - 1, col - 1]:
                beside, ahead = out[row, col + col_step], out[row + row_step, col]
                least = min(min(beside, ahead), out[row + row_step, col + col_step])
                out[row, col] = min(least + 1, LONGEST)


def free_squares(blocked: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Side of the largest free square that has a cell in its corner and lies ahead of it [cell].

    The sides follow from the cells ahead by dynamic programming: a cell's square is one larger
    than the least of its three neighbours'.

    Args:
        blocked: ``(H, W)``.

    Returns:
        ``(4, H + 2, W + 2)``; 0 in blocked cells and around the map, at most ``LONGEST``. Cell
        ``(row, col)`` is at ``[:, row + 1, col + 1]``. Quadrants are columns and rows growing,
        columns falling, rows falling, both falling.
    """
    blocked = np.ascontiguousarray(blocked, dtype=np.bool_)
    squares = np.zeros((4, blocked.shape[0] + 2, blocked.shape[1] + 2), dtype=np.uint8)
    for quadrant in range(4):
        _fill(blocked, -1 if quadrant & 2 else 1, -1 if quadrant & 1 else 1, squares[quadrant])
    return squares
