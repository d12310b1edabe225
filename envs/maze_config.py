"""What a maze environment is made of: its task, its mazes, what is observed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from activeloc import checks
from activeloc.beliefs.lattice import check_mazes
from activeloc.configuration import build, unknown
from activeloc.envs.actions import Actions
from activeloc.envs.egocentric import MazeObservation
from activeloc.errors import ConfigError
from activeloc.maps import MapSource
from activeloc.maps.maze import Maze

ACTIONS = Actions(turn=float(np.pi / 2.0), forward=1.0)


@dataclass(frozen=True, slots=True)
class MazeTask:
    """The maze task's own settings.

    Attributes:
        kind: ``maze``.
        p_off: Probability that a step forward is one cell short, and of being one long, clipped at
            walls; that a reading is one too small, and one too large. 0: no noise.
        confidence: The belief is sure when its largest probability is more than this; 1 for when
            it is 1.
        reward: ``largest``, the largest probability after a step; or ``doubt``, that less 1, and
            the episode ends once it is 1, since no doubt is to come. Returns differ by T, and
            training does not wait for the rest of the episode.

    Raises:
        ConfigError: If a value is out of its range.
    """

    kind: str = "maze"
    p_off: float = 0.0
    confidence: float = 1.0
    reward: str = "largest"

    def __post_init__(self) -> None:
        checks.choice("task.kind", self.kind, ("maze",))
        checks.choice("task.reward", self.reward, ("largest", "doubt"))
        checks.number("task.p_off", self.p_off, 0.0, 0.5)
        checks.number("task.confidence", self.confidence, 0.0, 1.0, above_low=True)


@dataclass(frozen=True)
class MazeConfig:
    """Everything that defines a maze environment, typed and checked.

    Attributes:
        task: Noise, and what counts as success.
        map: Where the mazes come from: ``maze(size=15):*``, or one map with walls around it.
        observation: What is observed.
    """

    task: MazeTask = field(default_factory=MazeTask)
    map: MapSource = field(default_factory=lambda: MapSource.parse("maze(size=15):*"))
    observation: MazeObservation = field(default_factory=MazeObservation)

    @classmethod
    def build(cls, settings: Mapping[str, Any]) -> MazeConfig:
        """From the environment's keyword arguments.

        Raises:
            ConfigError: If a name is unknown, or a value is refused or not for a maze.
            MapError: If a map cannot be read.
        """
        usual = {"belief": "histogram", "actions": "discrete", "world": "continuous", "people": 0.0}
        others = ("sensor", "motion", "reward", "filter_sensor", "filter_motion", *usual)
        for name, value in settings.items():
            if name not in cls.__dataclass_fields__ and name not in others:
                raise unknown("environment", name, [*cls.__dataclass_fields__, *others])
            if name in others and value not in (None, usual.get(name), {"kind": usual.get(name)}):
                raise ConfigError(
                    f"{name} is not for the maze task, which has one sensor, motion, filter and "
                    f"reward; got {value!r}"
                )
        task = settings.get("task")
        spec = settings.get("map")
        config = cls(
            build(MazeTask, {"kind": task} if isinstance(task, str) else task, "task"),
            MapSource.parse("maze(size=15):*" if spec is None else spec),
            build(MazeObservation, settings.get("observation"), "observation"),
        )
        _ = config.size
        return config

    @property
    def size(self) -> int:
        """m, cells along a side.

        Raises:
            ConfigError: If the maps are no mazes of one size.
        """
        if isinstance(self.map.generator, Maze):
            return self.map.generator.size
        if self.map.grid is None or len({*self.map.grid.shape}) != 1:
            raise ConfigError(
                f"map {self.map.spec!r} is not for the maze task; expected maze(size=15):*, or a "
                "map with as many rows as columns"
            )
        check_mazes(self.map.grid.free[None], 1, self.map.grid.shape[0])
        return self.map.grid.shape[0]

    @property
    def actions(self) -> Actions:
        """Turn left, turn right, one cell forward."""
        return ACTIONS
