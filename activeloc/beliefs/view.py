"""A belief seen at low resolution: summed on a grid of fixed shape, whatever the map.

The view covers the smallest square around the map, centred on it, so that shapes are not distorted
and one network can look at any building.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.common_bins import overlap
from activeloc.beliefs.pose_grid import PoseGrid
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
def view_shares(
    poses: PoseGrid, headings: int, rows: int, cols: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:
    """Pixels under each cell and heading bins under each of the grid's, with their shares.

    Returns:
        Pixel and share ``(C, P)``, heading bin and share ``(K, Q)``; shares sum to one per row.
    """
    left, bottom, pixel = view_frame(poses.terrain.grid, rows, cols)
    corner = poses.cells[:, ::-1].astype(np.float64) * poses.cell_size
    corner += np.array(poses.terrain.grid.origin) - (left, bottom)
    col, col_share = overlap(corner[:, 0], poses.cell_size, pixel)
    row, row_share = overlap(corner[:, 1], poses.cell_size, pixel)
    row, col = row.clip(0, rows - 1), col.clip(0, cols - 1)
    place = (row[:, :, None] * cols + col[:, None, :]).reshape(len(corner), -1)
    share = (row_share[:, :, None] * col_share[:, None, :]).reshape(len(corner), -1)
    start = poses.thetas - 0.5 * poses.bin_width + np.pi
    heading, heading_share = overlap(start, poses.bin_width, 2.0 * np.pi / headings)
    return (
        place.astype(np.int32),
        share / share.sum(axis=1, keepdims=True),
        heading % headings,
        heading_share / heading_share.sum(axis=1, keepdims=True),
    )


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
