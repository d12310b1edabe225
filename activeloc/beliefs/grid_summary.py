"""A kernel that sums a belief in coarser bins, and takes its entropy there.

Coarse bins are a product: rows times columns times heading bins. So one coarse row at a time is
added up, cell by cell with all headings at once, and folded into coarse headings where anything is.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import add, fill, load, mul, store


@njit(cache=True, nogil=True)
def _row_begins(places: NDArray[np.int32], n: int, cols: int, rows: int) -> NDArray[np.int64]:
    """``(rows + 1,)``; where each row's places begin among the first n."""
    begins, row = np.empty(rows + 1, dtype=np.int64), 0
    for c in range(n):
        while places[c] >= row * cols:
            begins[row] = c
            row += 1
    begins[row:] = n
    return begins


@njit(cache=True, nogil=True)
def _add_row(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    first: int,
    last: int,
    row_start: int,
    width: int,
    share: float,
    col_bins: NDArray[np.int32],
    col_shares: NDArray[np.float64],
    sums: NDArray[np.float32],
    is_reached: NDArray[np.bool_],
) -> None:
    """Add a share of one row's cells to coarse columns.

    Args:
        values: ``(P * W,)``.
        places: Of ``values``; the row's from
        first: this one on, before
        last: this one.
        row_start: The row's first place.
        width: W.
        share: What counts of the row.
        col_bins: ``(cols, M)``; coarse columns under each column, and
        col_shares: ``(cols, M)`` of it in each.
        sums: ``(X * W,)``, added to.
        is_reached: ``(X,)``; set where anything is added.
    """
    w = np.uint64(width)
    for c in range(first, last):
        col, at = places[c] - row_start, np.uint64(places[c]) * w
        for j in range(col_bins.shape[1]):
            if col_shares[col, j] > 0.0:
                x = col_bins[col, j]
                to, by = np.uint64(x) * w, fill(values.dtype.type(share * col_shares[col, j]))
                is_reached[x] = True
                for g in range(np.uint64(0), w, LANES):
                    part = mul(by, load(values, at + g))
                    store(sums, to + g, add(load(sums, to + g), part))


@njit(cache=True, nogil=True)
def _fold_headings(
    of: NDArray[np.float32],
    start: NDArray[np.int64],
    heading: NDArray[np.int32],
    share: NDArray[np.float64],
    even: int,
    out: NDArray[np.float64],
) -> None:
    """Sum a coarse column's headings ``(W,)`` in coarse ones ``(H,)``; see :func:`fold`."""
    for j in range(out.shape[0]):
        p = 0.0
        if even > 0:
            for k in range(j * even, (j + 1) * even):
                p += of[k]
        else:
            for e in range(start[j], start[j + 1]):
                p += share[e] * of[heading[e]]
        out[j] = p


@njit(cache=True, nogil=True)
def fold(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    cols: int,
    width: int,
    n_cols: int,
    factor: float,
    row_first: NDArray[np.int32],
    row_shares: NDArray[np.float64],
    col_bins: NDArray[np.int32],
    col_shares: NDArray[np.float64],
    heading_start: NDArray[np.int64],
    heading_bin: NDArray[np.int32],
    heading_share: NDArray[np.float64],
    even: int,
    w_uniform: float,
    uniform: NDArray[np.float64],
    uniform_nats: NDArray[np.float64],
    uniform_entropy: float,
    out: NDArray[np.float64],
) -> float:
    """The belief in coarser bins, or its entropy there.

    Args:
        values: ``(P * W,)``.
        places: Of ``values``.
        n: How many.
        cols: Places in a row.
        width: W.
        n_cols: X.
        factor: What the belief is multiplied by.
        row_first: ``(Y,)``; first row under each coarse row.
        row_shares: ``(Y, L)``; share in it of each of the rows from there.
        col_bins: ``(cols, M)``; coarse columns under each column, and
        col_shares: ``(cols, M)`` of it in each.
        heading_start: ``(H + 1,)``; the heading bins in each coarse one begin so far in
        heading_bin: ``(N,)``, with
        heading_share: ``(N,)`` of them there.
        even: How many whole headings there are in each coarse one, one after the other; 0 if cut.
        w_uniform: Weight of the uniform in the belief whose entropy is asked for.
        uniform: ``(Y * X, H)``, summing to one.
        uniform_nats: ``(Y * X, H)``; u log u of each u in ``uniform``, 0 for 0.
        uniform_entropy: Of ``uniform`` [nat].
        out: ``(H, Y * X)``, overwritten with the bins, without the uniform; or empty.

    Returns:
        The entropy of the belief mixed with the uniform [nat]; 0 where ``out`` is given.
    """
    n_rows = values.shape[0] // width // cols
    begins = _row_begins(places, n, cols, n_rows)
    sums, is_reached = np.zeros(n_cols * width, values.dtype), np.zeros(n_cols, np.bool_)
    folded = np.empty(heading_start.shape[0] - 1)
    h, rest, rest_entropy = 0.0, 1.0, uniform_entropy
    if out.size > 0:
        out[:] = 0.0
    for y in range(row_first.shape[0]):
        for i in range(row_shares.shape[1]):
            row = row_first[y] + i
            if row < n_rows and row_shares[y, i] > 0.0:
                _add_row(
                    values, places, begins[row], begins[row + 1], row * cols, width,
                    factor * row_shares[y, i], col_bins, col_shares, sums, is_reached,
                )  # fmt: skip
        for x in range(n_cols):
            if not is_reached[x]:
                continue
            of = sums[x * width : (x + 1) * width]
            _fold_headings(of, heading_start, heading_bin, heading_share, even, folded)
            for j in range(folded.shape[0]):
                p = folded[j]
                if p <= 0.0:
                    continue
                if out.size > 0:
                    out[j, y * n_cols + x] = p
                    continue
                if w_uniform > 0.0:
                    u = uniform[y * n_cols + x, j]
                    p = (1.0 - w_uniform) * p + w_uniform * u
                    rest -= u
                    rest_entropy += uniform_nats[y * n_cols + x, j]
                h -= p * np.log(p)
            of[:] = 0.0
            is_reached[x] = False
    # Elsewhere the belief is w u: the sum of -w u (log w + log u) over the bins not visited.
    if w_uniform > 0.0:
        h += w_uniform * (max(rest_entropy, 0.0) - max(rest, 0.0) * np.log(w_uniform))
    return h
