"""Kernels of the search in a maze without noise: a belief is a set, a plan is counting.

A belief is uniform over the n states that agree with every reading, all of them read
the same now, and actions are one-to-one. So an action only splits the set by the next reading, and
the expected largest probability after it, ``sum_z (n_z / n) (1 / n_z)``, is the number of parts
over n. A K-step plan is counting: with W in units of 1 / n,

    W(S, k) = max_a [ parts(a, S) + sum_z W(S_z, k - 1) ],    W({x}, k) = k.

While nothing splits the set its states move in step, so that where the first of them stands says
which belief it is: equal beliefs are merged, and each place is looked at once, by its shortest way.
Over the turns a at places u, d(u) steps away, that split the set (a step forward splits nothing),

    W(S, k) = max_(u, a) [ d(u) + parts + sum_z W(S_z, k - d(u) - 1) ],

or k if there is none within reach. A step can add n at most, so a branch that cannot win is cut,
and no plan is lost.

Where no plan of K steps is told anything, all actions are worth the same, and a robot may go in a
circle for ever. There K grows to the fewest steps in which one is.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


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
def most(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    steps: int,
) -> int:
    """W of a set: the most that K steps can add up to, in units of 1 / n.

    A walk down the tree of sets with a frame for each set that is open, since cached kernels cannot
    recurse. A frame looks at the places that its set can be moved to, nearest first.

    Args:
        successor: ``(S, 3)``.
        reading: ``(S,)``.
        states: ``(n,)``, at least one; all read the same.
        steps: K.
    """
    n_all, n_states = states.shape[0], reading.shape[0]
    if n_all == 1 or steps == 0:
        return steps
    room = min(n_states, 4 * (2 * steps * (steps + 1) + 1))  # No more places are within K steps.
    places = np.empty((steps, room, n_all), dtype=np.int16)
    walked = np.zeros((steps, room), dtype=np.int64)
    seen = np.zeros((steps, n_states), dtype=np.int64)
    moved, ends = np.empty((steps, n_all), np.int16), np.empty((steps, n_all), np.int32)
    n, k, best, mark = np.zeros((4, steps), dtype=np.int64)
    place, found, turn = np.zeros((3, steps), dtype=np.int64)
    parts, part, total, left = np.zeros((4, steps), dtype=np.int64)
    visits, f = 1, 0
    n[0], k[0], best[0], found[0], mark[0] = n_all, steps, steps, 1, 1
    places[0, 0] = states
    seen[0, states[0]] = 1
    while True:
        u = place[f]
        d = walked[f, u]
        rest = k[f] - d - 1
        if part[f] < parts[f] and total[f] + left[f] > best[f]:
            # The next part of what the turn splits the set into.
            first = np.int64(ends[f, part[f] - 1]) if part[f] > 0 else np.int64(0)
            size = np.int64(ends[f, part[f]]) - first
            part[f] += 1
            left[f] -= size * rest
            if size == 1 or rest == 0:
                total[f] += rest
                continue
            f += 1
            visits += 1
            n[f], k[f], best[f], found[f], mark[f] = size, rest, rest, 1, visits
            place[f] = turn[f] = parts[f] = part[f] = walked[f, 0] = 0
            places[f, 0, :size] = moved[f - 1, first : first + size]
            seen[f, places[f, 0, 0]] = visits
            continue
        if parts[f] > 0:  # The turn is done, or cut because it cannot win.
            best[f] = max(best[f], total[f])
            parts[f] = part[f] = 0
        if turn[f] == 3:
            place[f] += 1
            turn[f] = 0
            u = place[f]
            if u == found[f] or walked[f, u] + n[f] * (k[f] - walked[f, u]) <= best[f]:
                if f == 0:
                    return best[0]
                f -= 1
                total[f] += best[f + 1]
            continue
        action = turn[f]
        turn[f] += 1
        here = places[f, u, : n[f]]
        there = successor[here[0], action]
        if seen[f, there] == mark[f]:
            continue
        count = split(successor, reading, here, action, moved[f], ends[f])
        if count > 1:
            parts[f], total[f], left[f] = count, d + count, n[f] * rest
        elif rest > 0:
            places[f, found[f], : n[f]] = moved[f, : n[f]]
            walked[f, found[f]] = d + 1
            seen[f, there] = mark[f]
            found[f] += 1


@njit(cache=True, nogil=True)
def steps_to_news(
    successor: NDArray[np.int16], reading: NDArray[np.int8], states: NDArray[np.int16]
) -> int:
    """Fewest steps after which a reading splits a set; 0 if none ever does.

    Args:
        successor: ``(S, 3)``.
        reading: ``(S,)``.
        states: ``(n,)``, at least one; all read the same.
    """
    n, n_states = states.shape[0], reading.shape[0]
    places = np.empty((n_states, n), dtype=np.int16)
    walked, seen = np.zeros(n_states, dtype=np.int64), np.zeros(n_states, dtype=np.bool_)
    moved, ends = np.empty(n, dtype=np.int16), np.empty(n, dtype=np.int32)
    places[0] = states
    seen[states[0]] = True
    found, u = 1, 0
    while u < found:
        for action in range(3):
            there = successor[places[u, 0], action]
            if seen[there]:
                continue
            if split(successor, reading, places[u], action, moved, ends) > 1:
                return walked[u] + 1
            places[found] = moved
            walked[found] = walked[u] + 1
            seen[there] = True
            found += 1
        u += 1
    return 0


@njit(cache=True, nogil=True)
def worth(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    steps: int,
    value: NDArray[np.int64],
) -> None:
    """W of a set by each first action.

    Args:
        successor: ``(S, 3)``.
        reading: ``(S,)``.
        states: ``(n,)``, at least one; all read the same.
        steps: K, at least 1.
        value: ``(3,)``, overwritten.
    """
    moved, ends = np.empty_like(states), np.empty(states.shape[0], dtype=np.int32)
    for action in range(3):
        parts = split(successor, reading, states, action, moved, ends)
        value[action] = parts
        begin = 0
        for i in range(parts):
            value[action] += most(successor, reading, moved[begin : ends[i]], steps - 1)
            begin = ends[i]


@njit(cache=True, nogil=True)
def plan_all(
    successor: NDArray[np.int16],
    reading: NDArray[np.int8],
    states: NDArray[np.int16],
    n_states: NDArray[np.int32],
    steps: int,
    values: NDArray[np.float64],
) -> None:
    """Values of each action for a batch of mazes: mean largest probability a step.

    Args:
        successor: ``(B, S, 3)``.
        reading: ``(B, S)``.
        states: ``(B, N)``; states that the robot may be in.
        n_states: ``(B,)`` of them, at least one; all of a robot's read the same.
        steps: K, at least 1; more where a plan of K steps is told nothing.
        values: ``(B, 3)``, overwritten with W / (n K).
    """
    count = np.empty(3, dtype=np.int64)
    for b in range(states.shape[0]):
        n, k = n_states[b], steps
        if n == 1:
            values[b] = 1.0
            continue
        worth(successor[b], reading[b], states[b, :n], k, count)
        if count.max() == k:
            k = max(k, steps_to_news(successor[b], reading[b], states[b, :n]))
            worth(successor[b], reading[b], states[b, :n], k, count)
        values[b] = count / (n * k)
