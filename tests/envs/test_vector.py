"""The native vector environment against Gymnasium's own, made of single environments."""

import hashlib
import itertools
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import activeloc  # noqa: F401  (registers the ids)
from activeloc.envs.vector import LocalizationVectorEnv
from activeloc.errors import ActionError, ActiveLocError, ConfigError, MapError
from activeloc.maps import from_text

MAP = "rooms(width=6,height=5,resolution=0.1):0-1"  # One of two homes of 60 x 50 cells.
BELIEFS = {
    "histogram": {"kind": "histogram", "cell_size": 0.25, "headings": 36},
    "particles": {"kind": "particles", "n_min": 200, "n_max": 500},
}
IDS = sorted(id for id in gym.registry if id.startswith("activeloc/") and "Maze" not in id)
GLOBAL = "activeloc/GlobalLocalization-v0"
MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
CELL = from_text("####\n#..#\n#..#\n#.##\n####", resolution=0.5)
# Sure of little and soon: declarations end some episodes, the limit others.
HASTY = {"confidence": 0.25, "hold": 2, "kidnap_first": 2, "kidnap_last": 5}


def task_of(id):
    return {"kind": gym.spec(id).kwargs["task"], **HASTY}


def native(id=GLOBAL, belief="particles", mode=AutoresetMode.NEXT_STEP, n=3, **settings):
    settings = {"map": MAP, "belief": BELIEFS[belief], **settings}
    return gym.make_vec(id, num_envs=n, autoreset_mode=mode, **settings)


def singles(id=GLOBAL, belief="particles", mode=AutoresetMode.NEXT_STEP, n=3, **settings):
    """The oracle: n environments of ``gym.make``, stepped by Gymnasium."""
    settings = {"map": MAP, "belief": BELIEFS[belief], **settings}
    return gym.make_vec(
        id,
        num_envs=n,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **settings,
    )


def equal(a, b, where="result"):
    """Assert that nested results are equal to the bit; absent entries are None in both."""
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            equal(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, tuple) or (isinstance(a, np.ndarray) and a.dtype == object):
        assert len(a) == len(b), where
        for i, (one, other) in enumerate(zip(a, b, strict=True)):
            equal(one, other, f"{where}[{i}]")
    elif a is None:
        assert b is None, where
    else:
        assert (a.dtype, a.shape) == (b.dtype, b.shape), where
        np.testing.assert_array_equal(a, b, err_msg=where)


def actions_of(seed, n=3, steps=32):
    return np.random.default_rng(seed).choice(3, (steps, n), p=[0.3, 0.2, 0.5])


# --- it is the single environment, many times


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize(("id", "belief"), list(itertools.product(IDS, BELIEFS)))
def test_it_equals_single_environments_to_the_bit(id, belief, mode):
    settings = {"task": task_of(id), "max_episode_steps": 10}
    ours, theirs = native(id, belief, mode, **settings), singles(id, belief, mode, **settings)
    equal(ours.reset(seed=20), theirs.reset(seed=20))
    n_ends = 0
    for actions in actions_of(1):
        result = ours.step(actions)
        equal(result, theirs.step(actions))
        n_ends += (result[2] | result[3]).sum()
    assert n_ends >= 6


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_declaration_on_the_last_step_both_terminates_and_truncates(mode):
    """As TimeLimit has it."""
    settings = {"task": {"confidence": 1e-6, "hold": 3}, "max_episode_steps": 3}
    ours, theirs = native(mode=mode, **settings), singles(mode=mode, **settings)
    equal(ours.reset(seed=2), theirs.reset(seed=2))
    for actions in actions_of(3, steps=9):
        equal(ours.step(actions), theirs.step(actions))


def test_episodes_without_a_limit_go_on():
    env = native("activeloc/PositionTracking-v0", max_episode_steps=-1, n=1)
    env.reset(seed=1)
    assert not any(env.step(np.array([0]))[3].any() for _ in range(155))


@pytest.mark.parametrize("actions", ["discrete+stay", "continuous"])
def test_it_equals_single_environments_in_the_other_action_spaces(actions):
    ours, theirs = native(actions=actions), singles(actions=actions)
    assert ours.action_space == theirs.action_space
    equal(ours.reset(seed=4), theirs.reset(seed=4))
    ours.action_space.seed(0)
    for _ in range(8):
        chosen = ours.action_space.sample()
        equal(ours.step(chosen), theirs.step(chosen))


@pytest.mark.parametrize("seed", [7, [9, 3, 9], None])
def test_robot_i_is_the_single_environment_seeded_alike(seed):
    env, given = native(), [7, 8, 9] if seed == 7 else seed
    if seed is None:
        env.reset(seed=30)
        given = [30, 31, 32]
    observations, infos = env.reset(seed=seed)
    for i, one in enumerate(given):
        single = gym.make(GLOBAL, map=MAP, belief=BELIEFS["particles"])
        observation, info = single.reset(seed=one)
        if seed is None:
            observation, info = single.reset()
        for key, value in observation.items():
            np.testing.assert_array_equal(observations[key][i], value)
        for key, value in info.items():
            assert infos[key][i] == value


def test_a_seed_of_none_among_others_goes_on_with_its_own_luck():
    ours, theirs = native(), singles()
    equal(ours.reset(seed=1), theirs.reset(seed=1))
    equal(ours.reset(seed=[5, None, 6]), theirs.reset(seed=[5, None, 6]))


@pytest.mark.parametrize("belief", BELIEFS)
def test_some_robots_are_reset_and_the_others_go_on(belief):
    ours, theirs = native(belief=belief), singles(belief=belief)
    equal(ours.reset(seed=1), theirs.reset(seed=1))
    mask = np.array([False, True, False])
    for actions in actions_of(2, steps=3):
        equal(ours.step(actions), theirs.step(actions))
    mine = ours.reset(options={"reset_mask": mask})
    other = theirs.reset(options={"reset_mask": mask.copy()})
    equal(mine[0], other[0])
    assert all(mine[1][key][1] == other[1][key][1] for key in other[1])
    for actions in actions_of(3, steps=5):
        equal(ours.step(actions), theirs.step(actions))


def test_a_robot_that_is_done_can_be_reset_by_hand():
    settings = {"max_episode_steps": 3}
    ours, theirs = native(**settings), singles(**settings)
    equal(ours.reset(seed=1), theirs.reset(seed=1))
    for actions in actions_of(4, steps=3):
        equal(ours.step(actions), theirs.step(actions))
    mask = np.array([True, False, True])
    ours.reset(options={"reset_mask": mask})
    theirs.reset(options={"reset_mask": mask.copy()})
    for actions in actions_of(5, steps=5):
        equal(ours.step(actions), theirs.step(actions))


def test_options_reach_every_robot_and_are_left_as_they_were():
    env = native()
    options = {"grid": CELL, "pose": (0.9, 1.6, 0.4), "reset_mask": np.ones(3, dtype=bool)}
    kept = dict(options)
    env.reset(seed=1, options=options)
    assert options == kept
    for i in range(3):
        assert env.unwrapped.knowledge(i).belief.terrain(i).grid == CELL


# --- how Gymnasium sees it


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_it_says_how_it_resets(mode):
    assert native(mode=mode).metadata["autoreset_mode"] is mode
    assert native(mode=mode.name).metadata["autoreset_mode"] is mode
    assert native(mode=mode.value).metadata["autoreset_mode"] is mode
    assert LocalizationVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_its_spaces_are_those_of_single_environments():
    ours, theirs = native(), singles()
    for name in ("observation_space", "action_space"):
        assert getattr(ours, name) == getattr(theirs, name)
        assert getattr(ours, f"single_{name}") == getattr(theirs, f"single_{name}")
    assert ours.observation_space.contains(ours.reset(seed=0)[0])
    assert ours.unwrapped.max_episode_steps == 150


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_episode_statistics_are_recorded(mode):
    """A wrapper adds up what it sees of the batch; here, one by one."""
    settings = {"mode": mode, "task": task_of(GLOBAL), "max_episode_steps": 9}
    env = RecordEpisodeStatistics(native(**settings))
    env.reset(seed=6)
    totals, lengths, seen = np.zeros(3), np.zeros(3, dtype=int), 0
    fresh = np.zeros(3, dtype=bool)
    for actions in actions_of(7, steps=30):
        _, rewards, terminated, truncated, infos = env.step(actions)
        totals, lengths = totals + rewards, lengths + ~fresh
        done = terminated | truncated
        for i in np.flatnonzero(done):
            assert infos["episode"]["r"][i] == pytest.approx(totals[i])
            assert infos["episode"]["l"][i] == lengths[i]
            totals[i], lengths[i], seen = 0.0, 0, seen + 1
        fresh = done if mode is AutoresetMode.NEXT_STEP else np.zeros(3, dtype=bool)
    assert seen >= 6


def test_results_are_new_arrays():
    env, twin = native(), native()
    results, expected = env.reset(seed=1), twin.reset(seed=1)
    for actions in actions_of(8, steps=4):
        equal(results, expected)
        for value in (*results[0].values(), *results[-1].values()):
            value[...] = 1
        results, expected = env.step(actions), twin.step(actions)


# --- what it refuses


def state_of(env):
    return hashlib.sha256(pickle.dumps(env.unwrapped)).hexdigest()


BAD_ACTIONS = {
    "too few": [0, 1],
    "too many": [0, 1, 2, 0],
    "none": [],
    "one too large": [0, 1, 3],
    "one negative": [0, -1, 2],
    "floats": [0.0, 1.0, 2.0],
    "one is NaN": [0, np.nan, 1],
    "bools": [True, False, True],
    "words": ["0", "1", "2"],
    "a single number": 1,
    "nothing": None,
    "a column": [[0], [1], [2]],
    "ragged": [0, [1, 2], 0],
}


@pytest.mark.parametrize("name", BAD_ACTIONS)
def test_bad_actions_change_nothing(name):
    env = native()
    env.reset(seed=1)
    env.step(np.array([0, 2, 1]))
    before = state_of(env)
    with pytest.raises(ActionError, match=r"action.* (must|got)"):
        env.step(BAD_ACTIONS[name])
    assert state_of(env) == before
    twin = native()
    twin.reset(seed=1)
    twin.step(np.array([0, 2, 1]))
    equal(env.step(np.array([2, 2, 0])), twin.step(np.array([2, 2, 0])))


BAD_PAIRS = {
    "out of range": np.array([[0.0, 0.0], [0.0, 1.2]], np.float32),
    "NaN": np.array([[0.0, 0.0], [np.nan, 0.0]], np.float32),
    "infinite": np.array([[-np.inf, 0.0], [0.0, 0.0]], np.float32),
    "one number each": np.zeros((2, 1), np.float32),
    "flat": np.zeros(2, np.float32),
}


@pytest.mark.parametrize("name", BAD_PAIRS)
def test_bad_pairs_change_nothing(name):
    env = native(n=2, actions="continuous")
    env.reset(seed=1)
    before = state_of(env)
    with pytest.raises(ActionError, match="two numbers"):
        env.step(BAD_PAIRS[name])
    assert state_of(env) == before


def test_a_step_before_any_reset_is_refused():
    with pytest.raises(ActionError, match="before reset"):
        native().step(np.array([0, 0, 0]))


def test_a_step_before_every_robot_was_reset_changes_nothing():
    env = native()
    with pytest.raises(ActiveLocError, match="reset"):
        env.reset(seed=1, options={"reset_mask": np.array([True, False, True])})
    before = state_of(env)
    with pytest.raises(ActionError, match="before reset"):
        env.step(np.array([0, 0, 0]))
    assert state_of(env) == before


@pytest.mark.parametrize(
    "mask",
    [np.ones(2, bool), np.zeros(3, bool), np.ones(3), [1, 0, 1], "all", np.ones((3, 1), bool)],
    ids=str,
)
def test_a_mask_that_is_none_is_refused(mask):
    env = native()
    env.reset(seed=1)
    before = state_of(env)
    with pytest.raises(ConfigError, match="reset_mask must be 3 bools"):
        env.reset(options={"reset_mask": mask})
    assert state_of(env) == before


@pytest.mark.parametrize("seeds", [[1, 2], [1, 2, 3, 4], []], ids=str)
def test_as_many_seeds_as_robots(seeds):
    with pytest.raises(ConfigError, match="seed must be one or 3"):
        native().reset(seed=seeds)


def test_a_start_in_a_wall_leaves_every_episode_as_it_was():
    env, twin = native(), native()
    env.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises(MapError, match="obstacle"):
        env.reset(options={"grid": CELL, "pose": (0.1, 0.1, 0.0)})
    equal(env.step(np.array([0, 2, 1])), twin.step(np.array([0, 2, 1])))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"n": 0}, "num_envs must be a positive integer; got 0"),
        ({"n": True}, "num_envs must be a positive integer; got True"),
        ({"n": 2.0}, "num_envs must be a positive integer"),
        ({"mode": "DISABLED"}, "autoreset_mode must be one of NEXT_STEP, SAME_STEP"),
        ({"mode": AutoresetMode.DISABLED}, "autoreset_mode must be one of"),
        ({"mode": None}, "autoreset_mode must be one of"),
        ({"render_mode": "rgb_array"}, "render_mode must be None in a vector env"),
        ({"belif": "histogram"}, "did you mean 'belief'"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"max_episode_steps": 2.5}, "max_episode_steps"),
    ],
    ids=str,
)
def test_settings_that_are_none_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        native(**settings)
