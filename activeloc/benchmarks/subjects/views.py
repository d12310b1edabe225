"""The egocentric views, of mazes and of metric maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np

from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.metric_view import MetricView
from activeloc.benchmarks.clock import alternate
from activeloc.benchmarks.report import Row, at_most
from activeloc.benchmarks.settings import Settings
from activeloc.envs.localization import LocalizationEnv


def measure(settings: Settings) -> Iterator[Row]:
    """After the first scan, when most poses are still possible."""
    yield _maze(settings)
    yield _metric(settings)


def _maze(settings: Settings) -> Row:
    n = settings.size(64, 4)
    mazes: Any = gym.make_vec("activeloc/Maze15-v0", num_envs=n)
    mazes.reset(seed=0)
    view = EgocentricView(mazes.batch_knowledge.belief, 9)
    view.place(np.arange(n))
    seconds = alternate({"": view.draw}, budget=settings.budget / 2, rounds=settings.rounds)[""]
    return Row.of("views", "Maze15", "us/robot", 1e6 * seconds / n, target=at_most(20.0))


def _metric(settings: Settings) -> Row:
    env = LocalizationEnv(map="rooms:0" if settings.quick else "office:0")
    env.reset(seed=0)
    knowledge: Any = env.knowledge
    view = MetricView(knowledge.belief, knowledge.sensor, 8)
    calls = {"": lambda: view.draw(0)}
    seconds = alternate(calls, budget=settings.budget / 2, rounds=settings.rounds)[""]
    return Row.of("views", "default metric task", "us/robot", 1e6 * seconds, target=at_most(200.0))
