"""The counting planner against the slow, obvious expectation over policies."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from activeloc.agents.lookahead import LookaheadAgent
from activeloc.agents.maze_parts import most, plan_all, split, steps_to_news
from activeloc.agents.maze_search import first_actions, optimum, plan_values
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


def values(successor, reading, belief, steps):
    """Expected sum of the largest probability over the best policy, by its first action: no
    counting, no merging, no bound."""
    worths = []
    for action in range(3):
        moved = [int(successor[s, action]) for s in belief]
        worth = 0.0
        for z in {int(reading[s]) for s in moved}:
            part = [s for s in moved if reading[s] == z]
            p = len(part) / len(belief)
            worth += p * (1.0 / len(part) + value(successor, reading, part, steps - 1))
        worths.append(worth)
    return worths


def value(successor, reading, belief, steps):
    return max(values(successor, reading, belief, steps)) if steps else 0.0


def values_of(successor, reading, belief, steps):
    out = np.zeros((1, 3))
    plan_all(
        successor[None], reading[None], np.array([belief], dtype=np.int16),
        np.array([len(belief)], dtype=np.int32), steps, out,
    )  # fmt: skip
    return out[0] * steps


def dynamic_programming(successor, reading, states, steps):
    """n times :func:`value`, each belief that can be reached solved once."""

    @cache
    def best(belief, left):
        if left == 0:
            return 0
        worths = []
        for action in range(3):
            parts = {}
            for s in belief:
                t = int(successor[s, action])
                parts.setdefault(int(reading[t]), set()).add(t)
            below = sum(best(frozenset(part), left - 1) for part in parts.values())
            worths.append(len(parts) + below)
        return max(worths)

    return best(frozenset(int(s) for s in states), steps)


def is_told(successor, reading, belief, steps):
    """Whether some plan of so many steps splits the belief."""
    alike = {int(reading[s]) for s in belief}
    if len(alike) > 1 or steps == 0:
        return len(alike) > 1
    return any(is_told(successor, reading, successor[belief, a], steps - 1) for a in range(3))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("steps", [1, 2, 3, 5, 6])
def test_actions_are_worth_what_enumeration_says(seed, steps):
    successor, reading = maze(seed)
    rng = np.random.default_rng(seed)
    z = reading[rng.integers(len(reading))]
    belief = np.flatnonzero(reading == z)[: 9 if steps < 6 else 5]
    if not is_told(successor, reading, belief, steps):
        steps = next(k for k in range(1, 9) if is_told(successor, reading, belief, k))
    expected = values(successor, reading, list(belief), steps)
    np.testing.assert_allclose(values_of(successor, reading, belief, steps), expected, atol=1e-9)


def corridor(length):
    """Two like corridors side by side, of which one has a bay at its far end."""
    free = np.zeros((7, length + 2), dtype=bool)
    free[1, 1:-1] = free[4, 1:-1] = free[5, length] = True
    return tables(free)


@pytest.mark.parametrize("length", [3, 6, 11, 20])
def test_where_nothing_is_told_within_the_steps_they_grow_to_the_nearest_news(length):
    """From the near end, facing the wall: twice turn, walk to the far end, turn."""
    successor, reading = corridor(length)
    rows = [0, length]  # Cells of the corridors' near ends.
    belief = np.array([4 * c + 2 for c in rows])
    news = 2 + (length - 1) + 1
    assert steps_to_news(successor, reading, belief.astype(np.int16)) == news
    for steps in (1, news - 1, news):
        out = np.zeros((1, 3))
        plan_all(
            successor[None], reading[None], belief[None].astype(np.int16),
            np.array([2], dtype=np.int32), steps, out,
        )  # fmt: skip
        # Either turn leads there in time; the wall does not.
        np.testing.assert_allclose(out[0], [(news + 1) / (2 * news)] * 2 + [0.5], atol=1e-12)
    walked = [int(s) for s in belief]
    for _ in range(news):
        assert len({int(reading[s]) for s in walked}) == 1
        action = int(first_actions(values_of(successor, reading, walked, 3)[None])[0])
        walked = [int(successor[s, action]) for s in walked]
    assert len({int(reading[s]) for s in walked}) == 2


def test_of_places_that_cannot_be_told_apart_nothing_is_expected():
    free = np.zeros((7, 7), dtype=bool)
    free[1, 1:4] = free[3, 1:4] = True
    successor, reading = tables(free)
    belief = np.array([0, 12])
    assert steps_to_news(successor, reading, belief.astype(np.int16)) == 0
    np.testing.assert_allclose(values_of(successor, reading, belief, 5), 2.5)


@pytest.mark.parametrize("steps", [1, 4, 12])
def test_equal_beliefs_are_merged_without_a_loss(steps):
    """W of a set that is told something late, by the recursion that forgets nothing."""
    successor, reading = maze(3)
    for z in range(1, 4):
        states = np.flatnonzero(reading == z)
        expected = dynamic_programming(successor, reading, states, steps)
        assert most(successor, reading, states.astype(np.int16), steps) == expected


def test_the_optimum_is_dynamic_programmings_and_no_agent_gets_more():
    """Over the whole of 7 x 7 mazes' episodes; on average the best plan gets what is expected."""
    batch = gym.make_vec("activeloc/Maze7-v0", num_envs=200)
    batch.reset(seed=0)
    knowledge = batch.batch_knowledge
    found = optimum(knowledge, 15)
    on, held = knowledge.lattice, knowledge.belief.candidates()
    for robot in range(0, 200, 20):
        successor = on.successor[robot].reshape(-1, 3)
        states = [int(s) for s in held.states[robot, : held.n[robot]]]
        reading = on.depth[robot].reshape(-1) + 1
        expected = dynamic_programming(successor, reading, states, 15) / len(states)
        assert found[robot] == pytest.approx(expected, abs=1e-12)
    returns = {}
    for steps in (15, 2):
        batch.reset(seed=0)
        returns[steps] = np.zeros(200)
        for left in range(15, 0, -1):
            values = plan_values(batch.batch_knowledge, min(left, steps))
            returns[steps] += batch.step(first_actions(values))[1]
    error = returns[15] - found
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(200)
    assert returns[2].mean() < returns[15].mean() - 0.1


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


@pytest.mark.parametrize("id", ["Maze7-v0", "NoisyMaze9-v0"])
def test_robots_of_a_batch_are_asked_for_as_if_alone(id):
    batch = gym.make_vec(f"activeloc/{id}", num_envs=5)
    batch.reset(seed=0)
    knowledge = batch.batch_knowledge
    asked = replace(knowledge, robots=np.array([3, 0, 4]))
    values = plan_values(asked, 2)
    for row, seed in zip(values, (3, 0, 4), strict=True):
        alone = gym.make(f"activeloc/{id}").unwrapped
        alone.reset(seed=seed)
        np.testing.assert_array_equal(row, plan_values(alone.knowledge, 2)[0])
        if id == "Maze7-v0":
            own = optimum(replace(knowledge, robots=np.array([seed])), 5)
            np.testing.assert_array_equal(own, optimum(alone.knowledge, 5))
    assert len(np.unique(values)) > 3
    if id == "Maze7-v0":
        assert len(optimum(asked, 5)) == 3


def test_of_equal_values_forward_is_taken_then_left():
    values = [[1.0, 1.0, 1.0], [1.0, 1.0, 0.9], [0.9, 1.0, 1.0 + 1e-12], [0.8, 1.0, 0.9]]
    np.testing.assert_array_equal(first_actions(np.array(values)), [2, 0, 2, 1])


@pytest.mark.parametrize(("id", "usual"), [("Maze15-v0", 7), ("NoisyMaze9-v0", 3)])
def test_lookahead_plans_as_many_steps_as_said(id, usual):
    batch = gym.make_vec(f"activeloc/{id}", num_envs=4)
    batch.reset(seed=1)
    knowledge = batch.batch_knowledge
    worths = {steps: plan_values(knowledge, steps) for steps in (2, usual)}
    assert (worths[2] != worths[usual]).any()
    for agent, steps in ((LookaheadAgent(), usual), (LookaheadAgent(steps=2), 2)):
        np.testing.assert_array_equal(agent.action_values_all(knowledge), worths[steps])
        chosen = agent.act_all(knowledge)
        np.testing.assert_array_equal(chosen, first_actions(worths[steps]))
        assert [agent.act({}, batch.knowledge(robot)) for robot in range(4)] == chosen.tolist()


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
    assert right == 20


def test_lookahead_never_goes_in_a_circle():
    """Mazes with places further than seven steps from any news, where it did with K fixed."""
    seeds = [777 + i for i in (353, 409, 472, 648, 657, 718, 736, 830, 892, 912, 934)]
    batch = gym.make_vec("activeloc/Maze21-v0", num_envs=len(seeds))
    batch.reset(seed=seeds)
    agent, lonely = LookaheadAgent(), 0
    for _ in range(30):
        knowledge = batch.batch_knowledge
        on, held = knowledge.lattice, knowledge.belief.candidates()
        for robot in np.flatnonzero(held.n > 1):
            news = steps_to_news(
                on.successor[robot].reshape(-1, 3),
                (on.depth[robot].reshape(-1) + 1).astype(np.int8),
                held.states[robot, : held.n[robot]],
            )
            lonely += news > 7
        infos = batch.step(agent.act_all(knowledge))[-1]
    assert lonely > 0
    assert infos["is_success"].all()
