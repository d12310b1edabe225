"""The counting planner against the slow, obvious expectation over policies."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from activeloc.agents.maze_search import optimum, plan_all, plan_values, split
from activeloc.maps.maze import Maze
from activeloc.sensors.depth import depths

STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def tables(free):
    """Successors and readings of every state, cell by cell."""
    cells = [tuple(int(i) for i in cell) for cell in np.argwhere(free)]
    successor = np.zeros((4 * len(cells), 3), dtype=np.int16)
    reading = np.zeros(4 * len(cells), dtype=np.int8)
    depth = depths(free)
    for c, (row, col) in enumerate(cells):
        for k, (up, right) in enumerate(STEPS):
            ahead = (row + up, col + right)
            to = cells.index(ahead) if ahead in cells else c
            successor[4 * c + k] = 4 * c + (k + 1) % 4, 4 * c + (k - 1) % 4, 4 * to + k
            reading[4 * c + k] = depth[k, row, col]
    return successor, reading


def maze(seed, size=7):
    return tables(Maze(size).generate(np.random.default_rng(seed)).free)


def value(successor, reading, belief, steps):
    """Expected sum of the largest probability over the best policy: no counting, no bound."""
    if steps == 0:
        return 0.0
    worths = []
    for action in range(3):
        moved = [int(successor[s, action]) for s in belief]
        worth = 0.0
        for z in {int(reading[s]) for s in moved}:
            part = [s for s in moved if reading[s] == z]
            p = len(part) / len(belief)
            worth += p * (1.0 / len(part) + value(successor, reading, part, steps - 1))
        worths.append(worth)
    return max(worths)


def values_of(successor, reading, belief, steps):
    out = np.zeros((1, 3))
    plan_all(
        successor[None], reading[None], np.array([belief], dtype=np.int16),
        np.array([len(belief)], dtype=np.int32), np.array([steps], dtype=np.int32), out,
    )  # fmt: skip
    return out[0] * steps


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("steps", [1, 2, 3, 5])
def test_the_best_action_is_worth_what_enumeration_says(seed, steps):
    successor, reading = maze(seed)
    rng = np.random.default_rng(seed)
    z = reading[rng.integers(len(reading))]
    belief = np.flatnonzero(reading == z)[:9]
    best = value(successor, reading, list(belief), steps)
    assert values_of(successor, reading, belief, steps).max() == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_optimum_over_a_whole_horizon_is_enumerations(seed):
    successor, reading = maze(seed)
    belief = np.flatnonzero(reading == reading[3 * seed])[:7]
    expected = value(successor, reading, list(belief), 6)
    assert optimum(successor, reading, belief, 6) == pytest.approx(expected, abs=1e-9)


def test_no_plan_is_worth_more_than_the_optimum():
    successor, reading = maze(0)
    belief = np.flatnonzero(reading == 1)
    for steps in (3, 7, 9):
        best = values_of(successor, reading, belief, steps).max()
        assert best <= optimum(successor, reading, belief, steps) + 1e-9


def test_parts_are_the_states_that_read_alike():
    successor, reading = maze(1)
    states = np.flatnonzero(reading == 1).astype(np.int16)
    out, ends = np.empty_like(states), np.empty(len(states), dtype=np.int32)
    for action in range(3):
        parts = split(successor, reading, states, action, out, ends)
        assert sorted(out) == sorted(successor[states, action])
        starts = [0, *ends[:parts]]
        groups = [set(reading[out[a:b]]) for a, b in pairwise(starts)]
        assert all(len(group) == 1 for group in groups)
        assert len(set.union(*groups)) == parts == len(set(reading[successor[states, action]]))


def noisy_value(lattice, p, steps):
    """By Bayes' rule, normalised at every reading; the belief as a dictionary of states."""
    if steps == 0:
        return 0.0, None
    worths = []
    n_steps, depth = len(lattice.p_step), lattice.depth[0].reshape(-1)
    for action in range(3):
        bar = {}
        for s, mass in p.items():
            c, k = divmod(s, 4)
            if action == 2:
                for j, p_j in enumerate(lattice.p_step):
                    to = 4 * int(lattice.target[0, s * n_steps + j]) + k
                    bar[to] = bar.get(to, 0.0) + mass * p_j
            else:
                to = 4 * c + (k + (1 if action == 0 else 3)) % 4
                bar[to] = bar.get(to, 0.0) + mass
        worth = 0.0
        for z in range(lattice.sensor.confusion.shape[1]):
            joint = {s: m * lattice.sensor.confusion[depth[s], z] for s, m in bar.items()}
            evidence = sum(joint.values())
            if evidence > 0.0:
                bel = {s: m / evidence for s, m in joint.items() if m > 0.0}
                worth += evidence * (max(bel.values()) + noisy_value(lattice, bel, steps - 1)[0])
        worths.append(worth)
    return max(worths), worths


@pytest.mark.parametrize("seed", range(3))
def test_noisy_plans_are_worth_what_bayes_rule_says(seed):
    env = gym.make("activeloc/NoisyMaze9-v0", disable_env_checker=True).unwrapped
    env.reset(seed=seed)
    knowledge = env.knowledge
    held = knowledge.belief.candidates()
    p = {int(s): float(m) for s, m in zip(held.states[0], held.p[0], strict=True) if m > 0.0}
    for steps in (1, 2):
        values = plan_values(knowledge, steps)[0] * steps
        np.testing.assert_allclose(values, noisy_value(knowledge.lattice, p, steps)[1], rtol=1e-6)


def test_a_known_state_is_worth_a_step_each():
    successor, reading = maze(2)
    np.testing.assert_array_equal(values_of(successor, reading, [5], 4), 4.0)


def test_planning_for_seven_steps_finds_the_robot():
    """The strict accuracy of a few mazes of 15 x 15, played to the end."""
    rng, right = np.random.default_rng(0), 0
    for seed in range(20):
        successor, reading = maze(seed, 15)
        truth = int(rng.integers(len(reading)))
        belief = np.flatnonzero(reading == reading[truth])
        for step in range(20):
            action = int(values_of(successor, reading, belief, min(7, 20 - step)).argmax())
            truth, belief = successor[truth, action], successor[belief, action]
            belief = belief[reading[belief] == reading[truth]]
        right += len(belief) == 1
    assert right >= 19
