"""Kernels of the lattice: mazes, true robots and beliefs of a whole batch, one call a step.

A state is a cell c of the maze and a heading k, as one number ``4 c + k``. The filter itself is the
histogram's: :func:`advance` calls the kernels of :mod:`activeloc.beliefs.histogram_kernels` for one
robot after another. Kernels draw nothing, raise nothing and check nothing; noise comes in as
uniform numbers. Readings and depths are counted from zero here: a depth of one cell is 0.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.histogram_kernels import multiply, normalise, rotate, translate

LEFT, RIGHT, FORWARD = 0, 1, 2


@njit(cache=True, nogil=True)
def survey(
    free: NDArray[np.bool_],
    cells: NDArray[np.int32],
    index: NDArray[np.int32],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    first: int,
    successor: NDArray[np.int16],
) -> int:
    """Fill the tables of one maze; returns how many cells it has.

    Args:
        free: ``(m, m)``, with walls all around.
        cells: ``(C, 2)`` of row, column, overwritten.
        index: ``(m, m)``, overwritten with each free cell's number; -1 for walls.
        depth: ``(C, 4)``, overwritten with the cells to the wall ahead, less one.
        target: ``(C * 4 * J,)``, overwritten with the cells that steps of ``first`` and more cells
            lead to, clipped at walls.
        first: Shortest step [cell].
        successor: ``(C, 4, 3)``, overwritten with the states that the actions mean to lead to.
    """
    size = free.shape[0]
    n = 0
    for row in range(size):
        for col in range(size):
            index[row, col] = -1
            if free[row, col]:
                cells[n, 0], cells[n, 1] = row, col
                index[row, col] = n
                n += 1
    n_steps = target.shape[0] // (4 * cells.shape[0])
    at = index.ravel()
    # Cells ascend by row and column, so the neighbour that a depth is counted from is known already
    # on the way up for the headings down the axes, on the way back for those up. Unsigned numbers,
    # so that no look-up asks whether it counts from the end.
    for k in range(4):
        ahead_by = ((k == 1) - (k == 3)) * size + (k == 0) - (k == 2)
        for i in range(n):
            c = np.uint64(i if k >= 2 else n - 1 - i)
            here = cells[c, 0] * size + cells[c, 1]
            ahead = at[np.uint64(here + ahead_by)]
            reach = 0
            if ahead >= 0:
                reach = depth[np.uint64(ahead), k] + 1
            depth[c, k] = reach
            state = np.int64(4 * c)
            successor[c, k, LEFT] = state + ((k + 1) & 3)
            successor[c, k, RIGHT] = state + ((k + 3) & 3)
            successor[c, k, FORWARD] = 4 * ahead + k if ahead >= 0 else state + k
            first_target = np.uint64((state + k) * n_steps)
            for j in range(n_steps):
                there = here + min(first + j, reach) * ahead_by
                target[first_target + np.uint64(j)] = at[np.uint64(there)]
    return n


@njit(cache=True, nogil=True)
def survey_all(
    robots: NDArray[np.intp],
    free: NDArray[np.bool_],
    n_cells: NDArray[np.int32],
    cells: NDArray[np.int32],
    index: NDArray[np.int32],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    first: int,
    successor: NDArray[np.int16],
) -> None:
    """:func:`survey` of the mazes of some robots; tables have a leading axis of B."""
    for b in robots:
        n_cells[b] = survey(free[b], cells[b], index[b], depth[b], target[b], first, successor[b])


@njit(cache=True, nogil=True)
def drawn(p: NDArray[np.float64], uniform: float) -> int:
    """Where a uniform number in [0, 1) falls in a distribution ``(n,)``."""
    total = 0.0
    for i in range(p.shape[0]):
        total += p[i]
        if uniform < total:
            return i
    i = p.shape[0] - 1
    while i > 0 and p[i] == 0.0:
        i -= 1
    return i


@njit(cache=True, nogil=True)
def move_and_read(
    active: NDArray[np.bool_],
    actions: NDArray[np.int64],
    uniforms: NDArray[np.float64],
    p_step: NDArray[np.float64],
    confusion: NDArray[np.float64],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    state: NDArray[np.int32],
    reading: NDArray[np.int32],
) -> None:
    """The true robots act, then read their sensors.

    Args:
        active: ``(B,)``; the others are left alone.
        actions: ``(B,)``: 0 left, 1 right, 2 forward, anything else stays.
        uniforms: ``(B, 2)`` in [0, 1): of the step and of the reading.
        p_step: ``(J,)``; how likely each length of a step is.
        confusion: ``(D, D)``; row d, probabilities of the readings, depth and reading less one.
        depth: ``(B, C, 4)``.
        target: ``(B, C * 4 * J)``.
        state: ``(B,)``, overwritten.
        reading: ``(B,)``, overwritten with readings less one.
    """
    n_steps = p_step.shape[0]
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        c, k = state[b] // 4, state[b] % 4
        if actions[b] == LEFT:
            k = (k + 1) % 4
        elif actions[b] == RIGHT:
            k = (k + 3) % 4
        elif actions[b] == FORWARD:
            c = target[b, (4 * c + k) * n_steps + drawn(p_step, uniforms[b, 0])]
        state[b] = 4 * c + k
        reading[b] = drawn(confusion[depth[b, c, k]], uniforms[b, 1])


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
def is_possible(
    bel: NDArray[Any],
    live: NDArray[np.int32],
    depth: NDArray[np.int32],
    likelihood: NDArray[np.float64],
) -> bool:
    """Whether a state that holds mass explains a reading; most often the first ones do.

    Args:
        bel: ``(C, 4)``.
        live: ``(n,)`` of cells.
        depth: ``(C, 4)``; less one.
        likelihood: ``(D,)``; of the reading, by depth.
    """
    for c in live:
        for k in range(4):
            if bel[c, k] > 0.0 and likelihood[depth[c, k]] > 0.0:
                return True
    return False


@njit(cache=True, nogil=True)
def advance(
    active: NDArray[np.bool_],
    actions: NDArray[np.int64],
    reading: NDArray[np.int32],
    bel: NDArray[Any],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    n_cells: NDArray[np.int32],
    cells: NDArray[np.int32],
    index: NDArray[np.int32],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    row_start: NDArray[np.int64],
    weight: NDArray[Any],
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
        n_cells: ``(B,)``.
        cells: ``(B, C, 2)``.
        index: ``(B, m, m)``.
        depth: ``(B, C, 4)``.
        target: ``(B, C * 4 * J)``.
        row_start: ``(C * 4 + 1,)``; where each state's targets begin.
        weight: ``(2, C * 4 * J)``; how likely each target is; zeros.
        p: ``(Z, D)``; p(reading | depth), both less one.
        impossible: ``(B,)``; counts the readings that no state explains, which change nothing.
    """
    n_max = bel.shape[1]
    spare: NDArray[Any] = np.zeros((n_max, 4))
    spare_live, z = np.empty(n_max, np.int32), np.empty(1, np.int32)
    straight, surely = np.zeros(1, np.int32), np.ones(1)
    no_start, no_step = np.zeros(5, np.int64), np.zeros((0, 2), np.int32)
    no_weight: NDArray[Any] = np.zeros(0)
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        n, own = n_cells[b], bel[b, : n_cells[b]]
        if actions[b] == LEFT or actions[b] == RIGHT:
            rotate(own, live[b, : n_live[b]], 1 if actions[b] == LEFT else -1, surely)
        elif actions[b] == FORWARD:
            n_live[b] = translate(
                own, live[b, : n_live[b]], spare[:n], spare_live[:n], 0, cells[b], index[b],
                no_start, no_step, no_weight, row_start, target[b], weight, 0.0,
            )  # fmt: skip
            for i in range(n_live[b]):
                c = spare_live[i]
                live[b, i] = c
                for k in range(4):
                    own[c, k] = spare[c, k]
                    spare[c, k] = 0.0
        z[0] = reading[b]
        there = live[b, : n_live[b]]
        if 0 <= z[0] < p.shape[0] and is_possible(own, there, depth[b], p[z[0]]):
            total = multiply(own, there, depth[b], p, z, straight, 1, 1.0)
            n_live[b], _ = normalise(own, there, total, 0.0)
        else:
            impossible[b] += 1


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
        out: ``(B, 4, m, m)``, zeros, overwritten where there is mass.
    """
    for b in range(out.shape[0]):
        for i in range(n_live[b]):
            c = live[b, i]
            row, col = cells[b, c, 0], cells[b, c, 1]
            for k in range(4):
                out[b, k, row, col] = bel[b, c, k] / largest[b]
