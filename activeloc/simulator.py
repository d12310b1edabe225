"""The true robots: they sample the very models that the filters use.

In the *continuous* world a robot stands at a pose and stays where it is. The *discrete* world is
the histogram filter's own assumption made true: before every motion and every beam the robot's
place inside its cell and its heading inside its bin are drawn anew. There a filter must be
calibrated whatever the map; where it is not, the filter is wrong and not its assumptions.

*People* who are on no map may stand in the way, in either world: each beam meets one with a given
probability, whatever the other beams meet and whatever it met before. A beam that does reads where
the person stands, uniform between the robot and the range that the map alone would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import expected_range


@lru_cache(maxsize=32)
def terrain_of(grid: OccupancyGrid, radius: float) -> Terrain:
    """The terrain of a map, kept for the 32 maps used last."""
    return Terrain(grid, radius)


@lru_cache(maxsize=8)
def _pose_grid(grid: OccupancyGrid, radius: float, cell_size: float, headings: int) -> PoseGrid:
    return PoseGrid(terrain_of(grid, radius), cell_size, headings)


def checked_pose(terrain: Terrain, pose: object, name: str = "pose") -> NDArray[np.float64]:
    """A pose that somebody gave: ``(3,)``, theta in [-pi, pi).

    Args:
        terrain: Where the robot can be.
        pose: What was given.
        name: Its name, for messages.

    Raises:
        MapError: If it is no pose, or not one where the robot can be.
    """
    try:
        given = np.array(pose, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (3,) or not np.isfinite(given).all():
        raise MapError(f"{name} must be three finite numbers x, y, theta; got {pose!r}")
    if not bool(terrain.contains(given)):
        raise MapError(
            f"{name} ({given[0]:g}, {given[1]:g}) m on {terrain.grid.name} is in or too near an "
            f"obstacle for a robot of radius {terrain.radius:g} m, or cut off"
        )
    given[2] = wrap(given[2])
    return given


class Simulator:
    """B robots, each on its own map.

    Every step draws the same amount of noise whatever the robot does, so that two agents given one
    seed meet the same luck.

    Args:
        n_robots: B.
        sensor: The true sensor.
        motion: The true motion model.
        redraw: Cell size [m] and number of headings of the discrete world; None for the continuous.
        people: Probability that a beam is cut short by somebody who is not on the map.

    Raises:
        ConfigError: If ``people`` is no probability.
    """

    def __init__(
        self,
        n_robots: int,
        sensor: RangeSensor,
        motion: MotionModel,
        redraw: tuple[float, int] | None = None,
        people: float = 0.0,
    ) -> None:
        checks.number("people", people, 0.0, 1.0)
        self.people = people
        self.sensor = sensor
        self.motion = motion
        self.redraw = redraw
        self.poses = np.zeros((n_robots, 3))
        self.grids: list[OccupancyGrid | None] = [None] * n_robots

    def place(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        pose: NDArray[np.float64] | None = None,
    ) -> None:
        """Put a robot on a map.

        Args:
            robot: Which one.
            grid: The map.
            rng: Source of a pose uniform over the open ground.
            pose: ``(3,)``, instead of a drawn one.

        Raises:
            MapError: If the pose is not one where the robot can be.
        """
        terrain = terrain_of(grid, self.motion.radius)
        drawn = terrain.uniform_poses(rng.random((1, 4)))[0]
        self.poses[robot] = drawn if pose is None else checked_pose(terrain, pose)
        self.grids[robot] = grid

    def terrain(self, robot: int) -> Terrain:
        """Where a robot can be."""
        return terrain_of(self._grid(robot), self.motion.radius)

    def _grid(self, robot: int) -> OccupancyGrid:
        grid = self.grids[robot]
        if grid is None:
            raise MapError(f"robot {robot} has not been placed on a map")
        return grid

    def _by_map(self, robots: NDArray[np.intp]) -> list[Any]:
        """Places in ``robots`` ``(n,)``, those on one map together; each as an index."""
        maps: dict[int, list[int]] = {}
        for i, robot in enumerate(robots.tolist()):
            maps.setdefault(id(self._grid(robot)), []).append(i)
        if len(maps) == 1:
            return [slice(None)]
        return [np.array(places) for places in maps.values()]

    def _redrawn(
        self, robots: NDArray[np.intp], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Poses ``(n, m, 3)`` of robots on one map, drawn anew within their states.

        Args:
            robots: ``(n,)``.
            uniforms: ``(n, m, 4)``.
        """
        m = uniforms.shape[1]
        if self.redraw is None:
            poses = np.empty((len(robots), m, 3))
            poses[:] = self.poses[robots][:, None]
            return poses
        grid = self._grid(int(robots[0]))
        states = _pose_grid(grid, self.motion.radius, *self.redraw)
        poses = np.repeat(self.poses[robots], m, axis=0)
        poses = states.sample_in(*states.states_of(poses), uniforms.reshape(-1, 4))
        return poses.reshape(len(robots), m, 3)

    def step(
        self, robot: int, command: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """:meth:`step_some` for one robot: ``(3,)``."""
        return self.step_some(np.array([robot]), np.asarray(command)[None], [rng])[0]

    def step_some(
        self,
        robots: NDArray[np.intp],
        commands: NDArray[np.float64],
        rngs: Sequence[np.random.Generator],
    ) -> NDArray[np.float64]:
        """Carry out commands.

        Args:
            robots: ``(n,)``; which.
            commands: ``(n, 3)`` of rotation [rad], translation [m], rotation [rad].
            rngs: Source of each robot's noise.

        Returns:
            The odometries' readings ``(n, 3)``.
        """
        n, blundering = len(robots), self.motion.blunder > 0.0
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        normals, uniforms, blunders = np.empty((n, 2, 3)), np.empty((n, 1, 4)), np.empty((n, 5))
        for i, rng in enumerate(rngs):
            rng.standard_normal(out=normals[i])
            rng.random(out=uniforms[i])
            if blundering:
                rng.random(out=blunders[i])
        u = np.empty((n, 3))
        for at in self._by_map(robots):
            here = robots[at]
            start = self._redrawn(here, uniforms[at])[:, 0]
            self.poses[here], u[at] = self.motion.execute(
                self.terrain(int(here[0])), start, commands[at], normals[at]
            )
        return self.motion.misread(u, commands, blunders) if blundering else u

    def scan(self, robot: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """:meth:`scan_some` for one robot: ``(B,)`` [m]."""
        return self.scan_some(np.array([robot]), [rng])[0]

    def scan_some(
        self, robots: NDArray[np.intp], rngs: Sequence[np.random.Generator]
    ) -> NDArray[np.float64]:
        """What the sensors of robots ``(n,)`` read, each with its own noise: ``(n, B)`` [m]."""
        bearings = self.sensor.bearings
        shape = (len(robots), len(bearings))
        uniforms, redraw = np.empty((*shape, 2)), np.empty((*shape, 4))
        people, readings = np.empty((*shape, 2)), np.empty(shape)
        for i, rng in enumerate(rngs):
            rng.random(out=uniforms[i])
            rng.random(out=redraw[i])
            if self.people > 0.0:
                rng.random(out=people[i])
        for at in self._by_map(robots):
            here = robots[at]
            grid = self._grid(int(here[0]))
            rays = self._redrawn(here, redraw[at])
            rays[..., 2] += bearings
            readings[at] = self.sensor.read(grid, rays, uniforms[at])
            if self.people > 0.0:
                meets, where = people[at, :, 0], people[at, :, 1]
                person = where * expected_range(self.sensor, grid, rays)
                readings[at] = np.where(meets < self.people, person, readings[at])
        return readings
