"""What is to be evaluated: the environment, the agents, the episodes and their chance.

Episode i is the same for every agent, whatever else is run beside it: it is played on map number i
of the map source (round again after the last) and from two streams of the sweep's seed,

- ``SeedSequence(seed, spawn_key=(i, 0))``: one 64-bit word of it seeds the environment (start,
  noise of motion and sensor, noise of the filter);
- ``SeedSequence(seed, spawn_key=(i, 1))``: seeds the agent's own generator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from math import isfinite
from typing import Any

import numpy as np

import activeloc
from activeloc import checks
from activeloc.agents import Agent, make_agent
from activeloc.agents.evaluation.starts import Starts
from activeloc.configuration import unknown
from activeloc.envs import ENVIRONMENTS, MAX_EPISODE_STEPS
from activeloc.envs.maze_episodes import MazeConfig
from activeloc.envs.worlds import AnyConfig, configure
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource

MAX_SEED = 2**63 - 1
METRIC_ONLY = ("spin", "active", "glance")
"""Agents that play no mazes."""
MAX_EPISODES = 1_000_000
MAX_STEPS = 1_000_000


@dataclass(frozen=True)
class Sweep:
    """Agents that play the same episodes.

    Attributes:
        env: Registered id.
        map: Where the maps come from.
        agents: Settings of each agent, by its name, in the order of the tables; differences are
            taken against the first.
        settings: Keyword arguments of the environment that differ from its id's; not ``map``.
        episodes: How many each agent plays.
        seed: All chance follows from it.
        limit: Steps after which an episode has failed.
        gains: Whether planners' expected and realised gains are recorded; it costs time.
        starts: Mazes and starts to play, one an episode, instead of the map source's.

    Raises:
        ConfigError: If a name is unknown or a value refused.
        MapError: If the map cannot be read.
    """

    env: str
    map: MapSource
    agents: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Any]
    episodes: int = 16
    seed: int = 0
    limit: int = MAX_EPISODE_STEPS
    gains: bool = False
    starts: Starts | None = None

    def __post_init__(self) -> None:
        if self.env not in ENVIRONMENTS:
            raise unknown("environment", self.env, ENVIRONMENTS)
        checks.integer("episodes", self.episodes, 1, MAX_EPISODES)
        checks.integer("seed", self.seed, 0, MAX_SEED)
        checks.integer("steps", self.limit, 1, MAX_STEPS)
        checks.boolean("gains", self.gains)
        if not self.agents:
            raise ConfigError("agents: at least one is needed")
        for name in self.agents:
            self.agent(name)
        config = self.config()
        if isinstance(config, MazeConfig):
            self._check_mazes(config)
        elif self.starts is not None:
            raise ConfigError(f"starts are for mazes; {self.env} is none")

    def _check_mazes(self, config: MazeConfig) -> None:
        for name in self.agents:
            if name in METRIC_ONLY:
                raise ConfigError(f"agent {name} plays no mazes; {self.env} is one")
        if self.gains:
            raise ConfigError("gains are not recorded in mazes")
        if self.starts is None:
            return
        if self.episodes > len(self.starts):
            raise ConfigError(
                f"episodes must be at most the {len(self.starts)} of {self.starts.name}; "
                f"got {self.episodes}"
            )
        if self.starts.free.shape[1:] != (config.size, config.size):
            raise ConfigError(
                f"{self.starts.name}: grids are {self.starts.free.shape[1:]}; {self.env} needs "
                f"{config.size} x {config.size}"
            )

    def config(self) -> AnyConfig:
        """The environment's settings, every default filled in."""
        return configure({**ENVIRONMENTS[self.env], **self.settings, "map": self.map})

    def options(self, episode: int) -> dict[str, Any]:
        """What the environment is reset with for an episode."""
        if self.starts is not None:
            return self.starts.options(episode)
        return {"map": self.map.number(self.map_number(episode))}

    @property
    def where(self) -> str:
        """What the episodes are played on, in a word."""
        return self.map.spec if self.starts is None else self.starts.name

    def agent(self, name: str) -> Agent:
        """A new agent of the sweep's, for its environment."""
        return make_agent(name, self.agents[name], self.env)

    def map_number(self, episode: int) -> int:
        """Which of the source's maps an episode is played on."""
        n_maps = self.map.n_maps
        return episode if n_maps is None else episode % n_maps

    def env_seed(self, episode: int) -> int:
        """What the environment is reset with."""
        words = np.random.SeedSequence(self.seed, spawn_key=(episode, 0))
        return int(words.generate_state(1, np.uint64)[0])

    def agent_rng(self, episode: int) -> np.random.Generator:
        """An agent's own source of chance."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(episode, 1)))

    def identity(self) -> dict[str, Any]:
        """What must be equal for two episodes to belong together, as plain data.

        The number of episodes is not in it: a longer sweep holds the shorter one's.
        """
        return {
            "activeloc": activeloc.__version__,
            "env": self.env,
            "settings": plain(self.config()),
            "seed": self.seed,
            "steps": self.limit,
            "gains": self.gains,
            **({} if self.starts is None else {"starts": self.starts.digest}),
            "agents": {name: plain(self.agent(name)) for name in self.agents},
        }


def plain(value: Any) -> Any:
    """Settings as JSON can hold them: dataclasses by type and fields, a map by its digest."""
    if isinstance(value, OccupancyGrid):
        return {"name": value.name, "digest": value.digest}
    if is_dataclass(value) and not isinstance(value, type):
        named = {item.name: getattr(value, item.name) for item in fields(value) if item.init}
        return {"type": type(value).__name__, **{key: plain(item) for key, item in named.items()}}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return repr(value)
