"""A kernel that sums a belief on planes in coarser bins, and takes its entropy there.

Coarse bins are a product: heading bins times rows times columns. So one coarse heading at a time is
added up, its rows are folded into coarse rows, and those into coarse columns; only the stretch of
each row that holds anything is gone through.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import CHUNK


@njit(cache=True, nogil=True)
def _widen(
    start: int, stop: int, cols: int, low: NDArray[np.int32], high: NDArray[np.int32]
) -> None:
    """Widen the stretches ``(rows,)`` that hold anything by places ``start ... stop - 1``."""
    row, col = start // cols, start % cols
    while row < low.shape[0]:
        low[row] = min(low[row], col)
        high[row] = max(high[row], min(cols, col + stop - start))
        start += cols - col
        if start >= stop:
            break
        row, col = row + 1, 0


@njit(cache=True, nogil=True)
def _add_planes(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    first: NDArray[np.int64],
    size: int,
    cols: int,
    weights: NDArray[np.float32],
    plane: NDArray[np.float32],
    low: NDArray[np.int32],
    high: NDArray[np.int32],
) -> None:
    """Add shares of all planes up, a chunk of all of them after the other.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``.
        first: ``(K + 1,)``; where each plane's runs begin.
        size: P.
        cols: Places in a row.
        weights: ``(K,)``; what counts of each plane.
        plane: ``(P,)``, added to.
        low: ``(rows,)``; first column of each row that holds anything,
        high: ``(rows,)``; and one past the last. Both are widened.
    """
    which = np.flatnonzero((weights > 0.0) & (first[1:] > first[:-1]))
    at = first[which]
    # Of a few runs there is nothing to keep at hand.
    chunk = CHUNK if first[-1] > 4 * weights.shape[0] else size
    for begin in range(0, size, chunk):
        for j in range(which.shape[0]):
            k, weight = which[j], weights[which[j]]
            end = k * size + begin + chunk
            while at[j] < first[k + 1] and runs[at[j], 0] < end:
                of, n = np.uint64(runs[at[j], 0]), np.uint64(runs[at[j], 1] - runs[at[j], 0])
                start = runs[at[j], 0] - k * size
                to = np.uint64(start)
                for i in range(n):
                    plane[to + i] += weight * values[of + i]
                _widen(start, start + int(n), cols, low, high)
                at[j] += 1


@njit(cache=True, nogil=True)
def _fold_rows(
    plane: NDArray[np.float32],
    cols: int,
    low: NDArray[np.int32],
    high: NDArray[np.int32],
    bins: NDArray[np.int32],
    shares: NDArray[np.float64],
    folded: NDArray[np.float64],
    span: NDArray[np.int32],
) -> None:
    """Fold a plane's rows into coarse rows; the plane and its stretches are emptied.

    Args:
        plane: ``(P,)``.
        cols: Places in a row.
        low: ``(rows,)``; stretch of each row,
        high: ``(rows,)``.
        bins: ``(rows, W)``; coarse rows under each row, and
        shares: ``(rows, W)`` of it in each.
        folded: ``(coarse rows, cols)``, added to.
        span: ``(coarse rows, 2)``; widened to the columns that are reached.
    """
    for row in range(low.shape[0]):
        if low[row] >= high[row]:
            continue
        of = plane[row * cols + low[row] : row * cols + high[row]]
        for w in range(bins.shape[1]):
            if shares[row, w] > 0.0:
                b = bins[row, w]
                to, share = folded[b, low[row] : high[row]], np.float64(shares[row, w])
                for i in range(of.shape[0]):
                    to[i] += share * of[i]
                span[b, 0], span[b, 1] = min(span[b, 0], low[row]), max(span[b, 1], high[row])
        of[:] = 0.0
        low[row], high[row] = cols, 0


@njit(cache=True, nogil=True)
def first_runs(runs: NDArray[np.int32], n: int, size: int, n_headings: int) -> NDArray[np.int64]:
    """``(K + 1,)``; where each plane's runs begin."""
    first = np.zeros(n_headings + 1, dtype=np.int64)
    for r in range(n):
        first[runs[r, 0] // size + 1] += 1
    for k in range(n_headings):
        first[k + 1] += first[k]
    return first


@njit(cache=True, nogil=True)
def fold(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    cols: int,
    headings: NDArray[np.float64],
    factor: float,
    row_bins: NDArray[np.int32],
    row_shares: NDArray[np.float64],
    col_first: NDArray[np.int32],
    col_shares: NDArray[np.float64],
    w: float,
    uniform: NDArray[np.float64],
    uniform_nats: NDArray[np.float64],
    uniform_entropy: float,
    out: NDArray[np.float64],
) -> float:
    """The belief in coarser bins, or its entropy there.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``.
        n: How many.
        size: P.
        cols: Places in a row.
        headings: ``(H, K)``; share of each heading bin in each coarse one.
        factor: What the belief is multiplied by.
        row_bins: ``(rows, W)``; coarse rows under each row, and
        row_shares: ``(rows, W)`` of it in each.
        col_first: ``(X + 1,)``; first column under each coarse column.
        col_shares: ``(X, M)``; share in it of each of the columns from there.
        w: Weight of the uniform in the belief whose entropy is asked for.
        uniform: ``(Y * X, H)``, summing to one.
        uniform_nats: ``(Y * X, H)``; u log u of each u in ``uniform``, 0 for 0.
        uniform_entropy: Of ``uniform`` [nat].
        out: ``(Y * X, H)``, overwritten with the bins, without the uniform; or empty.

    Returns:
        The entropy of ``(1 - w) belief + w uniform`` [nat].
    """
    n_headings, n_rows = headings.shape[1], row_bins.shape[0]
    n_coarse, n_cols = row_bins.max() + 1, col_shares.shape[0]
    first = first_runs(runs, n, size, n_headings)
    plane, weights = np.zeros(size, dtype=values.dtype), np.empty(n_headings, dtype=values.dtype)
    low, high = np.full(n_rows, cols, dtype=np.int32), np.zeros(n_rows, dtype=np.int32)
    folded = np.zeros((n_coarse, cols + col_shares.shape[1]))
    span = np.empty((n_coarse, 2), dtype=np.int32)
    span[:, 0], span[:, 1] = cols, 0
    h, rest, rest_entropy = 0.0, 1.0, uniform_entropy
    if out.size > 0:
        out[:] = 0.0
    for j in range(headings.shape[0]):
        for k in range(n_headings):
            weights[k] = headings[j, k] * factor
        _add_planes(values, runs, first, size, cols, weights, plane, low, high)
        _fold_rows(plane, cols, low, high, row_bins, row_shares, folded, span)
        for y in range(n_coarse):
            if span[y, 0] >= span[y, 1]:
                continue
            for x in range(n_cols):
                begin = col_first[x]
                if begin >= span[y, 1] or begin + col_shares.shape[1] <= span[y, 0]:
                    continue
                p = 0.0
                for i in range(col_shares.shape[1]):
                    p += col_shares[x, i] * folded[y, col_first[x] + i]
                if p <= 0.0:
                    continue
                if out.size > 0:
                    out[y * n_cols + x, j] = p
                    continue
                if w > 0.0:
                    u = uniform[y * n_cols + x, j]
                    p = (1.0 - w) * p + w * u
                    rest -= u
                    rest_entropy += uniform_nats[y * n_cols + x, j]
                if p > 0.0:
                    h -= p * np.log(p)
            folded[y, span[y, 0] : span[y, 1]] = 0.0
            span[y, 0], span[y, 1] = cols, 0
    # Elsewhere the belief is w u: the sum of -w u (log w + log u) over the bins not visited.
    if w > 0.0:
        h += w * (max(rest_entropy, 0.0) - max(rest, 0.0) * np.log(w))
    return h
