"""The worlds there are: metric maps and mazes; one environment class plays in either.

A process that plays in one loads nothing of the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import gymnasium as gym

from activeloc.envs.episode_config import EpisodeConfig

if TYPE_CHECKING:
    from activeloc.envs.episodes import Episodes
    from activeloc.envs.knowledge import Knowledge
    from activeloc.envs.maze_config import MazeConfig
    from activeloc.envs.maze_episodes import MazeEpisodes
    from activeloc.envs.maze_knowledge import MazeKnowledge

AnyConfig: TypeAlias = "EpisodeConfig | MazeConfig"
AnyEpisodes: TypeAlias = "Episodes | MazeEpisodes"
AnyKnowledge: TypeAlias = "Knowledge | MazeKnowledge"


def configure(settings: Mapping[str, Any]) -> AnyConfig:
    """The environment's settings, typed and checked; the task's kind says which world it is.

    Raises:
        ConfigError: If a name is unknown or a value is refused.
        MapError: If a map cannot be read.
    """
    task = settings.get("task")
    kind = task.get("kind") if isinstance(task, Mapping) else getattr(task, "kind", task)
    if kind != "maze":
        return EpisodeConfig.build(settings)
    from activeloc.envs.maze_config import MazeConfig

    return MazeConfig.build(settings)


def episodes_of(config: AnyConfig, n_robots: int, threads: int = 1) -> AnyEpisodes:
    """A batch of episodes, and how many threads share the work."""
    if isinstance(config, EpisodeConfig):
        from activeloc.envs.episodes import Episodes

        return Episodes(config, n_robots, threads)
    from activeloc.envs.maze_episodes import MazeEpisodes

    return MazeEpisodes(config, n_robots, threads)


def observation_space(config: AnyConfig) -> gym.spaces.Dict:
    """The observation space of one robot."""
    if isinstance(config, EpisodeConfig):
        return config.observation.space(len(config.sensor.bearings))
    return config.observation.space(config.size)
