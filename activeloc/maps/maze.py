"""Perfect mazes: one path between any two cells, as in Active Neural Localization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps.parameters import MAX_TRIES, check_area, demand, give_up

P_LINK_SIDEWAYS = 2 / 3
P_WALL_BELOW = 2 / 3


@dataclass(frozen=True, slots=True)
class Maze:
    """A spanning tree of rooms on a square lattice, drawn row by row from the top.

    Eller's way, with the odds of Chaplot, Parisotto & Salakhutdinov, "Active Neural Localization"
    (ICLR 2018): wherever the tree leaves a choice, two rooms side by side are linked with odds 2:1
    and two rooms one above the other are parted with odds 2:1. A maze that equals its own rotation
    by 90 or 180 degrees cannot be told from it, so it is drawn again. With m = ``size`` there are
    ((m - 1) / 2)**2 rooms and one link fewer: 17, 97 and 199 free cells for m = 7, 15 and 21.

    Attributes:
        size: Cells along a side, walls included; odd.
        resolution: Side of a cell, which is a room, a link or a wall [m].
    """

    size: int = 15
    resolution: float = 1.0

    def __post_init__(self) -> None:
        """Refuse sizes that are no maze, or that have symmetric mazes only."""
        checks.integer("maze size", self.size, 5, 501)
        checks.number("maze resolution", self.resolution, 1e-3, 1e2)
        demand(self, self.size % 2 == 1, f"size must be odd, got {self.size}")
        side = self.size * self.resolution
        check_area(self, side, side, self.resolution)

    def generate(self, rng: np.random.Generator) -> OccupancyGrid:
        """Draw a maze.

        Raises:
            ConfigError: If every draw was symmetric.
        """
        for _ in range(MAX_TRIES):
            cells = _draw((self.size - 1) // 2, rng)
            turned = np.rot90(cells)
            if not np.array_equal(cells, turned) and not np.array_equal(cells, np.rot90(turned)):
                return OccupancyGrid(cells, self.resolution, name="maze")
        raise give_up(self, "maze without symmetry")


def _draw(n: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Cells ``(2 n + 1, 2 n + 1)`` of a maze of n x n rooms; the first row drawn is the top one."""
    cells = np.full((2 * n + 1, 2 * n + 1), Cell.OCCUPIED, dtype=np.uint8)
    cells[1::2, 1::2] = Cell.FREE
    part = np.arange(n)  # Label of the connected part that each room of the row belongs to.
    next_label = n
    for row in range(n):
        top_down = 2 * (n - row) - 1
        last = row == n - 1
        sideways, down = rng.random((2, n))
        below = part.copy()
        for col in range(n):
            # Rooms already passed count in `below`: their part lives on if they lead downwards.
            alone = np.count_nonzero(below == below[col]) == 1
            apart = col + 1 < n and below[col] != below[col + 1]
            if apart and ((last and alone) or sideways[col] < P_LINK_SIDEWAYS):
                cells[top_down, 2 * col + 2] = Cell.FREE
                below[below == below[col + 1]] = below[col]
                alone = False
            if last or (not alone and down[col] < P_WALL_BELOW):
                below[col] = next_label
                next_label += 1
            else:
                cells[top_down - 1, 2 * col + 1] = Cell.FREE
        part = below
    return cells
