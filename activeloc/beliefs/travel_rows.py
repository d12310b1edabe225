"""Kernels of the travel table: where a travel of a given length leads from beside obstacles.

A state's row follows from the kind of its free distances (:mod:`activeloc.beliefs.free_distance`)
and from which cells around it exist. States that have both in common share one row, which is worked
out once. Windows and their slots are those of :mod:`activeloc.beliefs.landings`.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.profiles import slot_of

LANES = 64  # Rows that are worked out side by side.


@njit(cache=True, nogil=True)
def _look_around(
    exists: NDArray[np.uint8],
    steps: NDArray[np.int32],
    ends: NDArray[np.int64],
    keys: NDArray[np.uint64],
    lands: NDArray[np.uint8],
    around: NDArray[np.uint64],
) -> None:
    """Whether the whole stencil of one heading lands on cells, and which of its slots are cells.

    Args:
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        steps: ``(E, 2)`` of rows and columns that the stencil reaches.
        ends: Slots that a way may end in.
        keys: A random key for each slot.
        lands: ``(rows, cols)``, overwritten.
        around: ``(rows, cols)``, overwritten with the sum of the keys of slots that exist.
    """
    rows, cols = lands.shape
    half = (exists.shape[1] - cols) // 2
    side = 2 * half + 1
    for row in range(rows):
        lands[row], around[row] = 1, 0
        here, sums = lands[row], around[row]
        for e in range(steps.shape[0]):
            there = exists[row + half + steps[e, 0], half + steps[e, 1] :]
            for col in range(cols):
                here[col] &= there[col]
        for j in range(ends.shape[0]):
            there, key = exists[row + ends[j] // side, ends[j] % side :], keys[ends[j]]
            for col in range(cols):
                sums[col] += key * np.uint64(there[col])


@njit(cache=True, nogil=True)
def sort_states(
    kind: NDArray[np.int32],
    is_safe: NDArray[np.bool_],
    place: NDArray[np.int32],
    share: NDArray[np.float64],
    exists: NDArray[np.uint8],
    half: int,
    steps: NDArray[np.int32],
    ends: NDArray[np.int64],
    keys: NDArray[np.uint64],
    known: NDArray[np.uint64],
    number: NDArray[np.int32],
    row: NDArray[np.int32],
    cell: NDArray[np.int32],
    held: NDArray[np.float64],
) -> int:
    """Tell open ground from states beside obstacles, one heading's, and number the rows of these.

    Args:
        kind: ``(C,)``; of each state's free distances.
        is_safe: For each kind, whether all its ways are open without doubt.
        place: ``(C,)``.
        share: ``(C,)``; of the open ground.
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        half: R.
        steps: ``(E, 2)`` of rows and columns that the stencil reaches,
        ends: slots, and
        keys: theirs.
        known: An open table, overwritten, and
        number: what it has, overwritten.
        row: ``(C,)``, overwritten; -1 on open ground.
        cell: ``(C,)``, overwritten with the first cell of each row, and
        held: ``(C,)`` with the share of the states that have it.

    Returns:
        How many rows there are.
    """
    shape = exists.shape[0] - 2 * half, exists.shape[1] - 2 * half
    around, lands = np.empty(shape, dtype=np.uint64), np.empty(shape, dtype=np.uint8)
    _look_around(exists, steps, ends, keys, lands, around)
    sums, stencil = around.ravel(), lands.ravel()
    known[:] = 0
    n = 0
    for c in range(place.shape[0]):
        p = place[c]
        if is_safe[kind[c]] and stencil[p] != 0:
            row[c] = -1
            continue
        key = sums[p] ^ (np.uint64(kind[c] + 1) * np.uint64(0x9E3779B97F4A7C15))
        at = slot_of(known, key)
        if known[at] == 0:
            known[at], number[at], cell[n], held[n] = key, n, c, 0.0
            n += 1
        row[c] = number[at]
        held[number[at]] += share[c]
    return n


@njit(cache=True, nogil=True)
def _add_probe(
    length: NDArray[np.uint8],
    q: NDArray[np.float64],
    p_free: NDArray[np.float64],
    slots: NDArray[np.uint16],
    shares: NDArray[np.float64],
    there: NDArray[np.float64],
    ways: NDArray[np.float64],
    rest: NDArray[np.float64],
    w: NDArray[np.float64],
) -> None:
    """Add the free ways of one probe to as many rows as there are lanes.

    Args:
        length: ``(LANES,)``; free distances in units.
        q: ``(LANES,)``; weight of the probe in each row, 0 where it is closed.
        p_free: ``(256,)``; probability that the way was open, by free distance.
        slots: ``(E,)``; where the probe's ways end, and
        shares: ``(E,)`` of them, summing to one.
        there: ``(slots, LANES)``; 1 where the belief has a cell.
        ways: ``(slots, LANES)``, added to.
        rest: ``(LANES,)``, overwritten with the weight of the ways cut short.
        w: ``(LANES,)``, overwritten.
    """
    for b in range(LANES):
        w[b] = q[b] * p_free[length[b]]
        rest[b] = 0.0
    for e in range(shares.shape[0]):
        share, exists = shares[e], there[slots[e]]
        for b in range(LANES):
            rest[b] += share * exists[b]
    for b in range(LANES):
        # A way that is open along the probe's heading but ends on no cell of the belief is none.
        landing = rest[b]
        is_way = 1.0 if landing >= 1e-3 else 0.0
        rest[b] = q[b] - w[b] * is_way
        w[b] *= is_way / max(landing, 1e-3)
    for e in range(shares.shape[0]):
        share, exists, to = shares[e], there[slots[e]], ways[slots[e]]
        for b in range(LANES):
            to[b] += w[b] * share * exists[b]


@njit(cache=True, nogil=True)
def fill_rows(
    free: NDArray[np.uint8],
    is_open: NDArray[np.bool_],
    kind: NDArray[np.int32],
    corner: NDArray[np.int64],
    exists: NDArray[np.uint8],
    half: int,
    start: NDArray[np.int64],
    slot: NDArray[np.uint16],
    share: NDArray[np.float64],
    stop: NDArray[np.uint16],
    ends: NDArray[np.int64],
    p_free: NDArray[np.float64],
    first: NDArray[np.int64],
    step: NDArray[np.int32],
    weight: NDArray[np.float32],
) -> int:
    """Write N rows of one heading; returns how many entries they have.

    Args:
        free: ``(kinds, T S)`` in units.
        is_open: ``(kinds, S)``; open sub-poses.
        kind: ``(N,)``; of the state of each row, and
        corner: ``(N,)``; where in ``exists``, flat, its window begins.
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        half: R.
        start: ``(T S + 1,)``; landings of each probe, entries of
        slot: ``(E,)`` that they fall into and
        share: ``(E,)``, summing to one for each.
        stop: ``(T S, F)``; slot that a probe stands in after its free distance.
        ends: Slots that a way may end in, ascending.
        p_free: ``(256,)``; probability that the way was open, by free distance.
        first: ``(N,)``, overwritten with the first entry of each row.
        step: Overwritten with places from the state's to the entry's.
        weight: ``(2, ...)``, overwritten with free and clipped weights.
    """
    side, width = 2 * half + 1, exists.shape[1]
    own, longest = np.uint16(side * side // 2), np.uint64(stop.shape[1] - 1)
    n_sub, cells = is_open.shape[1], exists.ravel()
    # Where each slot is in a window, and how many places away.
    within = ends // side * width + ends % side
    steps = (ends // side - half) * (width - 2 * half) + ends % side - half
    there, ways = np.zeros((side * side, LANES)), np.zeros((side * side, LANES))
    cut, w, rest = np.zeros((side * side, LANES)), np.empty(LANES), np.empty(LANES)
    length, q = np.zeros((free.shape[1], LANES), dtype=np.uint8), np.zeros((n_sub, LANES))
    n = 0
    for r in range(0, kind.shape[0], LANES):
        lanes = min(LANES, kind.shape[0] - r)
        for b in range(lanes):
            of, counts = free[kind[r + b]], is_open[kind[r + b]]
            each = 1.0 / (free.shape[1] // n_sub * counts.sum())
            for i in range(of.shape[0]):
                length[i, b] = of[i]
            for s in range(n_sub):
                q[s, b] = each if counts[s] else 0.0
        for m in range(ends.shape[0]):
            j = ends[m]
            ways[j] = cut[j] = 0.0
            for b in range(lanes):
                there[j, b] = cells[np.uint64(corner[r + b] + within[m])]
        for i in range(free.shape[1]):
            e, of, stops = slice(start[i], start[i + 1]), length[i], stop[i]
            _add_probe(of, q[i % n_sub], p_free, slot[e], share[e], there, ways, rest, w)
            for b in range(lanes):
                # Without a branch: nothing is added where nothing is cut short.
                j = stops[min(np.uint64(of[b]), longest)]
                cut[j if there[j, b] != 0.0 else own, b] += rest[b]
        for b in range(lanes):
            first[r + b] = n
            for m in range(ends.shape[0]):
                free_way, cut_way = ways[ends[m], b], cut[ends[m], b]
                step[n], weight[0, n], weight[1, n] = steps[m], free_way, cut_way
                n += free_way + cut_way > 0.0
    return n
