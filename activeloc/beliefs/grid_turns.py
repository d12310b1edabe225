"""Kernels that turn a belief, cell by cell: a circular convolution over the headings.

A cell's headings are written down so that no sum over neighbouring headings has to go round the
circle; sums are taken of eight headings at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import add, fill, load, mul, store

CELLS = 16  # Cells that are turned at a time: their headings stay in the fastest memory.


class Turning(NamedTuple):
    """What a turn does to the headings: a circular convolution, its weights in two parts.

    Attributes:
        first: Shift of the first tap [bin].
        taps: ``(J,)``, at most K; no turn at all if there is none.
        flat_first: First shift [bin] of a stretch of
        n_flat: so many shifts, fewer than K, that weigh alike,
        flat: so much each, besides the taps.
    """

    first: int
    taps: NDArray[np.floating]
    flat_first: int
    n_flat: int
    flat: float


class Convolution(NamedTuple):
    """A turn as the kernels carry it out.

    Attributes:
        begin: Heading from which on the first one gets anything by the taps.
        taps: ``(J,)``, at least one, of the belief's precision.
        flat_begin: Heading from which on the first one gets anything by
        n_flat: so many that count alike,
        flat: so much.
    """

    begin: int
    taps: NDArray[np.floating]
    flat_begin: int
    n_flat: int
    flat: float

    @classmethod
    def of(cls, turning: Turning, n_headings: int, precision: str, by: float = 1.0) -> Convolution:
        """A turn, its weights multiplied."""
        begin = (1 - turning.first - len(turning.taps)) % n_headings
        flat_begin = (1 - turning.flat_first - turning.n_flat) % n_headings
        taps = np.multiply(turning.taps, by, dtype=precision)
        return cls(begin, taps, flat_begin, turning.n_flat, turning.flat * by)


@njit(cache=True, nogil=True)
def _go_round(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n_headings: int,
    width: int,
    begin: int,
    n: int,
    circles: NDArray[np.float32],
) -> None:
    """Write n headings of each cell down, from one on and round the circle.

    Args:
        values: ``(P * W,)``.
        places: ``(c,)``; of the cells, at most CELLS.
        n_headings: K.
        width: W.
        begin: The first heading.
        n: How many, less than 2 W.
        circles: ``(CELLS * 3 * W,)``, overwritten: those of cell i from ``3 W i`` on.
    """
    for c in range(places.shape[0]):
        at, to = np.uint64(places[c]) * np.uint64(width), np.uint64(3 * width * c)
        done, first = 0, begin
        while done < n:
            # What is read beyond the last heading is overwritten by those that follow.
            for i in range(np.uint64(0), np.uint64(min(n_headings - first, n - done)), LANES):
                part = load(values, at + np.uint64(first) + i)
                store(circles, to + np.uint64(done) + i, part)
            done, first = done + n_headings - first, 0


@njit(cache=True, nogil=True)
def _add_taps(
    circles: NDArray[np.float32],
    taps: NDArray[np.float32],
    n_headings: int,
    width: int,
    out: NDArray[np.float32],
    to: NDArray[np.uint64],
) -> None:
    """out[to + k] = sum over j of taps[J - 1 - j] circle[k + j]; three groups at a time."""
    w, one, last = np.uint64(width), np.uint64(1), taps.shape[0] - 1
    second, third = LANES, LANES + LANES
    for c in range(to.shape[0]):
        start, g = np.uint64(3 * width * c), np.uint64(0)
        while g + third < w:
            at, by = start + g, fill(taps[last])
            p = mul(by, load(circles, at))
            q = mul(by, load(circles, at + second))
            r = mul(by, load(circles, at + third))
            for j in range(1, last + 1):
                at, by = at + one, fill(taps[last - j])
                p = add(p, mul(by, load(circles, at)))
                q = add(q, mul(by, load(circles, at + second)))
                r = add(r, mul(by, load(circles, at + third)))
            store(out, to[c] + g, p)
            store(out, to[c] + g + second, q)
            store(out, to[c] + g + third, r)
            g += third + LANES
        while g < w:
            at = start + g
            p = mul(fill(taps[last]), load(circles, at))
            for j in range(1, last + 1):
                at += one
                p = add(p, mul(fill(taps[last - j]), load(circles, at)))
            store(out, to[c] + g, p)
            g += LANES
        for k in range(np.uint64(n_headings), w):
            out[to[c] + k] = 0.0


@njit(cache=True, nogil=True)
def _add_flat(
    circles: NDArray[np.float32],
    n_flat: int,
    flat: float | np.floating,
    n_headings: int,
    width: int,
    out: NDArray[np.float32],
    to: NDArray[np.uint64],
) -> None:
    """out[to + k] += flat times the sum of circle[k + i], i up to n_flat.

    It is put together from sums of 1, 2, 4 ... headings, which take the place of the circle.
    """
    w, one, by = np.uint64(width), np.uint64(1), fill(flat)
    for c in range(to.shape[0]):
        at, left, long = np.uint64(3 * width * c), np.uint64(n_flat), one
        end = at + left + w
        while left > np.uint64(0):
            if left & one:
                for g in range(np.uint64(0), w, LANES):
                    part = mul(by, load(circles, at + g))
                    store(out, to[c] + g, add(load(out, to[c] + g), part))
                at += long
            left >>= one
            if left > np.uint64(0):
                # In place: what is added lies ahead, and is not yet a sum.
                for i in range(at, end, LANES):
                    store(circles, i, add(load(circles, i), load(circles, i + long)))
            long += long
        for k in range(np.uint64(n_headings), w):
            out[to[c] + k] = 0.0


@njit(cache=True, nogil=True)
def rotate(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    n_headings: int,
    width: int,
    turning: Convolution,
    out: NDArray[np.float32],
) -> None:
    """out(k) = sum over j of w(j) values(k - j), around the circle, in each of n places.

    Args:
        values: ``(P * W,)``.
        places: Of ``values``.
        n: How many.
        n_headings: K.
        width: W.
        turning: The weights w; it has taps.
        out: Overwritten in those places; may be ``values``.
    """
    circles, flats = np.zeros((2, CELLS * 3 * width), dtype=values.dtype)
    n_taps, n_flat, flat = turning.taps.shape[0], turning.n_flat, values.dtype.type(turning.flat)
    for c in range(0, n, CELLS):
        some = places[c : min(n, c + CELLS)]
        to = some.astype(np.uint64) * np.uint64(width)
        # All is written down before any of it is added up, and before the first is overwritten:
        # what was just written is slow to read at other places.
        _go_round(values, some, n_headings, width, turning.begin, width + n_taps - 1, circles)
        if n_flat > 0:
            n_last = width + n_flat - 1
            _go_round(values, some, n_headings, width, turning.flat_begin, n_last, flats)
        _add_taps(circles, turning.taps, n_headings, width, out, to)
        if n_flat > 0:
            _add_flat(flats, n_flat, flat, n_headings, width, out, to)
