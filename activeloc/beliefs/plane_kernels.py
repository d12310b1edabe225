"""Kernels of the histogram filter on planes: sums, evidence, what is dropped, for one robot.

A belief is ``values`` and its ``runs`` (:mod:`activeloc.beliefs.plane_layout`); ``size`` is P.
Kernels draw nothing, raise nothing and return what a caller needs to know as numbers. Sums over
many states are kept in float64, one for each place within a run, and added up in that order: the
compiler may do several places at once and every machine gets the same bits.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, CHUNK, collect, mark


@njit(cache=True, nogil=True)
def states_of(runs: NDArray[np.int32], n: int) -> int:
    """How many states there are in n runs."""
    states = 0
    for r in range(n):
        states += runs[r, 1] - runs[r, 0]
    return states


@njit(cache=True, nogil=True)
def total(values: NDArray[np.float32], runs: NDArray[np.int32], n: int) -> float:
    """Sum of a belief."""
    sums = np.zeros(CHUNK)
    for r in range(n):
        of = values[runs[r, 0] : runs[r, 1]]
        for i in range(of.shape[0]):
            sums[i] += of[i]
    return sums.sum()


@njit(cache=True, nogil=True)
def scale(values: NDArray[np.float32], runs: NDArray[np.int32], n: int, factor: float) -> None:
    """Multiply a belief by a factor."""
    by = values.dtype.type(factor)
    for r in range(n):
        of = values[runs[r, 0] : runs[r, 1]]
        for i in range(of.shape[0]):
            of[i] *= by


@njit(cache=True, nogil=True)
def add(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    other: NDArray[np.float32],
    other_runs: NDArray[np.int32],
    n_other: int,
    share: float,
    size: int,
    flags: NDArray[np.uint8],
) -> int:
    """Add a share of another belief, in place; returns how many runs ``values`` has.

    Args:
        values: ``(K * P,)``, overwritten.
        runs: Of ``values``, overwritten.
        n: How many.
        other: ``(K * P,)``.
        other_runs: Of ``other``.
        n_other: How many.
        share: Of it.
        size: P.
        flags: Zeros.
    """
    by = values.dtype.type(share)
    for r in range(n):
        mark(flags, runs[r, 0], runs[r, 1])
    for r in range(n_other):
        mark(flags, other_runs[r, 0], other_runs[r, 1])
        to = values[other_runs[r, 0] : other_runs[r, 1]]
        of = other[other_runs[r, 0] : other_runs[r, 1]]
        for i in range(to.shape[0]):
            to[i] += by * of[i]
    return collect(flags, size, runs)


@njit(cache=True, nogil=True)
def weigh(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    factor: NDArray[np.float32],
    floor: float,
) -> float:
    """Multiply by ``floor + (1 - floor) factor`` in place; returns the mass that is left."""
    sums = np.zeros(CHUNK)
    low, span = values.dtype.type(floor), values.dtype.type(1.0 - floor)
    for r in range(n):
        of, by = values[runs[r, 0] : runs[r, 1]], factor[runs[r, 0] : runs[r, 1]]
        for i in range(of.shape[0]):
            of[i] *= low + span * by[i]
            sums[i] += of[i]
    return sums.sum()


@njit(cache=True, nogil=True)
def normalise(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    mass: float,
    least: float,
    flags: NDArray[np.uint8],
) -> tuple[int, float]:
    """Divide by ``mass``, drop states under ``least``, keep the runs that are left.

    Args:
        values: ``(K * P,)``, overwritten.
        runs: Overwritten.
        n: How many.
        size: P.
        mass: Sum of ``values``.
        least: Probability under which a state is emptied; if all are that small, none is.
        flags: Zeros.

    Returns:
        Number of runs, and the mass that was kept of one.
    """
    if least * states_of(runs, n) >= 1.0 and largest(values, runs, n) < least * mass:
        least = 0.0
    # In the belief's own precision, so that several states can be done at once.
    zero = values.dtype.type(0)
    scale, limit = values.dtype.type(1.0 / mass), values.dtype.type(least * mass)
    dropped = 0.0
    for r in range(n):
        of, small = values[runs[r, 0] : runs[r, 1]], 0
        for i in range(of.shape[0]):
            small += (of[i] < limit) & (of[i] > zero)
        for i in range(of.shape[0] if small > 0 else 0):
            if of[i] < limit:
                dropped += of[i]
                of[i] = zero
        for i in range(of.shape[0]):
            of[i] *= scale
    lost = dropped / mass
    n = prune(values, runs, n, size, flags)
    if lost > 0.0:
        scale = values.dtype.type(1.0 / (1.0 - lost))
        for r in range(n):
            of = values[runs[r, 0] : runs[r, 1]]
            for i in range(of.shape[0]):
                of[i] *= scale
    return n, 1.0 - lost


@njit(cache=True, nogil=True)
def prune(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    flags: NDArray[np.uint8],
) -> int:
    """Leave blocks without mass out of the runs, unless their run is half full; how many are left.

    Args:
        values: ``(K * P,)``.
        runs: Overwritten.
        n: How many.
        size: P.
        flags: Zeros.
    """
    for r in range(n):
        of, held = values[runs[r, 0] : runs[r, 1]], 0
        for i in range(of.shape[0]):
            held += of[i] > 0.0
        if 2 * held > of.shape[0]:
            mark(flags, runs[r, 0], runs[r, 1])
            continue
        for b in range(np.uint64(runs[r, 0] // BLOCK), np.uint64(runs[r, 1] // BLOCK)):
            for i in range(BLOCK):
                if values[b * np.uint64(BLOCK) + np.uint64(i)] > 0.0:
                    flags[b] = 1
                    break
    return collect(flags, size, runs)


@njit(cache=True, nogil=True)
def largest(values: NDArray[np.float32], runs: NDArray[np.int32], n: int) -> float:
    """The largest probability."""
    best = values.dtype.type(0)
    for r in range(n):
        of = values[runs[r, 0] : runs[r, 1]]
        for i in range(of.shape[0]):
            best = max(best, of[i])
    return float(best)


@njit(cache=True, nogil=True)
def places_held(
    values: NDArray[np.float32], runs: NDArray[np.int32], n: int, size: int, enough: int
) -> int:
    """At how many places there is any mass; counts no further than a little over ``enough``."""
    seen, count = np.zeros(size, dtype=np.bool_), 0
    for r in range(n):
        start = runs[r, 0] % size
        there = seen[start : start + runs[r, 1] - runs[r, 0]]
        of = values[runs[r, 0] : runs[r, 1]]
        for i in range(there.shape[0]):
            if of[i] > 0.0 and not there[i]:
                there[i] = True
                count += 1
        if count > enough:
            break
    return count
