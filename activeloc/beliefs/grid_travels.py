"""The kernel that lets a belief travel: each lane group to the places that its list says.

Lists are those of :class:`activeloc.beliefs.travel_lists.TravelLists`.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES, clear, collect
from activeloc.beliefs.lanes import add, any_above, fill, load, mul, store, total, widened


@njit(cache=True, nogil=True)
def translate(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    width: int,
    which: NDArray[np.int32],
    first: NDArray[np.int64],
    step: NDArray[np.int32],
    weight: NDArray[np.float32],
    left: NDArray[np.float32],
    out: NDArray[np.float32],
    out_places: NDArray[np.int32],
    n_out: int,
    flags: NDArray[np.uint8],
    is_listed: bool,
) -> tuple[int, float]:
    """out(x') = sum over x of p(x' | x) values(x).

    Args:
        values: ``(P * W,)``.
        places: Of ``values``, the first n.
        n: How many.
        width: W.
        which: ``(P * G,)``; list of each place and lane group,
        first: ``(L + 1,)``; where each list's entries begin,
        step: ``(M,)``; places from the state's to the entry's, and
        weight: ``(M * LANES,)``; share of each heading that goes there.
        left: ``(L * LANES,)``; sum of each list's shares.
        out: ``(P * W,)``, overwritten.
        out_places: What ``out`` holds before; overwritten with what it holds afterwards.
        n_out: How many places that was.
        flags: Zeros.
        is_listed: Whether to list what ``out`` holds; else ``out_places`` stays as it was.

    Returns:
        How many places are listed, some of which may hold nothing, and the sum of ``out``.
    """
    clear(out, out_places, n_out, width)
    w, one, n_groups = np.uint64(width), np.uint64(1), np.uint64(width) // LANES
    nothing, sums = fill(values.dtype.type(0)), fill(0.0)
    for c in range(n):
        p, of = np.uint64(places[c]), nothing
        for g in range(n_groups):
            part = load(values, p * w + g * LANES)
            if not any_above(part, nothing):
                continue
            r = np.uint64(which[p * n_groups + g])
            of = add(of, mul(part, load(left, r * LANES)))
            for e in range(np.uint64(first[r]), np.uint64(first[r + one])):
                there = p + np.uint64(step[e])
                to = there * w + g * LANES
                store(out, to, add(load(out, to), mul(part, load(weight, e * LANES))))
                if is_listed:
                    flags[there] = 1
        sums = add(sums, widened(of))
    return collect(flags, out_places) if is_listed else 0, total(sums)
