"""Kernels of the histogram filter on planes: travels, for one robot.

As in :mod:`activeloc.beliefs.plane_kernels`; sums of many states are added up as there.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import (
    BLOCK,
    CHUNK,
    add_up,
    clear_rest,
    collect,
    mark,
    mark_held,
)


@njit(cache=True, nogil=True)
def _mark_travelled(
    runs: NDArray[np.int32],
    n: int,
    size: int,
    n_headings: int,
    turned: int,
    cols: int,
    start: NDArray[np.int64],
    shift: NDArray[np.int32],
    box: NDArray[np.int32],
    edge_start: NDArray[np.int64],
    flags: NDArray[np.uint8],
) -> None:
    """Flag what a travel may reach; see :func:`translate`.

    On open ground that is where the stencil leads, beside obstacles all on the way there.
    """
    for r in range(n):
        k = runs[r, 0] // size
        way, low, high = (k + turned) % n_headings, k * size, (k + 1) * size
        first_edge = edge_start[(runs[r, 0] + (way - k) * size) // BLOCK]
        if first_edge == edge_start[(runs[r, 1] + (way - k) * size) // BLOCK]:
            for e in range(start[way], start[way + 1]):
                first, last = max(low, runs[r, 0] + shift[e]), min(high, runs[r, 1] + shift[e])
                if first < last:
                    mark(flags, first, last)
            continue
        for row in range(box[way, 0], box[way, 1] + 1):
            first = max(low, runs[r, 0] + row * cols + box[way, 2])
            last = min(high, runs[r, 1] + row * cols + box[way, 3])
            if first < last:
                mark(flags, first, last)


@njit(cache=True, nogil=True, inline="always")
def _gather(
    out: NDArray[np.float32],
    to: np.uint64,
    n: np.uint64,
    plane: NDArray[np.float32],
    at: int,
    shifts: NDArray[np.int32],
    weights: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    """out[to + i] = sum over e of weights[e] plane[at + i - shifts[e]], i up to n.

    Entries from ``first`` to ``last`` come in fours, but for one that may be left over.
    """
    if last - first < 2:
        w = weights[first] if first < last else weights.dtype.type(0)
        a = np.uint64(at - shifts[first]) if first < last else np.uint64(at)
        for i in range(n):
            out[to + i] = w * plane[a + i]
        return
    whole = last - (last - first) % 4
    for e in range(first, whole, 4):
        wa, wb, wc, wd = weights[e], weights[e + 1], weights[e + 2], weights[e + 3]
        a, b = np.uint64(at - shifts[e]), np.uint64(at - shifts[e + 1])
        c, d = np.uint64(at - shifts[e + 2]), np.uint64(at - shifts[e + 3])
        if e > first:
            for i in range(n):
                out[to + i] += (wa * plane[a + i] + wb * plane[b + i]) + (
                    wc * plane[c + i] + wd * plane[d + i]
                )
        elif whole < last:
            we, f = weights[whole], np.uint64(at - shifts[whole])
            for i in range(n):
                out[to + i] = (
                    (wa * plane[a + i] + wb * plane[b + i])
                    + (wc * plane[c + i] + wd * plane[d + i])
                ) + we * plane[f + i]
        else:
            for i in range(n):
                out[to + i] = (wa * plane[a + i] + wb * plane[b + i]) + (
                    wc * plane[c + i] + wd * plane[d + i]
                )


@njit(cache=True, nogil=True)
def translate(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    turned: int,
    cols: int,
    stencil_start: NDArray[np.int64],
    stencil_shift: NDArray[np.int32],
    stencil_weight: NDArray[np.float32],
    box: NDArray[np.int32],
    plain: NDArray[np.uint8],
    edge_start: NDArray[np.int64],
    source: NDArray[np.uint16],
    target: NDArray[np.uint16],
    weight: NDArray[np.float32],
    out: NDArray[np.float32],
    out_runs: NDArray[np.int32],
    n_out: int,
    flags: NDArray[np.uint8],
) -> tuple[int, float]:
    """out(x') = sum over x of p(x' | x) values(x), plane by plane.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``, the first n.
        n: How many.
        size: P.
        turned: Heading bins between the robot's heading and the way it travels: 0, or K / 2 back.
        cols: Places in a row.
        stencil_start: ``(K + 1,)``; see :class:`activeloc.beliefs.travel_table.Travel` for these.
        stencil_shift: ``(E,)``.
        stencil_weight: ``(E,)``.
        box: ``(K, 4)``.
        plain: ``(K * P,)``.
        edge_start: ``(K * P / BLOCK + 1,)``.
        source: ``(N,)``.
        target: ``(N,)``.
        weight: ``(N,)``.
        out: ``(K * P,)``, overwritten.
        out_runs: What ``out`` holds before; overwritten with what it holds afterwards.
        n_out: How many runs that was.
        flags: Zeros.

    Returns:
        How many runs ``out`` has, and its sum.
    """
    n_headings = values.shape[0] // size
    _mark_travelled(
        runs, n, size, n_headings, turned, cols, stencil_start, stencil_shift, box, edge_start,
        flags,
    )  # fmt: skip
    clear_rest(out, out_runs, n_out, flags)
    n_out = collect(flags, size, out_runs)
    margin = 0
    for e in range(stencil_shift.shape[0]):
        margin = max(margin, abs(stencil_shift[e]))
    open_ground, sums = np.zeros(size + 2 * margin, dtype=values.dtype), np.zeros(CHUNK // 4)
    r, o = 0, 0
    while r < n:
        k = runs[r, 0] // size
        way, begin, written = (k + turned) % n_headings, r, o
        while r < n and runs[r, 0] < (k + 1) * size:
            to = runs[r, 0] - k * size + margin
            _keep(values, plain, runs[r, 0], runs[r, 1], (way - k) * size, open_ground, to)
            r += 1
        first, last = stencil_start[way], stencil_start[way + 1]
        while o < n_out and out_runs[o, 0] < (k + 1) * size:
            to, length = np.uint64(out_runs[o, 0]), np.uint64(out_runs[o, 1] - out_runs[o, 0])
            at = out_runs[o, 0] - k * size + margin
            if length == BLOCK:
                _gather(
                    out, to, np.uint64(BLOCK), open_ground, at, stencil_shift, stencil_weight,
                    first, last,
                )  # fmt: skip
            else:
                _gather(
                    out, to, length, open_ground, at, stencil_shift, stencil_weight, first, last
                )  # fmt: skip
            o += 1
        for i in range(begin, r):
            to = runs[i, 0] - k * size + margin
            for j in range(np.uint64(to), np.uint64(to + runs[i, 1] - runs[i, 0])):
                open_ground[j] = 0.0
            _add_edges(
                values, k * size, edge_start[(runs[i, 0] + (way - k) * size) // BLOCK],
                edge_start[(runs[i, 1] + (way - k) * size) // BLOCK], source, target, weight, out,
            )  # fmt: skip
        for i in range(written, o):
            _sum_up(out, out_runs[i, 0], out_runs[i, 1], sums, flags)
    return collect(flags, size, out_runs), sums.sum()


@njit(cache=True, nogil=True)
def _keep(
    values: NDArray[np.float32],
    plain: NDArray[np.uint8],
    first: int,
    last: int,
    turned: int,
    out: NDArray[np.float32],
    to: int,
) -> None:
    """Copy a run where the ground is open, zero beside obstacles.

    Args:
        values: ``(K * P,)``.
        plain: ``(K * P,)``; for a state of the run ``turned`` further on.
        first: Of the run,
        last: and one past its last.
        turned: See above.
        out: Overwritten from ``to`` on.
        to: See there.
    """
    at, where, there = np.uint64(first), np.uint64(first + turned), np.uint64(to)
    one = values.dtype.type
    # A product, not a choice: so several are done at once.
    for i in range(np.uint64(last - first)):
        out[there + i] = values[at + i] * one(plain[where + i])


@njit(cache=True, nogil=True)
def _add_edges(
    values: NDArray[np.float32],
    plane: int,
    first: int,
    last: int,
    source: NDArray[np.uint16],
    target: NDArray[np.uint16],
    weight: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Add the rows beside obstacles, entries ``first`` to ``last``, of the plane that begins so."""
    here, there = values[plane:], out[plane:]
    for e in range(np.uint64(first), np.uint64(last)):
        there[target[e]] += here[source[e]] * weight[e]


@njit(cache=True, nogil=True)
def _sum_up(
    values: NDArray[np.float32],
    first: int,
    last: int,
    sums: NDArray[np.float64],
    flags: NDArray[np.uint8],
) -> None:
    """Add a run to ``sums`` and flag its blocks, those that hold anything."""
    add_up(values, np.uint64(first), np.uint64(last - first), sums)
    mark_held(values, first, last, flags)
