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
    n_headings, width = bel.shape[1], index.shape[1]
    at = index.ravel()
    reached = np.zeros(bel.shape[0], dtype=np.bool_)
    for c in live:
        here = cells[c, 0] * width + cells[c, 1]
        for k in range(n_headings):
            p = bel[c, k]
            if p <= 0.0:
                continue
            bel[c, k] = 0.0
            way = (k + turned) % n_headings
            start, stop = row_start[c * n_headings + way], row_start[c * n_headings + way + 1]
            # Unsigned, so that no look-up asks whether it counts from the end.
            if start == stop:
                for e in range(stencil_start[way], stencil_start[way + 1]):
                    there = here + stencil_step[e, 0] * width + stencil_step[e, 1]
                    t = np.uint64(at[np.uint64(there)])
                    out[t, k] += p * stencil_weight[e]
                    reached[t] = True
            else:
                for e in range(np.uint64(start), np.uint64(stop)):
                    t = np.uint64(target[e])
                    out[t, k] += p * (weight[0, e] + clipped * weight[1, e])
                    reached[t] = True
    n = 0
    for i in range(reached.shape[0]):
        if reached[i]:
            out_live[n] = i
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
def multiply(
    bel: NDArray[np.float32],
    live: NDArray[np.int32],
    row: NDArray[np.int32],
    p: NDArray[np.float64],
    readings: NDArray[np.int32],
    offsets: NDArray[np.int32],
    per_heading: int,
    scale: float,
) -> float:
    """bel(x) = scale p(z | x) bel(x), a product over the beams, in place; returns its sum.

    Args:
        bel: ``(C, K)``, overwritten.
        live: ``(n,)`` of cells.
        row: ``(C, D)``; row of the table for each cell and direction.
        p: ``(Z, R)`` of likelihoods.
        readings: ``(A,)`` of bins.
        offsets: ``(A,)``; directions from a heading to each beam.
        per_heading: Directions per heading bin.
        scale: What every state is multiplied by besides.
    """
    n_headings, n_directions = bel.shape[1], row.shape[1]
    product = np.empty(n_headings, dtype=np.float64)
    total = 0.0
    for c in live:
        for k in range(n_headings):
            product[k] = scale * bel[c, k]
        for b in range(readings.shape[0]):
            likelihood = p[readings[b]]
            d = offsets[b] % n_directions
            for k in range(n_headings):
                if product[k] > 0.0:
                    # Unsigned, so that no look-up asks whether it counts from the end.
                    product[k] *= likelihood[np.uint64(row[c, np.uint64(d)])]
                d += per_heading
                if d >= n_directions:
                    d -= n_directions
        for k in range(n_headings):
            bel[c, k] = product[k]
            total += product[k]
    return total


@njit(cache=True, nogil=True)
def mean_product(
    rows: NDArray[np.int32],
    beams: NDArray[np.intp],
    p: NDArray[np.float64],
    readings: NDArray[np.int32],
    scale: float,
) -> float:
    """Mean over states of scale times the product of the beams' likelihoods.

    Args:
        rows: ``(S, B)``; row of the table for each state and beam.
        beams: ``(A,)``; which beams.
        p: ``(Z, R)``.
        readings: ``(A,)`` of bins.
        scale: What every product is multiplied by.
    """
    total = 0.0
    for s in range(rows.shape[0]):
        product = scale
        for b in range(beams.shape[0]):
            product *= p[readings[b], rows[s, beams[b]]]
        total += product
    return total / rows.shape[0]


@njit(cache=True, nogil=True)
def log_mean(
    rows: NDArray[np.int32],
    beams: NDArray[np.intp],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> float:
    """Logarithm of the mean over states of the beams' weighted likelihood; -inf if it is zero.

    Args:
        rows: ``(S, B)``; row of the table for each state and beam.
        beams: ``(A,)``; which beams.
        log_p: ``(Z, R)``.
        readings: ``(A,)`` of bins.
        weights: ``(A,)``.
    """
    shift, total = -np.inf, 0.0
    for s in range(rows.shape[0]):
        score = 0.0
        for b in range(beams.shape[0]):
            score += weights[b] * log_p[readings[b], rows[s, beams[b]]]
        if score == -np.inf:
            continue
        if score > shift:
            total *= np.exp(shift - score)
            shift = score
        total += np.exp(score - shift)
    return shift + np.log(total / rows.shape[0]) if total > 0.0 else -np.inf


@njit(cache=True, nogil=True)
def normalise(
    bel: NDArray[np.float32], live: NDArray[np.int32], total: float, least: float
) -> tuple[int, float]:
    """Divide by ``total``, drop states under ``least``, keep the list of cells that are left.

    Args:
        bel: ``(C, K)``, overwritten.
        live: ``(n,)``, overwritten.
        total: Mass before.
        least: Probability under which a state is emptied.

    Returns:
        Number of live cells, and the mass that was kept of one.
    """
    kept = 0.0
    for c in live:
        for k in range(bel.shape[1]):
            p = bel[c, k] / total
            kept += p if p >= least else 0.0
    if kept == 0.0:  # Every state is that small: a wide belief on a large map.
        least, kept = 0.0, 1.0
    n = 0
    for c in live:
        largest = 0.0
        for k in range(bel.shape[1]):
            p = bel[c, k] / total
            p = p / kept if p >= least else 0.0
            bel[c, k] = p
            largest = max(largest, p)
        if largest > 0.0:
            live[n] = c
            n += 1
    return n, kept


@njit(cache=True, nogil=True)
def mass(bel: NDArray[np.float32], live: NDArray[np.int32]) -> float:
    """Sum of the belief over its live cells."""
    total = 0.0
    for c in live:
        for k in range(bel.shape[1]):
            total += bel[c, k]
    return total


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
def mixed_entropy(
    live: NDArray[np.int32],
    place: NDArray[np.int32],
    place_share: NDArray[np.float32],
    masses: NDArray[np.float64],
    w: float,
    uniform: NDArray[np.float64],
    uniform_entropy: float,
) -> float:
    """Entropy of ``(1 - w) masses + w uniform`` [nat]; visits only the bins that have a mass.

    Args:
        live: ``(n,)`` of cells.
        place: ``(C, P)``; places under each cell.
        place_share: ``(C, P)``.
        masses: ``(places, headings)`` of the live cells, overwritten with zeros.
        w: Weight of the uniform, in [0, 1].
        uniform: ``(places, headings)``, summing to one.
        uniform_entropy: Of ``uniform`` [nat].
    """
    h, rest, rest_entropy = 0.0, 1.0, uniform_entropy
    for c in live:
        for i in range(place.shape[1]):
            if place_share[c, i] > 0.0:
                at = place[c, i]
                for j in range(masses.shape[1]):
                    p = masses[at, j]
                    if p > 0.0:
                        masses[at, j] = 0.0
                        if w > 0.0:
                            u = uniform[at, j]
                            p = (1.0 - w) * p + w * u
                            rest -= u
                            if u > 0.0:
                                rest_entropy += u * np.log(u)
                        if p > 0.0:
                            h -= p * np.log(p)
    # Elsewhere the belief is w u: the sum of -w u (log w + log u) over the bins not visited.
    if w > 0.0:
        h += w * (max(rest_entropy, 0.0) - max(rest, 0.0) * np.log(w))
    return h


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
    turns = (thetas - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    for c in live:
        dx, dy = centres[c, 0] - pose[0], centres[c, 1] - pose[1]
        if dx * dx + dy * dy > radius * radius:
            continue
        for k in range(bel.shape[1]):
            if abs(turns[k]) <= angle:
                p = bel[c, k]
                out[0] += p
                out[1] += p * dx
                out[2] += p * dy
                out[3] += p * turns[k]


@njit(cache=True, nogil=True)
def area_near(
    share: NDArray[np.float64],
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    row: float,
    col: float,
    reach: float,
) -> float:
    """Sum of ``share`` over the cells whose centre lies within ``radius`` [m] of a pose.

    Args:
        share: ``(C,)``.
        index: ``(rows, cols)`` of cell or -1.
        centres: ``(C, 2)`` [m].
        pose: ``(3,)``.
        radius: [m].
        row: Where the pose is, and
        col: its column [cell],
        reach: and how far around it to look [cell].
    """
    total = 0.0
    first_row, last_row = max(0.0, row - reach), min(float(index.shape[0]), row + reach + 1.0)
    first_col, last_col = max(0.0, col - reach), min(float(index.shape[1]), col + reach + 1.0)
    for r in range(int(first_row), int(last_row)):
        for c in range(int(first_col), int(last_col)):
            cell = index[r, c]
            if cell >= 0:
                dx, dy = centres[cell, 0] - pose[0], centres[cell, 1] - pose[1]
                if dx * dx + dy * dy <= radius * radius:
                    total += share[cell]
    return total
