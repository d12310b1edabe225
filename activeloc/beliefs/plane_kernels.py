"""Kernels of the histogram filter on planes: sums, evidence, what is dropped, for one robot.

A belief is ``values`` and its ``runs`` (:mod:`activeloc.beliefs.plane_layout`); ``size`` is P.
Kernels draw nothing, raise nothing and return what a caller needs to know as numbers. Sums over
many states are kept in float64, one for each four places of a run, and added up in that order: the
compiler may do several at once and every machine gets the same bits.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import CHUNK, add_up, collect, mark, mark_held


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
    sums = np.zeros(CHUNK // 4)
    for r in range(n):
        add_up(values, np.uint64(runs[r, 0]), np.uint64(runs[r, 1] - runs[r, 0]), sums)
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
    sums = np.zeros(CHUNK // 4)
    low, span = values.dtype.type(floor), values.dtype.type(1.0 - floor)
    for r in range(n):
        of, by = values[runs[r, 0] : runs[r, 1]], factor[runs[r, 0] : runs[r, 1]]
        for i in range(of.shape[0]):
            of[i] *= low + span * by[i]
        add_up(of, np.uint64(0), np.uint64(of.shape[0]), sums)
    return sums.sum()


@njit(cache=True, nogil=True)
def _count(of: NDArray[np.float32], limit: float | np.floating) -> tuple[int, int]:
    """How many states are not empty and under a limit, and how many are not under it."""
    small, kept, zero = np.int32(0), np.int32(0), of.dtype.type(0)
    for i in range(of.shape[0]):
        small = np.int32(small + np.int32((of[i] < limit) & (of[i] > zero)))
        kept = np.int32(kept + np.int32((of[i] >= limit) & (of[i] > zero)))
    return int(small), int(kept)


@njit(cache=True, nogil=True)
def _drop(
    of: NDArray[np.float32],
    limit: float | np.floating,
    factor: float | np.floating,
    dropped: NDArray[np.float64],
) -> None:
    """Empty what is under a limit, adding it up state by state, and multiply the rest."""
    zero = of.dtype.type(0)
    for i in range(of.shape[0]):
        kept = of[i] if of[i] >= limit else zero
        dropped[i] += of[i] - kept
        of[i] = kept * factor


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
    """Divide by ``mass``, then drop states under ``least``; keep the runs that are left.

    A block without mass is no part of a run any more, unless its run is half full.

    Args:
        values: ``(K * P,)``, overwritten; sums to the mass that was kept of one.
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
    factor, limit = values.dtype.type(1.0 / mass), values.dtype.type(least * mass)
    dropped = np.zeros(CHUNK)
    for r in range(n):
        of = values[runs[r, 0] : runs[r, 1]]
        small, kept = _count(of, limit)
        if small > 0:
            _drop(of, limit, factor, dropped)
        else:
            for i in range(of.shape[0]):
                of[i] *= factor
        if 2 * kept > of.shape[0]:
            mark(flags, runs[r, 0], runs[r, 1])
            continue
        if kept > 0:
            mark_held(values, runs[r, 0], runs[r, 1], flags)
    return collect(flags, size, runs), 1.0 - dropped.sum() / mass


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
    seen, count, looked = np.zeros(size, dtype=np.uint8), 0, 0
    for r in range(n):
        start = runs[r, 0] % size
        there = seen[start : start + runs[r, 1] - runs[r, 0]]
        of = values[runs[r, 0] : runs[r, 1]]
        for i in range(there.shape[0]):
            there[i] |= of[i] > 0.0
        looked += of.shape[0]
        if looked > size or r == n - 1:
            count, looked = seen.sum(), 0
            if count > enough:
                break
    return count
