"""What every registered environment owes Gymnasium, Stable-Baselines3 and whoever repeats a run."""

import inspect
import itertools
import json
import os
import pickle
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import activeloc  # noqa: F401  (registers the ids)
from activeloc.envs import ENVIRONMENTS, MAX_EPISODE_STEPS, STEPS
from activeloc.envs.localization import LocalizationEnv
from activeloc.errors import ConfigError, MapError
from activeloc.maps import MapSource, from_text

MAP = "rooms(width=6,height=5,resolution=0.1):1"  # 60 x 50 cells, two rooms and a door.
BELIEFS = {
    "histogram": {"kind": "histogram", "cell_size": 0.25, "headings": 36},
    "particles": {"kind": "particles", "n_min": 200, "n_max": 500},
}
SIZES = {
    "histogram": {"kind": "histogram"},
    "particles": {"kind": "particles", "n_min": 1000, "n_max": 20_000},
}
IDS = sorted(id for id in gym.registry if id.startswith("activeloc/"))
MAZES = [id for id in IDS if "Maze" in id]
METRIC = [id for id in IDS if id not in MAZES]
MAZE = "maze"  # Stands for the belief and the map, which a maze's id brings with it.
CASES = [*itertools.product(METRIC, BELIEFS), *((id, MAZE) for id in MAZES)]
GLOBAL = "activeloc/GlobalLocalization-v0"
INFO_KEYS = {
    "entropy": float,
    "entropy_fraction": float,
    "mass": float,
    "error_m": float,
    "error_rad": float,
    "is_success": bool,
    "wrong": bool,
    "impossible": int,
    "dropped": int,
    "touched": bool,
    "kidnapped": bool,
    "noticed": bool,
    "notice_steps": int,
    "recover_steps": int,
    "false_alarm": bool,
    "reward_information": float,
    "reward_step": float,
    "reward_success": float,
    "reward_wrong": float,
}
MAZE_INFO_KEYS = {
    "entropy": float,
    "entropy_fraction": float,
    "mass": float,
    "error_m": float,
    "error_rad": float,
    "is_success": bool,
    "likeliest_is_true": bool,
    "wrong": bool,
    "success_step": int,
    "impossible": int,
    "depth": int,
    "reward_largest": float,
}
HALL = from_text(
    """
############
#.....#....#
#..........#
#.....#....#
#..####....#
#..#.......#
############
""",
    resolution=0.5,
    origin=(-2.0, 1.0),
    name="hall",
)

every_environment = pytest.mark.parametrize(("id", "belief"), CASES)


def make(id=GLOBAL, belief="histogram", **settings):
    if belief == MAZE:
        return gym.make(id, **settings)
    belief = belief if isinstance(belief, dict) else BELIEFS[belief]
    return gym.make(id, map=MAP, belief=belief, **settings)


def digest(id, belief, map, seed, steps):
    """SHA-256 of all that an episode says; it runs in another process too, so it imports itself."""
    import hashlib

    import gymnasium as gym
    import numpy as np

    import activeloc  # noqa: F401, F811

    said = hashlib.sha256()
    env = gym.make(id) if belief is None else gym.make(id, map=map, belief=belief)
    actions = np.random.default_rng(seed)
    results = env.reset(seed=seed)
    for _ in range(steps):
        for name, value in sorted(results[0].items()):
            said.update(name.encode() + str(value.dtype).encode() + value.tobytes())
        said.update(repr([sorted(r.items()) if isinstance(r, dict) else r for r in results[1:]])
                    .encode())  # fmt: skip
        if len(results) == 5 and results[2]:
            results = env.reset()
        else:
            results = env.step(int(actions.integers(3)))
    return said.hexdigest()


def same(a, b):
    """Assert that two results of reset or step are equal to the bit."""
    for key in a[0]:
        assert a[0][key].dtype == b[0][key].dtype
        np.testing.assert_array_equal(a[0][key], b[0][key])
    assert a[0].keys() == b[0].keys()
    assert a[1:] == b[1:]


def test_the_ids_are_those_of_the_table():
    assert sorted(ENVIRONMENTS) == IDS
    assert len(IDS) >= 3


# --- the checkers of Gymnasium and Stable-Baselines3 (warnings are errors here)


@every_environment
def test_gymnasium_checks_it(id, belief):
    check_env(make(id, belief).unwrapped)


@pytest.mark.parametrize("actions", ["discrete+stay", "continuous"])
@pytest.mark.parametrize("belief", BELIEFS)
def test_gymnasium_checks_the_other_action_spaces(actions, belief):
    check_env(make(belief=belief, actions=actions).unwrapped)


# The belief is a stack of planes, no picture of bytes; our own feature extractor reads it.
not_a_picture = [
    pytest.mark.filterwarnings("ignore:It seems that your observation:UserWarning"),
    pytest.mark.filterwarnings("ignore:The minimal resolution for an image:UserWarning"),
    pytest.mark.filterwarnings("ignore:Your observation map has an unconventional:UserWarning"),
]


@pytest.mark.parametrize(("id", "belief"), [pytest.param(*c, marks=not_a_picture) for c in CASES])
def test_stable_baselines3_checks_it(id, belief):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(id, belief).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "actions", [pytest.param(a, marks=not_a_picture) for a in ("discrete+stay", "continuous")]
)
def test_stable_baselines3_checks_the_other_action_spaces(actions):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(actions=actions).unwrapped, skip_render_check=True)


# --- what is in an observation and an info


def check_results(env, results):
    """Assert what holds of every result of reset and step; say whether the episode is over."""
    observation, info = results[0], results[-1]
    assert env.observation_space.contains(observation)
    for name, value in observation.items():
        assert value.dtype == np.float32
        assert value.shape == env.observation_space[name].shape
    in_maze = env.spec.id in MAZES
    keys = MAZE_INFO_KEYS if in_maze else INFO_KEYS
    assert {name: type(value) for name, value in info.items()} == keys
    assert np.isfinite([float(v) for v in info.values()]).all()
    belief = env.unwrapped.knowledge.belief
    mass = belief.bel[0].sum() if in_maze else belief.view(0, 8, 32, 32).sum()
    assert mass == pytest.approx(1.0, abs=1e-4)
    if len(results) == 2:
        return False
    reward, terminated, truncated = results[1:4]
    assert type(reward) is float
    assert np.isfinite(reward)
    assert type(terminated) is bool
    assert type(truncated) is bool
    terms = sum(value for name, value in info.items() if name.startswith("reward_"))
    assert reward == pytest.approx(terms, abs=1e-12)
    return terminated or truncated


def check_episodes(env, seeds, steps):
    """How many steps and ends of episodes were seen."""
    n_ends = 0
    for seed in range(seeds):
        env.action_space.seed(seed)
        check_results(env, env.reset(seed=seed))
        for _ in range(steps):
            if check_results(env, env.step(env.action_space.sample())):
                n_ends += 1
                check_results(env, env.reset())
    return seeds * steps, n_ends


@every_environment
def test_observations_and_infos_are_what_is_promised(id, belief):
    check_episodes(make(id, belief), 5, 30)


@pytest.mark.parametrize(
    ("settings", "space"),
    [
        ({"actions": "discrete+stay"}, gym.spaces.Discrete(4)),
        ({"actions": "continuous"}, gym.spaces.Box(-1.0, 1.0, (2,), np.float32)),
        ({"world": "discrete"}, gym.spaces.Discrete(3)),
        ({"filter_sensor": {"sigma_hit": 0.3}}, gym.spaces.Discrete(3)),
    ],
    ids=str,
)
def test_observations_and_infos_of_other_settings(settings, space):
    env = make(**settings)
    assert env.action_space == space
    check_episodes(env, 3, 20)


@pytest.mark.slow
@every_environment
def test_observations_and_infos_at_full_size(id, belief):
    env = make(id, SIZES.get(belief, MAZE))
    n_steps, n_ends = check_episodes(env, 100, 200)
    print(f"{id} {belief}: {n_steps} steps, {n_ends} ends, all as promised")


@every_environment
def test_an_observation_is_small(id, belief):
    observation, _ = make(id, belief).reset(seed=0)
    assert observation["belief"].nbytes < 40_000
    assert sum(value.nbytes for value in observation.values()) < 40_000


@pytest.mark.parametrize("belief", BELIEFS)
def test_results_are_new_objects(belief):
    """Whoever keeps or changes a result changes nothing but that."""
    changed, untouched = make(belief=belief), make(belief=belief)
    results, twin = changed.reset(seed=3), untouched.reset(seed=3)
    kept = []
    for action in (0, 2, 1, 2, 0):
        kept.append((results[0], {k: v.copy() for k, v in twin[0].items()}))
        results[-1].clear()
        results[-1]["TimeLimit.truncated"] = True
        if len(kept) > 2:
            for value in kept.pop(0)[0].values():
                value[...] = 7.0
        results, twin = changed.step(action), untouched.step(action)
        same(results, twin)
    for observation, copy in kept:
        for key, value in observation.items():
            np.testing.assert_array_equal(value, copy[key])


# --- one seed, one episode


@every_environment
def test_one_seed_says_the_same_bytes(id, belief):
    setting = BELIEFS.get(belief)
    first = digest(id, setting, MAP, 4, 30)
    assert digest(id, setting, MAP, 4, 30) == first
    assert digest(id, setting, MAP, 5, 30) != first


def test_another_process_says_the_same_bytes():
    """Neither the order of sets nor an address finds its way into an episode."""
    cases = [(id, BELIEFS.get(belief), MAP, 6, 30) for id, belief in CASES]
    code = (
        f"{inspect.getsource(digest)}\nimport json, sys\n"
        "print(json.dumps([digest(*case) for case in json.loads(sys.argv[1])]))"
    )
    there = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, json.dumps(cases)],
        env={**os.environ, "PYTHONHASHSEED": "4321"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(there.stdout) == [digest(*case) for case in cases]


@every_environment
def test_a_pickled_episode_goes_on_as_it_would_have(id, belief):
    env = make(id, belief)
    env.reset(seed=8)
    for action in (2, 0, 2, 0):
        env.step(action)
    twin = pickle.loads(pickle.dumps(env))
    for action in (0, 2, 2, 1, 2):
        same(env.step(action), twin.step(action))
    same(env.reset(), twin.reset())
    same(env.step(2), twin.step(2))


def test_a_class_pickles_by_its_public_name():
    assert LocalizationEnv.__module__ == "activeloc.envs.localization"
    assert pickle.loads(pickle.dumps(LocalizationEnv)) is LocalizationEnv


@every_environment
def test_interleaved_environments_do_not_meet(id, belief):
    def alone(seed):
        env = make(id, belief)
        return [env.reset(seed=seed), *(env.step(a) for a in (0, 2, 2, 1, 0))]

    envs, seeds = (make(id, belief), make(id, belief)), (11, 12)
    together = [[env.reset(seed=seed)] for env, seed in zip(envs, seeds, strict=True)]
    for action in (0, 2, 2, 1, 0):
        for env, episode in zip(envs, together, strict=True):
            np.random.random()  # noqa: NPY002  (the global generator is nobody's business)
            episode.append(env.step(action))
    for seed, episode in zip(seeds, together, strict=True):
        for result, expected in zip(episode, alone(seed), strict=True):
            same(result, expected)


# --- gym.make and what it wraps around


def test_the_time_limit_truncates_and_does_not_terminate():
    env = make("activeloc/PositionTracking-v0", max_episode_steps=7)
    env.reset(seed=0)
    flags = [env.step(0)[2:4] for _ in range(7)]
    assert flags == [(False, False)] * 6 + [(False, True)]


@pytest.mark.parametrize("id", METRIC)
def test_the_spec_is_plain_data(id):
    env = make(id, "particles", actions="discrete+stay")
    twin = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert env.spec.max_episode_steps == STEPS.get(id, MAX_EPISODE_STEPS)
    same(env.reset(seed=2), twin.reset(seed=2))
    same(env.step(3), twin.step(3))


def test_workers_that_are_spawned_live_the_same_episodes():
    """They start without our registry: the id names the module that fills it."""
    settings = {"map": MAP, "belief": BELIEFS["particles"], "num_envs": 2}
    id = f"activeloc:{GLOBAL}"
    workers = gym.make_vec(
        id, vectorization_mode="async", vector_kwargs={"context": "spawn"}, **settings
    )
    native = gym.make_vec(id, **settings)
    try:
        for ours, theirs in [
            (native.reset(seed=5)[0], workers.reset(seed=5)[0]),
            *((native.step(a)[0], workers.step(a)[0]) for a in np.array([[0, 2], [2, 2], [1, 0]])),
        ]:
            for key in ours:
                np.testing.assert_array_equal(ours[key], theirs[key])
    finally:
        workers.close()


@pytest.mark.parametrize("belief", BELIEFS)
def test_pictures_have_one_shape_and_need_no_display(belief, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    env = make(belief=belief, render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for action in (0, 2, 2):
        env.step(action)
        frames.append(env.render())
    assert {(frame.shape, frame.dtype.name) for frame in frames} == {(frames[0].shape, "uint8")}
    assert frames[0].ndim == 3
    assert frames[0].shape[2] == 3
    assert all((frame != frames[0]).any() for frame in frames[1:])


def test_rendering_without_a_mode_warns():
    env = make().unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


# --- options of reset


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("id", METRIC)
def test_a_caller_says_where_the_robot_starts(id, belief):
    env = make(id, belief).unwrapped
    observation, _ = env.reset(seed=1, options={"grid": HALL, "pose": (2.6, 3.3, 1.5 * np.pi)})
    np.testing.assert_allclose(env.pose, [2.6, 3.3, -0.5 * np.pi], atol=1e-12)
    assert env.knowledge.belief.terrain(0).grid == HALL
    assert env.observation_space.contains(observation)


def test_a_caller_says_which_map():
    env = make().unwrapped
    own = MapSource.parse(MAP).number(0)
    other = "rooms(width=5,height=6,resolution=0.1):3"
    env.reset(seed=1, options={"map": other})
    assert env.knowledge.belief.terrain(0).grid == MapSource.parse(other).number(0) != own
    env.reset()
    assert env.knowledge.belief.terrain(0).grid == own


def test_a_start_that_was_asked_for_does_not_shift_the_luck_after_it():
    """Two robots with one seed, put at two places, turn by the same noise."""
    turned = []
    for pose in [(-0.7, 3.3, 0.0), (2.6, 3.3, 2.0)]:
        env = make().unwrapped
        env.reset(seed=9, options={"grid": HALL, "pose": pose})
        env.step(0)
        turned.append((env.pose[2] - pose[2], env.knowledge.u[0]))
    np.testing.assert_allclose(turned[0], turned[1], atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ((-0.25, 2.25, 0.0), "obstacle"),
        ((-1.99, 3.3, 0.0), "obstacle"),
        ((40.0, 3.3, 0.0), "obstacle|map"),
        ((-40.0, -3.3, 0.0), "obstacle|map"),
        ((np.nan, 3.3, 0.0), "finite"),
        ((0.3, 3.3, np.inf), "finite"),
        ((0.3, 3.3), "three"),
        ((0.3, 3.3, 0.0, 0.0), "three"),
        ("here", "three"),
        ([0.3, [3.3], 0.0], "three"),
    ],
    ids=str,
)
def test_a_start_where_no_robot_can_be_is_refused(pose, message):
    env, twin = make().unwrapped, make().unwrapped
    env.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises(MapError, match=message):
        env.reset(options={"grid": HALL, "pose": pose})
    same(env.step(0), twin.step(0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"poze": (0.3, 3.3, 0.0)}, "did you mean 'pose'"),
        ({"seed": 3}, "unknown name 'seed'"),
        ({"grid": "hall.yaml"}, "grid must be an OccupancyGrid"),
        ({"map": 3}, "map must be"),
        ({"map": "roms:3"}, "did you mean 'rooms'"),
    ],
    ids=str,
)
def test_options_that_are_none_are_refused(options, message):
    env, twin = make().unwrapped, make().unwrapped
    env.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises(ConfigError, match=message):
        env.reset(options=options)
    same(env.step(0), twin.step(0))
