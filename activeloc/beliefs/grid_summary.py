"""A kernel that sums a belief in coarser bins, and takes its entropy there.

Coarse bins are a product: rows times columns times heading bins. So one coarse row at a time is
added up, cell by cell with all headings at once, and folded into coarse headings where anything is.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import N_LANES, add, at_least, fill, load, log, mul, store, total

LEAST = float(np.finfo(np.float64).tiny)
"""The least number whose logarithm :func:`activeloc.beliefs.lanes.log` takes."""


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
def _add_rows(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    begins: NDArray[np.int64],
    first: int,
    shares: NDArray[np.float64],
    cols: int,
    width: int,
    factor: float,
    col_bins: NDArray[np.int32],
    col_shares: NDArray[np.float64],
    sums: NDArray[np.float32],
    is_reached: NDArray[np.bool_],
) -> None:
    """Add the cells under a coarse row to coarse columns.

    Args:
        values: ``(P * W,)``.
        places: Of ``values``; those of row r from
        begins: ``begins[r]`` on, before ``begins[r + 1]``.
        first: First row under the coarse one.
        shares: ``(L,)``; of it, and of those that follow.
        cols: Places in a row.
        width: W.
        factor: What the belief is multiplied by.
        col_bins: ``(cols, M)``; coarse columns under each column, and
        col_shares: ``(cols, M)`` of it in each.
        sums: ``(X * W + W,)``, added to.
        is_reached: ``(X,)``; set where anything is added.
    """
    w = np.uint64(width)
    for i in range(min(shares.shape[0], begins.shape[0] - 1 - first)):
        row, share = first + i, factor * shares[i]
        for c in range(begins[row], begins[row + 1]):
            col, at = places[c] - row * cols, np.uint64(places[c]) * w
            for j in range(col_bins.shape[1]):
                part = values.dtype.type(share * col_shares[col, j])
                if part > 0.0:
                    x, by = col_bins[col, j], fill(part)
                    to, is_reached[x] = np.uint64(x) * w, True
                    for g in range(np.uint64(0), w, LANES):
                        more = mul(by, load(values, at + g))
                        store(sums, to + g, add(load(sums, to + g), more))


@njit(cache=True, nogil=True)
def _fold_headings(
    sums: NDArray[np.float32],
    reached: NDArray[np.int64],
    width: int,
    start: NDArray[np.int64],
    heading: NDArray[np.int32],
    share: NDArray[np.float64],
    even: int,
    out: NDArray[np.float64],
) -> None:
    """Sum the headings of coarse columns in coarse ones, and empty the columns; see :func:`fold`.

    Args:
        sums: ``(X * W + W,)``; runs of headings that begin in the last column end beyond it.
        reached: ``(N,)``; columns.
        width: W.
        start: ``(H + 1,)``; see :func:`fold`.
        heading: ``(E,)``; see there.
        share: ``(E,)``; see there.
        even: See there.
        out: ``(N, H)``, overwritten.
    """
    w, one, of_each = np.uint64(width), np.uint64(1), np.uint64(even)
    runs, nothing = np.empty(width, sums.dtype), fill(sums.dtype.type(0))
    for i in range(reached.shape[0]):
        at = np.uint64(reached[i]) * w
        if even > 0:
            # Runs are added up from each heading on, eight at once; every so many is wanted.
            for g in range(np.uint64(0), w, LANES):
                run = load(sums, at + g)
                for k in range(one, of_each):
                    run = add(run, load(sums, at + g + k))
                store(runs, g, run)
            for j in range(out.shape[1]):
                out[i, j] = runs[j * even]
        else:
            for j in range(out.shape[1]):
                p = 0.0
                for e in range(start[j], start[j + 1]):
                    p += share[e] * sums[at + np.uint64(heading[e])]
                out[i, j] = p
        for g in range(np.uint64(0), w, LANES):
            store(sums, at + g, nothing)


@njit(cache=True, nogil=True)
def _nats(p: NDArray[np.float64], n: int) -> float:
    """Sum of p log p over the first n, all positive; those up to a whole lane group are lost."""
    # What is not there is as good as nothing, and has a logarithm.
    nothing = fill(LEAST)
    store(p, np.uint64(n), nothing)
    sums = fill(0.0)
    for i in range(np.uint64(0), np.uint64(n), LANES):
        # Less than the least is no normal number.
        each = load(p, i)
        sums = add(sums, mul(each, log(at_least(each, nothing, nothing))))
    return total(sums)


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
        out: ``(H, Y * X)``, to which the bins are added, without the uniform; or empty.

    Returns:
        The entropy of the belief mixed with the uniform [nat]; 0 where ``out`` is given.
    """
    n_rows, n_headings = values.shape[0] // width // cols, heading_start.shape[0] - 1
    begins = _row_begins(places, n, cols, n_rows)
    sums, is_reached = np.zeros((n_cols + 1) * width, values.dtype), np.zeros(n_cols, np.bool_)
    folded, told = np.empty((n_cols, n_headings)), np.empty(n_cols * n_headings + N_LANES)
    h, rest, rest_entropy = 0.0, 1.0, uniform_entropy
    for y in range(row_first.shape[0]):
        first, last = row_first[y], min(row_first[y] + row_shares.shape[1], n_rows)
        if begins[min(first, n_rows)] == begins[last]:
            continue
        # Rows with the same coarse row, and coarse columns, at a time: a call costs as much as a
        # column.
        _add_rows(
            values, places, begins, first, row_shares[y], cols, width, factor,
            col_bins, col_shares, sums, is_reached,
        )  # fmt: skip
        reached = np.flatnonzero(is_reached)
        is_reached[:] = False
        _fold_headings(
            sums, reached, width, heading_start, heading_bin, heading_share, even, folded
        )
        n_told = 0
        for i in range(reached.shape[0]):
            place = y * n_cols + reached[i]
            if out.size > 0:
                for j in range(n_headings):
                    out[j, place] += folded[i, j]
                continue
            for j in range(n_headings):
                # Without a branch: which bins hold anything, nobody can guess.
                p, counts = folded[i, j], 1.0 if folded[i, j] > 0.0 else 0.0
                told[n_told] = (1.0 - w_uniform) * p + w_uniform * uniform[place, j]
                rest -= counts * uniform[place, j]
                rest_entropy += counts * uniform_nats[place, j]
                n_told += p > 0.0
        h -= _nats(told, n_told)
    # Elsewhere the belief is w u: the sum of -w u (log w + log u) over the bins not visited.
    if w_uniform > 0.0:
        h += w_uniform * (max(rest_entropy, 0.0) - max(rest, 0.0) * np.log(w_uniform))
    return h
