"""Kernels that write out the rows of a travel, state by state, from those that states share.

A state (k, c) refers to its row by number, ``row[k, c]``, or has none and -1; the entries of row r
are ``first[r] ... first[r + 1] - 1``.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK


@njit(cache=True, nogil=True)
def lay_out(
    row: NDArray[np.int32],
    place: NDArray[np.int32],
    first: NDArray[np.int64],
    step: NDArray[np.int32],
    block_start: NDArray[np.int64],
    source: NDArray[np.uint16],
    target: NDArray[np.uint16],
) -> None:
    """Write out where every state's entries lead.

    Args:
        row: ``(K, C)``.
        place: ``(C,)``, ascending.
        first: ``(R + 1,)``.
        step: ``(M,)``; from the state's place to the entry's.
        block_start: ``(K * P / BLOCK + 1,)``, overwritten with the first entry of each block.
        source: ``(N,)``, overwritten with places, and
        target: ``(N,)`` too.
    """
    n, b, per_plane = 0, 0, (block_start.shape[0] - 1) // row.shape[0]
    for k in range(row.shape[0]):
        for c in range(place.shape[0]):
            p, r = place[c], row[k, c]
            if r < 0:
                continue
            block = k * per_plane + p // BLOCK
            while b <= block:
                block_start[b] = n
                b += 1
            for e in range(first[r], first[r + 1]):
                source[n], target[n] = p, p + step[e]
                n += 1
    block_start[b:] = n


@njit(cache=True, nogil=True)
def spread(
    row: NDArray[np.int32],
    first: NDArray[np.int64],
    values: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Write out the values ``(M,)`` of every state's entries ``(N,)``."""
    n = 0
    for k in range(row.shape[0]):
        for c in range(row.shape[1]):
            r = row[k, c]
            if r >= 0:
                for e in range(first[r], first[r + 1]):
                    out[n] = values[e]
                    n += 1
