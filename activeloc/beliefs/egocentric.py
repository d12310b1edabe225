"""What the belief says of the robot's surroundings, as seen from the robot: the egocentric view.

For every state that the belief holds, the maze is turned so that the robot's heading points up (to
higher rows: the robot looks along +row, its right hand along +col) and laid over a window of
``(2 r + 1, 2 r + 1)`` cells around it. Averaged over the belief this gives

- plane 0: probability that each relative place is free;
- planes 1 to 4: how much a reading would tell there, with the robot turned by 0, 90, 180 and 270
  degrees (counter-clockwise) from its heading: of N candidates, how many different readings they
  would give, ``log(count) / log(min(N, 16))``. 0: the reading is known beforehand, or no candidate
  can stand there; 1: it parts them as far as it can. No reading tells more than log(count) nats;
  without noise count / N is the expected probability of a candidate that it leaves.

Candidates are the states that hold at least a hundredth of the largest probability: without noise,
all. Readings beyond 16 cells count as one. The shape depends neither on the maze's size nor on
where north is, so that one policy can face any maze.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.lattice import LatticeBelief

PLANES = 5
LANES = 16
FAINT = 0.01


class EgocentricView:
    """Draws the view for the robots of a batch.

    It keeps each maze in its four turns, as one row of numbers: a window is then laid over another
    by adding one stretch of memory to another.

    Args:
        belief: Of the robots.
        radius: r [cell].
    """

    def __init__(self, belief: LatticeBelief, radius: int) -> None:
        self.belief = belief
        self.radius = radius
        lattice = belief.lattice
        size = lattice.size
        # A maze's rows lie 2 m - 1 apart, the width of all places relative to one.
        length = (size - 1) * (2 * size - 1) + size
        self.free = np.zeros((lattice.n_robots, 4, length), dtype=np.float32)
        self.readings = np.zeros((lattice.n_robots, 4, length), dtype=np.uint64)

    def place(self, robots: NDArray[np.intp]) -> None:
        """Take note of the mazes that robots have been put into."""
        on = self.belief.lattice
        turn_mazes(robots, on.size, on.n_cells, on.cells, on.depth, self.free, self.readings)

    def draw(self) -> NDArray[np.float32]:
        """The views of all robots: new ``(B, 5, 2 r + 1, 2 r + 1)``, in [0, 1]."""
        belief, side = self.belief, 2 * self.radius + 1
        on = belief.lattice
        out = np.zeros((on.n_robots, PLANES, side, side), dtype=np.float32)
        draw_views(
            on.size, belief.bel, belief.live, belief.n_live, belief.largest, on.cells,
            self.free, self.readings, out,
        )  # fmt: skip
        return out


@njit(cache=True, nogil=True)
def turned(row: int, col: int, k: int, size: int) -> tuple[int, int]:
    """Row and column of a cell when heading k points up; both in ``0 ... size - 1``."""
    last = size - 1
    if k == 0:
        return col, last - row
    if k == 1:
        return row, col
    if k == 2:
        return last - col, row
    return last - row, last - col


@njit(cache=True, nogil=True)
def turn_mazes(
    robots: NDArray[np.intp],
    size: int,
    n_cells: NDArray[np.int32],
    cells: NDArray[np.int32],
    depth: NDArray[np.int32],
    free: NDArray[np.float32],
    readings: NDArray[np.uint64],
) -> None:
    """Each robot's maze in its four turns.

    Args:
        robots: Which.
        size: m.
        n_cells: ``(B,)``.
        cells: ``(B, C, 2)``.
        depth: ``(B, C, 4)``; readings less one.
        free: ``(B, 4, L)``, overwritten: 1 where the cell is free.
        readings: ``(B, 4, L)``, overwritten: four lanes of 16 bits, one for each relative heading,
            with the bit of the reading set; 0 in walls.
    """
    width = 2 * size - 1
    for b in robots:
        free[b] = 0.0
        readings[b] = 0
        for c in range(n_cells[b]):
            for k in range(4):
                word = np.uint64(0)
                for q in range(4):
                    bit = LANES * q + min(depth[b, c, (k + q) % 4], LANES - 1)
                    word |= np.uint64(1) << np.uint64(bit)
                u, v = turned(cells[b, c, 0], cells[b, c, 1], k, size)
                free[b, k, u * width + v] = 1.0
                readings[b, k, u * width + v] = word


@njit(cache=True, nogil=True)
def count_lanes(word: np.uint64) -> np.uint64:
    """Bits set in each of four lanes of 16 bits, in the lanes."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    pairs = np.uint64(0x3333333333333333)
    word = (word & pairs) + ((word >> np.uint64(2)) & pairs)
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (word + (word >> np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)


@njit(cache=True, nogil=True)
def overlay(
    p: float,
    free: NDArray[np.float32],
    readings: NDArray[np.uint64],
    p_free: NDArray[np.float32],
    seen: NDArray[np.uint64],
    is_candidate: bool,
) -> None:
    """Lay one state's surroundings over the others': all of one length ``(L,)``."""
    weight = np.float32(p)
    for i in range(free.shape[0]):
        p_free[i] += weight * free[i]
    if is_candidate:
        for i in range(free.shape[0]):
            seen[i] |= readings[i]


@njit(cache=True, nogil=True)
def draw_views(
    size: int,
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    largest: NDArray[np.float64],
    cells: NDArray[np.int32],
    free: NDArray[np.float32],
    readings: NDArray[np.uint64],
    out: NDArray[np.float32],
) -> None:
    """The views of a batch.

    Args:
        size: m.
        bel: ``(B, C, 4)``.
        live: ``(B, C)``.
        n_live: ``(B,)``.
        largest: ``(B,)``; the largest probabilities.
        cells: ``(B, C, 2)``.
        free: ``(B, 4, L)``: see :func:`turn_mazes`.
        readings: ``(B, 4, L)``.
        out: ``(B, 5, 2 r + 1, 2 r + 1)``, zeros, overwritten.
    """
    width = 2 * size - 1
    p_free = np.empty(width * width, np.float32)
    seen = np.empty(width * width, np.uint64)
    radius = out.shape[2] // 2
    reach = min(radius, size - 1)
    logs = np.log(np.maximum(np.arange(LANES + 1), 1))
    shares = np.empty(LANES + 1, np.float32)
    for b in range(out.shape[0]):
        p_free[:] = 0.0
        seen[:] = 0
        n = 0
        for i in range(n_live[b]):
            c = live[b, i]
            for k in range(4):
                p = bel[b, c, k]
                if p <= 0.0:
                    continue
                u, v = turned(cells[b, c, 0], cells[b, c, 1], k, size)
                # The rows of the maze that lie in the window.
                first, last = max(0, u - reach), min(size - 1, u + reach)
                top, end = first * width, last * width + size
                start = (size - 1 - u) * width + size - 1 - v
                known = p >= FAINT * largest[b]
                n += known
                overlay(
                    p, free[b, k, top:end], readings[b, k, top:end],
                    p_free[start + top : start + end], seen[start + top : start + end], known,
                )  # fmt: skip
        most = 1.0 / np.log(max(min(n, LANES), 2))
        for i in range(LANES + 1):
            shares[i] = min(logs[i] * most, 1.0)
        for du in range(-reach, reach + 1):
            for dv in range(-reach, reach + 1):
                at = np.uint64((size - 1 + du) * width + size - 1 + dv)
                row, col = np.uint64(radius + du), np.uint64(radius + dv)
                out[b, 0, row, col] = min(p_free[at], np.float32(1.0))
                if n > 1 and seen[at] != 0:
                    counts = count_lanes(seen[at])
                    for q in range(4):
                        count = (counts >> np.uint64(LANES * q)) & np.uint64(0xFF)
                        out[b, 1 + q, row, col] = shares[count]
