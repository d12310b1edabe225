"""Our adapter against SB3's own, made of single environments."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from activeloc.agents.evaluation.records import penalised_area
from activeloc.agents.sb3.vec_env import Histories, NativeVecEnv, make_vec_env
from activeloc.errors import ConfigError

ENV = "activeloc/GlobalLocalization-v0"
N = 3


def ours(home, **settings):
    return make_vec_env(ENV, N, {**home, **settings})


def theirs(home, **settings):
    """The oracle."""
    return DummyVecEnv([lambda: Monitor(gym.make(ENV, **{**home, **settings})) for _ in range(N)])


def assert_equal(a, b):
    assert a.keys() == b.keys()
    for key in a:
        assert a[key].dtype == b[key].dtype
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def test_it_equals_sb3s_own_over_single_environments(home):
    """With declarations that end some episodes and a limit that ends others."""
    hasty = {"task": {"confidence": 0.12, "hold": 2}}
    native, dummy = ours(home, **hasty), theirs(home, **hasty)
    assert native.observation_space == dummy.observation_space
    assert native.action_space == dummy.action_space
    native.seed(11), dummy.seed(11)
    assert_equal(native.reset(), dummy.reset())
    ends = []
    for actions in np.random.default_rng(0).integers(3, size=(40, N)):
        one, other = native.step(actions), dummy.step(actions)
        assert_equal(one[0], other[0])
        assert one[1].dtype == other[1].dtype
        np.testing.assert_array_equal(one[1], other[1])
        np.testing.assert_array_equal(one[2], other[2])
        for robot in range(N):
            mine, its = one[3][robot], other[3][robot]
            if one[2][robot]:
                ends.append(mine["TimeLimit.truncated"])
                assert_equal(mine.pop("terminal_observation"), its.pop("terminal_observation"))
                statistics, wanted = mine.pop("episode"), its.pop("episode")
                assert statistics["r"] == pytest.approx(wanted["r"], abs=2e-6)
                assert statistics["l"] == wanted["l"]
            assert mine == its
            assert native.reset_infos[robot] == dummy.reset_infos[robot]
    assert True in ends
    assert False in ends


def test_an_episodes_statistics_are_those_of_its_infos(home):
    env = ours(home)
    env.seed(3)
    env.reset()
    curves = [[info["entropy_fraction"]] for info in env.reset_infos]
    n_episodes = 0
    for actions in np.random.default_rng(1).integers(3, size=(20, N)):
        dones, infos = env.step(actions)[2:]
        for robot, info in enumerate(infos):
            curves[robot].append(info["entropy_fraction"])
            if dones[robot]:
                n_episodes += 1
                given = info["episode"]
                area = penalised_area(curves[robot], bool(info["wrong"]), 7)
                assert given["area"] == pytest.approx(area)
                assert given["entropy"] == info["entropy"]
                assert given["is_success"] == info["is_success"]
                curves[robot] = [env.reset_infos[robot]["entropy_fraction"]]
    assert n_episodes >= 6


def test_replayed_actions_lead_to_where_they_led(home):
    env = ours(home)
    env.begin([4, 7, 9])
    for actions in np.random.default_rng(2).integers(3, size=(10, N)):
        observations, _, dones, _ = env.step(actions)
    taken = [actions.copy() for actions in env.actions_taken]
    assert len(taken) == 10
    ahead = env.step(np.array([2, 2, 0]))[0]
    other = ours(home)
    again, dones_again = other.replay([4, 7, 9], taken)
    assert_equal(again, observations)
    np.testing.assert_array_equal(dones_again, dones)
    assert_equal(other.step(np.array([2, 2, 0]))[0], ahead)


def test_only_the_keys_asked_for_are_kept(home):
    env = make_vec_env(ENV, 2, home, ["map", "scalars"])
    assert [*env.reset()] == ["map", "scalars"]
    assert {*env.observation_space.spaces} == {"map", "scalars"}


def test_methods_are_called_for_each_robot(home):
    env = ours(home)
    env.reset()
    assert [k.robot for k in env.env_method("knowledge", indices=[2, 0])] == [2, 0]
    assert env.get_attr("max_episode_steps") == [7] * N
    assert env.env_is_wrapped(Monitor) == [True] * N


def test_refusals(home):
    envs = gym.make_vec(ENV, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP, **home)
    with pytest.raises(ConfigError, match="SAME_STEP"):
        NativeVecEnv(envs)
    with pytest.raises(ConfigError, match="no 'nothing'"):
        make_vec_env(ENV, 2, home, ["nothing"])
    env = ours(home)
    with pytest.raises(ConfigError, match="cannot be set"):
        env.set_attr("a", 1)
    env.set_options([{"map": "office:1"}, {}, {}])
    with pytest.raises(ConfigError, match="same for all"):
        env.reset()


def test_histories_are_as_long_as_what_was_added_to_each():
    histories, lists = Histories(3), [[], [], []]
    rng = np.random.default_rng(0)
    for step in range(200):
        who, values = rng.random(3) < 0.8, rng.random(3)
        if step == 90:
            histories.clear(who)
            lists = [[] if gone else kept for gone, kept in zip(who, lists, strict=True)]
        histories.add(who, values)
        for robot in np.flatnonzero(who):
            lists[robot].append(values[robot])
    assert [histories.of(robot) for robot in range(3)] == lists
    assert max(map(len, lists)) > 64
