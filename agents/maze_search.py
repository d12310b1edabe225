"""Search in belief space where nothing is random: the noise-free maze.

There a belief is uniform over the n states that agree with every reading, all of them read the same
now, and actions are one-to-one. So an action only splits the set by the next reading, and the
expected largest probability after it, ``sum_z (n_z / n) (1 / n_z)``, is the number of parts over n.
A K-step plan is counting: with W in units of 1 / n,

    W(S, k) = max_a [ parts(a, S) + sum_z W(S_z, k - 1) ],    W({x}, k) = k,

which bounds itself: a step can add n at most, so a branch that cannot win is cut, and no plan is
lost. Maximising the sum over the steps is what matters: a planner that looks at its last step alone
puts everything off.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEFT, RIGHT, FORWARD = 0, 1, 2


@njit(cache=True, nogil=True)
def split(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    action: int,
    out: NDArray[np.int16],
    ends: NDArray[np.int32],
) -> int:
    """Move a set of states and sort it by the next reading; returns the number of parts.

    Args:
        successor: ``(S, 3)``; state after turning left, right, going forward.
        reading: ``(S,)``; at least 1.
        states: ``(n,)``.
        action: In 0, 1, 2.
        out: ``(n,)``, overwritten with the successors, part by part.
        ends: ``(n,)``, overwritten; where in ``out`` each part ends.
    """
    count = np.zeros(128, dtype=np.int32)
    for s in states:
        count[reading[successor[s, action]]] += 1
    parts, total = 0, 0
    for z in range(128):
        if count[z] > 0:
            begin = total
            total += count[z]
            ends[parts] = total
            parts += 1
            count[z] = begin
    for s in states:
        t = successor[s, action]
        out[count[reading[t]]] = t
        count[reading[t]] += 1
    return parts


@njit(cache=True, nogil=True)
def worth(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    level: NDArray[np.int16],
    ends: NDArray[np.int32],
    depth: int,
    low: int,
    high: int,
    steps: int,
    last: int,
    value: NDArray[np.float64],
) -> float:
    """W of the set ``level[depth, low:high]``: the most that ``steps`` steps can add up to.

    Args:
        successor: ``(S, 3)``.
        reading: ``(S,)``.
        level: ``(K + 1, n)``; sets on the way down, each under the one that it came from.
        ends: ``(K + 1, n)``; their parts.
        depth: Row of ``level``.
        low: First state of the set.
        high: One after the last.
        steps: Left to plan.
        last: Action before; a turn is not undone, for what it would show is known.
        value: ``(3,)``, overwritten at depth 0 with each action's worth, exact for the best only.
    """
    n = high - low
    if steps == 0:
        return 0.0
    if n == 1 and depth > 0:
        return float(steps)
    best = -1.0
    for order in range(3):
        action = 2 - order  # Forward first: of equals it is the one that leads somewhere.
        if depth > 0:
            if (action == 0 and last == 1) or (action == 1 and last == 0):
                continue
            if action == 2 and reading[level[depth, low]] == 1:
                continue  # Into the wall: nothing moves and nothing new is read.
        parts = split(
            successor, reading, level[depth, low:high], action,
            level[depth + 1, low:high], ends[depth + 1, low:high],
        )  # fmt: skip
        total = float(parts)
        left = float(n * (steps - 1))
        begin = 0
        for part in range(parts):
            if depth > 0 and total + left <= best:
                break
            end = ends[depth + 1, low + part]
            size = end - begin
            left -= size * (steps - 1)
            total += worth(
                successor, reading, level, ends, depth + 1, low + begin, low + end,
                steps - 1, action, value,
            )  # fmt: skip
            begin = end
        if depth == 0:
            value[action] = total
        elif total + left <= best:
            continue
        best = max(best, total)
    return best


@njit(cache=True, nogil=True)
def plan_all(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    n_states: NDArray[np.int32],
    steps: NDArray[np.int32],
    values: NDArray[np.float64],
) -> None:
    """K-step values of each action for a batch of mazes: mean largest probability a step.

    Args:
        successor: ``(B, S, 3)``.
        reading: ``(B, S)``.
        states: ``(B, N)``; states that the robot may be in.
        n_states: ``(B,)`` of them; all of a robot's read the same.
        steps: ``(B,)``; K of each.
        values: ``(B, 3)``, overwritten with W / (n K).
    """
    for b in range(states.shape[0]):
        n, k = n_states[b], steps[b]
        if n <= 1 or k == 0:
            values[b] = 1.0
            continue
        level = np.empty((k + 1, n), dtype=np.int16)
        ends = np.empty((k + 1, n), dtype=np.int32)
        level[0] = states[b, :n]
        worth(successor[b], reading[b], level, ends, 0, 0, n, k, -1, values[b])
        values[b] /= n * k


def optimum(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    steps: int,
) -> float:
    """Greatest expected return from a set of states, over a whole horizon: exact.

    Dynamic programming over the beliefs that can be reached, each solved once. For small mazes:
    there are as many beliefs as there are ways of splitting the first reading's states.

    Args:
        successor: ``(S, 3)``.
        reading: ``(S,)``.
        states: ``(n,)`` that agree with the first reading.
        steps: Horizon.

    Returns:
        Expected sum of the largest probability after each step.
    """
    after = [tuple(int(t) for t in row) for row in successor]
    read = [int(z) for z in reading]

    @cache
    def most(belief: frozenset[int], left: int) -> int:
        if left == 0:
            return 0
        if len(belief) == 1:
            return left
        best, bound = 0, len(belief) * left
        for action in (FORWARD, LEFT, RIGHT):
            parts: dict[int, set[int]] = {}
            for s in belief:
                t = after[s][action]
                parts.setdefault(read[t], set()).add(t)
            total = len(parts) + sum(most(frozenset(part), left - 1) for part in parts.values())
            best = max(best, total)
            if best == bound:
                break
        return best

    first = frozenset(int(s) for s in states)
    return most(first, steps) / len(first)
