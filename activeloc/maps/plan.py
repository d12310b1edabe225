"""A floor plan on a lattice: solid rock, out of which rooms and doors are carved.

A :class:`Box` counts cells, not metres, so that walls and doors have the same thickness wherever
they stand. A generator turns its parameters into cells once, and draws with whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeloc.grid import Cell, OccupancyGrid


class Box(NamedTuple):
    """Columns ``[left, right)`` and rows ``[bottom, top)``."""

    left: int
    bottom: int
    right: int
    top: int

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Number of rows."""
        return self.top - self.bottom

    def grown(self, margin: int, within: Box | None = None) -> Box:
        """This box with a margin around it; cut to another box, if one is given."""
        left, bottom, right, top = self
        box = Box(left - margin, bottom - margin, right + margin, top + margin)
        if within is None:
            return box
        return Box(
            max(box.left, within.left),
            max(box.bottom, within.bottom),
            min(box.right, within.right),
            min(box.top, within.top),
        )


@dataclass(frozen=True, slots=True)
class Lattice:
    """Metres to whole cells."""

    resolution: float

    def near(self, metres: float) -> int:
        """The nearest number of cells, at least one."""
        return max(1, round(metres / self.resolution))

    def up(self, metres: float) -> int:
        """The fewest cells that are as long, at least one."""
        return max(1, ceil(metres / self.resolution - 1e-9))


class FloorPlan:
    """Cells of a building while it is drawn; ``cells`` is ``(H, W)`` of :class:`Cell` values."""

    def __init__(self, width: int, height: int) -> None:
        self.cells: NDArray[np.uint8] = np.full((height, width), Cell.OCCUPIED, dtype=np.uint8)

    def carve(self, box: Box) -> None:
        """Make a box free."""
        self.cells[box.bottom : box.top, box.left : box.right] = Cell.FREE

    def fill(self, box: Box) -> None:
        """Make a box solid: a wall, a piece of furniture."""
        self.cells[box.bottom : box.top, box.left : box.right] = Cell.OCCUPIED

    def is_free(self, box: Box) -> bool:
        """Whether a box is free throughout."""
        return bool((self.cells[box.bottom : box.top, box.left : box.right] == Cell.FREE).all())

    def to_grid(self, resolution: float, name: str) -> OccupancyGrid:
        """The finished map."""
        return OccupancyGrid(self.cells, resolution, name=name)
