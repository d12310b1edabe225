"""A run small enough to be done many times."""

import pytest
import torch

from activeloc.agents.sb3.configuration import TrainingConfig

ENV = "activeloc/GlobalLocalization-v0"
HOME = {
    "map": "rooms(width=6,height=5,resolution=0.1):0",
    "belief": {"kind": "histogram", "cell_size": 0.5, "headings": 12},
    "observation": {"headings": 4, "rows": 9, "cols": 12, "view": False},
    "max_episode_steps": 7,
}
ROWS = {
    "ppo": {"n_envs": 3, "n_steps": 5, "batch_size": 5, "n_epochs": 2, "hidden": [16]},
    "recurrent_ppo": {
        "n_envs": 2,
        "n_steps": 5,
        "batch_size": 5,
        "n_epochs": 1,
        "hidden": [16],
        "memory": 8,
    },
    "dqn": {
        "n_envs": 2,
        "hidden": [16],
        "buffer_size": 60,
        "learning_starts": 20,
        "batch_size": 8,
        "gradient_steps": 1,
        "target_interval": 16,
    },
}


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def home():
    """Settings of a small environment."""
    return {**HOME}


@pytest.fixture
def make_config():
    """``make_config("ppo", total_timesteps=60, ...)``: a small run."""

    def make(algorithm="ppo", hyperparameters=None, **given):
        changes = {**ROWS[algorithm], **(hyperparameters or {}), "env": {**HOME}}
        defaults = {"total_timesteps": 90, "seed": 5, "checkpoint_every": 3, "evaluate_every": 0}
        return TrainingConfig.build(ENV, algorithm, changes, **{**defaults, **given})

    return make
