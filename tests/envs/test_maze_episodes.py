"""The maze task of Active Neural Localization: prior, reward, length, accuracies, given starts."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.envs.localization import LocalizationEnv
from activeloc.errors import ActionError, ActiveLocError, ConfigError, MapError
from activeloc.grid import OccupancyGrid
from activeloc.maps import from_text
from activeloc.maps.maze import Maze

STEPS = {
    "activeloc/Maze7-v0": (7, 15),
    "activeloc/Maze15-v0": (15, 20),
    "activeloc/Maze21-v0": (21, 30),
    "activeloc/NoisyMaze9-v0": (9, 15),
}
EXACT = [id for id in STEPS if "Noisy" not in id]
NOISY = "activeloc/NoisyMaze9-v0"
WAYS = ((0, 1), (1, 0), (0, -1), (-1, 0))
BAY = from_text(
    """
#######
#######
#...#.#
#.#.#.#
#.#...#
#.#####
#######
""",
    resolution=1.0,
    name="bay",
)
every_maze = pytest.mark.parametrize("id", STEPS)
every_mode = pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP"])


def depth(free, row, col, k):
    steps = 0
    while free[row, col]:
        row, col, steps = row + WAYS[k][0], col + WAYS[k][1], steps + 1
    return steps


def moved(free, place, action):
    row, col, k = place
    if action == 2:
        there = row + WAYS[k][0], col + WAYS[k][1]
        return (*there, k) if free[there] else place
    return row, col, (k + (1 if action == 0 else -1)) % 4


class Enumeration:
    """All states that agree with what was read, followed by hand."""

    def __init__(self, free, z):
        self.free = free
        places = itertools.product(*(range(n) for n in free.shape), range(4))
        self.places = [p for p in places if free[p[:2]] and depth(free, *p) == z]

    def step(self, action, z):
        places = [moved(self.free, place, action) for place in self.places]
        self.places = [place for place in places if depth(self.free, *place) == z]


@pytest.mark.parametrize("id", EXACT)
def test_reward_accuracies_and_length_are_those_of_counting_by_hand(id):
    size, n_steps = STEPS[id]
    env, strict, guessed = gym.make(id), [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        observation, info = env.reset(seed=seed)
        free = env.unwrapped.grid.free
        assert free.shape == (size, size)
        truth = tuple(int(i) for i in env.unwrapped.pose)
        known = Enumeration(free, info["depth"])
        for step in range(1, n_steps + 1):
            action = int(rng.integers(3))
            observation, reward, terminated, truncated, info = env.step(action)
            truth = moved(free, truth, action)
            assert info["depth"] == depth(free, *truth)
            known.step(action, info["depth"])
            n = len(known.places)
            assert reward == pytest.approx(1.0 / n, abs=1e-12)
            assert info["entropy"] == pytest.approx(np.log(n), abs=1e-12)
            assert info["is_success"] == (n == 1)
            assert info["likeliest_is_true"] == (min(known.places) == truth)
            assert not info["wrong"]
            expected = np.zeros((4, size, size))
            for row, col, k in known.places:
                expected[k, row, col] = 1.0
            np.testing.assert_allclose(observation["belief"], expected, atol=1e-6)
            assert (terminated, truncated) == (False, step == n_steps)
        np.testing.assert_array_equal(env.unwrapped.pose, truth)
        np.testing.assert_array_equal(observation["map"], free)
        assert observation["depth"][0] == pytest.approx(min(info["depth"] / 19, 1.0))
        assert observation["time"][0] == pytest.approx(n_steps / 100)
        strict.append(info["is_success"])
        guessed.append(info["likeliest_is_true"])
    assert 0 < sum(strict) < 30
    assert sum(strict) < sum(guessed)


def test_the_noisy_maze_succeeds_above_one_half_at_the_truth():
    env, seen = gym.make(NOISY), set()
    for seed in range(60):
        rng = np.random.default_rng(seed)
        env.reset(seed=seed)
        since = -1
        for step in range(1, 16):
            _, reward, _, _, info = env.step(int(rng.integers(3)))
            bel, lattice = env.unwrapped.knowledge.belief.bel[0], env.unwrapped.knowledge.lattice
            row, col, k = (int(i) for i in env.unwrapped.pose)
            at_truth = bel[lattice.index[0, row, col], k]
            assert env.unwrapped.probability_at_truth == at_truth
            assert reward == bel.max() == info["mass"]
            assert info["is_success"] == (at_truth > 0.5)
            assert info["wrong"] == (bel.max() > 0.5 >= at_truth)
            since = -1 if not info["is_success"] else step if since < 0 else since
            assert info["success_step"] == since
            seen |= {("success", info["is_success"]), ("wrong", info["wrong"])}
    assert len(seen) == 4


def test_noisy_readings_and_steps_follow_the_law():
    """Errors of the readings, counted where neither end of the range clips them."""
    env, errors, lengths = gym.make(NOISY), [], []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        env.reset(seed=seed)
        free = env.unwrapped.grid.free
        for _ in range(15):
            action, before = int(rng.choice([0, 2, 2])), env.unwrapped.pose
            info = env.step(action)[-1]
            row, col, k = (int(i) for i in env.unwrapped.pose)
            d = depth(free, row, col, k)
            if 1 < d < 7:
                errors.append(info["depth"] - d)
            if action == 2 and depth(free, *(int(i) for i in before)) > 2:
                lengths.append(int(abs(before - env.unwrapped.pose).sum()))
    for found, values in ((errors, (-1, 0, 1)), (lengths, (0, 1, 2))):
        assert set(found) == set(values)
        assert len(found) > 150
        for value, p in zip(values, (0.106, 0.788, 0.106), strict=True):
            share = np.mean([one == value for one in found])
            assert abs(share - p) < 4.0 * np.sqrt(p * (1.0 - p) / len(found))


def test_noise_is_new_at_every_step_of_a_long_episode():
    """A robot that turns on the spot: the errors of its readings never come round again."""
    env = gym.make(NOISY, max_episode_steps=400)
    env.reset(seed=0)
    free, errors = env.unwrapped.grid.free, []
    for _ in range(256):
        info = env.step(0)[-1]
        errors.append(info["depth"] - depth(free, *(int(i) for i in env.unwrapped.pose)))
    errors = np.array(errors)
    assert 0.05 < np.mean(errors != 0) < 0.35
    for lag in range(1, 193):
        assert (errors[lag:][:64] != errors[:64]).any()


def test_starts_are_uniform_over_cells_and_headings():
    env = gym.make("activeloc/Maze7-v0", map=BAY).unwrapped
    n_states = 4 * int(BAY.free.sum())
    counts = np.zeros((7, 7, 4))
    env.reset(seed=0)
    for _ in range(30 * n_states):
        env.reset()
        counts[tuple(int(i) for i in env.pose)] += 1
    assert not counts[~BAY.free].any()
    chi2 = ((counts[BAY.free] - 30.0) ** 2 / 30.0).sum()
    assert abs(chi2 - (n_states - 1)) < 5.0 * np.sqrt(2.0 * n_states)


def test_every_episode_has_a_new_maze_of_the_generators_law():
    env, drawn = gym.make("activeloc/Maze15-v0").unwrapped, set()
    env.reset(seed=1)
    for _ in range(50):
        env.reset()
        drawn.add(env.grid.cells.tobytes())
        assert env.grid.free.sum() == 97
    assert len(drawn) == 50


# --- length


@pytest.mark.parametrize("id", STEPS)
def test_an_episode_lasts_exactly_t_steps_and_t_is_an_argument(id):
    for env, n_steps in ((gym.make(id), STEPS[id][1]), (gym.make(id, max_episode_steps=40), 40)):
        env.reset(seed=0)
        ends = [env.step(i % 3)[2:4] for i in range(n_steps)]
        assert ends == [(False, False)] * (n_steps - 1) + [(False, True)]


@pytest.mark.parametrize("id", EXACT)
def test_doubt_is_the_usual_reward_less_one_until_none_is_left(id):
    """The same episodes with both rewards, alone and in a batch, until the belief is sure."""
    task = {"kind": "maze", "reward": "doubt"}
    usual, env = gym.make(id), gym.make(id, task=task)
    batch = gym.make_vec(id, num_envs=1, task=task, autoreset_mode="SAME_STEP")
    ended = 0
    for seed in range(12):
        for one in (usual, env, batch):
            one.reset(seed=seed)
        for step in range(STEPS[id][1]):
            action = int(np.random.default_rng([seed, step]).integers(3))
            _, reward, _, truncated, info = usual.step(action)
            _, doubt, over, cut, own = env.step(action)
            _, many, overs, cuts, infos = batch.step(np.array([action]))
            assert doubt == many[0] == reward - 1.0 == own["reward_doubt"]
            assert (over, cut) == (overs[0], cuts[0]) == (info["mass"] == 1.0, truncated)
            if over or cut:
                assert infos["final_info"]["is_success"][0] == info["is_success"]
                ended += over
                break
    assert 0 < ended < 12


@every_maze
def test_the_clock_may_be_left_out(id):
    env = gym.make(id, observation={"time": False, "view": True, "radius": 2}).unwrapped
    seen, _ = env.reset(seed=0)
    assert sorted(seen) == ["belief", "depth", "map", "view"]
    assert env.observation_space.contains(seen)


# --- given mazes and starts


@every_maze
@pytest.mark.parametrize("kind", ["map", "walls", "free"])
def test_a_caller_says_which_maze_and_where(id, kind):
    size = STEPS[id][0]
    free = Maze(size).draw(np.random.default_rng(99)) == 0
    grid = {"map": OccupancyGrid(~free, 0.5), "walls": ~free, "free": free}[kind]
    env = gym.make(id).unwrapped
    for row, col in np.argwhere(free)[::7]:
        for k in range(4):
            observation, info = env.reset(options={"grid": grid, "pose": (row, col, k)})
            np.testing.assert_array_equal(env.pose, (row, col, k))
            np.testing.assert_array_equal(observation["map"], free)
            if id != NOISY:
                assert info["depth"] == depth(free, row, col, k)
            assert env.observation_space.contains(observation)


def test_a_maze_may_be_any_map_of_the_size():
    env = gym.make("activeloc/Maze7-v0").unwrapped
    _, info = env.reset(seed=0, options={"grid": BAY, "pose": (1, 1, 1)})
    assert env.grid == OccupancyGrid(BAY.cells, 1.0)
    assert env.grid.name == "bay"
    # Four cells in view: along the long leg from either end of it, and from nowhere else.
    assert info["depth"] == 4
    assert info["mass"] == 0.5


def test_a_start_that_was_asked_for_does_not_shift_the_luck_after_it():
    free, luck = Maze(9).draw(np.random.default_rng(0)) == 0, []
    for pose in (np.argwhere(free)[0], np.argwhere(free)[-1]):
        env = gym.make(NOISY).unwrapped
        env.reset(seed=4, options={"grid": free, "pose": (*pose, 0)})
        luck.append(env.np_random.random())
    assert luck[0] == luck[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pose": (0, 0, 0)}, "obstacle"),
        ({"pose": (1, 1, 4)}, "heading 0 to 3"),
        ({"pose": (1, 1.5, 0)}, "whole"),
        ({"pose": (1, np.nan, 0)}, "finite"),
        ({"pose": (1, 1)}, "three"),
        ({"pose": "here"}, "three"),
        ({"pose": (-2, 1, 0)}, "outside"),
        ({"grid": np.zeros((7, 7))}, "bools"),
        ({"grid": np.zeros((7, 7), dtype=bool)}, "free cell"),
        ({"grid": np.eye(7, dtype=bool)}, "rim"),
        ({"grid": Maze(9).draw(np.random.default_rng(0)) == 0}, "7 x 7 cells; got shape"),
        ({"grid": "maze.txt"}, "OccupancyGrid or bools"),
        ({"poze": (1, 1, 0)}, "did you mean 'pose'"),
        ({"map": "office"}, "7 x 7 cells; got shape"),
    ],
    ids=str,
)
def test_starts_that_are_none_are_refused_and_change_nothing(options, message):
    envs = [gym.make("activeloc/Maze7-v0").unwrapped for _ in range(2)]
    for env in envs:
        env.reset(seed=1)
    with pytest.raises(ActiveLocError, match=message):
        envs[0].reset(options=options)
    results = [env.step(2) for env in envs]
    assert results[0][1:] == results[1][1:]
    for name, value in results[0][0].items():
        np.testing.assert_array_equal(value, results[1][0][name])


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"belief": "particles"}, ConfigError, "belief is not for the maze task"),
        ({"sensor": "beam"}, ConfigError, "sensor is not for the maze task"),
        ({"actions": "continuous"}, ConfigError, "actions is not for the maze task"),
        ({"map": "office"}, ConfigError, "not for the maze task"),
        ({"map": from_text("###\n#.#\n###\n...")}, ConfigError, "as many rows as columns"),
        ({"map": from_text("...\n#.#\n###")}, MapError, "rim"),
        ({"task": {"kind": "maze", "p_off": 0.6}}, ConfigError, "task.p_off"),
        ({"task": {"kind": "maze", "confidence": 0.0}}, ConfigError, "task.confidence"),
        ({"task": {"kind": "maze", "p_of": 0.1}}, ConfigError, "did you mean 'p_off'"),
        ({"task": {"kind": "maze", "reward": "entropy"}}, ConfigError, "task.reward"),
        ({"observation": {"view": 1}}, ConfigError, "observation.view"),
        ({"observation": {"time": 0}}, ConfigError, "observation.time"),
        ({"observation": {"radius": 0}}, ConfigError, "observation.radius"),
        ({"obsrvation": {}}, ConfigError, "did you mean 'observation'"),
    ],
    ids=str,
)
def test_settings_that_are_not_a_mazes_are_refused(settings, error, message):
    with pytest.raises(error, match=message):
        LocalizationEnv(**{"task": "maze", "map": "maze(size=7):*", **settings})


@pytest.mark.parametrize("action", [3, -1, 0.0, None, [0], "left", np.array([1])])
def test_actions_that_are_none_are_refused_and_change_nothing(action):
    env = gym.make("activeloc/Maze7-v0").unwrapped
    env.reset(seed=1)
    pose = env.pose
    with pytest.raises(ActionError, match="action must be an integer"):
        env.step(action)
    np.testing.assert_array_equal(env.pose, pose)
    assert env.knowledge.step[0] == 0


# --- the vector environment


def same(many, robot, one):
    assert many.keys() == one.keys()
    for name, value in one.items():
        assert many[name].dtype == value.dtype
        np.testing.assert_array_equal(many[name][robot], value)


def same_info(many, robot, one):
    for name, value in one.items():
        assert many[name][robot] == value
        assert many[f"_{name}"][robot]


@every_mode
@pytest.mark.parametrize("view", [False, True])
@every_maze
def test_a_robot_of_a_batch_lives_as_one_alone(id, view, mode):
    n, settings = 3, {"observation": {"view": view, "radius": 4}, "max_episode_steps": 9}
    batch = gym.make_vec(id, num_envs=n, autoreset_mode=mode, **settings)
    alone = [gym.make(id, **settings) for _ in range(n)]
    observations, infos = batch.reset(seed=10)
    for i, env in enumerate(alone):
        observation, info = env.reset(seed=10 + i)
        same(observations, i, observation)
        same_info(infos, i, info)
    rng, over = np.random.default_rng(0), np.zeros(n, dtype=bool)
    for _ in range(3 * 9 + 5):
        actions = rng.integers(3, size=n)
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        assert not terminated.any()
        for i, env in enumerate(alone):
            if over[i]:
                (observation, info), reward, over[i] = env.reset(), 0.0, False
            else:
                observation, reward, _, over[i], info = env.step(int(actions[i]))
            assert (rewards[i], truncated[i]) == (reward, over[i])
            if over[i] and mode == "SAME_STEP":
                for name, value in observation.items():
                    np.testing.assert_array_equal(infos["final_obs"][i][name], value)
                same_info(infos["final_info"], i, info)
                (observation, info), over[i] = env.reset(), False
            same(observations, i, observation)
            same_info(infos, i, info)


@every_mode
def test_robots_out_of_step_are_reset_one_by_one(mode):
    batch = gym.make_vec("activeloc/Maze7-v0", num_envs=3, autoreset_mode=mode)
    batch.reset(seed=0)
    for _ in range(4):
        batch.step(np.array([2, 2, 2]))
    batch.reset(options={"reset_mask": np.array([False, True, False])})
    truncated = np.array([batch.step(np.array([0, 1, 2]))[3] for _ in range(16)])
    assert truncated[10].tolist() == [True, False, True]
    assert truncated[14].tolist() == [False, True, False]
    assert truncated.sum() == 3


@pytest.mark.parametrize(
    "actions", [[0, 1], [0, 1, 3], [0, 1, -1], [0.0, 1.0, 2.0], [[0], [1], [2]], 1, [0, [1], 2]]
)
def test_the_batch_refuses_actions_that_are_none_and_changes_nothing(actions):
    batches = [gym.make_vec("activeloc/Maze7-v0", num_envs=3) for _ in range(2)]
    for batch in batches:
        batch.reset(seed=0)
    with pytest.raises(ActionError, match="actions must be"):
        batches[0].step(actions)
    first, second = (batch.step(np.array([2, 0, 1])) for batch in batches)
    for name, value in first[0].items():
        np.testing.assert_array_equal(value, second[0][name])


def test_results_of_a_batch_are_new_arrays():
    changed, untouched = (gym.make_vec("activeloc/Maze7-v0", num_envs=2) for _ in range(2))
    kept = [changed.reset(seed=3), untouched.reset(seed=3)]
    for action in (2, 0, 2, 1):
        for value in kept[0][0].values():
            value[...] = 7.0
        for value in kept[0][-1].values():
            value[...] = 1
        kept = [env.step(np.full(2, action)) for env in (changed, untouched)]
        for name in kept[0][0]:
            np.testing.assert_array_equal(kept[0][0][name], kept[1][0][name])
        np.testing.assert_array_equal(kept[0][1], kept[1][1])
        for name in kept[0][-1]:
            np.testing.assert_array_equal(kept[0][-1][name], kept[1][-1][name])


def test_planners_see_the_whole_batch():
    batch = gym.make_vec("activeloc/Maze7-v0", num_envs=4)
    with pytest.raises(ActionError, match="before reset"):
        batch.batch_knowledge  # noqa: B018
    batch.reset(seed=2)
    batch.step(np.array([0, 1, 2, 2]))
    knowledge = batch.batch_knowledge
    assert knowledge.robots.tolist() == [0, 1, 2, 3]
    assert knowledge.step.tolist() == [1, 1, 1, 1]
    candidates = knowledge.belief.candidates()
    np.testing.assert_allclose(knowledge.belief.largest, 1.0 / candidates.n)
    for robot in range(4):
        one = batch.knowledge(robot)
        assert one.robots.tolist() == [robot]
        states = candidates.states[robot, : candidates.n[robot]]
        depths = knowledge.lattice.depth[robot].ravel()[states] + 1
        assert (depths == knowledge.reading[robot]).all()
    metric = gym.make_vec("activeloc/GlobalLocalization-v0", num_envs=1)
    with pytest.raises(ConfigError, match="maze"):
        metric.batch_knowledge  # noqa: B018


def test_a_picture_shows_the_maze():
    env = gym.make("activeloc/Maze7-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(0)
    second = env.render()
    assert first.shape == second.shape
    assert (first != second).any()
