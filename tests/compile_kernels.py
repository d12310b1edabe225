"""Compile what most tests use, before they run: ``python tests/compile_kernels.py``.

Two workers that start on an empty cache compile the same kernels side by side. Two processes that
play different environments first compile each of them once, and share the work.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import gymnasium as gym
import numpy as np

import activeloc  # noqa: F401  (registers the ids)
from activeloc.agents import make_agent

OFFICE: dict[str, Any] = {"map": "office:0", "observation": {"view": True}}
MAZES: dict[str, Any] = {"observation": {"view": True}}
SHARES: tuple[tuple[tuple[str, dict[str, Any], str], ...], ...] = (
    (
        ("GlobalLocalization-v0", OFFICE | {"belief": "histogram"}, "active"),
        ("KidnappedRobot-v0", OFFICE | {"belief": "histogram"}, "greedy"),
    ),
    (
        ("Maze7-v0", MAZES, "lookahead"),
        ("Maze7-v0", MAZES, "greedy"),
        ("NoisyMaze9-v0", MAZES, "lookahead"),
        ("KidnappedRobot-v0", OFFICE | {"belief": "particles"}, "greedy"),
    ),
)


def play(share: tuple[tuple[str, dict[str, Any], str], ...], steps: int = 12) -> None:
    """Play some environments, each for a few steps: one robot, then two at once."""
    for name, settings, agent_name in share:
        env = gym.make(f"activeloc/{name}", disable_env_checker=True, **settings)
        agent, (observation, _) = make_agent(agent_name), env.reset(seed=0)
        agent.reset(np.random.default_rng(0))
        for _ in range(steps):
            action = agent.act(observation, env.unwrapped.knowledge)
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                break
        robots = gym.make_vec(f"activeloc/{name}", num_envs=2, **settings)
        robots.reset(seed=0)
        robots.step(robots.action_space.sample())


def main() -> None:
    """Play all shares, one process each."""
    with ProcessPoolExecutor(len(SHARES), get_context("spawn")) as pool:
        list(pool.map(play, SHARES))


if __name__ == "__main__":
    main()
