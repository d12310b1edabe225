"""Kernels of the Bayes filter on lattices, for a whole batch, one call a step.

States, readings and depths are those of :mod:`activeloc.beliefs.lattice_kernels`. A belief is
``bel[c, k]``; ``live[:n]`` lists the cells that hold any mass, in ascending order. All costs follow
that list, not the maze.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.lattice_kernels import FORWARD, LEFT, RIGHT


@njit(cache=True, nogil=True)
def begin(
    robots: NDArray[np.intp],
    reading: NDArray[np.int32],
    n_cells: NDArray[np.int32],
    depth: NDArray[np.int32],
    p: NDArray[np.float64],
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
) -> None:
    """bel(x) = p(z | x) / sum of p(z | x'): the posterior of a first reading, all states alike.

    A reading that no state of the maze explains leaves the belief uniform.

    Args:
        robots: Which.
        reading: ``(B,)``; less one.
        n_cells: ``(B,)``.
        depth: ``(B, C, 4)``.
        p: ``(Z, D)``; p(reading | depth), both less one.
        bel: ``(B, C, 4)``, overwritten.
        live: ``(B, C)``, overwritten.
        n_live: ``(B,)``, overwritten.
    """
    for b in robots:
        n, known = n_cells[b], 0 <= reading[b] < p.shape[0]
        likelihood = p[reading[b] if known else 0]
        total = 0.0
        for c in range(n):
            for k in range(4):
                total += likelihood[depth[b, c, k]] if known else 0.0
        alike = total == 0.0
        share = likelihood / (1.0 if alike else total)
        count = 0
        for c in range(n):
            largest = 0.0
            for k in range(4):
                q = 1.0 / (4 * n) if alike else share[depth[b, c, k]]
                bel[b, c, k] = q
                largest = max(largest, q)
            if largest > 0.0:
                live[b, count] = c
                count += 1
        bel[b, n:] = 0.0
        n_live[b] = count


@njit(cache=True, nogil=True)
def turn(bel: NDArray[np.float64], live: NDArray[np.int32], action: int) -> None:
    """Turn every state of ``bel (C, 4)`` by a quarter."""
    for cell in live:
        c = np.uint64(cell)
        first, second, third, fourth = bel[c, 0], bel[c, 1], bel[c, 2], bel[c, 3]
        if action == LEFT:
            bel[c, 0], bel[c, 1], bel[c, 2], bel[c, 3] = fourth, first, second, third
        else:
            bel[c, 0], bel[c, 1], bel[c, 2], bel[c, 3] = second, third, fourth, first


@njit(cache=True, nogil=True)
def drive(
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n: int,
    target: NDArray[np.int32],
    p_step: NDArray[np.float64],
    spare: NDArray[np.float64],
    reached: NDArray[np.uint8],
) -> int:
    """Drive every state of a belief forward; returns its number of live cells.

    Args:
        bel: ``(C, 4)``, overwritten.
        live: ``(C,)``, overwritten; the first ``n`` are live.
        n: .
        target: ``(C * 4 * J,)``; the cell that each state and length of a step leads to.
        p_step: ``(J,)``; how likely each length is.
        spare: ``(C, 4)`` of zeros, and left as such.
        reached: Zeros, at least C and a multiple of eight, and left as such.
    """
    n_steps = p_step.shape[0]
    for i in range(n):
        c = np.uint64(live[i])
        for k in range(4):
            p = bel[c, k]
            if p > 0.0:
                bel[c, k] = 0.0
                first = np.uint64((live[i] * 4 + k) * n_steps)
                for j in range(n_steps):
                    t = np.uint64(target[first + np.uint64(j)])
                    spare[t, k] += p * p_step[j]
                    reached[t] = 1
    n, words = 0, reached.view(np.uint64)
    for w in range(words.shape[0]):
        if words[w] == 0:
            continue
        for cell in range(8 * w, 8 * w + 8):
            c = np.uint64(cell)
            if reached[c]:
                live[n] = cell
                n += 1
                for k in range(4):
                    bel[c, k] = spare[c, k]
                    spare[c, k] = 0.0
        words[w] = 0
    return n


@njit(cache=True, nogil=True)
def correct(
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    depth: NDArray[np.int32],
    likelihood: NDArray[np.float64],
) -> int:
    """bel(x) = p(z | x) bel(x) / p(z); returns its number of live cells.

    A reading that no state explains changes nothing; -1 says so.

    Args:
        bel: ``(C, 4)``, overwritten.
        live: ``(n,)``, overwritten.
        depth: ``(C, 4)``.
        likelihood: ``(D,)``; of the reading, by depth.
    """
    total = 0.0
    for cell in live:
        c = np.uint64(cell)
        for k in range(4):
            total += bel[c, k] * likelihood[np.uint64(depth[c, k])]
    if total <= 0.0:
        return -1
    n = 0
    for i in range(live.shape[0]):
        c, held = np.uint64(live[i]), 0.0
        for k in range(4):
            p = bel[c, k] * likelihood[np.uint64(depth[c, k])] / total
            bel[c, k] = p
            held += p
        live[n] = live[i]
        n += held > 0.0
    return n


@njit(cache=True, nogil=True)
def advance(
    active: NDArray[np.bool_],
    actions: NDArray[np.int64],
    reading: NDArray[np.int32],
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    p_step: NDArray[np.float64],
    p: NDArray[np.float64],
    impossible: NDArray[np.int32],
) -> None:
    """Predict and correct the beliefs of a batch.

    Args:
        active: ``(B,)``; the others are left alone.
        actions: ``(B,)``; none of 0, 1, 2: the belief is corrected only.
        reading: ``(B,)``; less one.
        bel: ``(B, C, 4)``, overwritten.
        live: ``(B, C)``, overwritten.
        n_live: ``(B,)``, overwritten.
        depth: ``(B, C, 4)``.
        target: ``(B, C * 4 * J)``.
        p_step: ``(J,)``; how likely each length of a step is.
        p: ``(Z, D)``; p(reading | depth), both less one.
        impossible: ``(B,)``; counts the readings that no state explains, which change nothing.
    """
    n_max = bel.shape[1]
    spare, reached = np.zeros((n_max, 4)), np.zeros((n_max + 7) // 8 * 8, np.uint8)
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        n = int(n_live[b])
        if actions[b] == LEFT or actions[b] == RIGHT:
            turn(bel[b], live[b, :n], actions[b])
        elif actions[b] == FORWARD:
            n = drive(bel[b], live[b], n, target[b], p_step, spare, reached)
        z, left = reading[b], -1
        if 0 <= z < p.shape[0]:
            left = correct(bel[b], live[b, :n], depth[b], p[z])
        impossible[b] += left < 0
        n_live[b] = left if left >= 0 else n


@njit(cache=True, nogil=True)
def summarise(
    active: NDArray[np.bool_],
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    largest: NDArray[np.float64],
    likeliest: NDArray[np.int32],
    entropy: NDArray[np.float64],
) -> None:
    """Largest probability, the first state that has it, and entropy [nat] of each belief.

    Args:
        active: ``(B,)``; the others are left alone.
        bel: ``(B, C, 4)``.
        live: ``(B, C)``.
        n_live: ``(B,)``.
        largest: ``(B,)``, overwritten.
        likeliest: ``(B,)``, overwritten.
        entropy: ``(B,)``, overwritten.
    """
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        best, at, h = 0.0, 0, 0.0
        # Equal candidates are the rule: their logarithm is taken once.
        last, last_term = 0.0, 0.0
        for i in range(n_live[b]):
            c = live[b, i]
            for k in range(4):
                p = bel[b, c, k]
                if p <= 0.0:
                    continue
                if p != last:
                    last, last_term = p, -p * np.log(p)
                h += last_term
                state = 4 * c + k
                if p > best or (p == best and state < at):
                    best, at = p, state
        largest[b], likeliest[b], entropy[b] = best, at, max(h, 0.0)


@njit(cache=True, nogil=True)
def list_states(
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    states: NDArray[np.int16],
    p: NDArray[np.float64],
    n: NDArray[np.int32],
) -> None:
    """The states that hold mass, and how much.

    Args:
        bel: ``(B, C, 4)``.
        live: ``(B, C)``.
        n_live: ``(B,)``.
        states: ``(B, S)``, overwritten in its first ``n``; the rest is left as it was.
        p: ``(B, S)``, likewise.
        n: ``(B,)``, overwritten.
    """
    for b in range(n.shape[0]):
        count = 0
        for i in range(n_live[b]):
            c = live[b, i]
            for k in range(4):
                if bel[b, c, k] > 0.0:
                    states[b, count], p[b, count] = 4 * c + k, bel[b, c, k]
                    count += 1
        n[b] = count


@njit(cache=True, nogil=True)
def picture(
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    cells: NDArray[np.int32],
    largest: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """Draw p / max p of each belief in the maze's frame, heading by heading.

    Args:
        bel: ``(B, C, 4)``.
        live: ``(B, C)``.
        n_live: ``(B,)``.
        cells: ``(B, C, 2)``.
        largest: ``(B,)``.
        out: ``(B, 4, m, m)``, overwritten.
    """
    for b in range(out.shape[0]):
        out[b] = 0.0
        for i in range(n_live[b]):
            c = live[b, i]
            row, col = cells[b, c, 0], cells[b, c, 1]
            for k in range(4):
                out[b, k, row, col] = bel[b, c, k] / largest[b]
