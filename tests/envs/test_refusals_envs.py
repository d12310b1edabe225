"""Settings and actions that are none: refused at once, in one sentence, and nothing changes."""

import hashlib
import pickle
import time

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import activeloc  # noqa: F401  (registers the ids)
from activeloc.envs.localization import LocalizationEnv
from activeloc.envs.vector import LocalizationVectorEnv
from activeloc.errors import ActionError, ActiveLocError, ConfigError, MapError
from activeloc.maps import from_text
from activeloc.sensors import BeamModel

GLOBAL = "activeloc/GlobalLocalization-v0"
GRID = from_text("########\n#..#...#\n#......#\n#..#.###\n########", resolution=0.5, name="hut")
COARSE = {"kind": "histogram", "cell_size": 0.5, "headings": 12}
FEW = {"kind": "particles", "n_min": 20, "n_max": 50}


def refused(error, message, call):
    """Assert that a call is refused in less than two seconds and in one line."""
    start = time.perf_counter()
    with pytest.raises(error, match=message) as refusal:
        call()
    assert time.perf_counter() - start < 2.0
    assert isinstance(refusal.value, ActiveLocError)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


# --- settings

SETTINGS = {
    # names
    "a misspelt keyword": ({"belif": "histogram"}, "did you mean 'belief'"),
    "a keyword like nothing": ({"zzz": 1}, r"unknown name 'zzz' \(known: actions,"),
    "a misspelt task": ({"task": "globl"}, r"task\.kind must be one of global, .*got 'globl'"),
    "a misspelt belief": ({"belief": "histgram"}, "did you mean 'histogram'"),
    "a misspelt sensor": ({"sensor": "beams"}, "did you mean 'beam'"),
    "a misspelt generator": ({"map": "offce"}, "did you mean 'office'"),
    "misspelt actions": ({"actions": "discret"}, r"actions\.kind must be one of"),
    "a misspelt world": ({"world": "continous"}, "world must be one of continuous, discrete"),
    "a misspelt field": ({"belief": {"kind": "particles", "n_mni": 3}}, "did you mean 'n_min'"),
    "a field of the other belief": ({"belief": {"cell_sise": 1}}, "did you mean 'cell_size'"),
    "a misspelt nested field": (
        {"motion": {"odometry": {"rotation_from_rotaton": 0.1}}},
        r"motion\.odometry.*did you mean 'rotation_from_rotation'",
    ),
    "a misspelt reward": ({"reward": {"sucess": 1.0}}, "did you mean 'success'"),
    "a misspelt observation": ({"observation": {"row": 3}}, "did you mean 'rows'"),
    "a misspelt task field": ({"task": {"confidnce": 0.9}}, "did you mean 'confidence'"),
    # types
    "a number for the task": ({"task": 3}, "task must be a Task or a mapping"),
    "a list for the belief": ({"belief": ["histogram"]}, "belief must be one of"),
    "a kind that is a list": ({"belief": {"kind": ["histogram"]}}, "belief"),
    "a class for the sensor": ({"sensor": BeamModel}, "sensor must be one of beam, field"),
    "a number for the sensor": ({"sensor": 1.5}, "sensor must be one of beam, field"),
    "a string for the motion": ({"motion": "noisy"}, "motion must be a MotionModel"),
    "a number for a nested field": ({"motion": {"odometry": 0.1}}, "odometry must be a MotionNoi"),
    "a list for the reward": ({"reward": [1, 2]}, "reward must be a RewardWeights"),
    "a number for the observation": ({"observation": 32}, "observation must be an? Observation"),
    "a number for the actions": ({"actions": 3}, "actions must be an? Actions"),
    "a number for the map": ({"map": 7}, "map must be a string, a path or a map, got 7"),
    "a list for the map": ({"map": ["office"]}, "map must be"),
    "a number for the world": ({"world": 3}, "world must be one of"),
    "a bool for a number": ({"sensor": {"z_max": True}}, r"z_max must be a number.*got True"),
    "a bool for an integer": ({"sensor": {"beams": True}}, r"beams must be an integer.*got True"),
    "a float for an integer": ({"task": {"hold": 3.0}}, r"task\.hold must be an integer"),
    "a string for a number": ({"task": {"confidence": "0.9"}}, r"task\.confidence must be a num"),
    "a number for a bool": ({"actions": {"stay": 1}}, r"actions\.stay must be true or false"),
    "a keyword that is no word": ({"task": {3: 4}}, "unknown name 3"),
    # ranges
    "no beams": ({"sensor": {"beams": 0}}, r"beams must be an integer in \[1, 4096\]; got 0"),
    "a billion beams": ({"sensor": {"beams": 10**9}}, "beams must be an integer"),
    "no range": ({"sensor": {"z_max": 0.0}}, r"z_max must be a number in \(0, "),
    "an endless range": ({"sensor": {"z_max": np.inf}}, "z_max must be"),
    "a range of NaN": ({"sensor": {"z_max": np.nan}}, "z_max must be.*got nan"),
    "a sharp sensor": ({"sensor": {"sigma_hit": 0.0}}, "sigma_hit must be"),
    "more than all around": ({"sensor": {"field_of_view": 7.0}}, "field_of_view must be"),
    "no mixture": ({"sensor": {"w_hit": 0.8}}, "must be 1, got 0.9"),
    "a negative weight": ({"sensor": {"w_max": -0.1}}, "w_max must be"),
    "a negative noise": ({"motion": {"odometry": {"rotation_from_rotation": -1}}}, "rotation_from"),
    "a negative radius": ({"motion": {"radius": -0.1}}, "radius must be"),
    "a contact ratio of two": ({"motion": {"contact_ratio": 2.0}}, "contact_ratio must be"),
    "an odd number of headings": ({"belief": {"headings": 7}}, "headings must be even; got 7"),
    "no headings": ({"belief": {"headings": 0}}, "headings must be an integer"),
    "cells of nothing": ({"belief": {"cell_size": 0.0}}, "cell_size must be"),
    "half precision": ({"belief": {"precision": "float16"}}, "precision must be one of"),
    "no particles": ({"belief": {"kind": "particles", "n_min": 0}}, "n_min must be an integer"),
    "a billion particles": ({"belief": {"kind": "particles", "n_max": 10**9}}, "n_max must be"),
    "fewer at most than at least": (
        {"belief": {"kind": "particles", "n_min": 9, "n_max": 8}},
        "n_min must be at most belief.n_max; got 9 and 8",
    ),
    "a share of particles": ({"belief": {"kind": "particles", "ess_ratio": 1.5}}, "ess_ratio"),
    "an unknown resampling": ({"belief": {"kind": "particles", "resampling": "x"}}, "resampling"),
    "a leak of two": ({"belief": {"leak": 2.0}}, "leak must be"),
    "a confidence of two": ({"task": {"confidence": 2.0}}, "confidence must be"),
    "a confidence of nothing": ({"task": {"confidence": 0.0}}, "confidence must be"),
    "no hold": ({"task": {"hold": 0}}, "hold must be"),
    "kidnapped before it starts": ({"task": {"kidnap_first": 0}}, "kidnap_first must be"),
    "kidnapped backwards": ({"task": {"kidnap_last": 2}}, "kidnap_first must be at most"),
    "no turn": ({"actions": {"turn": 0.0}}, r"actions\.turn must be"),
    "a drive backwards": ({"actions": {"forward": -0.5}}, r"actions\.forward must be"),
    "an infinite weight": ({"reward": {"step": np.inf}}, r"reward\.step must be"),
    "no pixels": ({"observation": {"cols": 0}}, r"observation\.cols must be"),
    # together
    "a discrete world of particles": (
        {"world": "discrete", "belief": "particles"},
        "world='discrete' is the histogram filter's",
    ),
    "a filter with other beams": (
        {"sensor": {"beams": 3}, "filter_sensor": {"beams": 4}},
        "filter_sensor must have the sensor's 3 beams; got 4",
    ),
    "a filter of another kind with other beams": (
        {"sensor": {"beams": 3}, "filter_sensor": {"kind": "field", "beams": 2}},
        "3 beams; got 2",
    ),
    "bins wider than the range": ({"belief": {"kind": "particles", "reading_bin": 9.0}}, "reading"),
    "an unknown render mode": ({"render_mode": "human"}, "render_mode must be"),
}
MAPS = {
    "a file that is not there": ("no/such/map.yaml", MapError, "no/such/map.yaml"),
    "seeds that run down": ("office:7-3", ConfigError, "seeds"),
    "a parameter that is none": ("office(romos=3)", ConfigError, "did you mean 'rooms'"),
    "a folder": ("/", MapError, "/"),
    "an empty name": ("", ConfigError, "no generator ''"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_are_refused(name):
    settings, message = SETTINGS[name]
    refused(ConfigError, message, lambda: LocalizationEnv(**{"map": GRID, **settings}))
    refused(ConfigError, message, lambda: LocalizationVectorEnv(2, **{"map": GRID, **settings}))


@pytest.mark.parametrize("name", MAPS)
def test_maps_are_refused(name):
    spec, error, message = MAPS[name]
    refused(error, message, lambda: LocalizationEnv(map=spec))


def test_gym_make_passes_the_refusal_on():
    refused(ConfigError, "did you mean 'belief'", lambda: gym.make(GLOBAL, belif="histogram"))


@pytest.mark.parametrize("belief", [COARSE, FEW], ids=lambda belief: belief["kind"])
def test_a_robot_that_fits_nowhere_is_refused(belief):
    env = LocalizationEnv(map=GRID, belief=belief, motion={"radius": 3.0})
    refused(MapError, "a robot of radius 3 m fits nowhere", lambda: env.reset(seed=0))


def test_reading_bins_wider_than_the_range_are_refused():
    env = LocalizationEnv(map=GRID, belief={**COARSE, "reading_bin": 9.0})
    refused(ConfigError, "reading_bin must be a number in", lambda: env.reset(seed=0))


# --- actions


def state_of(env):
    """A fingerprint of all that the environment holds."""
    return hashlib.sha256(pickle.dumps(env)).hexdigest()


DISCRETE = {
    "NaN": np.nan,
    "infinity": np.inf,
    "too large": 3,
    "far too large": 10**30,
    "negative": -1,
    "a float": 1.0,
    "a float of NumPy": np.float32(2.0),
    "a bool": True,
    "a bool of NumPy": np.bool_(False),
    "nothing": None,
    "a word": "2",
    "bytes": b"2",
    "a list": [2],
    "an empty list": [],
    "a ragged list": [[1], [1, 2]],
    "an array of one": np.array([2]),
    "an array of shape (1, 1)": np.array([[2]]),
    "an array of two": np.array([0, 1]),
    "a complex number": 1j,
    "a set": {1},
    "an object": object(),
}
CONTINUOUS = {
    "NaN": [np.nan, 0.0],
    "infinity": [0.0, np.inf],
    "too large": [1.01, 0.0],
    "too small": [0.0, -1.01],
    "one number": [0.5],
    "a scalar": 0.5,
    "three numbers": [0.1, 0.2, 0.3],
    "a column": [[0.1], [0.2]],
    "bools": [True, False],
    "words": ["0.1", "0.2"],
    "nothing": None,
    "half of nothing": [0.1, None],
    "ragged": [0.1, [0.2]],
    "complex numbers": [1j, 0.0],
    "an integer": 1,
    "a word": "left",
}
GOOD_DISCRETE = [0, np.int64(2), np.uint8(1), np.array(2)]
GOOD_CONTINUOUS = [(0.5, -0.25), np.array([1, -1]), np.array([-1.0, 1.0], np.float32)]


@pytest.fixture(scope="module", params=[COARSE, FEW], ids=lambda belief: belief["kind"])
def pair(request):
    """Two environments in one state."""
    envs = [LocalizationEnv(map=GRID, belief=request.param, task="tracking") for _ in range(2)]
    for env in envs:
        env.reset(seed=1)
        env.step(0)
    return envs


@pytest.mark.parametrize("name", DISCRETE)
def test_actions_are_refused_and_change_nothing(pair, name):
    env, twin = pair
    before = state_of(env)
    refused(ActionError, r"action must be an integer in \[0, 2\]; got",
            lambda: env.step(DISCRETE[name]))  # fmt: skip
    assert state_of(env) == before
    ours, theirs = env.step(2), twin.step(2)
    np.testing.assert_array_equal(ours[0]["belief"], theirs[0]["belief"])
    assert ours[1:] == theirs[1:]


@pytest.mark.parametrize("name", CONTINUOUS)
def test_pairs_are_refused_and_change_nothing(name):
    env = LocalizationEnv(map=GRID, belief=FEW, actions="continuous")
    env.reset(seed=1)
    before = state_of(env)
    refused(ActionError, r"action must be two numbers in \[-1, 1\]; got",
            lambda: env.step(CONTINUOUS[name]))  # fmt: skip
    assert state_of(env) == before
    env.step([0.1, 0.2])


@pytest.mark.parametrize("action", GOOD_DISCRETE, ids=repr)
def test_integers_of_any_kind_are_actions(action):
    env, twin = (LocalizationEnv(map=GRID, belief=FEW, task="tracking") for _ in range(2))
    env.reset(seed=1)
    twin.reset(seed=1)
    assert env.step(action)[1:] == twin.step(int(action))[1:]


@pytest.mark.parametrize("action", GOOD_CONTINUOUS, ids=repr)
def test_pairs_of_any_kind_are_actions(action):
    env = LocalizationEnv(map=GRID, belief=FEW, actions="continuous",
                          motion={"actuation": {}, "odometry": {}})  # fmt: skip
    env.reset(seed=1, options={"pose": (0.8, 1.25, 0.0)})
    before = env.pose
    env.step(action)
    assert env.pose[2] - before[2] == pytest.approx(action[0] * np.pi / 6)
    assert env.knowledge.u[1] == pytest.approx((action[1] + 1.0) * 0.25)


def test_a_fourth_action_is_one_only_where_the_robot_may_stay():
    env = LocalizationEnv(map=GRID, belief=FEW, actions="discrete+stay")
    env.reset(seed=1)
    before = env.pose
    env.step(3)
    np.testing.assert_array_equal(env.pose, before)
    refused(ActionError, r"integer in \[0, 3\]; got 4", lambda: env.step(4))


def test_a_step_before_the_first_reset_is_refused():
    refused(ActionError, "before reset", lambda: LocalizationEnv(map=GRID, belief=FEW).step(0))
    with pytest.raises(ResetNeeded):
        gym.make(GLOBAL, map=GRID, belief=FEW).step(0)


@pytest.mark.parametrize("ask", ["knowledge", "render"])
def test_there_is_nothing_to_see_before_the_first_reset(ask):
    env = LocalizationEnv(map=GRID, belief=FEW, render_mode="rgb_array")
    refused(ActionError, "before reset", lambda: env.knowledge if ask == "knowledge" else
            env.render())  # fmt: skip


@pytest.mark.parametrize("belief", [COARSE, FEW], ids=lambda belief: belief["kind"])
def test_a_step_after_the_end_is_refused_and_changes_nothing(belief):
    env = LocalizationEnv(map=GRID, belief=belief, task={"confidence": 1e-9, "hold": 1})
    env.reset(seed=1)
    assert env.step(0)[2]
    before = state_of(env)
    for action in (0, 99):
        refused(ActionError, "call reset", lambda action=action: env.step(action))
    assert state_of(env) == before
    env.reset()
    env.step(0)
