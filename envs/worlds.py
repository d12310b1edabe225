"""The worlds there are: metric maps and mazes; one environment class plays in either."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from activeloc.envs.episodes import EpisodeConfig, Episodes, Knowledge
from activeloc.envs.maze_episodes import MazeConfig, MazeEpisodes, MazeKnowledge

AnyConfig = EpisodeConfig | MazeConfig
AnyEpisodes = Episodes | MazeEpisodes
AnyKnowledge = Knowledge | MazeKnowledge


def configure(settings: Mapping[str, Any]) -> AnyConfig:
    """The environment's settings, typed and checked; the task's kind says which world it is.

    Raises:
        ConfigError: If a name is unknown or a value is refused.
        MapError: If a map cannot be read.
    """
    task = settings.get("task")
    kind = task.get("kind") if isinstance(task, Mapping) else getattr(task, "kind", task)
    build = MazeConfig.build if kind == "maze" else EpisodeConfig.build
    return build(settings)


def episodes_of(config: AnyConfig, n_robots: int, threads: int = 1) -> AnyEpisodes:
    """A batch of episodes, and how many threads share the work."""
    if isinstance(config, MazeConfig):
        return MazeEpisodes(config, n_robots, threads)
    return Episodes(config, n_robots, threads)


def observation_space(config: AnyConfig) -> gym.spaces.Dict:
    """The observation space of one robot."""
    if isinstance(config, MazeConfig):
        return config.observation.space(config.size)
    return config.observation.space(len(config.sensor.bearings))
