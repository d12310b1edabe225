"""What one action in a maze is expected to leave of the belief: summed exactly, for a batch."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.lattice_kernels import FORWARD, LEFT
from activeloc.envs.maze_episodes import MazeKnowledge

TIE = 1e-9
PREFERENCE = np.array([2, 0, 1])
"""Among equals: forward, left, right. Turning in a known place leads nowhere."""


def expected_entropies(knowledge: MazeKnowledge) -> NDArray[np.float64]:
    """E_z[H(x' | z, u)] for each robot that is asked for and each action: ``(n, 3)`` [nat]."""
    on, belief = knowledge.lattice, knowledge.belief
    out = np.empty((len(knowledge.robots), 3))
    _expected_entropies(
        knowledge.robots, belief.bel, belief.live, belief.n_live, on.depth, on.target, on.p_step,
        on.sensor.confusion, out,
    )  # fmt: skip
    return out


def least_expected_entropy(knowledge: MazeKnowledge) -> NDArray[np.int64]:
    """For each robot that is asked for the action after which least entropy is expected: ``(n,)``.

    Equal ones (to 1e-9 nat) in the order forward, left, right.
    """
    left_over = expected_entropies(knowledge)[:, PREFERENCE]
    least = left_over.min(axis=1, keepdims=True)
    return PREFERENCE[(left_over <= least + TIE).argmax(axis=1)].astype(np.int64)


@njit(cache=True, nogil=True)
def _expected_entropies(
    robots: NDArray[np.intp],
    bel: NDArray[np.float64],
    live: NDArray[np.int32],
    n_live: NDArray[np.int32],
    depth: NDArray[np.int32],
    target: NDArray[np.int32],
    p_step: NDArray[np.float64],
    confusion: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """H(x', z | u) - H(z | u): the entropy of both less that of the reading.

    Args:
        robots: ``(n,)``.
        bel: ``(B, C, 4)``.
        live: ``(B, C)``.
        n_live: ``(B,)``.
        depth: ``(B, C, 4)``; less one.
        target: ``(B, C * 4 * J)``.
        p_step: ``(J,)``.
        confusion: ``(D, D)``; p(reading | depth) by depth, then reading, both less one.
        out: ``(n, 3)``, overwritten.
    """
    n_steps, n_readings = p_step.shape[0], confusion.shape[1]
    bel_bar = np.zeros((bel.shape[1], 4))
    p_z = np.empty(n_readings)
    reached = np.empty(bel.shape[1], np.int32)
    is_reached = np.zeros(bel.shape[1], np.bool_)
    for i in range(robots.shape[0]):
        b = robots[i]
        for u in range(3):
            n_reached = 0
            for at in range(n_live[b]):
                c = live[b, at]
                for k in range(4):
                    p = bel[b, c, k]
                    if p <= 0.0:
                        continue
                    turned = k if u == FORWARD else (k + (1 if u == LEFT else 3)) % 4
                    for j in range(n_steps if u == FORWARD else 1):
                        t = target[b, (4 * c + k) * n_steps + j] if u == FORWARD else c
                        bel_bar[t, turned] += p * (p_step[j] if u == FORWARD else 1.0)
                        if not is_reached[t]:
                            is_reached[t] = True
                            reached[n_reached] = t
                            n_reached += 1
            p_z[:] = 0.0
            h = 0.0
            for at in range(n_reached):
                c = reached[at]
                is_reached[c] = False
                for k in range(4):
                    p = bel_bar[c, k]
                    bel_bar[c, k] = 0.0
                    if p <= 0.0:
                        continue
                    d = depth[b, c, k]
                    for z in range(n_readings):
                        q = p * confusion[d, z]
                        if q > 0.0:
                            h -= q * np.log(q)
                            p_z[z] += q
            for z in range(n_readings):
                if p_z[z] > 0.0:
                    h += p_z[z] * np.log(p_z[z])
            out[i, u] = h
