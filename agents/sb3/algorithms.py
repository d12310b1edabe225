"""From a configuration to a Stable-Baselines3 model, on the CPU."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import stable_baselines3
from sb3_contrib import RecurrentPPO as SB3RecurrentPPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import LinearSchedule

from activeloc.agents.sb3.configuration import TrainingConfig
from activeloc.agents.sb3.features import extractor_for, keys_for
from activeloc.agents.sb3.hyperparameters import DQN, PPO, RecurrentPPO
from activeloc.agents.sb3.vec_env import NativeVecEnv, make_vec_env
from activeloc.errors import ConfigError


def training_env(config: TrainingConfig, n_envs: int | None = None) -> NativeVecEnv:
    """The environment of a run, its observation cut to what the network reads.

    Args:
        config: Of the run.
        n_envs: Robots; the algorithm's number if None.

    Raises:
        ConfigError: If a setting is refused.
        MapError: If a map is refused.
    """
    row = config.hyperparameters
    env = make_vec_env(config.env, n_envs or row.n_envs, config.settings)
    if not isinstance(env.action_space, gym.spaces.Discrete):
        raise ConfigError(f"{config.algorithm} needs discrete actions; got {env.action_space}")
    assert isinstance(env.observation_space, gym.spaces.Dict)
    return NativeVecEnv(env.envs, keys_for(env.observation_space, row.reader))


def build_model(config: TrainingConfig, env: NativeVecEnv) -> BaseAlgorithm:
    """A fresh model; every source of chance is seeded by the run's seed."""
    row = config.hyperparameters
    assert isinstance(env.observation_space, gym.spaces.Dict)
    network: dict[str, Any] = {
        "features_extractor_class": extractor_for(env.observation_space),
        "features_extractor_kwargs": {"hidden": row.hidden},
        "net_arch": [],
    }
    shared: dict[str, Any] = {
        "env": env,
        "learning_rate": LinearSchedule(row.learning_rate, 0.0, 1.0),
        "gamma": row.gamma,
        "batch_size": row.batch_size,
        "seed": config.seed % 2**32,
        "device": "cpu",
    }
    if isinstance(row, DQN):
        return stable_baselines3.DQN(
            "MultiInputPolicy",
            buffer_size=row.buffer_size,
            learning_starts=row.learning_starts,
            train_freq=row.train_freq,
            gradient_steps=row.gradient_steps,
            target_update_interval=row.target_interval,
            exploration_fraction=row.exploration_fraction,
            exploration_final_eps=row.exploration_final,
            policy_kwargs=network,
            **shared,
        )
    shared |= _on_policy(row)
    if isinstance(row, RecurrentPPO):
        network |= {
            "lstm_hidden_size": row.memory,
            "shared_lstm": True,
            "enable_critic_lstm": False,
        }
        return SB3RecurrentPPO("MultiInputLstmPolicy", policy_kwargs=network, **shared)
    return stable_baselines3.PPO("MultiInputPolicy", policy_kwargs=network, **shared)


def _on_policy(row: PPO) -> dict[str, Any]:
    return {
        "n_steps": row.n_steps,
        "n_epochs": row.n_epochs,
        "gae_lambda": row.gae_lambda,
        "ent_coef": row.ent_coef,
        "vf_coef": row.vf_coef,
        "clip_range": row.clip_range,
        "max_grad_norm": row.max_grad_norm,
    }
