"""The lattice's tables and its filter, against walking through the maze by hand."""

import itertools

import numpy as np
import pytest

from activeloc.beliefs.lattice import Lattice, LatticeBelief
from activeloc.errors import ConfigError, MapError
from activeloc.maps.maze import Maze

WAYS = ((0, 1), (1, 0), (0, -1), (-1, 0))
LEFT, RIGHT, FORWARD, STAY = 0, 1, 2, 3


def maze(size, seed=0):
    return Maze(size).draw(np.random.default_rng(seed)) == 0


def depth(free, row, col, k):
    """Cells to the wall ahead, walked one by one."""
    steps = 0
    while free[row, col]:
        row, col, steps = row + WAYS[k][0], col + WAYS[k][1], steps + 1
    return steps


def walk(free, row, col, k, cells):
    """Where a step of so many cells leads, stopped by walls."""
    for _ in range(cells):
        if free[row + WAYS[k][0], col + WAYS[k][1]]:
            row, col = row + WAYS[k][0], col + WAYS[k][1]
    return row, col, k


def outcomes(free, place, action, p_off):
    """Every place an action may lead to, with its probability."""
    row, col, k = place
    if action == LEFT:
        return [((row, col, (k + 1) % 4), 1.0)]
    if action == RIGHT:
        return [((row, col, (k - 1) % 4), 1.0)]
    lengths = ((0, p_off), (1, 1.0 - 2.0 * p_off), (2, p_off))
    return [(walk(free, row, col, k, n), p) for n, p in lengths if p > 0.0]


def p_reading(free, place, z, p_off):
    """P(z | place): off by one to either side, kept inside 1 ... m - 2."""
    d, longest = depth(free, *place), len(free) - 2
    errors = ((-1, p_off), (0, 1.0 - 2.0 * p_off), (1, p_off))
    return sum(p for error, p in errors if min(max(d + error, 1), longest) == z)


def posterior(free, actions, readings, p_off):
    """p(x_T | z_0 ... z_T, u_1 ... u_T) by summing over every path of states: ``(m, m, 4)``."""
    joint = np.zeros((*free.shape, 4))
    for row, col in np.argwhere(free):
        for k in range(4):
            start = (int(row), int(col), k)
            paths = [(start, p_reading(free, start, readings[0], p_off))]
            for action, z in zip(actions, readings[1:], strict=True):
                paths = [
                    (there, p * q * p_reading(free, there, z, p_off))
                    for here, p in paths
                    for there, q in outcomes(free, here, action, p_off)
                ]
            for place, p in paths:
                joint[place] += p
    return joint / joint.sum()


def as_array(lattice, belief, robot):
    result = np.zeros((lattice.size, lattice.size, 4))
    for c in range(lattice.n_cells[robot]):
        result[tuple(lattice.cells[robot, c])] = belief.bel[robot, c]
    return result


def played(size, p_off, n_steps, n_robots=3, seed=0):
    """A lattice, its belief, and what was done and read, ``(n_robots, ...)``."""
    rng = np.random.default_rng(seed)
    lattice = Lattice(n_robots, size, p_off)
    robots = np.arange(n_robots)
    lattice.place(robots, np.stack([maze(size, seed + i) for i in robots]))
    belief, everyone = LatticeBelief(lattice), np.ones(n_robots, dtype=np.bool_)
    state = (rng.random(n_robots) * 4 * lattice.n_cells).astype(np.int32)
    reading = np.zeros(n_robots, dtype=np.int32)
    lattice.move_and_read(
        everyone, np.full(n_robots, STAY), rng.random((n_robots, 2)), state, reading
    )
    belief.reset(robots, reading)
    actions, readings = [], [reading + 1]
    for _ in range(n_steps):
        chosen = rng.choice([LEFT, RIGHT, FORWARD, FORWARD], n_robots)
        lattice.move_and_read(everyone, chosen, rng.random((n_robots, 2)), state, reading)
        belief.step(everyone, chosen, reading)
        actions.append(chosen)
        readings.append(reading + 1)
    return lattice, belief, state, np.array(actions).reshape(-1, n_robots).T, np.array(readings).T


@pytest.mark.parametrize("p_off", [0.0, 0.106])
@pytest.mark.parametrize(("size", "n_steps"), [(5, 0), (5, 4), (7, 1), (7, 3), (9, 4)])
def test_the_belief_is_the_sum_over_every_path_of_states(size, n_steps, p_off):
    lattice, belief, _, actions, readings = played(size, p_off, n_steps, seed=n_steps)
    for robot in range(3):
        expected = posterior(lattice.free[robot], actions[robot], readings[robot], p_off)
        np.testing.assert_allclose(as_array(lattice, belief, robot), expected, rtol=0, atol=1e-12)


def test_without_noise_it_is_uniform_over_the_states_that_agree_with_all_readings():
    lattice, belief, state, actions, readings = played(15, 0.0, 6, n_robots=8)
    sizes = set()
    for robot in range(8):
        free, agreeing = lattice.free[robot], set()
        for row, col, k in itertools.product(range(15), range(15), range(4)):
            place, seen = (row, col, k), []
            if free[row, col]:
                seen.append(depth(free, *place))
                for action in actions[robot]:
                    ((place, _),) = outcomes(free, place, action, 0.0)
                    seen.append(depth(free, *place))
            if seen == readings[robot].tolist():
                agreeing.add(place)
        found = as_array(lattice, belief, robot)
        assert {tuple(int(i) for i in place) for place in np.argwhere(found)} == agreeing
        np.testing.assert_allclose(found[found > 0.0], 1.0 / len(agreeing), rtol=1e-12)
        assert found[tuple(int(i) for i in lattice.pose_of(robot, state[robot]))] > 0.0
        sizes.add(len(agreeing))
    assert len(sizes) > 2


@pytest.mark.parametrize(("size", "p_off"), [(5, 0.0), (7, 0.106), (15, 0.0), (21, 0.2)])
def test_tables_are_what_walking_finds(size, p_off):
    lattice = Lattice(2, size, p_off)
    lattice.place(np.arange(2), np.stack([maze(size, 3), maze(size, 4)]))
    lengths = [0, 1, 2] if p_off else [1]
    for robot in range(2):
        free = lattice.free[robot]
        n = lattice.n_cells[robot]
        assert [tuple(cell) for cell in lattice.cells[robot, :n]] == [
            tuple(cell) for cell in np.argwhere(free)
        ]
        for c, k in itertools.product(range(n), range(4)):
            place = (*(int(i) for i in lattice.cells[robot, c]), k)
            state = 4 * c + k
            assert lattice.state_of(robot, *place) == state
            np.testing.assert_array_equal(lattice.pose_of(robot, state), place)
            assert lattice.depth[robot, c, k] + 1 == depth(free, *place)
            for j, length in enumerate(lengths):
                t = lattice.target[robot, state * len(lengths) + j]
                assert (*lattice.cells[robot, t], k) == walk(free, *place, length)
            for action in (LEFT, RIGHT, FORWARD):
                there = lattice.successor[robot, c, k, action]
                ((meant, _),) = outcomes(free, place, action, 0.0)
                np.testing.assert_array_equal(lattice.pose_of(robot, there), meant)


def test_mazes_without_inner_walls_fill_their_tables_and_no_others():
    lattice, free = Lattice(3, 7), np.zeros((3, 7, 7), dtype=np.bool_)
    free[:, 1:-1, 1:-1] = True
    free[2, 5] = False
    for robots in ([2], [1], [0]):
        lattice.place(np.array(robots), free[robots])
    assert lattice.n_cells.tolist() == [25, 25, 20]
    for robot in range(3):
        n = lattice.n_cells[robot]
        np.testing.assert_array_equal(lattice.cells[robot, :n], np.argwhere(free[robot]))
        assert (lattice.index[robot] >= 0).sum() == n
        np.testing.assert_array_equal(lattice.index[robot][free[robot]], np.arange(n))


def test_true_robots_move_and_read_by_the_law():
    """20,000 robots in one place go forward: how far, and what they read, by count."""
    n, free = 20_000, np.zeros((7, 7), dtype=np.bool_)
    free[3, 1:6] = True
    lattice = Lattice(n, 7, 0.106)
    lattice.place(np.arange(n), np.repeat(free[None], n, axis=0))
    state = np.full(n, lattice.state_of(0, 3, 2, 0), dtype=np.int32)
    reading, uniforms = np.zeros(n, dtype=np.int32), np.random.default_rng(0).random((n, 2))
    lattice.move_and_read(np.ones(n, dtype=np.bool_), np.full(n, FORWARD), uniforms, state, reading)
    went = np.bincount(lattice.cells[0, state // 4, 1], minlength=7) / n
    np.testing.assert_allclose(went[2:5], [0.106, 0.788, 0.106], atol=0.01)
    assert (state % 4 == 0).all()
    at_three = lattice.cells[0, state // 4, 1] == 3
    read = np.bincount(reading[at_three] + 1, minlength=6) / at_three.sum()
    np.testing.assert_allclose(read[2:5], [0.106, 0.788, 0.106], atol=0.012)


def test_a_robot_that_is_not_active_is_left_alone():
    lattice, belief, state, _, _ = played(9, 0.106, 3)
    bel, before = belief.bel.copy(), state.copy()
    active = np.array([False, True, False])
    reading = np.array([4, 1, 4], dtype=np.int32)
    kept = reading.copy()
    lattice.move_and_read(active, np.full(3, FORWARD), np.full((3, 2), 0.99), state, reading)
    belief.step(active, np.full(3, FORWARD), reading)
    np.testing.assert_array_equal(belief.bel[[0, 2]], bel[[0, 2]])
    np.testing.assert_array_equal(state[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(reading[[0, 2]], kept[[0, 2]])
    assert (belief.bel[1] != bel[1]).any()


@pytest.mark.parametrize("reading", [4, 77, -1])
def test_an_impossible_reading_keeps_the_prediction_and_is_counted(reading):
    free = np.zeros((7, 7), dtype=np.bool_)
    free[3, 1:4] = True  # Depths 1, 2 and 3 only.
    lattice = Lattice(1, 7)
    lattice.place(np.array([0]), free[None])
    belief = LatticeBelief(lattice)
    belief.reset(np.array([0]), np.array([0], dtype=np.int32))
    before = belief.bel.copy()
    one = np.ones(1, dtype=np.bool_)
    belief.step(one, np.array([LEFT]), np.array([reading], dtype=np.int32))
    np.testing.assert_array_equal(belief.bel, np.roll(before, 1, axis=2))
    assert belief.impossible[0] == 1
    belief.reset(np.array([0]), np.array([reading], dtype=np.int32))
    np.testing.assert_allclose(belief.bel[0, :3], 1.0 / 12.0)


def test_summaries_and_candidates_are_those_of_the_array():
    for p_off in (0.0, 0.106):
        lattice, belief, _, _, _ = played(9, p_off, 2, n_robots=6)
        candidates = belief.candidates()
        for robot in range(6):
            flat = belief.bel[robot].ravel()
            assert belief.largest[robot] == flat.max()
            assert belief.likeliest[robot] == flat.argmax()
            p = flat[flat > 0.0]
            assert belief.entropy[robot] == pytest.approx(-(p * np.log(p)).sum(), abs=1e-12)
            n = candidates.n[robot]
            assert sorted(candidates.states[robot, :n]) == np.flatnonzero(flat).tolist()
            np.testing.assert_array_equal(
                candidates.p[robot, :n], flat[candidates.states[robot, :n]]
            )
            planes = belief.planes()[robot]
            expected = as_array(lattice, belief, robot).transpose(2, 0, 1) / flat.max()
            np.testing.assert_allclose(planes, expected, atol=1e-7)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (np.zeros((1, 7, 9), dtype=np.bool_), "has 7 x 7 cells; got shape"),
        (np.zeros((1, 7, 7), dtype=np.bool_), "must have a free cell"),
        (np.ones((1, 7, 7), dtype=np.bool_), "walls along its rim"),
    ],
)
def test_what_is_no_maze_is_refused(free, message):
    with pytest.raises(MapError, match=message):
        Lattice(1, 7).place(np.array([0]), free)


@pytest.mark.parametrize("place", [(0, 0, 0), (1, 1, 4), (1, 1, -1), (-1, 1, 0), (1, 7, 0)])
def test_what_is_no_place_is_refused(place):
    lattice = Lattice(1, 7)
    lattice.place(np.array([0]), maze(7)[None])
    with pytest.raises(MapError, match="free cell"):
        lattice.state_of(0, *place)


@pytest.mark.parametrize("size", [2, 82, 7.0, True])
def test_sizes_that_are_none_are_refused(size):
    with pytest.raises(ConfigError, match="lattice size"):
        Lattice(1, size)


@pytest.mark.parametrize("p_off", [-0.1, 0.51, np.nan, "much"])
def test_noise_that_is_no_probability_is_refused(p_off):
    with pytest.raises(ConfigError, match="p_off"):
        Lattice(1, 7, p_off)
