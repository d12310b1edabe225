"""The map: an occupancy grid, its frame, its free space.

``cells[row, col]`` covers the square from ``origin + (col, row) * resolution`` to
``origin + (col + 1, row + 1) * resolution``: columns grow with x, rows with y. The one place that
converts between metres and cells is :meth:`OccupancyGrid.to_cells` with its inverse.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from activeloc.errors import MapError
from activeloc.free_squares import free_squares

MAX_CELLS = 25_000_000


class Cell(IntEnum):
    """What a cell of the map is known to be."""

    FREE = 0
    OCCUPIED = 1
    UNKNOWN = 2


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A map of square cells, each free, occupied or unknown.

    Unknown cells stop beams and robots as occupied ones do; so does the outside of the map.

    Attributes:
        cells: ``(H, W)`` of :class:`Cell` values; kept as a read-only copy of ``uint8``.
        resolution: Side of a cell [m].
        origin: x and y of the lower left corner of ``cells[0, 0]`` [m].
        name: What to call the map in tables and file names.

    Raises:
        MapError: If the cells are not a two-dimensional array of 0, 1 and 2, the resolution is
            not positive, the origin is not two finite numbers, or no cell is free.
    """

    cells: NDArray[np.uint8]
    resolution: float = 0.05
    origin: tuple[float, float] = (0.0, 0.0)
    name: str = field(default="map")

    def __post_init__(self) -> None:
        cells = np.asarray(self.cells)
        if cells.ndim != 2 or cells.size == 0:
            raise MapError(f"{self.name}: cells must be (H, W), not empty; got shape {cells.shape}")
        if cells.size > MAX_CELLS:
            raise MapError(f"{self.name}: {cells.size} cells; at most {MAX_CELLS} are allowed")
        if cells.dtype.kind not in "bui" or not np.isin(cells, list(Cell)).all():
            raise MapError(
                f"{self.name}: cells must be 0 (free), 1 (occupied) or 2 (unknown), "
                f"got {cells.dtype} with values {np.unique(cells)[:5]}"
            )
        if not (np.isfinite(self.resolution) and 0.0 < self.resolution <= 1e3):
            raise MapError(f"{self.name}: resolution must be in (0, 1000] m, got {self.resolution}")
        origin = np.asarray(self.origin, dtype=np.float64)
        if origin.shape != (2,) or not np.isfinite(origin).all():
            raise MapError(f"{self.name}: origin must be two finite numbers, got {self.origin}")
        if not (cells == Cell.FREE).any():
            raise MapError(f"{self.name}: no free cell among {cells.size}")
        frozen = np.array(cells, dtype=np.uint8, order="C")
        frozen.flags.writeable = False
        object.__setattr__(self, "cells", frozen)
        object.__setattr__(self, "resolution", float(self.resolution))
        object.__setattr__(self, "origin", (float(origin[0]), float(origin[1])))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns ``(H, W)``."""
        height, width = self.cells.shape
        return height, width

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Smallest x, largest x, smallest y, largest y [m]."""
        (x, y), (height, width) = self.origin, self.shape
        return x, x + width * self.resolution, y, y + height * self.resolution

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """``(H, W)``; true where the cell is known to be free."""
        result: NDArray[np.bool_] = self.cells == Cell.FREE
        return result

    @cached_property
    def blocked(self) -> NDArray[np.bool_]:
        """``(H, W)``; true where a beam stops: occupied and unknown cells."""
        return ~self.free

    @cached_property
    def squares(self) -> NDArray[np.uint8]:
        """``(4, H + 2, W + 2)``; how far a beam may leap (:mod:`activeloc.free_squares`) [cell].

        Four bytes a cell of the map.
        """
        return free_squares(self.blocked)

    @cached_property
    def clearance(self) -> NDArray[np.float64]:
        """``(H, W)``; distance from each cell's centre to the nearest blocked square [m].

        Zero in blocked cells. The outside of the map is blocked. Exact: the point of a square
        that is nearest to a cell's centre is a corner, a side's midpoint or a centre.
        """
        height, width = self.shape
        touched = np.ones((2 * height + 1, 2 * width + 1), dtype=np.bool_)
        touched[1:-1, 1:-1] = False
        for row, col in np.ndindex(3, 3):
            touched[row : row + 2 * height - 1 : 2, col : col + 2 * width - 1 : 2] |= self.blocked
        nearest = ndimage.distance_transform_edt(
            ~touched, return_distances=False, return_indices=True
        )[:, 1::2, 1::2]
        apart = (nearest - 2 * np.indices(self.shape, dtype=nearest.dtype) - 1).astype(np.float64)
        half_cells = np.sqrt((apart * apart).sum(axis=0))
        result: NDArray[np.float64] = half_cells * (0.5 * self.resolution)
        return result

    @cached_property
    def frame(self) -> NDArray[np.float64]:
        """``(3,)``; x and y of the lower left corner and the resolution [m], for kernels."""
        return np.array([*self.origin, self.resolution])

    def renamed(self, name: str) -> OccupancyGrid:
        """The same map under another name, with all that has been computed of it."""
        twin = copy(self)
        object.__setattr__(twin, "name", name)
        return twin

    def count(self) -> dict[str, int]:
        """How many cells are free, occupied and unknown."""
        return {cell.name.lower(): int((self.cells == cell).sum()) for cell in Cell}

    def passable(self, radius: float) -> NDArray[np.bool_]:
        """Where a disc may have its centre: ``(H, W)``, the largest connected part.

        Cells count as connected through their sides, never through a corner: no robot and no beam
        passes between two cells that touch in a point.

        Args:
            radius: Of the disc [m]; 0 for a point.

        Raises:
            MapError: If the disc fits nowhere.
        """
        roomy = self.free & (self.clearance >= radius) if radius > 0.0 else self.free
        labels, n_parts = ndimage.label(roomy)
        if n_parts == 0:
            raise MapError(f"{self.name}: a robot of radius {radius:g} m fits nowhere on this map")
        sizes = np.bincount(labels.ravel())
        sizes[0] = 0
        result: NDArray[np.bool_] = labels == sizes.argmax()
        return result

    def to_cells(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Metres to continuous cell coordinates: ``(..., 2)`` of column, row."""
        result: NDArray[np.float64] = (np.asarray(xy) - self.origin) / self.resolution
        return result

    def to_metres(self, column_row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Continuous cell coordinates ``(..., 2)`` of column, row to metres."""
        result: NDArray[np.float64] = np.asarray(column_row) * self.resolution + self.origin
        return result

    @cached_property
    def digest(self) -> str:
        """SHA-256 of cells, resolution and origin: equal maps have equal digests."""
        head = repr((self.shape, self.resolution, self.origin)).encode()
        return sha256(head + self.cells.tobytes()).hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OccupancyGrid) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)
