"""A belief seen at low resolution: summed on a grid of fixed shape, whatever the map.

The view covers the smallest square around the map, centred on it, so that shapes are not distorted
and one network can look at any building.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.grid import OccupancyGrid


def view_frame(grid: OccupancyGrid, rows: int, cols: int) -> tuple[float, float, float]:
    """The x and y of the view's lower left corner, and the side of its pixels [m]."""
    x0, x1, y0, y1 = grid.extent
    pixel = max((x1 - x0) / cols, (y1 - y0) / rows)
    return 0.5 * (x0 + x1) - 0.5 * cols * pixel, 0.5 * (y0 + y1) - 0.5 * rows * pixel, pixel


def view_pixels(
    xy: NDArray[np.float64], grid: OccupancyGrid, rows: int, cols: int
) -> NDArray[np.int32]:
    """Flat pixel ``row * cols + col`` of each place ``(N, 2)`` [m]."""
    left, bottom, pixel = view_frame(grid, rows, cols)
    col = np.clip(np.floor((xy[:, 0] - left) / pixel), 0, cols - 1)
    row = np.clip(np.floor((xy[:, 1] - bottom) / pixel), 0, rows - 1)
    return np.asarray(row * cols + col, dtype=np.int32)


@lru_cache(maxsize=64)
def map_view(grid: OccupancyGrid, rows: int, cols: int) -> NDArray[np.float32]:
    """Share of free ground under each pixel of the view: ``(rows, cols)`` in [0, 1]."""
    cells: NDArray[np.float64] = np.argwhere(grid.free)[:, ::-1].astype(np.float64) + 0.5
    pixel = view_pixels(grid.to_metres(cells), grid, rows, cols)
    side = view_frame(grid, rows, cols)[2]
    free = np.bincount(pixel, minlength=rows * cols) * grid.resolution**2 / side**2
    result = np.minimum(free, 1.0).reshape(rows, cols).astype(np.float32)
    result.flags.writeable = False
    return result


@njit(cache=True, nogil=True)
def show(p: NDArray[np.float64], largest: float, out: NDArray[np.float32]) -> None:
    """Fill ``out (N,)`` with sqrt(p / max p), so that a network sees what is unlikely too.

    Args:
        p: ``(N,)``, not negative.
        largest: Of them; positive.
        out: Overwritten.
    """
    by = 1.0 / largest
    for i in range(p.shape[0]):
        out[i] = np.sqrt(np.float32(p[i] * by))
