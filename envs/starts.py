"""Where episodes on metric maps begin: maps and poses that are drawn, or that a caller gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.configuration import unknown
from activeloc.envs.tasks import Task
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.simulator import Simulator, checked_pose

RESET_OPTIONS = ("map", "grid", "pose", "kidnap_pose")


def draw_map(
    source: MapSource, task: Task, rng: np.random.Generator, options: Mapping[str, Any]
) -> OccupancyGrid:
    """The map of an episode.

    Args:
        source: Where the maps come from.
        task: The problem.
        rng: Source of what is drawn.
        options: See :meth:`activeloc.envs.episodes.Episodes.reset`.

    Raises:
        ConfigError: If an option is unknown or not for this task.
        MapError: If the map cannot be read.
    """
    for name in options:
        if name not in RESET_OPTIONS:
            raise unknown("reset options", name, RESET_OPTIONS)
    if options.get("kidnap_pose") is not None and task.kind != "kidnapped":
        raise ConfigError(
            f"reset options: kidnap_pose is for a kidnapped robot; the task is {task.kind!r}"
        )
    if "map" in options:
        source = MapSource.parse(options["map"])
    grid = source.draw(rng)
    if options.get("grid") is not None:
        grid = options["grid"]
    if not isinstance(grid, OccupancyGrid):
        raise ConfigError(f"reset options: grid must be an OccupancyGrid; got {type(grid)}")
    return grid


def draw_kidnapping(
    simulator: Simulator,
    robot: int,
    task: Task,
    rng: np.random.Generator,
    options: Mapping[str, Any],
) -> tuple[int, NDArray[np.float64], bool]:
    """When a robot is carried off, where to ``(3,)``, and whether a caller has said so.

    Raises:
        MapError: If the robot cannot be there.
    """
    step = task.kidnap_step(rng)
    terrain = simulator.terrain(robot)
    drawn = terrain.uniform_poses(rng.random((1, 4)))[0]
    given = options.get("kidnap_pose")
    if given is None:
        return step, drawn, False
    return step, checked_pose(terrain, given, "kidnap_pose"), True
