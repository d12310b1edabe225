"""The grid of poses on which a histogram filter keeps its belief.

A state is a (cell, heading bin) pair: square cells of ``cell_size`` metres that hold some open
ground, and ``headings`` equal bins from -pi. Every cell is probed at a fixed lattice of sub-poses;
averages over a cell are averages over those of its sub-poses where the robot can be, so a cell that
a wall cuts in two is neither lost nor counted whole, and identical rooms get identical averages.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from activeloc.errors import ConfigError
from activeloc.motion import Terrain

SUB = 4  # Sub-poses along each side of a cell.
MAX_STATES = 50_000_000


def sub_lattice() -> NDArray[np.float64]:
    """``(SUB * SUB, 2)`` of sub-pose offsets from a cell's lower left corner [cell]."""
    side = (np.arange(SUB) + 0.5) / SUB
    return np.stack(np.meshgrid(side, side, indexing="xy"), axis=-1).reshape(-1, 2)


def bin_centres(headings: int) -> NDArray[np.float64]:
    """``(K,)``; centres of the heading bins, from just above -pi [rad]."""
    middles: NDArray[np.float64] = np.arange(headings, dtype=np.float64) + 0.5
    return middles * (2.0 * np.pi / headings) - np.pi


@dataclass(frozen=True, eq=False)
class PoseGrid:
    """Cells and heading bins over a terrain.

    Args:
        terrain: Where the robot can be.
        cell_size: Side of a cell [m].
        headings: Number of heading bins, K.

    Raises:
        ConfigError: If the grid would have more than 50 million states.
    """

    terrain: Terrain
    cell_size: float
    headings: int

    def __post_init__(self) -> None:
        rows, cols = self.shape
        if rows * cols * self.headings > MAX_STATES:
            raise ConfigError(
                f"belief.cell_size {self.cell_size:g} m with {self.headings} headings gives "
                f"{rows * cols * self.headings} states on {self.terrain.grid.name}; "
                f"at most {MAX_STATES} are allowed"
            )

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells that cover the map."""
        x0, x1, y0, y1 = self.terrain.grid.extent
        return (
            max(1, int(np.ceil((y1 - y0) / self.cell_size - 1e-9))),
            max(1, int(np.ceil((x1 - x0) / self.cell_size - 1e-9))),
        )

    @cached_property
    def lattice(self) -> NDArray[np.float64]:
        """See :func:`sub_lattice`."""
        return sub_lattice()

    @cached_property
    def _probes(self) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """Row and column of every cell with open ground, and which of its sub-poses are open."""
        rows, cols = self.shape
        corner = np.stack(np.meshgrid(np.arange(cols), np.arange(rows), indexing="xy"), axis=-1)
        column_row = corner[:, :, None, :] + self.lattice
        xy = column_row * self.cell_size + self.terrain.grid.origin
        is_open = self.terrain.contains(xy)
        kept = is_open.any(axis=-1)
        return np.argwhere(kept).astype(np.int32), is_open[kept]

    @property
    def cells(self) -> NDArray[np.int32]:
        """``(C, 2)`` of row and column of each cell of the belief."""
        return self._probes[0]

    @property
    def is_open(self) -> NDArray[np.bool_]:
        """``(C, SUB * SUB)``; which sub-poses of each cell the robot can be at."""
        return self._probes[1]

    @cached_property
    def area(self) -> NDArray[np.float64]:
        """``(C,)``; open share of each cell, in (0, 1]."""
        result: NDArray[np.float64] = self.is_open.mean(axis=-1, dtype=np.float64)
        return result

    @cached_property
    def index(self) -> NDArray[np.int32]:
        """``(rows, cols)``; the belief's cell at each place, -1 where it has none."""
        result = np.full(self.shape, -1, dtype=np.int32)
        result[self.cells[:, 0], self.cells[:, 1]] = np.arange(len(self.cells), dtype=np.int32)
        return result

    @cached_property
    def _nearest(self) -> NDArray[np.int32]:
        """``(rows, cols)``; the belief's cell at each place or nearest to it."""
        where = ndimage.distance_transform_edt(
            self.index < 0, return_distances=False, return_indices=True
        )
        result: NDArray[np.int32] = self.index[where[0], where[1]]
        return result

    @cached_property
    def centres(self) -> NDArray[np.float64]:
        """``(C, 2)``; x and y of the mean open sub-pose of each cell [m]."""
        weight = self.is_open / self.is_open.sum(axis=-1, keepdims=True)
        offset = weight @ self.lattice
        result: NDArray[np.float64] = (self.cells[:, ::-1] + offset) * self.cell_size
        return result + self.terrain.grid.origin

    @cached_property
    def bin_width(self) -> float:
        """Width of a heading bin [rad]."""
        return 2.0 * np.pi / self.headings

    @cached_property
    def thetas(self) -> NDArray[np.float64]:
        """See :func:`bin_centres`."""
        return bin_centres(self.headings)

    def sub_poses(self) -> NDArray[np.float64]:
        """``(C, SUB * SUB, 2)``; x and y of every sub-pose [m], open or not."""
        corner: NDArray[np.float64] = self.cells[:, None, ::-1].astype(np.float64) + self.lattice
        result: NDArray[np.float64] = corner * self.cell_size + self.terrain.grid.origin
        return result

    def states_of(self, poses: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Cell and heading bin of poses ``(N, 3)``; off the belief's cells, the nearest one."""
        poses = np.asarray(poses, dtype=np.float64)
        scaled = (poses[:, :2] - self.terrain.grid.origin) / self.cell_size
        col, row = np.floor(np.where(np.isfinite(scaled), scaled, -1.0)).astype(np.int64).T
        row, col = np.clip(row, 0, self.shape[0] - 1), np.clip(col, 0, self.shape[1] - 1)
        heading = np.floor((poses[:, 2] + np.pi) / self.bin_width).astype(np.int64) % self.headings
        return self._nearest[row, col], heading.astype(np.int32)

    def sample_in(
        self,
        cell: NDArray[np.int32],
        heading: NDArray[np.int32],
        uniforms: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Poses uniform over the open ground of given states.

        Args:
            cell: ``(N,)``.
            heading: ``(N,)``.
            uniforms: ``(N, 4)`` in [0, 1): sub-pose, place around it (two), heading in its bin.

        Returns:
            ``(N, 3)``. A place that falls out of the open ground is moved to its sub-pose.
        """
        n_open = self._open_first[1][cell]
        rank = (uniforms[:, 0] * n_open).astype(np.intp)
        sub = self._open_first[0][cell, rank]
        middle = (self.cells[cell, ::-1] + self.lattice[sub]) * self.cell_size
        jitter = (uniforms[:, 1:3] - 0.5) * (self.cell_size / SUB)
        xy = middle + jitter + self.terrain.grid.origin
        fallen = ~self.terrain.contains(xy)
        xy[fallen] = middle[fallen] + self.terrain.grid.origin
        theta = self.thetas[heading] + (uniforms[:, 3] - 0.5) * self.bin_width
        return np.column_stack([xy, theta])

    @cached_property
    def _open_first(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Sub-poses of each cell with the open ones first, and how many those are."""
        return np.argsort(~self.is_open, axis=-1, kind="stable"), self.is_open.sum(axis=-1)
