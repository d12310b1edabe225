"""Kernels of the histogram filter on planes: travels, for one robot.

As in :mod:`activeloc.beliefs.plane_kernels`; sums of many states are added up as there.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, CHUNK, clear_rest, collect, mark


@njit(cache=True, nogil=True)
def _blend(
    out: NDArray[np.float32],
    first: bool,
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    c: NDArray[np.float32],
    d: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    """Set ``out`` to, or unless it is the first add, a weighted sum of four stretches as long."""
    wa, wb, wc, wd = weights[0], weights[1], weights[2], weights[3]
    if first:
        for i in range(out.shape[0]):
            out[i] = (wa * a[i] + wb * b[i]) + (wc * c[i] + wd * d[i])
    else:
        for i in range(out.shape[0]):
            out[i] += (wa * a[i] + wb * b[i]) + (wc * c[i] + wd * d[i])


@njit(cache=True, nogil=True)
def _mark_travelled(
    runs: NDArray[np.int32],
    n: int,
    size: int,
    n_headings: int,
    turned: int,
    cols: int,
    box: NDArray[np.int32],
    flags: NDArray[np.uint8],
) -> None:
    """Flag what a travel reaches; see :func:`translate`."""
    for r in range(n):
        k = runs[r, 0] // size
        way, low, high = (k + turned) % n_headings, k * size, (k + 1) * size
        for row in range(box[way, 0], box[way, 1] + 1):
            first = max(low, runs[r, 0] + row * cols + box[way, 2])
            last = min(high, runs[r, 1] + row * cols + box[way, 3])
            if first < last:
                mark(flags, first, last)


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
    n_headings, zero = values.shape[0] // size, values.dtype.type(0)
    _mark_travelled(runs, n, size, n_headings, turned, cols, box, flags)
    clear_rest(out, out_runs, n_out, flags)
    n_out = collect(flags, size, out_runs)
    margin = 0
    for e in range(stencil_shift.shape[0]):
        margin = max(margin, abs(stencil_shift[e]))
    open_ground = np.zeros(size + 2 * margin, dtype=values.dtype)
    sums = np.zeros(CHUNK)
    r, o = 0, 0
    while r < n:
        k = runs[r, 0] // size
        way, low, begin, written = (k + turned) % n_headings, k * size, r, o
        here = values[low : low + size]
        while r < n and runs[r, 0] < low + size:
            start, stop = runs[r, 0] - low, runs[r, 1] - low
            _keep(
                open_ground[start + margin : stop + margin], here[start:stop],
                plain[way * size + start : way * size + stop],
            )  # fmt: skip
            r += 1
        while o < n_out and out_runs[o, 0] < low + size:
            _gather(
                out[out_runs[o, 0] : out_runs[o, 1]], open_ground, out_runs[o, 0] - low + margin,
                stencil_shift[stencil_start[way] : stencil_start[way + 1]],
                stencil_weight[stencil_start[way] : stencil_start[way + 1]],
            )  # fmt: skip
            o += 1
        there = out[low : low + size]
        for i in range(begin, r):
            start, stop = runs[i, 0] - low, runs[i, 1] - low
            open_ground[start + margin : stop + margin] = zero
            first_edge = edge_start[(way * size + start) // BLOCK]
            last_edge = edge_start[(way * size + stop) // BLOCK]
            for e in range(np.uint64(first_edge), np.uint64(last_edge)):
                there[target[e]] += here[source[e]] * weight[e]
        for i in range(written, o):
            of = out[out_runs[i, 0] : out_runs[i, 1]]
            for j in range(of.shape[0]):
                sums[j] += of[j]
    return n_out, sums.sum()


@njit(cache=True, nogil=True)
def _keep(out: NDArray[np.float32], of: NDArray[np.float32], kept: NDArray[np.uint8]) -> None:
    """Copy a stretch where it is kept; zero elsewhere."""
    zero = of.dtype.type(0)
    for i in range(out.shape[0]):
        out[i] = of[i] if kept[i] != 0 else zero


@njit(cache=True, nogil=True)
def _gather(
    out: NDArray[np.float32],
    plane: NDArray[np.float32],
    at: int,
    shifts: NDArray[np.int32],
    weights: NDArray[np.float32],
) -> None:
    """out[i] = sum over e of weights[e] plane[at + i - shifts[e]]; entries come in fours."""
    length = out.shape[0]
    for e in range(0, shifts.shape[0], 4):
        a, b, c, d = at - shifts[e], at - shifts[e + 1], at - shifts[e + 2], at - shifts[e + 3]
        _blend(
            out, e == 0, plane[a : a + length], plane[b : b + length],
            plane[c : c + length], plane[d : d + length], weights[e : e + 4],
        )  # fmt: skip
