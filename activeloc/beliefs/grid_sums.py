"""Kernels of the histogram filter: sums, evidence, the likeliest state, what is dropped.

A belief is ``values`` and the list of its ``places`` (:mod:`activeloc.beliefs.grid_layout`).
Kernels draw nothing, raise nothing and return what a caller needs to know as numbers. What a cell
holds is added up in the belief's own precision, eight headings at once; cells are added up in
float64, in the order of their places.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import (
    add,
    any_above,
    at_least,
    fill,
    load,
    mul,
    store,
    sub,
    total,
    widened,
)


@njit(cache=True, nogil=True)
def mass(values: NDArray[np.float32], places: NDArray[np.int32], n: int, width: int) -> float:
    """Sum of a belief."""
    w, sums = np.uint64(width), fill(0.0)
    for c in range(n):
        at = np.uint64(places[c]) * w
        of = load(values, at)
        for g in range(LANES, w, LANES):
            of = add(of, load(values, at + g))
        sums = add(sums, widened(of))
    return total(sums)


@njit(cache=True, nogil=True)
def scale(
    values: NDArray[np.float32], places: NDArray[np.int32], n: int, width: int, factor: float
) -> None:
    """Multiply a belief by a factor."""
    w, by = np.uint64(width), fill(values.dtype.type(factor))
    for c in range(n):
        at = np.uint64(places[c]) * w
        for g in range(np.uint64(0), w, LANES):
            store(values, at + g, mul(by, load(values, at + g)))


@njit(cache=True, nogil=True)
def mix(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    other: NDArray[np.float32],
    other_places: NDArray[np.int32],
    n_other: int,
    share: float,
    width: int,
    merged: NDArray[np.int32],
) -> int:
    """Add a share of another belief, in place.

    Args:
        values: ``(P * W,)``, overwritten.
        places: Of ``values``.
        n: How many.
        other: ``(P * W,)``.
        other_places: Of ``other``.
        n_other: How many.
        share: Of it.
        width: W.
        merged: ``(P,)``, overwritten with the places of both.

    Returns:
        How many places those are.
    """
    w, by = np.uint64(width), fill(values.dtype.type(share))
    c, m = 0, 0
    for o in range(n_other):
        while c < n and places[c] < other_places[o]:
            merged[m] = places[c]
            c, m = c + 1, m + 1
        if c < n and places[c] == other_places[o]:
            c += 1
        merged[m] = other_places[o]
        m += 1
        at = np.uint64(other_places[o]) * w
        for g in range(np.uint64(0), w, LANES):
            part = mul(by, load(other, at + g))
            store(values, at + g, add(load(values, at + g), part))
    while c < n:
        merged[m] = places[c]
        c, m = c + 1, m + 1
    return m


@njit(cache=True, nogil=True)
def weigh(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    width: int,
    factor: NDArray[np.float32],
    floor: float,
    divisor: float,
) -> float:
    """Multiply by ``(floor + (1 - floor) factor) / divisor``; returns what is left."""
    w, sums = np.uint64(width), fill(0.0)
    low = fill(values.dtype.type(floor / divisor))
    span = fill(values.dtype.type((1.0 - floor) / divisor))
    for c in range(n):
        at, of = np.uint64(places[c]) * w, fill(values.dtype.type(0))
        for g in range(np.uint64(0), w, LANES):
            by = add(low, mul(span, load(factor, at + g)))
            part = mul(by, load(values, at + g))
            store(values, at + g, part)
            of = add(of, part)
        sums = add(sums, widened(of))
    return total(sums)


@njit(cache=True, nogil=True)
def largest_in(
    values: NDArray[np.float32], at: np.uint64, width: np.uint64, best: NDArray[np.float32]
) -> np.uint64:
    """State of a cell's largest probability, the first of equals; ``best (1,)`` is set to it."""
    mode = at
    for k in range(width):
        if values[at + k] > best[0]:
            best[0], mode = values[at + k], at + k
    return mode


@njit(cache=True, nogil=True)
def likeliest(values: NDArray[np.float32], places: NDArray[np.int32], n: int, width: int) -> int:
    """State of the largest probability, the first of equals.

    Args:
        values: ``(P * W,)``.
        places: Of the belief.
        n: How many.
        width: W.
    """
    w, best, mode = np.uint64(width), np.zeros(1, values.dtype), np.uint64(0)
    for c in range(n):
        at, most = np.uint64(places[c]) * w, fill(values.dtype.type(0))
        for g in range(np.uint64(0), w, LANES):
            part = load(values, at + g)
            most = at_least(part, most, most)
        if any_above(most, fill(best[0])):
            mode = largest_in(values, at, w, best)
    return int(mode)


@njit(cache=True, nogil=True)
def normalise(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    n_headings: int,
    width: int,
    whole: float,
    least: float,
) -> tuple[int, float, int]:
    """Divide by ``whole``, then drop states under ``least``, and cells without any.

    Args:
        values: ``(P * W,)``, overwritten; sums to the mass that was kept of one.
        places: Overwritten.
        n: How many.
        n_headings: K.
        width: W.
        whole: Sum of ``values``.
        least: Probability under which a state is emptied; if all are that small, none is.

    Returns:
        Number of places, the mass that was kept of one, and the likeliest state.
    """
    w, kept_places = np.uint64(width), 0
    number = values.dtype.type
    best, mode = np.zeros(1, values.dtype), np.uint64(0)
    if least * n * n_headings >= 1.0:
        highest = values[likeliest(values, places, n, width)]
        least = 0.0 if highest < least * whole else least
    factor, limit, nothing = fill(number(1.0 / whole)), fill(number(least * whole)), fill(number(0))
    dropped = fill(0.0)
    for c in range(n):
        at, lost, most = np.uint64(places[c]) * w, nothing, nothing
        for g in range(np.uint64(0), w, LANES):
            part = load(values, at + g)
            kept = at_least(part, limit, nothing)
            lost = add(lost, sub(part, kept))
            part = mul(kept, factor)
            most = at_least(part, most, most)
            store(values, at + g, part)
        dropped = add(dropped, widened(lost))
        places[kept_places] = places[c]
        kept_places += any_above(most, nothing)
        if any_above(most, fill(best[0])):
            mode = largest_in(values, at, w, best)
    return kept_places, 1.0 - total(dropped) / whole, int(mode)
