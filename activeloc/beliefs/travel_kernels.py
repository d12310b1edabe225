"""Kernels of the travel table: where a travel of a given length leads from each state.

A probe is a sub-pose s of a cell at a heading t within a bin. Cells are known by their places in a
plane.
"""

from math import erf, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import SUB


@njit(cache=True, nogil=True)
def fill_stencils(
    thetas: NDArray[np.float64],
    lattice: NDArray[np.float64],
    turns: NDArray[np.float64],
    lengths: NDArray[np.float64],
    weights: NDArray[np.float64],
    window: NDArray[np.float64],
) -> None:
    """Add up where a travel ends: ``window[k, s, row, col]`` around the cell it starts in.

    Args:
        thetas: ``(K,)``.
        lattice: ``(S, 2)`` of sub-pose offsets [cell].
        turns: ``(A,)``; equally likely headings, relative to the bin's centre [rad].
        lengths: ``(L,)``; travels [cell], with
        weights: ``(L,)``.
        window: ``(K, S, 2 R + 1, 2 R + 1)``, zeros.
    """
    half = window.shape[2] // 2
    share = 1.0 / (turns.shape[0] * SUB * SUB)
    for k in range(thetas.shape[0]):
        for t in range(turns.shape[0]):
            dx, dy = np.cos(thetas[k] + turns[t]), np.sin(thetas[k] + turns[t])
            for n in range(lengths.shape[0]):
                for s in range(lattice.shape[0]):
                    for i in range(SUB):
                        x = lattice[s, 0] + ((i + 0.5) / SUB - 0.5) / SUB + lengths[n] * dx
                        col = int(np.floor(x)) + half
                        for j in range(SUB):
                            y = lattice[s, 1] + ((j + 0.5) / SUB - 0.5) / SUB + lengths[n] * dy
                            window[k, s, int(np.floor(y)) + half, col] += share * weights[n]


@njit(cache=True, nogil=True)
def count_near(
    free: NDArray[np.uint8],
    is_open: NDArray[np.bool_],
    place: NDArray[np.int32],
    units: int,
    near: NDArray[np.float32],
) -> None:
    """Share of each state's probes with less than so many units free ahead.

    Args:
        free: ``(K, T, S, P)`` in units.
        is_open: ``(S, C)``.
        place: ``(C,)``.
        units: Free distance that is no longer near.
        near: ``(K, P)``, zeros, overwritten.
    """
    n_sub = is_open.shape[0]
    n_open = np.zeros(place.shape[0])
    for s in range(n_sub):
        for c in range(place.shape[0]):
            n_open[c] += is_open[s, c]
    held = np.empty(place.shape[0], dtype=np.int32)
    for k in range(free.shape[0]):
        held[:] = 0
        for t in range(free.shape[1]):
            for s in range(n_sub):
                of, counts = free[k, t, s], is_open[s]
                for c in range(place.shape[0]):
                    held[c] += counts[c] and of[place[c]] < units
        for c in range(place.shape[0]):
            near[k, place[c]] = held[c] / (free.shape[1] * n_open[c])


@njit(cache=True, nogil=True)
def fill_plain(
    free: NDArray[np.uint8],
    whole: NDArray[np.uint8],
    exists: NDArray[np.uint8],
    steps: NDArray[np.int32],
    safe: int,
    plain: NDArray[np.uint8],
) -> None:
    """Where a stencil holds: all probes open, free, and landing on cells of the belief.

    Args:
        free: ``(N, P)`` in units, of the probes.
        whole: ``(P,)``; 1 where all sub-poses of a cell are open.
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        steps: ``(E, 2)`` of rows and columns that the stencil reaches, at most R.
        safe: Free distance with no doubt open [unit].
        plain: ``(rows, cols)``, overwritten with 0 and 1.
    """
    rows, cols = plain.shape
    half = (exists.shape[1] - cols) // 2
    least = np.full(free.shape[1], 255, dtype=np.uint8)
    for i in range(free.shape[0]):
        of = free[i]
        for p in range(least.shape[0]):
            least[p] = min(least[p], of[p])
    for row in range(rows):
        here, at = plain[row], row * cols
        for col in range(cols):
            here[col] = whole[at + col] if least[at + col] >= safe else 0
        for e in range(steps.shape[0]):
            there = exists[row + half + steps[e, 0], half + steps[e, 1] :]
            for col in range(cols):
                here[col] &= there[col]


@njit(cache=True, nogil=True)
def _add_probe(
    free: NDArray[np.uint8],
    q: NDArray[np.float64],
    p_free: NDArray[np.float64],
    exists: NDArray[np.uint8],
    shifts: NDArray[np.int64],
    slots: NDArray[np.int64],
    shares: NDArray[np.float64],
    ways: NDArray[np.float64],
    rest: NDArray[np.float64],
    w: NDArray[np.float64],
) -> None:
    """Add the free ways of one probe to the windows of a row of places.

    Args:
        free: ``(n,)`` in units.
        q: ``(n,)``; weight of the probe in each state's row, 0 where it is closed.
        p_free: ``(256,)``; probability that the way was open, by free distance.
        exists: 1 where the belief has a cell, from the first slot of the first place on.
        shifts: ``(E,)``; where there the probe's ways end,
        slots: ``(E,)``; in which slot, and
        shares: ``(E,)`` of them, summing to one.
        ways: ``(slots, n)``, added to.
        rest: ``(n,)``, overwritten with the weight of the ways cut short.
        w: ``(n,)``, overwritten.
    """
    n = free.shape[0]
    for i in range(n):
        w[i] = q[i] * p_free[free[i]]
        rest[i] = 0.0
    for e in range(shifts.shape[0]):
        there, share = exists[shifts[e] :], shares[e]
        for i in range(n):
            rest[i] += share * there[i]
    for i in range(n):
        # A way that is open along the probe's heading but ends on no cell of the belief is none.
        landing = rest[i]
        is_way = 1.0 if landing >= 1e-3 else 0.0
        rest[i] = q[i] - w[i] * is_way
        w[i] *= is_way / max(landing, 1e-3)
    for e in range(shifts.shape[0]):
        there, share, to = exists[shifts[e] :], shares[e], ways[slots[e]]
        for i in range(n):
            to[i] += w[i] * share * there[i]


@njit(cache=True, nogil=True)
def _stops(
    lattice: NDArray[np.float64], angles: NDArray[np.float64], reach: NDArray[np.float64], half: int
) -> NDArray[np.int64]:
    """``(T S, 256)``; slot where each probe stands after its free distance or the travel [unit]."""
    stop = np.empty((angles.shape[0] * lattice.shape[0], 256), dtype=np.int64)
    for i in range(stop.shape[0]):
        s, angle = i % lattice.shape[0], angles[i // lattice.shape[0]]
        dx, dy = np.cos(angle), np.sin(angle)
        for f in range(256):
            z = min(f * reach[0], reach[1])
            row, col = int(np.floor(lattice[s, 1] + z * dy)), int(np.floor(lattice[s, 0] + z * dx))
            stop[i, f] = (row + half) * (2 * half + 1) + col + half
    return stop


@njit(cache=True, nogil=True)
def fill_rows(
    first: int,
    free: NDArray[np.uint8],
    q: NDArray[np.float64],
    exists: NDArray[np.uint8],
    plain: NDArray[np.uint8],
    lattice: NDArray[np.float64],
    angles: NDArray[np.float64],
    start: NDArray[np.int64],
    slot: NDArray[np.int64],
    share: NDArray[np.float64],
    p_free: NDArray[np.float64],
    reach: NDArray[np.float64],
    size: NDArray[np.int64],
    target: NDArray[np.uint16],
    weight: NDArray[np.float32],
) -> tuple[int, int]:
    """Write the rows of one heading that obstacles touch, as long as there is room.

    A row of places is done at once, probe by probe.

    Args:
        first: First row of places.
        free: ``(T, S, P)`` in units; probes are T headings from S sub-poses.
        q: ``(S, P)``; weight of a probe in each state's row, 0 where it is closed.
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        plain: ``(rows, cols)``; states that need no row.
        lattice: ``(S, 2)`` of offsets of the sub-poses [cell].
        angles: ``(T,)``; headings of the probes.
        start: ``(T S + 1,)``; landings of each probe, entries of
        slot: ``(E,)`` of the window that they fall into and
        share: ``(E,)``, summing to one for each.
        p_free: ``(256,)``; probability that the way was open, by free distance.
        reach: Length of a unit, and of the travel [cell].
        size: ``(rows * cols,)``, zeros, overwritten with entries per row.
        target: Overwritten with places.
        weight: ``(2, ...)``, overwritten with free and clipped weights.

    Returns:
        One past the last row of places done, and how many entries were written.
    """
    n_sub, (rows, cols) = free.shape[1], plain.shape
    half = (exists.shape[1] - cols) // 2
    side = 2 * half + 1
    own, all_cells = half * side + half, exists.ravel()
    # A slot of the window: where its place is from the state's, and where in ``exists`` from the
    # first slot's.
    where, around = np.empty(side * side, dtype=np.int64), np.empty(side * side, dtype=np.int64)
    for i in range(side * side):
        where[i] = (i // side - half) * cols + i % side - half
        around[i] = i // side * exists.shape[1] + i % side
    shift, stop = around[slot], _stops(lattice, angles, reach, half)
    used = _used(slot, stop, own, side * side)
    ways, cut = np.zeros((side * side, cols)), np.zeros((side * side, cols))
    rest, w, columns = np.empty(cols), np.empty(cols), np.empty(cols, dtype=np.int64)
    n = 0
    for row in range(first, rows):
        is_cell = all_cells[row * exists.shape[1] :]
        here = is_cell[half * exists.shape[1] + half :]
        n_beside = 0
        for col in range(cols):
            if here[col] != 0 and plain[row, col] == 0:
                columns[n_beside] = col
                n_beside += 1
        if n_beside == 0:
            continue
        if n + n_beside * used.shape[0] > target.shape[0]:
            return row, n
        beside = columns[:n_beside]
        at = row * cols
        for i in range(start.shape[0] - 1):
            length = free[i // n_sub, i % n_sub, at : at + cols]
            e = slice(start[i], start[i + 1])
            _add_probe(
                length, q[i % n_sub, at : at + cols], p_free, is_cell, shift[e], slot[e], share[e],
                ways, rest, w,
            )  # fmt: skip
            for col in beside:
                if rest[col] > 0.0:
                    there = stop[i, length[col]]
                    cut[there if is_cell[col + around[there]] != 0 else own, col] += rest[col]
        for col in beside:
            for j in used:
                if ways[j, col] + cut[j, col] > 0.0:
                    target[n] = at + col + where[j]
                    weight[0, n], weight[1, n] = ways[j, col], cut[j, col]
                    n += 1
                    size[at + col] += 1
        for j in used:
            ways[j, :] = 0.0
            cut[j, :] = 0.0
    return rows, n


@njit(cache=True, nogil=True)
def _used(
    slot: NDArray[np.int64], stop: NDArray[np.int64], own: int, n_slots: int
) -> NDArray[np.int64]:
    """Slots that a way may end in, ascending."""
    is_used = np.zeros(n_slots, dtype=np.bool_)
    is_used[own] = True
    for e in range(slot.shape[0]):
        is_used[slot[e]] = True
    for i in range(stop.shape[0]):
        for f in range(stop.shape[1]):
            is_used[stop[i, f]] = True
    return np.flatnonzero(is_used)


@njit(cache=True, nogil=True)
def open_chance(unit: float, threshold: float, spread: float, safe: float) -> NDArray[np.float64]:
    """``(256,)``; probability that a way was open whose free distance is so many units.

    Args:
        unit: Its length, and that of
        threshold: the free distance that is as likely open as not,
        spread: its standard deviation, and
        safe: a free distance with no doubt open.
    """
    p = np.ones(256)
    for f in range(256):
        if f * unit < safe:
            x = (f * unit - threshold) / (spread * sqrt(2.0))
            p[f] = 0.5 * (1.0 + erf(x)) if x > -4.5 else 0.0  # 1e-10
    return p
