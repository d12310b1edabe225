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
from activeloc.agents import make_agent
from activeloc.configuration import unknown
from activeloc.envs import ENVIRONMENTS, MAX_EPISODE_STEPS
from activeloc.envs.episodes import EpisodeConfig
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource

MAX_SEED = 2**63 - 1
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

    def __post_init__(self) -> None:
        if self.env not in ENVIRONMENTS:
            raise unknown("environment", self.env, ENVIRONMENTS)
        checks.integer("episodes", self.episodes, 1, MAX_EPISODES)
        checks.integer("seed", self.seed, 0, MAX_SEED)
        checks.integer("steps", self.limit, 1, MAX_STEPS)
        if not self.agents:
            raise ConfigError("agents: at least one is needed")
        for name, settings in self.agents.items():
            make_agent(name, settings)
        self.config()

    def config(self) -> EpisodeConfig:
        """The environment's settings, every default filled in."""
        return EpisodeConfig.build({**ENVIRONMENTS[self.env], **self.settings, "map": self.map})

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
            "agents": {
                name: plain(make_agent(name, settings)) for name, settings in self.agents.items()
            },
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
