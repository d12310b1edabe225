"""Tiles of a belief on planes: a strip of places with all their headings.

What goes through many headings of the same places goes tile by tile: a tile is small enough to stay
in the fastest memory. Tiles cover the places where any heading holds mass, so the cost follows the
mass.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, holds, mark

WIDE = 32  # Blocks of a tile; one where little is listed, so that no more is listed afterwards.
SPARSE = 8  # Little is listed if less than one in so many states is.


@njit(cache=True, nogil=True)
def tiles_of(
    runs: NDArray[np.int32], n: int, size: int, n_headings: int, wide: int
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Tiles over all places that n runs reach, and which headings hold anything there.

    Args:
        runs: Of a belief.
        n: How many.
        size: P.
        n_headings: K.
        wide: Most blocks of a tile; it has one if little is listed.

    Returns:
        ``(T, 2)`` of first place and one past the last, ascending, and ``(T, K)``.
    """
    states, seen = 0, np.zeros(size // BLOCK, dtype=np.bool_)
    for r in range(n):
        states += runs[r, 1] - runs[r, 0]
        first = runs[r, 0] % size // BLOCK
        seen[first : first + (runs[r, 1] - runs[r, 0]) // BLOCK] = True
    widest = 1 if SPARSE * states < n_headings * size else wide
    tiles, of_block = np.empty((seen.sum(), 2), dtype=np.int32), np.empty(seen.size, dtype=np.int32)
    n_tiles = 0
    for b in range(seen.size):
        if not seen[b]:
            continue
        last = n_tiles - 1
        if last < 0 or tiles[last, 1] != b * BLOCK or b * BLOCK - tiles[last, 0] == widest * BLOCK:
            tiles[n_tiles, 0], last = b * BLOCK, n_tiles
            n_tiles += 1
        tiles[last, 1], of_block[b] = (b + 1) * BLOCK, last
    alive = np.zeros((n_tiles, n_headings), dtype=np.bool_)
    for r in range(n):
        k, first = runs[r, 0] // size, runs[r, 0] % size // BLOCK
        for b in range(first, first + (runs[r, 1] - runs[r, 0]) // BLOCK):
            alive[of_block[b], k] = True
    return tiles[:n_tiles], alive


@njit(cache=True, nogil=True)
def arc_of(alive: NDArray[np.bool_]) -> tuple[int, int]:
    """First heading and length of the shortest arc with all headings ``(K,)`` that are alive."""
    n_headings, gap, after, last = alive.shape[0], 0, 0, -1
    for j in range(2 * n_headings):
        if alive[j if j < n_headings else j - n_headings]:
            if last >= 0 and j - last > gap:
                gap, after = j - last, j
            last = j
    return after % n_headings, n_headings - gap + 1


@njit(cache=True, nogil=True)
def store(
    of: NDArray[np.float32],
    at: np.uint64,
    n: np.uint64,
    out: NDArray[np.float32],
    to: np.uint64,
) -> None:
    """Copy a stretch, most often of one block: a loop of a known length."""
    if n == BLOCK:
        for i in range(np.uint64(BLOCK)):
            out[to + i] = of[at + i]
    else:
        for i in range(n):
            out[to + i] = of[at + i]


@njit(cache=True, nogil=True)
def load(
    values: NDArray[np.float32],
    size: int,
    start: int,
    length: np.uint64,
    first: int,
    n: int,
    out: NDArray[np.float32],
    to: np.uint64,
) -> None:
    """Copy n headings of a tile, one after the other, to ``out`` from ``to`` on."""
    n_headings, k = values.shape[0] // size, first
    for _ in range(n):
        store(values, np.uint64(k * size + start), length, out, to)
        to += length
        k = k + 1 if k + 1 < n_headings else 0


@njit(cache=True, nogil=True)
def store_tile(
    of: NDArray[np.float32],
    n_rows: int,
    first: int,
    tile: NDArray[np.int32],
    out: NDArray[np.float32],
    size: int,
    flags: NDArray[np.uint8],
) -> None:
    """Put a tile where it belongs, those rows that hold anything, and flag them.

    Args:
        of: The tile's rows.
        n_rows: How many.
        first: Heading of the first.
        tile: ``(2,)``; first place and one past the last.
        out: ``(K * P,)``, overwritten there.
        size: P.
        flags: See :func:`collect`.
    """
    k, n_headings, length = first, out.shape[0] // size, np.uint64(tile[1] - tile[0])
    for row in range(n_rows):
        at = np.uint64(row) * length
        if holds(of, at, length):
            store(of, at, length, out, np.uint64(k * size + tile[0]))
            mark(flags, k * size + tile[0], k * size + tile[1])
        k = k + 1 if k + 1 < n_headings else 0
