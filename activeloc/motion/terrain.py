"""Where a robot can be on a map."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activeloc.free_squares import free_squares
from activeloc.grid import OccupancyGrid


def wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles in ``[-pi, pi)`` [rad]."""
    result: NDArray[np.float64] = (np.asarray(angle) + np.pi) % (2.0 * np.pi) - np.pi
    # Just under -pi the remainder is rounded up to the full circle.
    return np.where(result >= np.pi, -np.pi, result)


class Terrain:
    """Where the centre of a round robot can be on a map: its configuration space.

    A cell of the map is open to the centre when the disc around the cell's centre touches no
    blocked square (:attr:`OccupancyGrid.clearance`) and the cell belongs to the largest connected
    part. Motions are rays through the open cells, so thin walls are never jumped.

    Args:
        grid: The map.
        radius: Of the robot [m].

    Raises:
        MapError: If the robot fits nowhere.
    """

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        self.grid = grid
        self.radius = radius
        self.open = grid.passable(radius)
        self.blocked = ~self.open
        self.frame = grid.frame

    @cached_property
    def open_cells(self) -> NDArray[np.intp]:
        """``(N, 2)`` of row and column of every open cell."""
        return np.argwhere(self.open)

    @cached_property
    def squares(self) -> NDArray[np.uint8]:
        """``(4, H + 2, W + 2)``; see :func:`activeloc.free_squares.free_squares`, of open cells."""
        return free_squares(self.blocked)

    @property
    def area(self) -> float:
        """Open area [m^2]."""
        return len(self.open_cells) * self.grid.resolution**2

    def contains(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each pose ``(..., 3)`` is in an open cell of the map."""
        column_row = self.grid.to_cells(np.asarray(poses)[..., :2])
        inside = np.isfinite(column_row).all(axis=-1)
        col, row = np.moveaxis(np.floor(np.where(np.isfinite(column_row), column_row, -1.0)), -1, 0)
        height, width = self.grid.shape
        inside &= (row >= 0) & (row < height) & (col >= 0) & (col < width)
        row, col = (
            np.where(inside, row, 0).astype(np.intp),
            np.where(inside, col, 0).astype(np.intp),
        )
        result: NDArray[np.bool_] = inside & self.open[row, col]
        return result

    def uniform_poses(self, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses uniform over the open area and all headings.

        Args:
            uniforms: ``(..., 4)`` in [0, 1): cell, place in the cell (two), heading.

        Returns:
            ``(..., 3)``.
        """
        uniforms = np.asarray(uniforms)
        chosen = self.open_cells[(uniforms[..., 0] * len(self.open_cells)).astype(np.intp)]
        column_row = chosen[..., ::-1] + uniforms[..., 1:3]
        theta = wrap(2.0 * np.pi * uniforms[..., 3:4])
        return np.concatenate([self.grid.to_metres(column_row), theta], axis=-1)
