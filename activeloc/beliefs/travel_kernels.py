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
    parts: NDArray[np.float64],
    landings: NDArray[np.int64],
    shares: NDArray[np.float64],
    q: float,
    p: float,
    is_cell: NDArray[np.uint8],
    around: NDArray[np.int64],
) -> float:
    """Add the free ways of one probe to its state's window; returns the share of ways cut short.

    Args:
        parts: ``(slots,)``, added to.
        landings: ``(E,)``; slots that the probe's ways end in, with
        shares: ``(E,)``, summing to one.
        q: Weight of the probe in the row.
        p: Probability that its way was open.
        is_cell: 1 where the belief has a cell, from the state's own on.
        around: ``(slots,)``; where each slot is in ``is_cell``.
    """
    landing = 0.0
    for e in range(landings.shape[0]):
        if is_cell[around[landings[e]]] != 0:
            landing += shares[e]
    # A way that is open along the probe's heading but ends on no cell of the belief.
    if landing < 1e-3:
        return 1.0
    for e in range(landings.shape[0]):
        if is_cell[around[landings[e]]] != 0:
            parts[landings[e]] += q * p / landing * shares[e]
    return 1.0 - p


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
    is_open: NDArray[np.bool_],
    place: NDArray[np.int32],
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
    target: NDArray[np.uint32],
    weight: NDArray[np.float32],
) -> tuple[int, int]:
    """Write the rows of one heading that obstacles touch, from a cell on, as long as there is room.

    Args:
        first: First cell.
        free: ``(T, S, P)`` in units; probes are T headings from S sub-poses.
        is_open: ``(S, C)``.
        place: ``(C,)``.
        exists: ``(rows + 2 R, cols + 2 R)``; 1 where the belief has a cell.
        plain: ``(1 + T, rows, cols)``; states that need no row, and those where all the probes of
            one heading are free and land on cells.
        lattice: ``(S, 2)`` of offsets of the sub-poses [cell].
        angles: ``(T,)``; headings of the probes.
        start: ``(T S + T + 1,)``; landings of each probe, and of each heading, entries of
        slot: ``(E,)`` of the window that they fall into and
        share: ``(E,)``, summing to one for each.
        p_free: ``(256,)``; probability that the way was open, by free distance.
        reach: Length of a unit, and of the travel [cell].
        size: ``(C,)``, overwritten with entries per row.
        target: Overwritten with places.
        weight: ``(2, ...)``, overwritten with free and clipped weights.

    Returns:
        One past the last cell done, and how many entries were written.
    """
    n_turns, n_sub, n_cells = free.shape[0], is_open.shape[0], place.shape[0]
    cols = plain.shape[2]
    half = (exists.shape[1] - cols) // 2
    side = 2 * half + 1
    all_cells, own = exists.ravel(), half * side + half
    # A slot of the window: where its place is from the state's, and where in ``exists`` from the
    # first slot's.
    where, around = np.empty(side * side, dtype=np.int64), np.empty(side * side, dtype=np.int64)
    for i in range(side * side):
        where[i] = (i // side - half) * cols + i % side - half
        around[i] = i // side * exists.shape[1] + i % side
    parts = np.zeros((2, side * side))
    ways, cut = parts[0], parts[1]
    stop = _stops(lattice, angles, reach, half)
    is_used = np.zeros(side * side, dtype=np.bool_)
    is_used[own] = True
    for e in range(slot.shape[0]):
        is_used[slot[e]] = True
    for i in range(stop.shape[0]):
        for f in range(256):
            is_used[stop[i, f]] = True
    used = np.flatnonzero(is_used)
    n = 0
    for c in range(first, n_cells):
        here = place[c]
        row, col = here // cols, here % cols
        size[c] = 0
        if plain[0, row, col] != 0:
            continue
        if n + side * side > target.shape[0]:
            return c, n
        n_open = 0
        for s in range(n_sub):
            n_open += is_open[s, c]
        q = 1.0 / (n_open * n_turns)
        is_cell = all_cells[row * exists.shape[1] + col :]
        for t in range(n_turns):
            if plain[1 + t, row, col] != 0:
                for e in range(start[n_turns * n_sub + t], start[n_turns * n_sub + t + 1]):
                    ways[slot[e]] += share[e] / n_turns
                continue
            for s in range(n_sub):
                if not is_open[s, c]:
                    continue
                length, rest, i = free[t, s, here], 1.0, t * n_sub + s
                if p_free[length] > 0.0:
                    rest = _add_probe(
                        ways, slot[start[i] : start[i + 1]], share[start[i] : start[i + 1]],
                        q, p_free[length], is_cell, around,
                    )  # fmt: skip
                if rest > 0.0:
                    there = stop[i, length]
                    cut[there if is_cell[around[there]] != 0 else own] += q * rest
        begin = n
        for at in used:
            if ways[at] + cut[at] > 0.0:
                target[n] = here + where[at]
                weight[0, n], weight[1, n] = ways[at], cut[at]
                ways[at] = cut[at] = 0.0
                n += 1
        size[c] = n - begin
    return n_cells, n


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
