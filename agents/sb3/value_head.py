"""What a policy expects to get, fitted to what it gets: between imitation and PPO."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy

from activeloc.agents.sb3.vec_env import NativeVecEnv


def fit_values(
    policy: ActorCriticPolicy,
    env: NativeVecEnv,
    n_steps: int,
    gamma: float,
    rng: np.random.Generator,
    go_on: Callable[[], bool] = lambda: True,
) -> float:
    """Fit the value head, linear in the features, to the returns that the policy gets.

    PPO's first advantages would otherwise be noise, and undo what was imitated.

    Args:
        policy: Acts, as drawn; the weights of its value head are changed.
        env: Its robots begin new episodes.
        n_steps: Of all robots together.
        gamma: Discount.
        rng: Source of the episodes' seeds.
        go_on: Asked before each step.

    Returns:
        Share of the returns' variance that the head explains; NaN if no episode ended.
    """
    observations = env.begin(int(word) for word in rng.integers(2**62, size=env.num_envs))
    features, rewards, dones = [], [], []
    for _ in range(-(-n_steps // env.num_envs)):
        if not go_on():
            return np.nan
        tensors, _ = policy.obs_to_tensor(observations)
        with torch.no_grad():
            latent = policy.mlp_extractor(policy.extract_features(tensors))[1]
        features.append(latent.numpy())
        env.step_async(policy.predict(observations, deterministic=False)[0])
        observations, reward, done, _ = env.step_wait()
        rewards.append(reward)
        dones.append(done)
    returns, ended = returns_to_go(np.array(rewards), np.array(dones, dtype=np.bool_), gamma)
    if not ended.any():
        return np.nan
    x = np.array(features)[ended].astype(np.float64)
    x = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    ridge = 1e-3 * len(x) * np.eye(x.shape[1])
    head = np.linalg.solve(x.T @ x + ridge, x.T @ returns[ended])
    with torch.no_grad():
        policy.value_net.weight.copy_(torch.as_tensor(head[None, :-1]))
        policy.value_net.bias.copy_(torch.as_tensor(head[-1:]))
    return 1.0 - float(np.var(returns[ended] - x @ head)) / max(
        float(np.var(returns[ended])), 1e-12
    )


def returns_to_go(
    rewards: NDArray[Any], dones: NDArray[np.bool_], gamma: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Discounted sums of what is to come in each episode, and whether its end was seen.

    Args:
        rewards: ``(T, B)``.
        dones: ``(T, B)``; the step was the last of its episode.
        gamma: Discount.
    """
    returns, ended = np.zeros(rewards.shape), np.zeros(rewards.shape, dtype=np.bool_)
    after, seen = np.zeros(rewards.shape[1]), np.zeros(rewards.shape[1], dtype=np.bool_)
    for t in range(len(rewards) - 1, -1, -1):
        after = rewards[t] + gamma * np.where(dones[t], 0.0, after)
        seen = seen | dones[t]
        returns[t], ended[t] = after, seen
    return returns, ended
