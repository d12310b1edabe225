"""Kernels of the histogram filter on small lattices, for one robot.

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
