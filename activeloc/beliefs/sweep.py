"""Ranges from every sub-pose of a pose grid at once, in classes of a byte.

Beams of one direction that start at the same place within a map cell are traced together, as
:mod:`activeloc.tracing` does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.raycast import EPS, cast_ray
from activeloc.tracing import lay, trace


@njit(cache=True, nogil=True)
def _sweep(
    free: NDArray[np.uint8],
    plane: int,
    shape: tuple[int, int],
    side: int,
    margin: int,
    lattice: NDArray[np.float64],
    angles: NDArray[np.float64],
    limits: NDArray[np.float64],
    out: NDArray[np.uint8],
) -> None:
    """Classes of the nearest range in any of several directions.

    Args:
        free: ``(side * side * plane,)``; see :func:`activeloc.tracing.lay`, padded, in one plane
            for each map cell within a cell of the belief.
        plane: Places of a plane.
        shape: Rows and columns of the belief's cells.
        side: Map cells along a cell.
        margin: Cells by which ``free`` is padded on each side; a row's right margin is the next
            one's left.
        lattice: ``(S, 2)`` of column and row of the sub-poses [map cell].
        angles: ``(R,)`` [rad].
        limits: ``(Q,)``; where each class but the first begins [map cell]; the longest range last.
        out: ``(S, >= rows * cols)``, overwritten.
    """
    reach, farthest = limits[limits.shape[0] - 1], limits.shape[0]
    cols = shape[1] + margin
    longest, per_row = 6 * (int(reach) + 4), shape[1]
    cells, ranges = np.empty((longest, 2), dtype=np.int32), np.empty(longest)
    crossed, classes = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=out.dtype)
    laid = np.empty((shape[0] - 1) * cols + per_row, dtype=out.dtype)
    for r in range(angles.shape[0]):
        dx, dy, n, x_in, y_in = np.cos(angles[r]), np.sin(angles[r]), 0, -1.0, -1.0
        for s in range(lattice.shape[0]):
            # The middle of a map cell stays it, whatever the lattice's fractions round to.
            col, row = int(np.floor(lattice[s, 0] + EPS)), int(np.floor(lattice[s, 1] + EPS))
            if lattice[s, 0] - col != x_in or lattice[s, 1] - row != y_in:
                x_in, y_in = lattice[s, 0] - col, lattice[s, 1] - row
                n = trace(x_in, y_in, dx, dy, reach, cells, ranges)
                for i in range(n):
                    classes[i] = np.searchsorted(limits, ranges[i], "right")
            for i in range(n):
                y, x = cells[i, 0] + row, cells[i, 1] + col
                at = (margin + y // side) * cols + margin + x // side
                crossed[i] = (y % side * side + x % side) * plane + at
            laid[:] = farthest
            lay(free, crossed[:n], classes[:n], laid)
            for y in range(shape[0]):
                of, to = laid[y * cols :], out[s, y * per_row : (y + 1) * per_row]
                if r == 0:
                    for x in range(per_row):
                        to[x] = of[x]
                else:
                    for x in range(per_row):
                        to[x] = min(to[x], of[x])


@njit(cache=True, nogil=True)
def _cast(
    squares: NDArray[np.uint8],
    places: NDArray[np.float64],
    at: NDArray[np.int32],
    angles: NDArray[np.float64],
    limits: NDArray[np.float64],
    out: NDArray[np.uint8],
) -> None:
    """The same ray by ray, where the cells of map and belief do not fit.

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`cast_ray`.
        places: ``(C, S, 2)`` of column and row of the sub-poses [map cell].
        at: ``(C,)``; place of each cell.
        angles: ``(R,)`` [rad].
        limits: ``(Q,)`` [map cell].
        out: ``(S, >= places)``, overwritten at the cells.
    """
    for c in range(places.shape[0]):
        for s in range(places.shape[1]):
            z = limits[limits.shape[0] - 1]
            for r in range(angles.shape[0]):
                x, y = places[c, s]
                z = cast_ray(squares, x, y, np.cos(angles[r]), np.sin(angles[r]), z)
            out[s, at[c]] = np.searchsorted(limits, z, "right")


class Sweep:
    """Classes of the ranges from all sub-poses along any direction.

    Args:
        grid: Whose sub-poses; where the robot can be does not matter here.
        world: What stops a beam: the map, or where the robot's centre can be.
        limits: ``(Q,)``; the range at which each class but the first begins, ascending; the last
            is the longest range [map cell]. At most 65535.

    Attributes:
        dtype: Of the classes, 0 ... Q.
    """

    def __init__(
        self, grid: PoseGrid, world: OccupancyGrid | Terrain, limits: NDArray[np.float64]
    ) -> None:
        self.grid, self.world, self.limits = grid, world, limits
        self.dtype: np.dtype[Any] = np.dtype(np.uint8 if len(limits) < 256 else np.uint16)
        cells_per = grid.cell_size / grid.terrain.grid.resolution
        self.side = round(cells_per)
        self.fits = self.side >= 1 and abs(cells_per - self.side) < 1e-9
        if self.fits:
            self._lay_out()

    def _lay_out(self) -> None:
        (rows, cols), side = self.grid.shape, self.side
        self._margin = margin = int(np.ceil(self.limits[-1] / side)) + 2
        shape = rows + 2 * margin + 1, cols + margin
        padded = np.ones((shape[0] * side, shape[1] * side), dtype=np.bool_)
        height, width = self.world.blocked.shape
        padded[margin * side :, margin * side :][:height, :width] = self.world.blocked
        planes = padded.reshape(shape[0], side, shape[1], side).transpose(1, 3, 0, 2)
        self._free = (
            np.where(planes, 0, 2 ** (8 * self.dtype.itemsize) - 1).astype(self.dtype).ravel()
        )
        self._plane = shape[0] * shape[1]

    def along(self, angles: NDArray[np.float64], out: NDArray[Any]) -> None:
        """Classes of the nearest range in any of several directions ``(R,)`` [rad].

        Args:
            angles: Where to look.
            out: ``(SUB * SUB, P)``, overwritten; of the pose grid's rectangle, row by row. What is
                no cell of the grid is undefined.
        """
        grid = self.grid
        if self.fits:
            _sweep(
                self._free, self._plane, grid.shape, self.side, self._margin,
                grid.lattice * self.side, angles, self.limits, out,
            )  # fmt: skip
            return
        at = grid.cells[:, 0] * grid.shape[1] + grid.cells[:, 1]
        places = grid.terrain.grid.to_cells(grid.sub_poses())
        _cast(self.world.squares, places, at, angles, self.limits, out)
