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

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import expected_range, rays_of


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

    def _redrawn(self, robot: int, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """The robot's pose ``(n, 3)``, drawn anew within its state for each of ``(n, 4)``."""
        poses = np.repeat(self.poses[robot : robot + 1], len(uniforms), axis=0)
        if self.redraw is None:
            return poses
        grid = _pose_grid(self._grid(robot), self.motion.radius, *self.redraw)
        cell, heading = grid.states_of(poses)
        return grid.sample_in(cell, heading, uniforms)

    def step(
        self, robot: int, command: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Carry a command out.

        Args:
            robot: Which one.
            command: ``(3,)`` of rotation [rad], translation [m], rotation [rad].
            rng: Source of the noise.

        Returns:
            The odometry's reading ``(3,)``.
        """
        normals, uniforms = rng.standard_normal((2, 1, 3)), rng.random((1, 4))
        terrain = self.terrain(robot)
        start = self._redrawn(robot, uniforms)
        reached, carried_out = self.motion.execute(terrain, start, command, normals[0])
        self.poses[robot] = reached[0]
        u = self.motion.read_odometry(carried_out, normals[1])
        if self.motion.blunder > 0.0:
            u = self.motion.misread(u, np.asarray(command), rng.random((1, 5)))
        return u[0]

    def scan(self, robot: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """What the sensor reads: ``(B,)`` [m]."""
        bearings = self.sensor.bearings
        uniforms, redraw = rng.random((len(bearings), 2)), rng.random((len(bearings), 4))
        if self.redraw is None:
            rays = rays_of(self.poses[robot], bearings)
        else:
            rays = self._redrawn(robot, redraw)
            rays[:, 2] += bearings
        readings = self.sensor.read(self._grid(robot), rays, uniforms)
        if self.people == 0.0:
            return readings
        meets, where = rng.random((len(bearings), 2)).T
        person = where * expected_range(self.sensor, self._grid(robot), rays)
        return np.where(meets < self.people, person, readings)
