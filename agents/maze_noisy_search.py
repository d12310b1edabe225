"""Kernels of the search in a maze with noise.

A sum over joint probabilities q(x, z), which need not be normalised:

    V(q, k) = max_a sum_z [ max_x q_az(x) + V(q_az, k - 1) ],    q_az(x) = p(z | x) (T_a q)(x).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def predict(
    q: NDArray[np.float64],
    action: int,
    target: NDArray[np.int32],
    p_step: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """out(x') = sum over x of p(x' | x, action) q(x).

    Args:
        q: ``(S,)`` over states 4 c + k.
        action: In 0, 1, 2.
        target: ``(S * J,)``; cell that each length of a step leads to.
        p_step: ``(J,)``.
        out: ``(S,)``, overwritten.
    """
    n_steps = p_step.shape[0]
    out[:] = 0.0
    for s in range(q.shape[0]):
        if q[s] > 0.0:
            cell, k = s // 4, s % 4
            if action == 0:
                out[4 * cell + (k + 1) % 4] += q[s]
            elif action == 1:
                out[4 * cell + (k + 3) % 4] += q[s]
            else:
                for j in range(n_steps):
                    out[4 * target[s * n_steps + j] + k] += p_step[j] * q[s]


@njit(cache=True, nogil=True)
def noisy_worth(
    target: NDArray[np.int32],
    depth: NDArray[np.int32],
    p_step: NDArray[np.float64],
    confusion: NDArray[np.float64],
    level: NDArray[np.float64],
    moved: NDArray[np.float64],
    value: NDArray[np.float64],
) -> None:
    """V of the probabilities ``level[0]`` by each first action; a frame a depth, as :func:`worth`.

    Args:
        target: ``(S * J,)``.
        depth: ``(S,)``; less one.
        p_step: ``(J,)``.
        confusion: ``(D, Z)``; p(reading | depth), both less one.
        level: ``(K + 1, S)``; overwritten below the first row.
        moved: ``(K, S)``, overwritten.
        value: ``(3,)``, overwritten.
    """
    horizon, n_readings = moved.shape[0], confusion.shape[1]
    order = np.full(horizon, -1)
    z = np.full(horizon, n_readings)
    total, best = np.zeros(horizon), np.full(horizon, -1.0)
    d = 0
    while True:
        if z[d] < n_readings:
            largest, mass = 0.0, 0.0
            for s in range(depth.shape[0]):
                q = moved[d, s]
                if q > 0.0:
                    q *= confusion[depth[s], z[d]]
                    mass += q
                    largest = max(largest, q)
                level[d + 1, s] = q
            z[d] += 1
            if mass > 1e-9:
                total[d] += largest
                if d + 1 < horizon:
                    d += 1
                    order[d], z[d], best[d] = -1, n_readings, -1.0
            continue
        if order[d] >= 0:
            if d == 0:
                value[2 - order[d]] = total[d]
            best[d] = max(best[d], total[d])
        order[d] += 1
        if order[d] == 3:
            if d == 0:
                return
            d -= 1
            total[d] += best[d + 1]
            continue
        action = 2 - order[d]
        total[d] = 0.0
        predict(level[d], action, target, p_step, moved[d])
        z[d] = 0


@njit(cache=True, nogil=True)
def plan_all_noisy(
    robots: NDArray[np.intp],
    bel: NDArray[np.float64],
    n_cells: NDArray[np.int32],
    target: NDArray[np.int32],
    depth: NDArray[np.int32],
    p_step: NDArray[np.float64],
    confusion: NDArray[np.float64],
    steps: int,
    values: NDArray[np.float64],
) -> None:
    """K-step values of each action for a batch of noisy mazes: mean largest probability a step.

    Args:
        robots: ``(n,)``; which.
        bel: ``(B, S)``.
        n_cells: ``(B,)``.
        target: ``(B, S * J)``.
        depth: ``(B, S)``; less one.
        p_step: ``(J,)``.
        confusion: ``(D, Z)``.
        steps: K.
        values: ``(n, 3)``, overwritten with V / K.
    """
    for i in range(robots.shape[0]):
        b, n = robots[i], 4 * n_cells[robots[i]]
        level, moved = np.empty((steps + 1, n)), np.empty((steps, n))
        level[0] = bel[b, :n]
        noisy_worth(target[b], depth[b, :n], p_step, confusion, level, moved, values[i])
        values[i] /= steps
