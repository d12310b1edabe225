"""How a histogram belief lies in memory: one plane per heading bin, its places row by row.

State (c, k) is element ``k P + place[c]`` of a flat array: a plane is the pose grid's rectangle of
cells, padded to P places, a multiple of :data:`BLOCK`. Places without a cell stay zero. So a turn
adds planes up, a travel shifts within a plane, and either runs over contiguous memory.

What holds mass is kept as *runs*: intervals of states, whole blocks of them, in ascending order,
each within one plane and, there, between two multiples of :data:`CHUNK`. Outside of its runs a
sheet is zero. Every kernel's cost follows the runs, not the map.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import PoseGrid

FULL = np.uint64(0x0101010101010101)  # Eight flags.
BLOCK = 16  # States that live and die together: a cache line of float32.
CHUNK = 32 * BLOCK  # Longest run; runs do not reach over its multiples within a plane.


class PlaneLayout:
    """Where the states of a pose grid are.

    Args:
        poses: The states.

    Attributes:
        headings: K.
        cols: Places in a row.
        size: P.
        place: ``(C,)``; place of each cell, ascending.
        n_blocks: In all planes together.
    """

    def __init__(self, poses: PoseGrid) -> None:
        rows, cols = poses.shape
        self.headings, self.cols = poses.headings, cols
        self.size = -(-rows * cols // BLOCK) * BLOCK
        self.place = (poses.cells[:, 0] * cols + poses.cells[:, 1]).astype(np.int32)
        self.n_blocks = self.headings * self.size // BLOCK

    def laid_out(self, bel: NDArray[np.floating], precision: str) -> NDArray[np.floating]:
        """``(K * P,)`` from ``(C, K)``."""
        values = np.zeros((self.headings, self.size), dtype=precision)
        values[:, self.place] = bel.T
        return values.ravel()

    def by_cell(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """``(C, K)``, a copy, from ``(K * P,)``."""
        planes = values.reshape(self.headings, self.size)
        return np.ascontiguousarray(planes[:, self.place].T)


def aligned(n: int, precision: str) -> NDArray[np.floating]:
    """``(n,)`` zeros whose blocks begin where cache lines do."""
    line = 64 // np.dtype(precision).itemsize
    room = np.zeros(n + line, dtype=precision)
    first = -(room.ctypes.data // room.itemsize) % line
    return room[first : first + n]


class Sheet:
    """A belief laid out in planes.

    Args:
        layout: Of its states.
        precision: ``float32`` or ``float64``.

    Attributes:
        values: ``(K * P,)``; zero outside of the runs.
        runs: ``(N, 2)`` of first state and one past the last; the first n count.
        n: How many runs there are.
        flags: ``(blocks,)``; zeros, for the kernels.
    """

    __slots__ = ("flags", "n", "runs", "values")

    def __init__(self, layout: PlaneLayout, precision: str) -> None:
        self.values = aligned(layout.headings * layout.size, precision)
        longest = layout.n_blocks // 2 + 2 * layout.headings + layout.n_blocks * BLOCK // CHUNK + 1
        self.runs = np.empty((longest, 2), dtype=np.int32)
        self.n = 0
        # Eight at a time are looked at.
        self.flags = np.zeros(-(-layout.n_blocks // 8) * 8, dtype=np.uint8)

    def put(self, values: NDArray[np.floating], layout: PlaneLayout) -> None:
        """Take over a copy of ``(K * P,)``."""
        self.values[:] = values
        self.n = find_runs(self.values, self.flags, layout.size, self.runs)

    def copy_to(self, other: Sheet) -> None:
        """Make another sheet of the layout, which must be empty, like this one."""
        other.n = self.n
        copy_runs(self.values, self.runs, self.n, other.values, other.runs)


@njit(cache=True, nogil=True)
def mark(flags: NDArray[np.uint8], first: int, last: int) -> None:
    """Flag the blocks of states ``first ... last - 1``."""
    for b in range(np.uint64(first // BLOCK), np.uint64((last + BLOCK - 1) // BLOCK)):
        flags[b] = 1


@njit(cache=True, nogil=True)
def add_up(
    of: NDArray[np.float32], at: np.uint64 | int, n: np.uint64 | int, sums: NDArray[np.float64]
) -> None:
    """Add a stretch of blocks, no longer than a run, to sums ``(CHUNK / 4,)``, four states to each.

    Those four are added in their own precision before they are added to what is kept of many.
    """
    quarter = n // np.uint64(4)
    second, third = at + quarter, at + quarter + quarter
    fourth = third + quarter
    for i in range(quarter):
        sums[i] += (of[at + i] + of[second + i]) + (of[third + i] + of[fourth + i])


@njit(cache=True, nogil=True)
def holds(of: NDArray[np.float32], at: np.uint64 | int, n: np.uint64 | int) -> bool:
    """Whether a stretch of blocks holds anything."""
    zero = of.dtype.type(0)
    for first in range(at, at + n, np.uint64(BLOCK)):
        held = False
        for i in range(np.uint64(BLOCK)):
            held |= of[first + i] != zero
        if held:
            return True
    return False


@njit(cache=True, nogil=True)
def mark_held(of: NDArray[np.float32], first: int, last: int, flags: NDArray[np.uint8]) -> None:
    """Flag those blocks of states ``first ... last - 1`` that hold anything."""
    # Seen as words of eight bytes, which are zero where the numbers are: none is below zero.
    words, eight, eights = of.view(np.int64), np.uint64(8), np.uint64(of.itemsize >> 2)
    for b in range(np.uint64(first // BLOCK), np.uint64(last // BLOCK)):
        held = np.int64(0)
        for at in range(b * eights * eight, (b + np.uint64(1)) * eights * eight, eight):
            for i in range(eight):
                held |= words[at + i]
        flags[b] |= np.uint8(held != 0)


@njit(cache=True, nogil=True)
def collect(flags: NDArray[np.uint8], size: int, runs: NDArray[np.int32]) -> int:
    """Turn flags into runs, and take them back; returns how many runs that is.

    Args:
        flags: ``(blocks,)``, a multiple of eight of them; zeros afterwards.
        size: States of a plane.
        runs: Overwritten.
    """
    words, per_plane = flags.view(np.uint64), size // BLOCK
    n, b = 0, 0
    while b < flags.shape[0]:
        if b % 8 == 0 and words[b // 8] == 0:
            b += 8
            continue
        if flags[b] == 0:
            b += 1
            continue
        first, within = b, b % per_plane
        end = b + min(per_plane - within, CHUNK // BLOCK - within % (CHUNK // BLOCK))
        while b < end and flags[b] != 0:
            if b % 8 == 0 and b + 8 <= end and words[b // 8] == FULL:
                words[b // 8] = 0
                b += 8
                continue
            flags[b] = 0
            b += 1
        runs[n, 0], runs[n, 1] = first * BLOCK, b * BLOCK
        n += 1
    return n


@njit(cache=True, nogil=True)
def find_runs(
    values: NDArray[np.float32], flags: NDArray[np.uint8], size: int, runs: NDArray[np.int32]
) -> int:
    """Runs of the blocks that hold anything; returns how many."""
    mark_held(values, 0, values.shape[0], flags)
    return collect(flags, size, runs)


@njit(cache=True, nogil=True)
def copy_runs(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    out: NDArray[np.float32],
    out_runs: NDArray[np.int32],
) -> None:
    """Copy what n runs hold, and the runs."""
    for r in range(n):
        out_runs[r, 0], out_runs[r, 1] = runs[r, 0], runs[r, 1]
        out[runs[r, 0] : runs[r, 1]] = values[runs[r, 0] : runs[r, 1]]


@njit(cache=True, nogil=True)
def clear_runs(values: NDArray[np.float32], runs: NDArray[np.int32], n: int) -> None:
    """Empty n runs."""
    for r in range(n):
        values[runs[r, 0] : runs[r, 1]] = 0.0


@njit(cache=True, nogil=True)
def clear_rest(
    values: NDArray[np.float32], runs: NDArray[np.int32], n: int, flags: NDArray[np.uint8]
) -> None:
    """Empty those blocks of n runs that are not flagged."""
    words = flags.view(np.uint64)
    for r in range(n):
        b, end = runs[r, 0] // BLOCK, runs[r, 1] // BLOCK
        while b < end:
            if b % 8 == 0 and b + 8 <= end and words[b // 8] == FULL:
                b += 8
                continue
            if flags[b] == 0:
                values[b * BLOCK : (b + 1) * BLOCK] = 0.0
            b += 1
