"""Kernels of the lattice: the tables of mazes, and true robots in them, for a whole batch.

A state is a cell c of the maze and a heading k, as one number ``4 c + k``. Kernels draw nothing,
raise nothing and check nothing; noise comes in as uniform numbers. Readings and depths are counted
from zero here: a depth of one cell is 0.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
    # Mazes have no pattern that a branch could be foretold by: there is none in what follows.
    size = free.shape[0]
    n = 0
    index[0], index[-1] = -1, -1
    for row in range(1, size - 1):
        index[row, 0], index[row, -1] = -1, -1
        for col in range(1, size - 1):
            cells[n, 0], cells[n, 1] = row, col
            index[row, col] = n if free[row, col] else -1
            n += free[row, col]
    n_steps = target.shape[0] // (4 * cells.shape[0])
    at = index.ravel()
    # Cells ascend by row and column, so the neighbour that a depth is counted from is known already
    # on the way up for the headings down the axes, on the way back for those up. Unsigned numbers,
    # so that no look-up asks whether it counts from the end.
    for k in range(4):
        ahead_by = ((k == 1) - (k == 3)) * size + (k == 0) - (k == 2)
        for i in range(n):
            cell = i if k >= 2 else n - 1 - i
            c, state = np.uint64(cell), 4 * cell
            here = cells[c, 0] * size + cells[c, 1]
            ahead = at[np.uint64(here + ahead_by)]
            goes_on = ahead >= 0
            beyond = ahead if goes_on else 0
            reach = (depth[np.uint64(beyond), k] + 1) * goes_on
            depth[c, k] = reach
            successor[c, k, LEFT] = state + ((k + 1) & 3)
            successor[c, k, RIGHT] = state + ((k + 3) & 3)
            successor[c, k, FORWARD] = 4 * (ahead if goes_on else cell) + k
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
