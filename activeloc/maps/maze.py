"""Perfect mazes: one path between any two cells, as in Active Neural Localization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps.parameters import MAX_TRIES, check_area, demand, give_up

FREE, OCCUPIED = int(Cell.FREE), int(Cell.OCCUPIED)
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
        return OccupancyGrid(self.draw(rng), self.resolution, name="maze")

    def draw(self, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The cells ``(m, m)`` of a maze; :meth:`generate` with nothing around it.

        Raises:
            ConfigError: If every draw was symmetric.
        """
        return self.draw_each([rng])[0]

    def draw_each(self, rngs: Sequence[np.random.Generator]) -> NDArray[np.uint8]:
        """The cells ``(n, m, m)`` of a maze from each of n sources, together.

        Raises:
            ConfigError: If every draw from one of them was symmetric.
        """
        n = (self.size - 1) // 2
        cells = np.empty((len(rngs), self.size, self.size), dtype=np.uint8)
        uniforms = np.empty((len(rngs), n, 2, n))
        wanted = np.arange(len(rngs))
        for _ in range(MAX_TRIES):
            for i in wanted.tolist():
                rngs[i].random(out=uniforms[i])
            wanted = wanted[carve_each(wanted, uniforms, cells)]
            if not len(wanted):
                return cells
        raise give_up(self, "maze without symmetry")


@njit(cache=True, nogil=True)
def carve_each(
    which: NDArray[np.intp], uniforms: NDArray[np.float64], cells: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """:func:`carve` some mazes; whether each of them is symmetric ``(n,)``.

    Args:
        which: ``(n,)``.
        uniforms: ``(B, n, 2, n)``.
        cells: ``(B, m, m)``, overwritten.
    """
    symmetric = np.zeros(which.shape[0], np.bool_)
    for i, b in enumerate(which):
        carve(uniforms[b], cells[b])
        symmetric[i] = is_symmetric(cells[b])
    return symmetric


@njit(cache=True, nogil=True)
def carve(uniforms: NDArray[np.float64], cells: NDArray[np.uint8]) -> None:
    """Fill in a maze of n x n rooms; the first row drawn is the top one.

    Args:
        uniforms: ``(n, 2, n)`` in [0, 1): row by row, of the links sideways, then of those down.
        cells: ``(2 n + 1, 2 n + 1)``, overwritten.
    """
    n = uniforms.shape[0]
    cells[:] = OCCUPIED
    for row in range(n):
        for col in range(n):
            cells[2 * row + 1, 2 * col + 1] = FREE
    part = np.arange(n)  # Label of the connected part that each room of the row belongs to.
    below = np.empty_like(part)
    next_label = n
    for row in range(n):
        top_down = 2 * (n - row) - 1
        last = row == n - 1
        below[:] = part
        for col in range(n):
            # Rooms already passed count in `below`: their part lives on if they lead downwards.
            alone = True
            for other in range(n):
                if other != col and below[other] == below[col]:
                    alone = False
            apart = col + 1 < n and below[col] != below[col + 1]
            if apart and ((last and alone) or uniforms[row, 0, col] < P_LINK_SIDEWAYS):
                cells[top_down, 2 * col + 2] = FREE
                joined = below[col + 1]
                for other in range(n):
                    if below[other] == joined:
                        below[other] = below[col]
                alone = False
            if last or (not alone and uniforms[row, 1, col] < P_WALL_BELOW):
                below[col] = next_label
                next_label += 1
            else:
                cells[top_down - 1, 2 * col + 1] = FREE
        part[:] = below


@njit(cache=True, nogil=True)
def is_symmetric(cells: NDArray[np.uint8]) -> bool:
    """Whether a square equals its own rotation by 90 or 180 degrees."""
    last = cells.shape[0] - 1
    quarter, half = True, True
    for row in range(last + 1):
        for col in range(last + 1):
            half = half and cells[row, col] == cells[last - row, last - col]
            quarter = quarter and cells[row, col] == cells[col, last - row]
            if not (half or quarter):
                return False
    return True
