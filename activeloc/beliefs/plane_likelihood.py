"""Kernels that weigh a belief on planes by a scan: look-ups, and a product or a sum over the beams.

Beam b of a robot heading along bin k looks along direction ``(per_heading k + offsets[b]) mod D``;
``row`` says, plane by plane of directions, which row of the likelihoods each place has there.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, CHUNK, add_up, clear_rest, collect, holds
from activeloc.beliefs.plane_tiles import WIDE, store_tile, tiles_of
from activeloc.beliefs.plane_turns import Turning, scratch_of, turn_tile

ROOM = 1 << 15  # Likelihoods of a tile that are kept at a time: what fits fast memory.


@njit(cache=True, nogil=True)
def _slots_of(
    readings: NDArray[np.int32],
    n_directions: int,
    first: NDArray[np.int64],
    is_shared: NDArray[np.bool_],
) -> int:
    """Where likelihoods are kept: by direction for readings of several beams; returns how many.

    Args:
        readings: ``(A,)``; of the beams.
        n_directions: D.
        first: ``(A,)``, overwritten with the first slot of each beam's reading.
        is_shared: ``(A,)``, overwritten with whether it has D of them, as another beam reads it
            too. A reading that comes once is looked up once a direction, and has one.
    """
    n = 0
    for b in range(readings.shape[0]):
        is_shared[b], earlier = False, -1
        for other in range(readings.shape[0]):
            if other != b and readings[other] == readings[b]:
                is_shared[b] = True
                earlier = other if other < b and earlier < 0 else earlier
        first[b] = n if earlier < 0 else first[earlier]
        if earlier < 0:
            n += n_directions if is_shared[b] else 1
    return n


@njit(cache=True, nogil=True)
def _look_up(
    row: NDArray[np.uint16],
    at: np.uint64,
    p: NDArray[np.float32],
    out: NDArray[np.float32],
    to: np.uint64,
    n: np.uint64,
) -> None:
    """Likelihoods ``p (R,)`` of one reading along a stretch of rows."""
    for i in range(n):
        out[to + i] = p[row[at + i]]


@njit(cache=True, nogil=True, inline="always")
def _weigh_row(
    of: NDArray[np.float32],
    at: np.uint64,
    n: np.uint64,
    by: NDArray[np.float32],
    where: NDArray[np.uint64],
) -> None:
    """Multiply a row by the likelihoods of all beams, four in one pass.

    Args:
        of: Overwritten from ``at`` on,
        at: see above,
        n: so many.
        by: Likelihoods; those of each beam from
        where: ``(A,)`` on.
    """
    left, b = where.shape[0], 0
    while left > 0:
        many = min(left, 4)
        i0, i1 = where[b], where[b + min(1, many - 1)]
        i2, i3 = where[b + min(2, many - 1)], where[b + many - 1]
        if many == 4:
            for i in range(n):
                of[at + i] *= (by[i0 + i] * by[i1 + i]) * (by[i2 + i] * by[i3 + i])
        elif many == 3:
            for i in range(n):
                of[at + i] *= (by[i0 + i] * by[i1 + i]) * by[i2 + i]
        elif many == 2:
            for i in range(n):
                of[at + i] *= by[i0 + i] * by[i1 + i]
        else:
            for i in range(n):
                of[at + i] *= by[i0 + i]
        b, left = b + many, left - many


@njit(cache=True, nogil=True)
def _scale(
    of: NDArray[np.float32], n: np.uint64, factor: float | np.floating, sums: NDArray[np.float64]
) -> None:
    """Multiply the first n of a tile by a factor and add them up, in many parts at once."""
    step = np.uint64(CHUNK)
    for first in range(np.uint64(0), n, step):
        many = min(step, n - first)
        for i in range(many):
            of[first + i] *= factor
        add_up(of, first, many, sums)


@njit(cache=True, nogil=True)
def _directions(
    n_headings: int, n_directions: int, per_heading: int, offsets: NDArray[np.int32]
) -> NDArray[np.int64]:
    """``(K, A)``; along which direction each heading's beams look."""
    out = np.empty((n_headings, offsets.shape[0]), dtype=np.int64)
    for k in range(n_headings):
        for b in range(offsets.shape[0]):
            out[k, b] = (k * per_heading + offsets[b]) % n_directions
    return out


@njit(cache=True, nogil=True)
def multiply(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    turning: Turning,
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

    What several beams read, that nothing is in range above all, is looked up once in a tile for
    each direction, whichever beam and heading asks.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``.
        n: How many.
        size: P.
        turning: The turn; see :func:`plane_turns.rotate`.
        row: ``(D * P,)``.
        p: ``(Z, R)`` of likelihoods.
        readings: ``(A,)``; row of ``p`` for each beam.
        offsets: ``(A,)``.
        per_heading: Directions per heading bin.
        scale: What every state is multiplied by besides.
        out: ``(K * P,)``, overwritten; may be ``values``, and ``out_runs`` the runs.
        out_runs: What ``out`` holds before; overwritten with what it holds afterwards.
        n_out: How many runs that was.
        flags: Zeros.

    Returns:
        How many runs the belief has now, and its sum.
    """
    n_directions, n_headings = row.shape[0] // size, values.shape[0] // size
    n_beams = readings.shape[0]
    slots, is_shared = np.empty(n_beams, dtype=np.int64), np.empty(n_beams, dtype=np.bool_)
    n_slots = max(1, _slots_of(readings, n_directions, slots, is_shared))
    tiles, alive = tiles_of(runs, n, size, n_headings, 1 if turning.n_flat > 0 else WIDE)
    scratch = scratch_of(values, size, turning, tiles)
    # A wide tile is weighed in strips, so that the likelihoods of one stay in fast memory.
    strip = np.uint64(max(1, ROOM // (n_slots * BLOCK)) * BLOCK)
    known, strips = np.full(n_slots, -1, dtype=np.int32), 0
    by, sums = np.empty(n_slots * int(strip), dtype=values.dtype), np.zeros(CHUNK // 4)
    where, factor = np.empty(n_beams, dtype=np.uint64), values.dtype.type(scale)
    directions = _directions(n_headings, n_directions, per_heading, offsets)
    for t in range(tiles.shape[0]):
        first, n_rows = turn_tile(values, size, tiles[t], alive[t], turning, scratch)
        of, length = scratch.turned, np.uint64(tiles[t, 1] - tiles[t, 0])
        for begin in range(np.uint64(0), length if n_beams > 0 else np.uint64(0), strip):
            k, wide = first, min(strip, length - begin)
            strips += 1
            for i in range(n_rows):
                at = np.uint64(i) * length + begin
                if holds(of, at, wide):
                    for b in range(n_beams):
                        slot = np.uint64(slots[b] + (directions[k, b] if is_shared[b] else 0))
                        where[b] = slot * strip
                        if known[slot] != strips or not is_shared[b]:
                            known[slot] = strips
                            here = np.uint64(directions[k, b] * size + tiles[t, 0]) + begin
                            _look_up(row, here, p[readings[b]], by, where[b], wide)
                    # Loops of a known length are twice as fast where they are short.
                    if wide == BLOCK:
                        _weigh_row(of, at, np.uint64(BLOCK), by, where)
                    else:
                        _weigh_row(of, at, wide, by, where)
                k = k + 1 if k + 1 < n_headings else 0
        _scale(of, np.uint64(n_rows) * length, factor, sums)
        store_tile(of, n_rows, first, tiles[t], out, size, flags)
    clear_rest(out, out_runs, n_out, flags)
    return collect(flags, size, out_runs), sums.sum()


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
