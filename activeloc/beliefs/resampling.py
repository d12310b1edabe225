"""Resampling: which particles survive.

Every scheme is a pure function ``(weights (N,), n, uniforms) -> (n,) indices`` and is unbiased: the
expected number of offspring of particle i is ``n w_i``. Weights need not sum to one: pointers are
scaled by the last cumulative weight, so that rounding never runs off the end.

Douc & Cappé, "Comparison of resampling schemes for particle filtering" (2005); systematic is the
low-variance sampler of *Probabilistic Robotics*, table 4.4, multinomial its roulette wheel.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

Scheme = Callable[[NDArray[np.float64], int, NDArray[np.float64]], NDArray[np.intp]]


@njit(cache=True, nogil=True)
def _walk(
    wheel: NDArray[np.float64], pointers: NDArray[np.float64], last: int, out: NDArray[np.intp]
) -> None:
    """:func:`_pick` for pointers that ascend: one walk along the wheel.

    Args:
        wheel: ``(N,)``; cumulative weights.
        pointers: ``(n,)`` in [0, 1), ascending.
        last: Index of the last weight above zero.
        out: ``(n,)``, overwritten.
    """
    i = 0
    for k in range(pointers.shape[0]):
        at = pointers[k] * wheel[-1]
        while i < last and wheel[i] <= at:
            i += 1
        out[k] = i


@njit(cache=True, nogil=True)
def _walk_evenly(
    wheel: NDArray[np.float64], start: float, last: int, out: NDArray[np.intp]
) -> None:
    """:func:`_walk` for the n pointers ``(start + k) / n``."""
    i, n, total = 0, out.shape[0], wheel[-1]
    for k in range(n):
        at = (start + k) / n * total
        while i < last and wheel[i] <= at:
            i += 1
        out[k] = i


def comb(wheel: NDArray[np.float64], n: int, start: float) -> NDArray[np.intp]:
    """Indices ``(n,)`` under a comb of n teeth on a wheel of cumulative weights ``(N,)``.

    Args:
        wheel: Not falling, its last value positive.
        n: Teeth.
        start: In [0, 1); the first tooth, in their distance.
    """
    out = np.empty(n, dtype=np.intp)
    _walk_evenly(wheel, start, _last(wheel), out)
    return out


def _pick(weights: NDArray[np.float64], pointers: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the particle whose share of the wheel holds each pointer in [0, 1).

    The roulette wheel with binary search.
    """
    wheel = np.asarray(weights, dtype=np.float64).cumsum()
    index = np.searchsorted(wheel, pointers * wheel[-1], side="right")
    return np.minimum(index, _last(wheel))


def _pick_ascending(
    weights: NDArray[np.float64], pointers: NDArray[np.float64]
) -> NDArray[np.intp]:
    wheel = np.asarray(weights, dtype=np.float64).cumsum()
    out = np.empty(len(pointers), dtype=np.intp)
    _walk(wheel, pointers, _last(wheel), out)
    return out


def _last(wheel: NDArray[np.float64]) -> int:
    """Index of the last particle with a share of the wheel."""
    return int(np.searchsorted(wheel, wheel[-1], side="left"))


def systematic(
    weights: NDArray[np.float64], n: int, uniforms: NDArray[np.float64]
) -> NDArray[np.intp]:
    """One comb of n teeth: offspring within one of ``n w``. Uses ``uniforms[0]``."""
    return comb(np.asarray(weights, dtype=np.float64).cumsum(), n, float(uniforms[0]))


def stratified(
    weights: NDArray[np.float64], n: int, uniforms: NDArray[np.float64]
) -> NDArray[np.intp]:
    """One pointer in each of n equal strata. Uses ``uniforms[:n]``."""
    return _pick_ascending(weights, (uniforms[:n] + np.arange(n)) / n)


def multinomial(
    weights: NDArray[np.float64], n: int, uniforms: NDArray[np.float64]
) -> NDArray[np.intp]:
    """N independent spins of the roulette wheel, by binary search. Uses ``uniforms[:n]``."""
    return _pick(weights, uniforms[:n])


def residual(
    weights: NDArray[np.float64], n: int, uniforms: NDArray[np.float64]
) -> NDArray[np.intp]:
    """``floor(n w)`` copies of each, the rest by the wheel over what was cut off.

    Uses as many uniforms as there are particles left to draw.
    """
    share = np.asarray(weights, dtype=np.float64) / np.sum(weights, dtype=np.float64) * n
    copies = np.floor(share).astype(np.intp)
    kept = np.repeat(np.arange(len(share)), copies)
    missing = n - len(kept)
    if missing <= 0:
        return kept[:n]
    rest = share - copies
    return np.concatenate([kept, _pick(rest, uniforms[:missing])])


SCHEMES: dict[str, Scheme] = {
    "systematic": systematic,
    "stratified": stratified,
    "multinomial": multinomial,
    "residual": residual,
}


def effective_sample_size(weights: NDArray[np.float64]) -> float:
    """``(sum w)^2 / sum w^2``: how many equal particles the weights are worth, in [1, N]."""
    w = np.asarray(weights, dtype=np.float64)
    w = w / w.max()  # Squares of the smallest weights would underflow.
    return float(w.sum() ** 2 / (w**2).sum())
