"""Many beams of one direction at once: the path of one, and the map laid under all of them.

Beams of one direction that start at the same place within a cell cross the same cells at the same
ranges, wherever they start. So the path of one is traced, and the map is laid under all of them
together, crossed cell by crossed cell: the least range at which it is blocked counts. That is one
pass over contiguous bytes per crossed cell instead of a ray per start, and agrees with
:func:`activeloc.raycast.cast_ray` to the bit, corners included.

Source: the traversal is Amanatides & Woo, "A fast voxel traversal algorithm for ray tracing", 1987.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.raycast import EPS, _first_cell


@njit(cache=True, nogil=True)
def trace(
    x: float, y: float, dx: float, dy: float, reach: float, cells: NDArray[np.int32],
    ranges: NDArray[np.float64],
) -> int:  # fmt: skip
    """Cells that a beam touches and its range there, nearest first; returns how many.

    Args:
        x: Start in the cell (0, 0), as the columns go.
        y: Start, as the rows go.
        dx: Unit heading.
        dy: Unit heading.
        reach: Range at which it ends [cell].
        cells: ``(N, 2)`` of row and column, overwritten; N at least ``3 (2 reach + 4)``.
        ranges: ``(N,)``, overwritten.
    """
    n = 0
    if abs(dx) < 1e-14 or abs(dy) < 1e-14:
        by_row = abs(dx) < 1e-14
        across, start = (x, y) if by_row else (y, x)
        step = 1 if (dy if by_row else dx) > 0.0 else -1
        line = int(np.floor(across + 0.5))
        on_line = abs(across - line) <= EPS
        last = line if on_line else int(np.floor(across))
        first = line - 1 if on_line else last
        along = _first_cell(start, step)
        while True:
            z = max(0.0, (along - start) if step > 0 else (start - along - 1))
            if z >= reach:
                return n
            for lane in range(first, last + 1):
                cells[n, 0], cells[n, 1] = (along, lane) if by_row else (lane, along)
                ranges[n] = z
                n += 1
            along += step
    col, row = _first_cell(x, dx), _first_cell(y, dy)
    cells[0, 0], cells[0, 1], ranges[0] = row, col, 0.0
    n = 1
    col_step, row_step = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    per_col, per_row = 1.0 / dx, 1.0 / dy
    while True:
        next_col = (col + (dx > 0.0) - x) * per_col
        next_row = (row + (dy > 0.0) - y) * per_row
        z = min(next_col, next_row)
        if z >= reach:
            return n
        by_col, by_row = next_col < next_row + EPS, next_row < next_col + EPS
        if by_col and by_row:  # A corner: the two cells beside it are touched as well.
            cells[n, 0], cells[n, 1] = row, col + col_step
            cells[n + 1, 0], cells[n + 1, 1] = row + row_step, col
            ranges[n] = ranges[n + 1] = z
            n += 2
        col += col_step if by_col else 0
        row += row_step if by_row else 0
        cells[n, 0], cells[n, 1], ranges[n] = row, col, z
        n += 1


@njit(cache=True, nogil=True)
def lay(
    free: NDArray[np.uint8],
    crossed: NDArray[np.int64],
    classes: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> None:
    """Lower ``out`` to the least class of a crossed cell that is blocked.

    Args:
        free: ``(M,)``; all bits set where the map is free, none where it is blocked.
        crossed: ``(N,)``; where in ``free`` the cells lie that are crossed from the first place.
        classes: ``(N,)``; of each crossed cell.
        out: ``(places,)``.
    """
    n = crossed.shape[0]
    for i in range(0, n - n % 8, 8):
        a, b, c, d = (
            free[crossed[i] :], free[crossed[i + 1] :], free[crossed[i + 2] :],
            free[crossed[i + 3] :],
        )  # fmt: skip
        e, f, g, h = (
            free[crossed[i + 4] :], free[crossed[i + 5] :], free[crossed[i + 6] :],
            free[crossed[i + 7] :],
        )  # fmt: skip
        ca, cb, cc, cd = classes[i], classes[i + 1], classes[i + 2], classes[i + 3]
        ce, cf, cg, ch = classes[i + 4], classes[i + 5], classes[i + 6], classes[i + 7]
        for p in range(out.shape[0]):
            ab, cd_ = min(a[p] | ca, b[p] | cb), min(c[p] | cc, d[p] | cd)
            ef, gh = min(e[p] | ce, f[p] | cf), min(g[p] | cg, h[p] | ch)
            out[p] = min(out[p], min(min(ab, cd_), min(ef, gh)))
    for i in range(n - n % 8, n):
        a, ca = free[crossed[i] :], classes[i]
        for p in range(out.shape[0]):
            out[p] = min(out[p], a[p] | ca)
