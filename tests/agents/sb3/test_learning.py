"""A policy learns: a tiny maze, from rewards alone and from a planner, in well under a minute.

Success of a policy that has learnt nothing is a few in a hundred, so these fail where anything on
the way from the reward to the weights is broken.
"""

import numpy as np
import pytest

from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.configuration import TrainingConfig
from activeloc.agents.sb3.training import load_policy, train

SMALL = {
    "n_envs": 128,
    "batch_size": 512,
    "hidden": [64, 64],
    "learning_rate": 3e-3,
    "evaluate_every": 0,
    "env": {"observation": {"radius": 3}},
    "imitation": {"labels": 4000, "rounds": 2, "epochs": 5, "values": 2000},
}


def right(config, model, n=200):
    """Share of episodes that end in certainty, of seeds that training does not use."""
    env = training_env(config, n)
    observations, result = env.begin(range(10**6, 10**6 + n)), np.full(n, np.nan)
    while np.isnan(result).any():
        env.step_async(model.predict(observations, deterministic=True)[0])
        observations, _, dones, infos = env.step_wait()
        for robot in np.flatnonzero(dones & np.isnan(result)):
            result[robot] = infos[robot]["episode"]["is_success"]
    return result.mean()


@pytest.mark.parametrize(("imitate", "steps"), [(None, 100_000), ("lookahead", 2_048)])
def test_a_policy_learns_a_tiny_maze(tmp_path, imitate, steps):
    config = TrainingConfig.build(
        "activeloc/Maze7-v0", "ppo", SMALL, total_timesteps=steps, seed=1, imitate=imitate
    )
    assert right(config, build_model(config, training_env(config))) < 0.2
    path = train(config, tmp_path / "run")
    assert right(config, load_policy(path)[1]) >= 0.9


def test_one_seed_gives_one_set_of_weights(tmp_path):
    """Two runs of 20,000 steps, imitation and all, to the bit."""
    config = TrainingConfig.build(
        "activeloc/Maze7-v0", "ppo", SMALL, total_timesteps=20_000, seed=4, imitate="lookahead"
    )
    paths = [train(config, tmp_path / name) for name in ("a", "b")]
    one, other = [(path / "policy.safetensors").read_bytes() for path in paths]
    assert one == other
