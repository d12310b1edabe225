"""Maps and poses that are measured on."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps import MapSource, load_map

BASEMENT = "basement_hallways.png"
SIDE = 1200
"""Cells along a side of the basement and of what stands in for it; cells of 0.05 m."""
Z_MAX = 25.0
"""Longest range on it [m]."""
SPREAD = np.array([0.3, 0.3, 0.1])
"""Standard deviation of a localized cloud [m], [m], [rad]."""


@lru_cache(maxsize=4)
def large_map(folder: Path | None) -> OccupancyGrid:
    """A map of 1200 x 1200 cells: the basement, if the folder has it, or a generated building."""
    if folder is not None and (folder / BASEMENT).is_file():
        return load_map(folder / BASEMENT)
    cells = np.full((SIDE, SIDE), Cell.UNKNOWN, dtype=np.uint8)
    wing = MapSource.parse("office(rooms=12,corridors=4,corridor=2.4):0").number(0)
    height, width = (min(SIDE, n) for n in wing.shape)
    row, col = (SIDE - height) // 2, (SIDE - width) // 2
    cells[row : row + height, col : col + width] = wing.cells[:height, :width]
    return OccupancyGrid(cells, wing.resolution, name="generated basement")


def open_ground(side: int, cell_size: float) -> OccupancyGrid:
    """A map of ``side`` x ``side`` cells of a pose grid, free but for the walls around it."""
    per_cell = round(cell_size / 0.05)
    cells = np.zeros((side * per_cell + 2,) * 2, dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = Cell.OCCUPIED
    return OccupancyGrid(cells, 0.05, (-0.05, -0.05), f"open {side} x {side}")


def bearings(beams: int, field_of_view: float = np.pi) -> NDArray[np.float64]:
    """``(B,)``; spread evenly [rad]."""
    return np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, beams)


def free_poses(grid: OccupancyGrid, n: int, seed: int = 0) -> NDArray[np.float64]:
    """``(n, 3)``; anywhere in free cells, any heading."""
    rng = np.random.default_rng(seed)
    places = np.argwhere(grid.free)[:, ::-1]
    xy = grid.to_metres(places[rng.integers(len(places), size=n)] + rng.random((n, 2)))
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, n)])


def local_poses(grid: OccupancyGrid, n: int, seed: int = 0) -> NDArray[np.float64]:
    """``(n, 3)``; a localized cloud in free cells, around a place with room for it."""
    rng = np.random.default_rng(seed)
    roomy = np.argwhere(grid.clearance > min(0.6, 0.9 * grid.clearance.max()))[:, ::-1]
    centre = grid.to_metres(roomy[rng.integers(len(roomy))] + 0.5)
    poses = np.array([*centre, 0.3]) + rng.normal(size=(4 * n, 3)) * SPREAD
    col, row = np.floor(grid.to_cells(poses[:, :2])).astype(int).T
    inside = (col >= 0) & (row >= 0) & (col < grid.shape[1]) & (row < grid.shape[0])
    inside[inside] = grid.free[row[inside], col[inside]]
    kept: NDArray[np.float64] = poses[inside][:n]
    return kept
