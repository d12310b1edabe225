"""How far agents in mazes stay behind the best that can be done: exact, over the whole horizon.

Without noise the greatest expected return from a first reading can be computed
(:func:`activeloc.agents.maze_search.optimum`). An agent that plans to the end of the episode gets
it; every agent plays the same episodes, and its regret is what that one gets more.
``python -m benchmarks.regret --env Maze7-v0 --agents lookahead,ppo``.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from activeloc.agents import make_agent
from activeloc.agents.maze_search import first_actions, optimum, plan_values
from activeloc.cli.settings import NAMESPACE

RESAMPLES = 4000


@dataclass(frozen=True, slots=True)
class Played:
    """How episodes went.

    Attributes:
        returns: ``(N,)``.
        ms: CPU time of an episode's decisions [ms].
    """

    returns: NDArray[np.float64]
    ms: float


def expected(env_id: str, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """The greatest expected return of each episode."""
    batch: Any = gym.make_vec(env_id, num_envs=len(seeds))
    batch.reset(seed=seeds)
    return optimum(batch.batch_knowledge, steps)


def plan(env_id: str, seeds: list[int], steps: int, horizon: int) -> Played:
    """Plans of ``horizon`` steps, or of as many as are left; all robots are planned for at once."""
    batch: Any = gym.make_vec(env_id, num_envs=len(seeds), max_episode_steps=steps)
    batch.reset(seed=seeds)
    returns, seconds = np.zeros(len(seeds)), 0.0
    for left in range(steps, 0, -1):
        knowledge, begun = batch.batch_knowledge, time.thread_time()
        actions = first_actions(plan_values(knowledge, min(horizon, left)))
        seconds += time.thread_time() - begun
        returns += batch.step(actions)[1]
    return Played(returns, 1e3 * seconds / len(seeds))


def play(name: str, env_id: str, seeds: list[int], steps: int) -> Played:
    """An agent, one robot after the other."""
    env = gym.make(env_id, max_episode_steps=steps, disable_env_checker=True)
    agent = make_agent(name, env=env_id)
    returns, seconds = np.zeros(len(seeds)), 0.0
    for episode, seed in enumerate(seeds):
        observation, _ = env.reset(seed=seed)
        agent.reset(np.random.default_rng(seed))
        for _ in range(steps):
            begun = time.thread_time()
            action = agent.act(observation, env.unwrapped.knowledge)  # type: ignore[attr-defined]
            seconds += time.thread_time() - begun
            observation, reward, *_ = env.step(action)
            returns[episode] += float(reward)
    return Played(returns, 1e3 * seconds / len(seeds))


def interval(values: NDArray[np.float64]) -> str:
    """Mean and its 95 % percentile bootstrap interval."""
    rng = np.random.default_rng(0)
    drawn = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f"{values.mean():.3f} [{low:.3f}, {high:.3f}]"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", default="Maze7-v0", help="a maze without noise")
    parser.add_argument("--agents", default="random,greedy,lookahead,ppo")
    parser.add_argument("--horizons", default="7,9", help="steps of plans; also shorter at the end")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--steps", type=int, help="T; the environment's if not given")
    parser.add_argument("--seed", type=int, default=777, help="of the first episode")
    options = parser.parse_args()
    env_id = NAMESPACE + options.env.removeprefix(NAMESPACE)
    steps = options.steps or gym.spec(env_id).max_episode_steps
    assert steps is not None
    seeds = [options.seed + episode for episode in range(options.episodes)]
    best = plan(env_id, seeds, steps, steps)
    table = Table(title=f"{options.env}, {steps} steps, {len(seeds)} episodes from {seeds[0]}")
    for column in ("agent", "return", "regret", "episodes without", "ms an episode"):
        table.add_column(column, justify="left" if column == "agent" else "right")
    table.add_row("optimum, expected", interval(expected(env_id, seeds, steps)), "", "", "")
    table.add_row("optimum, played", interval(best.returns), "0", "100%", f"{best.ms:.1f}")
    horizons = [int(word) for word in options.horizons.split(",") if word]
    rows = {f"plans of {k} steps": plan(env_id, seeds, steps, k) for k in horizons}
    rows |= {name: play(name, env_id, seeds, steps) for name in options.agents.split(",") if name}
    for name, played in rows.items():
        regret = best.returns - played.returns
        without, ms = f"{(regret <= 1e-9).mean():.0%}", f"{played.ms:.1f}"
        table.add_row(name, interval(played.returns), interval(regret), without, ms)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
