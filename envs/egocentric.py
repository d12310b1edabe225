"""What a policy sees of a maze: the belief in the maze's frame, and the view from the robot.

The world frame shows where the robot may be; the egocentric view
(:mod:`activeloc.beliefs.egocentric`) shows what may be around it, in a shape that depends neither
on the maze's size nor on where north is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

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

    def space(self, size: int) -> gym.spaces.Dict:
        """The observation space of one robot in a maze of ``size`` x ``size`` cells."""
        shapes: dict[str, tuple[int, ...]] = {
            "belief": (4, size, size),
            "map": (size, size),
            "depth": (1,),
        }
        if self.time:
            shapes["time"] = (1,)
        if self.view:
            side = 2 * self.radius + 1
            shapes["view"] = (PLANES, side, side)
        return gym.spaces.Dict(
            {name: gym.spaces.Box(0.0, 1.0, shape, np.float32) for name, shape in shapes.items()}
        )


def observe_mazes(
    planes: NDArray[np.float32],
    maps: NDArray[np.float32],
    view: NDArray[np.float32] | None,
    reading: NDArray[np.int32],
    steps: NDArray[np.int64] | None,
) -> dict[str, NDArray[Any]]:
    """The observations of a batch: arrays of float32 with a leading axis of B, new but the first.

    Args:
        planes: ``(B, 4, m, m)``; p / max p.
        maps: ``(B, m, m)``; 1 where a cell is free.
        view: ``(B, 5, 2 r + 1, 2 r + 1)``; the egocentric view; None to leave it out.
        reading: ``(B,)``; last depths read, less one.
        steps: ``(B,)``; steps taken; None to leave the clock out.

    Returns:
        ``belief`` ``(B, 4, m, m)``: p / max p by heading, row, column. ``map`` ``(B, m, m)``: 1
        where a cell is free. ``depth`` ``(B, 1)``: reading / 19, at most 1. ``time`` ``(B, 1)``:
        steps / 100, at most 1. ``view`` ``(B, 5, 2 r + 1, 2 r + 1)``.
    """
    observation = {
        "belief": planes,
        "map": maps.copy(),
        "depth": _share(reading[:, None] + 1, FAR),
    }
    if steps is not None:
        observation["time"] = _share(steps[:, None], LONG)
    if view is not None:
        observation["view"] = view.copy()
    return observation


def _share(count: NDArray[Any], most: int) -> NDArray[np.float32]:
    """Counts over the largest, at most 1."""
    return np.minimum(count, most).astype(np.float32) / np.float32(most)
