"""Kernels that weigh a belief on planes by a scan: look-ups, and a product or a sum over the beams.

Beam b of a robot heading along bin k looks along direction ``(per_heading k + offsets[b]) mod D``;
``row`` says, plane by plane of directions, which row of the likelihoods each place has there.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import CHUNK, by_chunk, clear_rest, collect
from activeloc.beliefs.plane_motion import mark_turned, turn_run

SHORT = 16  # Runs up to this long are gone through state by state, skipping the empty ones.


@njit(cache=True, nogil=True)
def _multiply_run(
    of: NDArray[np.float32],
    by: np.float32,
    row: NDArray[np.uint16],
    starts: NDArray[np.int64],
    p: NDArray[np.float32],
    readings: NDArray[np.int32],
    sums: NDArray[np.float64],
) -> None:
    """Weigh one run; see :func:`multiply`.

    Args:
        of: ``(length,)``, overwritten.
        by: ``scale``, of the belief's precision.
        row: See there.
        starts: ``(A,)``; where the rows of each beam begin.
        p: See there.
        readings: See there.
        sums: ``(CHUNK,)``; added to.
    """
    length, n_beams = of.shape[0], readings.shape[0]
    if length <= SHORT:
        for i in range(length):
            if of[i] > 0.0:
                q = of[i] * by
                for b in range(n_beams):
                    q *= p[readings[b], row[np.uint64(starts[b] + i)]]
                of[i] = q
                sums[i] += q
        return
    b = 0
    while b < n_beams:
        # Four beams in one pass, or three, so that few are left alone.
        left = n_beams - b
        many = min(4, left) if left != 5 else 3
        row_a, p_a = row[starts[b] :], p[readings[b]]
        row_b, p_b = row_a, p_a
        row_c, p_c = row_a, p_a
        if many > 1:
            row_b, p_b = row[starts[b + 1] :], p[readings[b + 1]]
        if many > 2:
            row_c, p_c = row[starts[b + 2] :], p[readings[b + 2]]
        if many == 4:
            row_d, p_d = row[starts[b + 3] :], p[readings[b + 3]]
            for i in range(length):
                of[i] *= (p_a[row_a[i]] * p_b[row_b[i]]) * (p_c[row_c[i]] * p_d[row_d[i]])
        elif many == 3:
            for i in range(length):
                of[i] *= (p_a[row_a[i]] * p_b[row_b[i]]) * p_c[row_c[i]]
        elif many == 2:
            for i in range(length):
                of[i] *= p_a[row_a[i]] * p_b[row_b[i]]
        else:
            for i in range(length):
                of[i] *= p_a[row_a[i]]
        b += many
    for i in range(length):
        of[i] *= by
        sums[i] += of[i]


@njit(cache=True, nogil=True)
def multiply(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    first: int,
    taps: NDArray[np.float32],
    row: NDArray[np.uint16],
    p: NDArray[np.float32],
    readings: NDArray[np.int32],
    offsets: NDArray[np.int32],
    per_heading: int,
    scale: float,
    out: NDArray[np.float32],
    out_runs: NDArray[np.int32],
    n_out: int,
    flags: NDArray[np.uint8],
) -> tuple[int, float]:
    """bel(x) = scale p(z | x) bel(x), a product over the beams, after a turn.

    Args:
        values: ``(K * P,)``; overwritten if there is no turn.
        runs: Of ``values``.
        n: How many.
        size: P.
        first: Of the turn, and
        taps: ``(J,)``; see :func:`plane_motion.rotate`. No turn if there is none.
        row: ``(D * P,)``.
        p: ``(Z, R)`` of likelihoods.
        readings: ``(A,)``; row of ``p`` for each beam.
        offsets: ``(A,)``.
        per_heading: Directions per heading bin.
        scale: What every state is multiplied by besides.
        out: ``(K * P,)``, overwritten after a turn.
        out_runs: What ``out`` holds before; overwritten with what it holds afterwards.
        n_out: How many runs that was.
        flags: Zeros.

    Returns:
        How many runs the belief has now, and its sum.
    """
    n_directions, n_headings = row.shape[0] // size, values.shape[0] // size
    turns = taps.shape[0] > 0
    if turns:
        mark_turned(runs, n, size, n_headings, first, taps, flags)
        clear_rest(out, out_runs, n_out, flags)
        n = collect(flags, size, out_runs)
        runs = out_runs
    by, sums = values.dtype.type(scale), np.zeros(CHUNK)
    starts, held = np.empty(readings.shape[0], dtype=np.int64), out if turns else values
    # A chunk of places for all headings: the directions' rows stay in fast memory.
    for r in by_chunk(runs, n, size):
        k = runs[r, 0] // size
        of = held[runs[r, 0] : runs[r, 1]]
        if turns:
            turn_run(values, size, runs[r, 0], first, taps, of)
        for b in range(readings.shape[0]):
            direction = (k * per_heading + offsets[b]) % n_directions
            starts[b] = (direction - k) * size + runs[r, 0]
        _multiply_run(of, by, row, starts, p, readings, sums)
    return n, sums.sum()


@njit(cache=True, nogil=True)
def add_logarithms(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    row: NDArray[np.uint16],
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
        values: ``(K * P,)``, overwritten.
        runs: Of ``values``.
        n: How many.
        size: P.
        row: ``(D * P,)``.
        log_p: ``(Z, R)``.
        readings: ``(A,)``; row of ``log_p`` for each beam.
        offsets: ``(A,)``.
        weights: ``(A,)``; how much each reading counts.
        per_heading: Directions per heading bin.
    """
    n_directions = row.shape[0] // size
    shift, states = -np.inf, 0
    for r in range(n):
        states += runs[r, 1] - runs[r, 0]
    score, at = np.empty(states), 0
    for r in range(n):
        k = runs[r, 0] // size
        for s in range(runs[r, 0], runs[r, 1]):
            if values[s] > 0.0:
                score[at] = 0.0
                for b in range(readings.shape[0]):
                    there = ((k * per_heading + offsets[b]) % n_directions - k) * size + s
                    score[at] += weights[b] * log_p[readings[b], row[there]]
                shift = max(shift, score[at])
            at += 1
    if shift == -np.inf:
        return 0.0, shift
    total, at = 0.0, 0
    for r in range(n):
        for s in range(runs[r, 0], runs[r, 1]):
            if values[s] > 0.0:
                values[s] *= np.exp(score[at] - shift)
                total += values[s]
            at += 1
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
        rows: ``(B, S)``; row of the table for each beam and state.
        beams: ``(A,)``; which beams.
        p: ``(Z, R)``.
        readings: ``(A,)``; row of ``p`` for each of them.
        scale: What every product is multiplied by.
    """
    n_states, chunk = rows.shape[1], 1024
    sums, product = np.zeros(chunk), np.empty(chunk, dtype=p.dtype)
    for first in range(0, n_states, chunk):
        length = min(chunk, n_states - first)
        product[:] = scale
        for b in range(beams.shape[0]):
            at, of = rows[beams[b], first : first + length], p[readings[b]]
            for i in range(length):
                product[i] *= of[at[i]]
        for i in range(length):
            sums[i] += product[i]
    return sums.sum() / n_states


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
