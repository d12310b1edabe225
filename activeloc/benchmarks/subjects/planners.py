"""Decisions a second, over whole episodes."""

from __future__ import annotations

from collections.abc import Iterator
from time import thread_time
from typing import Any

import gymnasium as gym
import numpy as np

from activeloc.agents import make_agent
from activeloc.benchmarks.report import Row, Target, at_least
from activeloc.benchmarks.settings import Settings

METRIC, MAZE = "activeloc/GlobalLocalization-v0", "activeloc/Maze15-v0"


def measure(settings: Settings) -> Iterator[Row]:
    """Greedy and active on the default task, lookahead in mazes."""
    metric, mazes = settings.size(6, 2), settings.size(40, 2)
    where = {"map": "rooms(width=6,height=6):0"} if settings.quick else {"map": "office:0-3"}
    for name, target in (("greedy", at_least(30.0)), ("active", at_least(5.0)), ("glance", None)):
        steps = settings.size(150, 5)
        yield _rate(name, METRIC, metric, steps, target, "default task", where)
    yield _rate("lookahead", MAZE, mazes, 20, at_least(1_000.0), "K = 7, Maze15", {})


def _rate(
    name: str,
    env_id: str,
    episodes: int,
    steps: int,
    target: Target | None,
    where: str,
    settings: dict[str, Any],
) -> Row:
    """Decisions over the CPU time that they took, an episode at a time."""
    env: Any = gym.make(env_id, disable_env_checker=True, max_episode_steps=steps, **settings)
    agent, rates, total = make_agent(name, env=env_id), [], 0
    for episode in range(-1, episodes):  # The first compiles.
        observation, _ = env.reset(seed=max(0, episode))
        agent.reset(np.random.default_rng(episode + 1))
        spent, decisions, over = 0.0, 0, False
        while not over:
            begun = thread_time()
            action = agent.act(observation, env.unwrapped.knowledge)
            spent += thread_time() - begun
            decisions += 1
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
        if episode >= 0:
            rates.append(decisions / spent)
            total += decisions
    note = f"{episodes} episodes, {total} decisions; the spread is over episodes"
    return Row.of("planners", f"{name}, {where}", "decisions/s", rates, target=target, note=note)
