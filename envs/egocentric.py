"""What a policy sees of a maze: the belief in the maze's frame, and the view from the robot.

The world frame shows where the robot may be; the egocentric view
(:mod:`activeloc.beliefs.egocentric`) shows what may be around it, in a shape that depends neither
on the maze's size nor on where north is.
"""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from activeloc import checks
from activeloc.beliefs.egocentric import PLANES

FAR = 19
"""A depth of this many cells, the longest of a 21 x 21 maze, is shown as 1; so are longer ones."""
LONG = 100
"""Steps after which the clock shows 1."""


@dataclass(frozen=True, slots=True)
class MazeObservation:
    """What is observed of a maze.

    Attributes:
        view: Whether the egocentric view is in it. It costs more than the rest of a step.
        radius: r of its window [cell].
        time: Whether the clock is in it. A policy that does not see it goes on as well in a longer
            episode.

    Raises:
        ConfigError: If a value is out of its range.
    """

    view: bool = False
    radius: int = 9
    time: bool = True

    def __post_init__(self) -> None:
        checks.boolean("observation.view", self.view)
        checks.integer("observation.radius", self.radius, 1, 100)
        checks.boolean("observation.time", self.time)

    def shapes(self, size: int) -> dict[str, tuple[int, ...]]:
        """What is observed of one robot in a maze of ``size`` x ``size`` cells, and its shape.

        ``belief`` ``(4, m, m)``: p / max p by heading, row, column. ``map`` ``(m, m)``: 1 where a
        cell is free. ``depth`` ``(1,)``: the last reading / 19, at most 1. ``time`` ``(1,)``: steps
        / 100, at most 1. ``view`` ``(5, 2 r + 1, 2 r + 1)``:
        :mod:`activeloc.beliefs.egocentric`.
        """
        side = 2 * self.radius + 1
        shapes: dict[str, tuple[int, ...]] = {
            "belief": (4, size, size),
            "map": (size, size),
            "depth": (1,),
        }
        if self.time:
            shapes["time"] = (1,)
        if self.view:
            shapes["view"] = (PLANES, side, side)
        return shapes

    def space(self, size: int) -> gym.spaces.Dict:
        """The observation space of one robot in a maze of ``size`` x ``size`` cells."""
        return gym.spaces.Dict(
            {
                name: gym.spaces.Box(0.0, 1.0, shape, np.float32)
                for name, shape in self.shapes(size).items()
            }
        )
