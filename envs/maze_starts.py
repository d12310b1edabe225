"""Where episodes in mazes begin: drawn mazes, and mazes and poses that a caller gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.lattice import check_mazes
from activeloc.configuration import unknown
from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.maps.maze import Maze

RESET_OPTIONS = ("map", "grid", "pose")
NOWHERE = (-1, -1, -1)
"""The pose that stands for one to be drawn."""


def draw_starts(
    source: MapSource,
    rngs: Sequence[np.random.Generator],
    options: Mapping[str, Any],
    size: int,
) -> tuple[NDArray[np.bool_], Sequence[str], tuple[int, int, int]]:
    """Free cells ``(n, m, m)`` and names of mazes, and the pose to start at.

    Args:
        source: Where the mazes come from.
        rngs: One for each of n robots.
        options: See :meth:`activeloc.envs.maze_episodes.MazeEpisodes.reset`.
        size: m.

    Raises:
        ConfigError: If an option is unknown.
        MapError: If a maze is of another size, or the robot cannot be at the pose.
    """
    for name in options:
        if name not in RESET_OPTIONS:
            raise unknown("reset options", name, RESET_OPTIONS)
    if "map" in options:
        source = MapSource.parse(options["map"])
    free, names = _draw(source, rngs)
    if options.get("grid") is not None:
        given, name = free_cells(options["grid"])
        free = np.stack([given] * len(rngs))
        names = [name or own for own in names]
    check_mazes(free, len(rngs), size)
    return free, names, checked_pose(options.get("pose"), free) or NOWHERE


def _draw(
    source: MapSource, rngs: Sequence[np.random.Generator]
) -> tuple[NDArray[np.bool_], Sequence[str]]:
    """Mazes' free cells and names; those of endless mazes are drawn without a number."""
    if isinstance(source.generator, Maze) and source.n_maps is None:
        return source.generator.draw_each(rngs) == 0, ["maze"] * len(rngs)
    grids = [source.draw(rng) for rng in rngs]
    if len({grid.shape for grid in grids}) > 1:
        shapes = " and ".join(str(shape) for shape in sorted({grid.shape for grid in grids}))
        raise MapError(f"mazes must be of one size; got {shapes}")
    return np.stack([grid.free for grid in grids]), [grid.name for grid in grids]


def free_cells(maze: object) -> tuple[NDArray[np.bool_], str]:
    """Free cells ``(m, m)`` and name of a maze that a caller gives.

    Args:
        maze: A map, or bools, true for walls or for free cells: the rim, which is wall, says which.

    Raises:
        MapError: If it is neither, or the rim is not of one kind.
    """
    if isinstance(maze, OccupancyGrid):
        return maze.free, maze.name
    cells = np.asarray(maze)
    if cells.dtype != np.bool_ or cells.ndim != 2 or cells.size == 0:
        raise MapError(
            f"a maze must be an OccupancyGrid or bools (m, m); got {cells.dtype} of shape "
            f"{cells.shape}"
        )
    wall = cells[0, 0]
    if not ((cells[[0, -1]] == wall).all() and (cells[:, [0, -1]] == wall).all()):
        raise MapError("a maze must have walls along its rim; the rim is partly true, partly false")
    return cells != wall, "given"


def checked_pose(pose: object, free: NDArray[np.bool_]) -> tuple[int, int, int] | None:
    """Row, column and heading as integers; None where none is given.

    Args:
        pose: What a caller gave.
        free: ``(n, m, m)``; the mazes that the pose must be a free cell of.

    Raises:
        MapError: If it is no place in one of them.
    """
    if pose is None:
        return None
    try:
        given = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape != (3,):
        raise MapError(f"pose must be three numbers: row, column, heading; got {pose!r}")
    if not np.isfinite(given).all() or (given != np.round(given)).any():
        raise MapError(f"pose must be three finite whole numbers; got {pose!r}")
    row, col, heading = (int(value) for value in given)
    size = free.shape[1]
    inside = 0 <= row < size and 0 <= col < size and 0 <= heading < 4
    if not (inside and free[:, row, col].all()):
        raise MapError(
            f"pose: ({row}, {col}, {heading}) is in an obstacle or outside of the map; expected "
            f"row and column of a free cell of {size} x {size} and a heading 0 to 3"
        )
    return row, col, heading
