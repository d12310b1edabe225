"""Kernels that weigh a belief by a scan: look-ups, and a product or a sum over the beams.

Beam b of a robot heading along bin k looks along direction ``(per_heading k + offsets[b]) mod D``.
``rows`` says which row of the likelihoods each place has there: for each place and each *phase*
(direction modulo ``per_heading``) the directions of that phase in the order of the headings, K of
them, and the first LANES again: so neighbouring headings ask for neighbouring rows, whichever beam.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import (
    N_LANES,
    add,
    any_above,
    fill,
    load,
    look_up,
    mul,
    store,
    total,
    widened,
)

ROOM = 1 << 12  # Likelihoods that are kept at a time: what fits the fastest memory.
BLOCK = 512  # States whose products are taken side by side.


@njit(cache=True, nogil=True)
def sort_out(
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
    power: float,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.float64], bool, float, float]:
    """The beams of a scan that count.

    Args:
        readings: ``(B,)``; -1 for none.
        weights: ``(B,)``; how much each counts.
        power: What most count.
        low: ``(Z,)``; logarithm of the least likelihood to that power of each reading, and
        high: ``(Z,)``; of the largest.

    Returns:
        ``(A,)`` each: which beams, their readings and weights; whether all have that weight; and
        the logarithms of the least and of the largest product that there can be then.
    """
    beams, n = np.empty(readings.shape[0], dtype=np.intp), 0
    some, counts = np.empty_like(readings), np.empty_like(weights)
    alike, lowest, highest = True, 0.0, 0.0
    for b in range(readings.shape[0]):
        z = readings[b]
        if z >= 0 and weights[b] > 0.0:
            beams[n], some[n], counts[n] = b, z, weights[b]
            n += 1
            alike &= weights[b] == power
            lowest += low[z]
            highest += high[z]
    return beams[:n], some[:n], counts[:n], alike, lowest, highest


@njit(cache=True, nogil=True)
def _slots_of(
    readings: NDArray[np.int32], phase: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which beams ask for the same likelihoods: those that read alike in one phase.

    Args:
        readings: ``(A,)``; of the beams, and
        phase: ``(A,)``; theirs.

    Returns:
        ``(S,)``; the first beam of each such slot, and ``(A,)``; the slot of each beam.
    """
    asker, slot, n = np.empty_like(readings, dtype=np.int64), np.empty_like(readings, np.int64), 0
    for b in range(readings.shape[0]):
        slot[b] = n
        for s in range(n):
            if readings[asker[s]] == readings[b] and phase[asker[s]] == phase[b]:
                slot[b] = s
        if slot[b] == n:
            asker[n] = b
            n += 1
    return asker[:n], slot


@njit(cache=True, nogil=True)
def _asks(
    n_headings: int, width: int, offsets: NDArray[np.int32], per_heading: int
) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """For which directions beams ask: the first ``(A, G)`` of each lane group, in its phase.

    Returns:
        Those, and ``(A,)``; where each beam's phase begins among a place's rows.
    """
    asks = np.empty((offsets.shape[0], width // N_LANES), dtype=np.uint64)
    of_phase = np.empty(offsets.shape[0], dtype=np.uint64)
    for b in range(offsets.shape[0]):
        ahead, phase = divmod(offsets[b], per_heading)
        of_phase[b] = phase * (n_headings + N_LANES)
        for g in range(asks.shape[1]):
            asks[b, g] = (g * N_LANES + ahead) % n_headings
    return asks, of_phase


@njit(cache=True, nogil=True)
def _alive(of: NDArray[np.float32], at: np.uint64, alive: NDArray[np.uint64]) -> int:
    """Which lane groups of a cell hold anything, and how many."""
    n, nothing = 0, fill(of.dtype.type(0))
    for g in range(np.uint64(alive.shape[0])):
        alive[n] = g
        n += any_above(load(of, at + g * LANES), nothing)
    return n


@njit(cache=True, nogil=True)
def multiply(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    n_headings: int,
    width: int,
    rows: NDArray[np.uint16],
    p: NDArray[np.float32],
    n_rows: int,
    readings: NDArray[np.int32],
    offsets: NDArray[np.int32],
    per_heading: int,
    scale: float,
) -> float:
    """bel(x) = scale p(z | x) bel(x), a product over the beams; returns its sum.

    Where most lane groups of a cell hold anything, each direction is looked up once, for all beams
    that read alike: that nothing is in range above all.

    Args:
        values: ``(P * W,)``, overwritten.
        places: Of ``values``.
        n: How many.
        n_headings: K.
        width: W.
        rows: ``(P * per_heading * (K + LANES) + LANES,)``; unsigned.
        p: ``(Z * R,)`` of likelihoods.
        n_rows: R.
        readings: ``(A,)``; row of ``p`` for each beam.
        offsets: ``(A,)``.
        per_heading: Directions per heading bin.
        scale: What every state is multiplied by besides.
    """
    w, stretch, n_beams = np.uint64(width), np.uint64(n_headings) + LANES, readings.shape[0]
    asker, slot = _slots_of(readings, offsets % per_heading)
    asks, of_phase = _asks(n_headings, width, offsets, per_heading)
    reading = readings.astype(np.uint64) * np.uint64(n_rows)
    per_place, room = np.uint64(per_heading) * stretch, np.uint64(asker.shape[0]) * stretch
    at_once = max(1, ROOM // max(1, asker.shape[0] * (n_headings + N_LANES)))
    alive = np.empty((at_once, width // N_LANES), dtype=np.uint64)
    n_alive = np.empty(at_once, dtype=np.int64)
    kept = np.empty(np.uint64(at_once) * room + LANES, dtype=values.dtype)
    factor, sums = fill(values.dtype.type(scale)), fill(0.0)
    for begin in range(0, n, at_once):
        some = places[begin : min(n, begin + at_once)]
        # All that is looked up comes first: what was just written is slow to read at other places.
        for c in range(some.shape[0]):
            here, to = np.uint64(some[c]) * per_place, np.uint64(c) * room
            n_alive[c] = _alive(values, np.uint64(some[c]) * w, alive[c])
            for s in range(asker.shape[0] if 2 * n_alive[c] > alive.shape[1] else 0):
                at = here + of_phase[asker[s]]
                for k in range(np.uint64(0), stretch - LANES, LANES):
                    store(kept, to + k, look_up(p, reading[asker[s]], rows, at + k))
                store(kept, to + stretch - LANES, load(kept, to))
                to += stretch
        for c in range(some.shape[0]):
            at, of = np.uint64(some[c]) * w, fill(values.dtype.type(0))
            here, keeps = np.uint64(some[c]) * per_place, 2 * n_alive[c] > alive.shape[1]
            for i in range(n_alive[c]):
                g = alive[c, i]
                part = mul(factor, load(values, at + g * LANES))
                if keeps:
                    for b in range(n_beams):
                        to = np.uint64(c) * room + np.uint64(slot[b]) * stretch
                        part = mul(part, load(kept, to + asks[b, g]))
                else:
                    for b in range(n_beams):
                        to = here + of_phase[b] + asks[b, g]
                        part = mul(part, look_up(p, reading[b], rows, to))
                store(values, at + g * LANES, part)
                of = add(of, part)
            sums = add(sums, widened(of))
    return total(sums)


@njit(cache=True, nogil=True)
def add_logarithms(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    n_headings: int,
    width: int,
    rows: NDArray[np.uint16],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    offsets: NDArray[np.int32],
    weights: NDArray[np.float64],
    per_heading: int,
) -> tuple[float, float]:
    """bel(x) = p(z | x) bel(x), not yet normalised; returns its sum and the shift of its logarithm.

    The evidence log p(z) is log(sum) + shift. The largest log-likelihood on the support becomes
    exp(0), so the sum cannot underflow. Impossible evidence (sum 0) leaves ``values`` as it was.

    Args:
        values: ``(P * W,)``, overwritten.
        places: Of ``values``.
        n: How many.
        n_headings: K.
        width: W.
        rows: ``(P * per_heading * (K + LANES) + LANES,)``; unsigned.
        log_p: ``(Z, R)``.
        readings: ``(A,)``; row of ``log_p`` for each beam.
        offsets: ``(A,)``.
        weights: ``(A,)``; how much each reading counts.
        per_heading: Directions per heading bin.
    """
    stretch, shift = n_headings + N_LANES, -np.inf
    score = np.empty((n, n_headings))
    for c in range(n):
        for k in range(n_headings):
            score[c, k] = -np.inf
            if values[places[c] * width + k] > 0.0:
                score[c, k] = 0.0
                for b in range(readings.shape[0]):
                    ahead, phase = divmod(offsets[b], per_heading)
                    of = (places[c] * per_heading + phase) * stretch
                    row = rows[of + (k + ahead) % n_headings]
                    score[c, k] += weights[b] * log_p[readings[b], row]
                shift = max(shift, score[c, k])
    if shift == -np.inf:
        return 0.0, shift
    total = 0.0
    for c in range(n):
        for k in range(n_headings):
            s = places[c] * width + k
            if values[s] > 0.0:
                values[s] *= np.exp(score[c, k] - shift)
                total += values[s]
    return total, shift


@njit(cache=True, nogil=True)
def mean_product(
    rows: NDArray[np.uint16],
    beams: NDArray[np.intp],
    p: NDArray[np.float32],
    readings: NDArray[np.int32],
    scale: float,
) -> float:
    """Mean over states of scale times the product of the beams' likelihoods.

    Args:
        rows: ``(B, S)``; row of the table for each beam and state, a multiple of LANES of these.
        beams: ``(A,)``; which beams.
        p: ``(Z, R)``.
        readings: ``(A,)``; row of ``p`` for each of them.
        scale: What every product is multiplied by.
    """
    table, n_states, sums = p.ravel(), np.uint64(rows.shape[1]), fill(0.0)
    flat, n_rows, product = rows.ravel(), np.uint64(p.shape[1]), np.empty(BLOCK, p.dtype)
    for first in range(np.uint64(0), n_states, np.uint64(BLOCK)):
        n = min(np.uint64(BLOCK), n_states - first)
        product[:] = scale
        # Beam by beam: the likelihoods of one reading stay in the fastest memory.
        for b in range(beams.shape[0]):
            at = np.uint64(beams[b]) * n_states + first
            begin = np.uint64(readings[b]) * n_rows
            for i in range(np.uint64(0), n, LANES):
                more = look_up(table, begin, flat, at + i)
                store(product, i, mul(load(product, i), more))
        for i in range(np.uint64(0), n, LANES):
            sums = add(sums, widened(load(product, i)))
    return total(sums) / rows.shape[1]


@njit(cache=True, nogil=True)
def log_mean(
    rows: NDArray[np.uint16],
    beams: NDArray[np.intp],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> float:
    """Logarithm of the mean over states of the beams' weighted likelihood; -inf if it is zero.

    Args:
        rows: ``(B, S)``; row of the table for each beam and state.
        beams: ``(A,)``; which beams.
        log_p: ``(Z, R)``.
        readings: ``(A,)`` of bins.
        weights: ``(A,)``.
    """
    shift, total = -np.inf, 0.0
    for s in range(rows.shape[1]):
        score = 0.0
        for b in range(beams.shape[0]):
            score += weights[b] * log_p[readings[b], rows[beams[b], s]]
        if score == -np.inf:
            continue
        if score > shift:
            total *= np.exp(shift - score)
            shift = score
        total += np.exp(score - shift)
    return shift + np.log(total / rows.shape[1]) if total > 0.0 else -np.inf
