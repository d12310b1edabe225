"""How a histogram belief lies in memory: cell by cell, the headings of a cell side by side.

State (c, k) is element ``place[c] W + k`` of a flat array. Places are those of the pose grid's
rectangle of cells, row by row; W is the number of headings K, filled up to G whole lane groups
(:mod:`activeloc.beliefs.lanes`). Places without a cell stay zero, and so does what W has beyond K.
So a turn works on a few neighbouring lines of memory, a travel moves lane groups from place to
place, and both do several headings at once; a cell that holds mass at one heading most often does
at its neighbours.

The cells that hold mass are kept as a list of their places, ascending. Outside of it a sheet is
zero. Every kernel's cost follows the list, not the map.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.lanes import N_LANES, any_above, fill, load, store
from activeloc.beliefs.pose_grid import PoseGrid

LANES = np.uint64(N_LANES)
WORD = 8  # Places are filled up to a multiple of it: flags are looked at so many at a time.


class GridLayout:
    """Where the states of a pose grid are.

    Args:
        poses: The states.

    Attributes:
        headings: K.
        width: W.
        cols: Places in a row.
        size: P; places in all.
        place: ``(C,)``; place of each cell, ascending.
    """

    def __init__(self, poses: PoseGrid) -> None:
        rows, cols = poses.shape
        self.headings, self.cols = poses.headings, cols
        self.width = -(-poses.headings // N_LANES) * N_LANES
        # One more than there are: what is read beyond the last cell's headings is there too.
        self.size = (rows * cols // WORD + 1) * WORD
        self.place = (poses.cells[:, 0] * cols + poses.cells[:, 1]).astype(np.int32)

    def laid_out(self, of: NDArray[np.generic], precision: str) -> NDArray[np.floating]:
        """``(P * W,)`` from ``(C, K)``."""
        values = aligned(self.size * self.width, precision)
        values.reshape(self.size, self.width)[self.place, : self.headings] = of
        return values

    def by_cell(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """``(C, K)``, a copy, from ``(P * W,)``."""
        return values.reshape(self.size, self.width)[self.place, : self.headings]


def aligned(n: int, precision: str) -> NDArray[np.floating]:
    """``(n,)`` zeros that begin where a cache line does."""
    line = 64 // np.dtype(precision).itemsize
    room = np.zeros(n + line, dtype=precision)
    first = -(room.ctypes.data // room.itemsize) % line
    return room[first : first + n]


class Sheet:
    """A belief laid out.

    Args:
        layout: Of its states.
        precision: ``float32`` or ``float64``.

    Attributes:
        values: ``(P * W,)``; zero outside of the listed places.
        places: ``(P,)``; the first n count.
        n: How many places are listed.
        flags: ``(P,)``; zeros, for the kernels.
    """

    __slots__ = ("flags", "n", "places", "values")

    def __init__(self, layout: GridLayout, precision: str) -> None:
        self.values = aligned(layout.size * layout.width, precision)
        self.places = np.empty(layout.size, dtype=np.int32)
        self.n = 0
        self.flags = np.zeros(layout.size, dtype=np.uint8)

    def clear(self, layout: GridLayout) -> None:
        """Empty it."""
        clear(self.values, self.places, self.n, layout.width)
        self.n = 0

    def put(self, values: NDArray[np.floating], layout: GridLayout) -> None:
        """Take over a copy of ``(P * W,)``."""
        self.values[:] = values
        self.find(layout)

    def list_all(self, layout: GridLayout) -> None:
        """List all cells."""
        self.n = len(layout.place)
        self.places[: self.n] = layout.place

    def find(self, layout: GridLayout) -> None:
        """List the cells that hold anything."""
        self.list_all(layout)
        self.n = held(self.values, self.places, self.n, layout.width)

    def copy_to(self, other: Sheet, layout: GridLayout) -> None:
        """Make another sheet of the layout, which must be empty, like this one."""
        other.n = self.n
        copy_places(self.values, self.places, self.n, layout.width, other.values, other.places)


@njit(cache=True, nogil=True)
def holds(values: NDArray[np.float32], at: np.uint64, width: np.uint64) -> bool:
    """Whether a cell holds anything."""
    nothing, g = fill(values.dtype.type(0)), np.uint64(0)
    while g < width and not any_above(load(values, at + g), nothing):
        g += LANES
    return bool(g < width)


@njit(cache=True, nogil=True)
def held(values: NDArray[np.float32], places: NDArray[np.int32], n: int, width: int) -> int:
    """Keep those of n places that hold anything; returns how many."""
    w, kept = np.uint64(width), 0
    for c in range(n):
        if holds(values, np.uint64(places[c]) * w, w):
            places[kept] = places[c]
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def collect(flags: NDArray[np.uint8], places: NDArray[np.int32]) -> int:
    """List the flagged places, and take the flags back; returns how many.

    Args:
        flags: ``(P,)`` of 0 and 1; zeros afterwards.
        places: Overwritten.
    """
    words, n = flags.view(np.uint64), 0
    for i in range(words.shape[0]):
        if words[i] == 0:
            continue
        for p in range(WORD * i, WORD * (i + 1)):
            places[n] = p
            n += flags[p]
        words[i] = 0
    return n


@njit(cache=True, nogil=True)
def copy_places(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    width: int,
    out: NDArray[np.float32],
    out_places: NDArray[np.int32],
) -> None:
    """Copy what n places hold, and their list."""
    w = np.uint64(width)
    for c in range(n):
        out_places[c], at = places[c], np.uint64(places[c]) * w
        for g in range(np.uint64(0), w, LANES):
            store(out, at + g, load(values, at + g))


@njit(cache=True, nogil=True)
def clear(values: NDArray[np.float32], places: NDArray[np.int32], n: int, width: int) -> None:
    """Empty n places."""
    w, nothing = np.uint64(width), fill(values.dtype.type(0))
    for c in range(n):
        at = np.uint64(places[c]) * w
        for g in range(np.uint64(0), w, LANES):
            store(values, at + g, nothing)
