"""Kernels of the histogram filter, for one robot.

A belief is ``bel[c, k]``: cell c of the pose grid, heading bin k. ``live[:n]`` lists the cells that
hold any mass; every kernel's cost follows that list, not the map. Kernels draw nothing, raise
nothing and return what a caller needs to know as numbers.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def rotate(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    first: int,
    taps: NDArray[np.float64],
) -> None:
    """bel(c, k) = sum over j of taps[j] bel(c, k - first - j), around the circle, in place.

    Args:
        bel: ``(C, K)``.
        live: ``(n,)`` of cells.
        first: Shift of the first tap [bin].
        taps: ``(J,)``, summing to one.
    """
    n_headings = bel.shape[1]
    row = np.empty(n_headings, dtype=np.float64)
    for c in live:
        row[:] = 0.0
        for j in range(taps.shape[0]):
            shift = (first + j) % n_headings
            w = taps[j]
            for k in range(n_headings - shift):
                row[k + shift] += w * bel[c, k]
            for k in range(n_headings - shift, n_headings):
                row[k + shift - n_headings] += w * bel[c, k]
        for k in range(n_headings):
            bel[c, k] = row[k]


@njit(cache=True, nogil=True)
def translate(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    out: NDArray[np.float32],
    out_live: NDArray[np.int32],
    turned: int,
    cells: NDArray[np.int32],
    index: NDArray[np.int32],
    stencil_start: NDArray[np.int64],
    stencil_step: NDArray[np.int32],
    stencil_weight: NDArray[np.float32],
    row_start: NDArray[np.int64],
    target: NDArray[np.int32],
    weight: NDArray[np.float32],
    clipped: float,
) -> int:
    """out(x') = sum over x of (free + clipped * stopped)(x' | x) bel(x); returns its live cells.

    ``bel`` is left empty, to be the next call's ``out``.

    Args:
        bel: ``(C, K)``, overwritten with zeros.
        live: ``(n,)`` of cells.
        out: ``(C, K)``, zeros, overwritten.
        out_live: ``(C,)``, overwritten with the cells that mass has come to.
        turned: Heading bins between the robot's heading and the way it travels: 0, or K / 2 back.
        cells: ``(C, 2)``.
        index: ``(rows, cols)``.
        stencil_start: ``(K + 1,)``; see :class:`Travel` for these six.
        stencil_step: ``(E, 2)``.
        stencil_weight: ``(E,)``.
        row_start: ``(C * K + 1,)``.
        target: ``(N,)``.
        weight: ``(2, N)``.
        clipped: Weight of ways that an obstacle cuts short, in [0, 1].
    """
    n_headings = bel.shape[1]
    reached = np.zeros(bel.shape[0], dtype=np.bool_)
    n = 0
    for c in live:
        row, col = cells[c]
        for k in range(n_headings):
            p = bel[c, k]
            if p <= 0.0:
                continue
            bel[c, k] = 0.0
            way = (k + turned) % n_headings
            start, stop = row_start[c * n_headings + way], row_start[c * n_headings + way + 1]
            if start == stop:
                for e in range(stencil_start[way], stencil_start[way + 1]):
                    t = index[row + stencil_step[e, 0], col + stencil_step[e, 1]]
                    out[t, k] += p * stencil_weight[e]
                    if not reached[t]:
                        reached[t] = True
                        out_live[n] = t
                        n += 1
            else:
                for e in range(start, stop):
                    t = target[e]
                    out[t, k] += p * (weight[0, e] + clipped * weight[1, e])
                    if not reached[t]:
                        reached[t] = True
                        out_live[n] = t
                        n += 1
    return n


@njit(cache=True, nogil=True)
def weigh(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    factor: NDArray[np.float32],
    floor: float,
) -> float:
    """Multiply bel by ``floor + (1 - floor) factor`` in place; returns the mass that is left."""
    total = 0.0
    for c in live:
        for k in range(bel.shape[1]):
            bel[c, k] *= floor + (1.0 - floor) * factor[c, k]
            total += bel[c, k]
    return total


@njit(cache=True, nogil=True)
def correct(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    row: NDArray[np.int32],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    offsets: NDArray[np.int32],
    weights: NDArray[np.float64],
    per_heading: int,
    score: NDArray[np.float64],
) -> tuple[float, float]:
    """bel(x) = p(z | x) bel(x), not yet normalised; returns its sum and the shift of its logarithm.

    The evidence log p(z) is log(sum) + shift. The largest log-likelihood on the support becomes
    exp(0), so the sum cannot underflow. Impossible evidence (sum 0) leaves ``bel`` as it was.

    Args:
        bel: ``(C, K)``, overwritten.
        live: ``(n,)`` of cells.
        row: ``(C, D)``; row of the table for each cell and direction.
        log_p: ``(Z, R)``.
        readings: ``(B,)`` of bins; -1 for no reading.
        offsets: ``(B,)``; directions from a heading to each beam.
        weights: ``(B,)``; how much each reading counts.
        per_heading: Directions per heading bin.
        score: ``(C, K)``, overwritten with log-likelihoods where there is mass.
    """
    n_headings, n_directions = bel.shape[1], row.shape[1]
    shift = -np.inf
    for c in live:
        for k in range(n_headings):
            if bel[c, k] > 0.0:
                total = 0.0
                for b in range(readings.shape[0]):
                    if readings[b] >= 0 and weights[b] > 0.0:
                        d = (k * per_heading + offsets[b]) % n_directions
                        total += weights[b] * log_p[readings[b], row[c, d]]
                score[c, k] = total
                shift = max(shift, total)
    if shift == -np.inf:
        return 0.0, shift
    total = 0.0
    for c in live:
        for k in range(n_headings):
            if bel[c, k] > 0.0:
                bel[c, k] *= np.exp(score[c, k] - shift)
                total += bel[c, k]
    return total, shift


@njit(cache=True, nogil=True)
def normalise(bel: NDArray[np.float32], live: NDArray[np.int32], total: float, least: float) -> int:
    """Divide by ``total``, drop states under ``least``, keep the list of cells that are left.

    Args:
        bel: ``(C, K)``, overwritten.
        live: ``(n,)``, overwritten.
        total: Mass before.
        least: Probability under which a state is emptied.

    Returns:
        Number of live cells.
    """
    kept = 0.0
    for c in live:
        for k in range(bel.shape[1]):
            p = bel[c, k] / total
            if p >= least:
                kept += p
    if kept == 0.0:  # Every state is that small: a wide belief on a large map.
        least, kept = 0.0, 1.0
    n = 0
    for c in live:
        alive = False
        for k in range(bel.shape[1]):
            p = bel[c, k] / total
            bel[c, k] = p / kept if p >= least else 0.0
            if bel[c, k] > 0.0:
                alive = True
        if alive:
            live[n] = c
            n += 1
    return n


@njit(cache=True, nogil=True)
def bin_masses(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    place: NDArray[np.int32],
    place_share: NDArray[np.float32],
    heading: NDArray[np.int32],
    heading_share: NDArray[np.float32],
    out: NDArray[np.float64],
) -> None:
    """Add the belief up in coarser bins.

    Args:
        bel: ``(C, K)``.
        live: ``(n,)``.
        place: ``(C, P)``; places under each cell.
        place_share: ``(C, P)``.
        heading: ``(K, Q)``; heading bins under each of the belief's.
        heading_share: ``(K, Q)``.
        out: ``(places, headings)``, added to.
    """
    row = np.empty(out.shape[1], dtype=np.float64)
    for c in live:
        row[:] = 0.0
        for k in range(bel.shape[1]):
            if bel[c, k] > 0.0:
                for q in range(heading.shape[1]):
                    row[heading[k, q]] += bel[c, k] * heading_share[k, q]
        for i in range(place.shape[1]):
            if place_share[c, i] > 0.0:
                for h in range(out.shape[1]):
                    out[place[c, i], h] += place_share[c, i] * row[h]


@njit(cache=True, nogil=True)
def most_likely(bel: NDArray[np.float32], live: NDArray[np.int32]) -> tuple[int, int]:
    """Cell and heading bin of the largest probability; the first of equals in ``live``'s order."""
    best, cell, heading = -1.0, 0, 0
    for c in live:
        for k in range(bel.shape[1]):
            if bel[c, k] > best:
                best, cell, heading = bel[c, k], c, k
    return cell, heading


@njit(cache=True, nogil=True)
def local_moments(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    angle: float,
    out: NDArray[np.float64],
) -> None:
    """Mass within ``radius`` [m] and ``angle`` [rad] of a pose, and its first moments about it.

    Args:
        bel: ``(C, K)``.
        live: ``(n,)``.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        pose: ``(3,)``.
        radius: Of the window; cells count by their centre.
        angle: Of the window.
        out: ``(4,)``, overwritten: mass, and mass times mean offset in x, y and theta.
    """
    out[:] = 0.0
    for c in live:
        dx, dy = centres[c, 0] - pose[0], centres[c, 1] - pose[1]
        if dx * dx + dy * dy > radius * radius:
            continue
        for k in range(bel.shape[1]):
            turn = (thetas[k] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
            if abs(turn) <= angle:
                p = bel[c, k]
                out[0] += p
                out[1] += p * dx
                out[2] += p * dy
                out[3] += p * turn
