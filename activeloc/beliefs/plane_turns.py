"""Kernels that turn a belief on planes, tile by tile.

A turn adds up the same places of many planes, once for each tap: what is read again and again is
one tile (:mod:`activeloc.beliefs.plane_tiles`), and stays in the fastest memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, clear_rest, collect, holds, mark
from activeloc.beliefs.plane_tiles import arc_of, load, store_tile, tiles_of

WIDEST = 128  # Blocks of a tile whose rows are read where they lie, and written where they belong.


class Turning(NamedTuple):
    """What a turn does to the headings: a circular convolution, its weights in two parts.

    Attributes:
        first: Shift of the first tap [bin].
        taps: ``(J,)``, of the belief's precision; no turn at all if there is none.
        flat_first: First shift [bin] of a stretch of
        n_flat: so many shifts, fewer than K, that weigh alike,
        flat: so much each, besides the taps.
    """

    first: int
    taps: NDArray[np.floating]
    flat_first: int
    n_flat: int
    flat: float


class Scratch(NamedTuple):
    """What a tile is worked on in: rows of places, heading after heading.

    Attributes:
        source: Of the tile, with empty rows before and after.
        spare: As much.
        turned: Of what it becomes.
    """

    source: NDArray[np.floating]
    spare: NDArray[np.floating]
    turned: NDArray[np.floating]


@njit(cache=True, nogil=True)
def _shifts(turning: Turning) -> tuple[int, int]:
    """First shift of a turn, and how many there are from the first to the last."""
    first, last = turning.first, turning.first + turning.taps.shape[0]
    if turning.n_flat > 0:
        first = min(first, turning.flat_first)
        last = max(last, turning.flat_first + turning.n_flat)
    return first, last - first


@njit(cache=True, nogil=True)
def scratch_of(
    values: NDArray[np.float32], size: int, turning: Turning, tiles: NDArray[np.int32]
) -> Scratch:
    """Room for any of some tiles of a belief ``(K * P,)`` and what it becomes."""
    n_headings, shifts, width = values.shape[0] // size, _shifts(turning)[1], BLOCK
    for t in range(tiles.shape[0]):
        width = max(width, tiles[t, 1] - tiles[t, 0])
    source = np.empty((n_headings + 2 * shifts) * width, dtype=values.dtype)
    turned = np.empty((n_headings + shifts) * width, dtype=values.dtype)
    return Scratch(source, np.empty_like(source), turned)


@njit(cache=True, nogil=True)
def _add(
    out: NDArray[np.float32],
    to: np.uint64,
    of: NDArray[np.float32],
    at: np.uint64,
    weight: float | np.floating,
    n: np.uint64,
) -> None:
    """Add a multiple of a stretch to another; unsigned, so that no index counts from the end."""
    for i in range(n):
        out[to + i] += weight * of[at + i]


@njit(cache=True, nogil=True)
def _add_taps(
    source: NDArray[np.float32],
    at: np.uint64,
    length: np.uint64,
    taps: NDArray[np.float32],
    out: NDArray[np.float32],
    n: np.uint64,
) -> None:
    """Set ``out`` to a sum of stretches of ``source``, the first at ``at``, each a row before."""
    whole = taps.shape[0] - taps.shape[0] % 4
    if whole == 0:
        out[:n] = 0.0
    for j in range(0, whole, 4):
        wa, wb, wc, wd = taps[j], taps[j + 1], taps[j + 2], taps[j + 3]
        a = at - np.uint64(j) * length
        b, c, d = a - length, a - length - length, a - length - length - length
        if j == 0:
            for i in range(n):
                out[i] = (wa * source[a + i] + wb * source[b + i]) + (
                    wc * source[c + i] + wd * source[d + i]
                )
        else:
            for i in range(n):
                out[i] += (wa * source[a + i] + wb * source[b + i]) + (
                    wc * source[c + i] + wd * source[d + i]
                )
    for j in range(whole, taps.shape[0]):
        _add(out, np.uint64(0), source, at - np.uint64(j) * length, taps[j], n)


@njit(cache=True, nogil=True)
def _sum_fours(
    of: NDArray[np.float32], ahead: np.uint64, out: NDArray[np.float32], n: np.uint64
) -> None:
    """Set ``out`` to sums of four stretches, each ``ahead`` of the one before."""
    b, c = ahead, ahead + ahead
    d = b + c
    for i in range(n):
        out[i] = (of[i] + of[b + i]) + (of[c + i] + of[d + i])


@njit(cache=True, nogil=True)
def _add_flat(
    scratch: Scratch, at: np.uint64, held: np.uint64, length: np.uint64, turning: Turning,
    n: np.uint64,
) -> None:  # fmt: skip
    """Add sums over ``n_flat`` rows each: those of 1, 4, 16 ... rows, where they are put together.

    Args:
        scratch: Its ``source`` is overwritten and ``turned`` added to.
        at: Where the rows of the first sum begin.
        held: Elements of the source.
        length: Of a row.
        turning: Its flat part counts.
        n: Elements of ``turned``.
    """
    of, spare, out = scratch.source, scratch.spare, scratch.turned
    weight, none, left = of.dtype.type(turning.flat), np.uint64(0), np.uint64(turning.n_flat)
    ahead, four = length, np.uint64(4)
    while True:
        for _ in range(left % four):
            _add(out, none, of, at, weight, n)
            at += ahead
        left = left // four
        if left == none:
            return
        # A sum that reaches beyond the source is never asked for.
        reach = ahead + ahead + ahead
        held = held - reach if held > reach else none
        _sum_fours(of, ahead, spare, held)
        of, spare = spare, of
        ahead = ahead * four


@njit(cache=True, nogil=True)
def _turn_row(
    values: NDArray[np.float32],
    size: int,
    k: int,
    start: int,
    turning: Turning,
    out: NDArray[np.float32],
    to: np.uint64,
    length: np.uint64,
) -> None:
    """One heading of a tile after the taps of a turn, taken from where the belief lies."""
    n_headings, taps = values.shape[0] // size, turning.taps
    at, whole = (k - turning.first) % n_headings, taps.shape[0] - taps.shape[0] % 4
    left_over = (k - turning.first - whole) % n_headings
    if whole == 0:
        out[to : to + length] = 0.0
        for j in range(taps.shape[0]):
            _add(out, to, values, np.uint64(at * size + start), taps[j], length)
            at = (at - 1) % n_headings
        return
    for j in range(0, whole, 4):
        wa, wb, wc, wd = taps[j], taps[j + 1], taps[j + 2], taps[j + 3]
        a, b = np.uint64(at * size + start), np.uint64((at - 1) % n_headings * size + start)
        c = np.uint64((at - 2) % n_headings * size + start)
        d = np.uint64((at - 3) % n_headings * size + start)
        if j > 0:
            for i in range(length):
                out[to + i] += (wa * values[a + i] + wb * values[b + i]) + (
                    wc * values[c + i] + wd * values[d + i]
                )
        elif taps.shape[0] == whole + 1:
            we, e = taps[whole], np.uint64(left_over * size + start)
            for i in range(length):
                out[to + i] = (
                    (wa * values[a + i] + wb * values[b + i])
                    + (wc * values[c + i] + wd * values[d + i])
                ) + we * values[e + i]
        else:
            for i in range(length):
                out[to + i] = (wa * values[a + i] + wb * values[b + i]) + (
                    wc * values[c + i] + wd * values[d + i]
                )
        at = (at - 4) % n_headings


@njit(cache=True, nogil=True)
def _goes_row_by_row(tile: NDArray[np.int32], turning: Turning) -> bool:
    """Whether a tile is so wide that its rows are taken from where they lie."""
    return bool(tile[1] - tile[0] > BLOCK and turning.n_flat == 0)


@njit(cache=True, nogil=True)
def _rows_of(alive: NDArray[np.bool_], turning: Turning) -> tuple[int, int]:
    """First heading, and number of headings, that a tile may have after a turn."""
    first, n = arc_of(alive)
    shift, n_shifts = _shifts(turning)
    return (first + shift) % alive.shape[0], min(n + n_shifts - 1, alive.shape[0])


@njit(cache=True, nogil=True)
def turn_tile(
    values: NDArray[np.float32],
    size: int,
    tile: NDArray[np.int32],
    alive: NDArray[np.bool_],
    turning: Turning,
    scratch: Scratch,
) -> tuple[int, int]:
    """Turn one tile of a belief, or only fetch it if there is no turn.

    Args:
        values: ``(K * P,)``.
        size: P.
        tile: ``(2,)``; its first place and one past the last.
        alive: ``(K,)``; headings that hold anything there, at least one.
        turning: The turn.
        scratch: See :func:`scratch_of`; its ``turned`` has the rows afterwards.

    Returns:
        First heading of the rows, and how many there are, at most K; they may go round the circle.
    """
    start, length, n_headings = tile[0], np.uint64(tile[1] - tile[0]), alive.shape[0]
    first, n = arc_of(alive)
    source, out = scratch.source, scratch.turned
    if turning.taps.shape[0] == 0:
        load(values, size, start, length, first, n, out, np.uint64(0))
        return first, n
    shift, n_shifts = _shifts(turning)
    if _goes_row_by_row(tile, turning):
        k, n_rows = _rows_of(alive, turning)
        for row in range(n_rows):
            at = np.uint64(row) * length
            _turn_row(values, size, (k + row) % n_headings, start, turning, out, at, length)
        return k, n_rows
    # Rows that shifts reach from empty ones, so that every sum has as many rows.
    empty = np.uint64(n_shifts - 1) * length
    held = empty + np.uint64(n) * length
    source[:empty] = 0.0
    load(values, size, start, length, first, n, source, empty)
    source[held : held + empty] = 0.0
    n_rows = n + n_shifts - 1
    room = np.uint64(n_rows) * length
    at = empty - np.uint64(turning.first - shift) * length
    _add_taps(source, at, length, turning.taps, out, room)
    if turning.n_flat > 0:
        at = empty - np.uint64(turning.flat_first - shift + turning.n_flat - 1) * length
        _add_flat(scratch, at, held + empty, length, turning, room)
    # What goes once round the circle meets what did not.
    around, one = np.uint64(n_headings) * length, values.dtype.type(1)
    for row in range(n_rows - 1, n_headings - 1, -1):
        at = np.uint64(row) * length
        _add(out, at - around, out, at, one, length)
    return (first + shift) % n_headings, min(n_rows, n_headings)


@njit(cache=True, nogil=True)
def rotate(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    size: int,
    turning: Turning,
    out: NDArray[np.float32],
    out_runs: NDArray[np.int32],
    n_out: int,
    flags: NDArray[np.uint8],
) -> int:
    """out(k) = sum over j of w(j) values(k - j), around the circle; returns how many runs it has.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``, the first n.
        n: How many.
        size: P.
        turning: The weights w.
        out: ``(K * P,)``, overwritten.
        out_runs: What ``out`` holds before; overwritten with what it holds afterwards.
        n_out: How many runs that was.
        flags: Zeros.
    """
    n_headings = values.shape[0] // size
    tiles, alive = tiles_of(runs, n, size, n_headings, WIDEST)
    scratch = scratch_of(values, size, turning, tiles)
    for t in range(tiles.shape[0]):
        if _goes_row_by_row(tiles[t], turning):
            k, n_rows = _rows_of(alive[t], turning)
            length = np.uint64(tiles[t, 1] - tiles[t, 0])
            for row in range(k, k + n_rows):
                at = row % n_headings * size + tiles[t, 0]
                to = np.uint64(at)
                _turn_row(values, size, row % n_headings, tiles[t, 0], turning, out, to, length)
                if holds(out, to, length):
                    mark(flags, at, at + tiles[t, 1] - tiles[t, 0])
            continue
        k, n_rows = turn_tile(values, size, tiles[t], alive[t], turning, scratch)
        store_tile(scratch.turned, n_rows, k, tiles[t], out, size, flags)
    clear_rest(out, out_runs, n_out, flags)
    return collect(flags, size, out_runs)
