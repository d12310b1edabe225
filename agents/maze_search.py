"""Search in belief space in mazes: exact, since a maze's readings are few.

Without noise a belief is uniform over the n states that agree with every reading, all of them read
the same now, and actions are one-to-one. So an action only splits the set by the next reading, and
the expected largest probability after it, ``sum_z (n_z / n) (1 / n_z)``, is the number of parts
over n. A K-step plan is counting: with W in units of 1 / n,

    W(S, k) = max_a [ parts(a, S) + sum_z W(S_z, k - 1) ],    W({x}, k) = k.

While nothing splits the set its states move in step, so that where the first of them stands says
which belief it is: equal beliefs are merged, and each place is looked at once, by its shortest way.
Over the turns a at places u, d(u) steps away, that split the set (a step forward splits nothing),

    W(S, k) = max_(u, a) [ d(u) + parts + sum_z W(S_z, k - d(u) - 1) ],

or k if there is none within reach. A step can add n at most, so a branch that cannot win is cut,
and no plan is lost. Maximising the sum over the steps is what matters: a planner that looks at its
last step alone puts everything off.

Where no plan of K steps is told anything, all actions are worth the same, and a robot may go in a
circle for ever. There K grows to the fewest steps in which one is.

With noise the same is a sum over joint probabilities q(x, z), which need not be normalised:

    V(q, k) = max_a sum_z [ max_x q_az(x) + V(q_az, k - 1) ],    q_az(x) = p(z | x) (T_a q)(x).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.agents.maze_greedy import PREFERENCE, TIE
from activeloc.envs.maze_episodes import MazeKnowledge


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


def plan_values(knowledge: MazeKnowledge, steps: int) -> NDArray[np.float64]:
    """Mean over K steps of the expected largest probability, for each first action: ``(n, 3)``.

    Args:
        knowledge: Of the robots that are asked for.
        steps: K.
    """
    on, belief, robots = knowledge.lattice, knowledge.belief, knowledge.robots
    values = np.zeros((len(robots), 3))
    n = on.depth.shape[1] * 4
    if on.p_off > 0.0:
        plan_all_noisy(
            robots, belief.bel.reshape(-1, n), on.n_cells, on.target, on.depth.reshape(-1, n),
            on.p_step, on.sensor.confusion, steps, values,
        )  # fmt: skip
        return values
    held = belief.candidates()
    plan_all(
        on.successor.reshape(-1, n, 3)[robots],
        (on.depth.reshape(-1, n)[robots] + 1).astype(np.int8),
        held.states[robots], held.n[robots], steps, values,
    )  # fmt: skip
    return values


def first_actions(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """The best of each row ``(n, 3)``; of equals (to 1e-9) forward, then left: ``(n,)``."""
    ordered = values[:, PREFERENCE]
    best = ordered.max(axis=1, keepdims=True)
    return PREFERENCE[(ordered >= best - TIE).argmax(axis=1)].astype(np.int64)


def optimum(knowledge: MazeKnowledge, steps: int) -> NDArray[np.float64]:
    """Greatest expected return over a whole horizon, for each robot that is asked for: ``(n,)``.

    Args:
        knowledge: Of robots in mazes without noise.
        steps: Steps left in the episode.
    """
    on, held = knowledge.lattice, knowledge.belief.candidates()
    n_states = on.depth.shape[1] * 4
    successor = on.successor.reshape(-1, n_states, 3)
    reading = (on.depth.reshape(-1, n_states) + 1).astype(np.int8)
    return np.array(
        [
            most(successor[b], reading[b], held.states[b, : held.n[b]], steps) / held.n[b]
            for b in knowledge.robots
        ]
    )
