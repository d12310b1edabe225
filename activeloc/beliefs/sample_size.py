"""How many particles does a belief need?

Two answers. *Entropy*: so many per effective state, ``N = per_state exp(H)``, with H on the common
bins: a belief twice as wide gets twice the particles. *KLD*: enough that with probability
``confidence`` the Kullback-Leibler divergence between the sample and the belief that it is drawn
from stays under ``error``, which grows with the number of bins that the sample falls into. Bins
that nothing has been drawn from are not counted, so a thin tail over many bins can break the
promise; ``n_min`` is there to cover it.

Fox, "Adapting the sample size in particle filters through KLD-sampling" (IJRR 22, 2003);
*Probabilistic Robotics* (2005), section 8.3.7 and table 8.4.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import ndtri

from activeloc import checks


@njit(cache=True, nogil=True)
def wilson_hilferty(k: int, z: float, error: float) -> float:
    """``chi2_(k-1, confidence) / (2 error)`` approximately; z is the normal quantile.

    Wilson and Hilferty's cube: equation (7) of the paper. One bin counts as two.
    """
    df = max(k, 2) - 1.0
    part = 2.0 / (9.0 * df)
    cube = 1.0 - part + np.sqrt(part) * z
    return df / (2.0 * error) * cube * cube * cube


@njit(cache=True, nogil=True)
def power_of(p: float, order: float) -> float:
    """``p ** order``; a square root, where that is meant, takes a tenth of the time."""
    return np.sqrt(p) if order == 0.5 else p**order


@njit(cache=True, nogil=True)
def effective_states(p: NDArray[np.float64], order: float = 1.0) -> float:
    """Exp of Rényi's entropy of an order in (0, 1]; at 1 it is Shannon's.

    ``(sum p^a)^(1 / (1 - a))``: the lower the order, the more the unlikely states count.
    """
    shannon, powers = 0.0, 0.0
    for k in range(p.shape[0]):
        if p[k] > 0.0:
            if order == 1.0:
                shannon -= p[k] * np.log(p[k])
            else:
                powers += power_of(p[k], order)
    return np.exp(shannon) if order == 1.0 else powers ** (1.0 / (1.0 - order))


def kld_count(k: int, error: float, confidence: float) -> int:
    """Particles that k occupied bins need.

    Args:
        k: Occupied bins, at least 1; one bin counts as two, for it bounds nothing.
        error: Bound on the divergence [nat], above zero.
        confidence: Probability with which it holds, in (0, 1); a probability, not a quantile.

    Raises:
        ConfigError: If a number is out of its range.
    """
    checks.integer("KLD bins", k, 1, 1_000_000_000)
    checks.number("KLD error", error, 0.0, 10.0, above_low=True)
    checks.number("KLD confidence", confidence, 0.0, 1.0, above_low=True)
    checks.number("KLD confidence", confidence, 0.0, 1.0 - 1e-12)
    return int(np.ceil(max(1.0, wilson_hilferty(k, float(ndtri(confidence)), error))))


@njit(cache=True, nogil=True)
def draw_until(
    wheel: NDArray[np.float64],
    bins: NDArray[np.int64],
    pointers: NDArray[np.float64],
    z: float,
    error: float,
    n_min: int,
    seen: NDArray[np.bool_],
    out: NDArray[np.intp],
) -> int:
    """KLD sampling: draw particle after particle until there are enough; returns how many.

    Args:
        wheel: ``(M,)``; cumulative weights.
        bins: ``(M,)``; bin of each particle.
        pointers: ``(n_max,)`` in [0, 1), independent.
        z: Normal quantile of the confidence.
        error: Bound on the divergence [nat].
        n_min: Fewest.
        seen: ``(bins,)`` of false, overwritten.
        out: ``(n_max,)``, overwritten with indices.
    """
    k, wanted = 0, float(n_min)
    last = wheel.shape[0] - 1
    while last > 0 and wheel[last - 1] == wheel[last]:
        last -= 1
    for n in range(pointers.shape[0]):
        if n >= wanted and n >= n_min:
            return n
        index = min(np.searchsorted(wheel, pointers[n] * wheel[-1], side="right"), last)
        out[n] = index
        if not seen[bins[index]]:
            seen[bins[index]] = True
            k += 1
            wanted = max(wanted, wilson_hilferty(k, z, error))
    return pointers.shape[0]
