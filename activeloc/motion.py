"""Motion: what a command or an odometry reading does to a pose.

A motion is a rotation, a translation and a second rotation ``(rot1 [rad], trans [m], rot2 [rad])``.
The robot carries a command out with *actuation* noise and is stopped where its disc touches an
obstacle; its *odometry* then reads what was carried out, with noise of its own. Filters never see
the command: their control u is the odometry's reading, so a robot stuck at a wall is known to be
stuck. One kernel, :func:`drive`, moves the simulated robot and every hypothesis of every filter.

Noise comes in as standard normal numbers; nothing here draws any.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from math import hypot

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.free_squares import free_squares
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_ray

# A robot stops this far before the square that it touches [cell], and so never stands on its edge.
MARGIN = 1e-6

# A blunder of the odometry strays from the command's heading by up to this [rad].
BLUNDER_ANGLE = float(np.deg2rad(30.0))
# What filters make of a blunder: off by up to this [rad], and by up to this, stuck or not [m].
SLIP_ANGLE = float(np.deg2rad(45.0))
SLIP_TRAVEL = 0.5


def wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles in ``[-pi, pi)`` [rad]."""
    result: NDArray[np.float64] = (np.asarray(angle) + np.pi) % (2.0 * np.pi) - np.pi
    # Just under -pi the remainder is rounded up to the full circle.
    return np.where(result >= np.pi, -np.pi, result)


@njit(cache=True, nogil=True)
def fill_sigmas(
    u: NDArray[np.float64],
    rotation_from_rotation: float,
    rotation_from_translation: float,
    translation_from_translation: float,
    translation_from_rotation: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (N, 3)`` with the standard deviations of motions ``(N, 3)``."""
    for i in range(u.shape[0]):
        by_travel = rotation_from_translation * u[i, 1]
        out[i, 0] = hypot(rotation_from_rotation * u[i, 0], by_travel)
        out[i, 1] = hypot(
            translation_from_translation * u[i, 1],
            translation_from_rotation * hypot(u[i, 0], u[i, 2]),
        )
        out[i, 2] = hypot(rotation_from_rotation * u[i, 2], by_travel)


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """How far a motion strays: four coefficients, each a standard deviation per unit of motion.

    The odometry model of Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), table 5.6; the
    squares of the fields are the book's alpha_1 ... alpha_4, in its order. The two contributions
    to one motion add up in variance.

    Attributes:
        rotation_from_rotation: Of a rotation, per radian rotated [rad / rad].
        rotation_from_translation: Of each rotation, per metre travelled [rad / m].
        translation_from_translation: Of the translation, per metre travelled [m / m].
        translation_from_rotation: Of the translation, per radian rotated [m / rad].

    Raises:
        ConfigError: If a coefficient is not a number in [0, 10].
    """

    rotation_from_rotation: float = 0.0
    rotation_from_translation: float = 0.0
    translation_from_translation: float = 0.0
    translation_from_rotation: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            checks.number(f"{type(self).__name__}.{item.name}", getattr(self, item.name), 0.0, 10.0)

    def sigma(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviations of the three parts of motions ``(..., 3)``: an array like ``u``."""
        if np.shape(u) == (3,):  # The same without numpy's overhead, which is felt at every step.
            return np.array(self._sigmas(float(u[0]), float(u[1]), float(u[2])))
        u = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty_like(u)
        fill_sigmas(
            u.reshape(-1, 3), self.rotation_from_rotation, self.rotation_from_translation,
            self.translation_from_translation, self.translation_from_rotation, out.reshape(-1, 3),
        )  # fmt: skip
        return out

    def _sigmas(self, rot1: float, trans: float, rot2: float) -> tuple[float, float, float]:
        by_travel = self.rotation_from_translation * trans
        return (
            hypot(self.rotation_from_rotation * rot1, by_travel),
            hypot(
                self.translation_from_translation * trans,
                self.translation_from_rotation * hypot(rot1, rot2),
            ),
            hypot(self.rotation_from_rotation * rot2, by_travel),
        )


class Terrain:
    """Where the centre of a round robot can be on a map: its configuration space.

    A cell of the map is open to the centre when the disc around the cell's centre touches no
    blocked square (:attr:`OccupancyGrid.clearance`) and the cell belongs to the largest connected
    part. Motions are rays through the open cells, so thin walls are never jumped.

    Args:
        grid: The map.
        radius: Of the robot [m].

    Raises:
        MapError: If the robot fits nowhere.
    """

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        self.grid = grid
        self.radius = radius
        self.open = grid.passable(radius)
        self.blocked = ~self.open
        self.frame = grid.frame

    @cached_property
    def open_cells(self) -> NDArray[np.intp]:
        """``(N, 2)`` of row and column of every open cell."""
        return np.argwhere(self.open)

    @cached_property
    def squares(self) -> NDArray[np.uint8]:
        """``(4, H + 2, W + 2)``; see :func:`activeloc.free_squares.free_squares`, of open cells."""
        return free_squares(self.blocked)

    @property
    def area(self) -> float:
        """Open area [m^2]."""
        return len(self.open_cells) * self.grid.resolution**2

    def contains(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each pose ``(..., 3)`` is in an open cell of the map."""
        column_row = self.grid.to_cells(np.asarray(poses)[..., :2])
        inside = np.isfinite(column_row).all(axis=-1)
        col, row = np.moveaxis(np.floor(np.where(np.isfinite(column_row), column_row, -1.0)), -1, 0)
        height, width = self.grid.shape
        inside &= (row >= 0) & (row < height) & (col >= 0) & (col < width)
        row, col = (
            np.where(inside, row, 0).astype(np.intp),
            np.where(inside, col, 0).astype(np.intp),
        )
        result: NDArray[np.bool_] = inside & self.open[row, col]
        return result

    def uniform_poses(self, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses uniform over the open area and all headings.

        Args:
            uniforms: ``(..., 4)`` in [0, 1): cell, place in the cell (two), heading.

        Returns:
            ``(..., 3)``.
        """
        uniforms = np.asarray(uniforms)
        chosen = self.open_cells[(uniforms[..., 0] * len(self.open_cells)).astype(np.intp)]
        column_row = chosen[..., ::-1] + uniforms[..., 1:3]
        theta = wrap(2.0 * np.pi * uniforms[..., 3:4])
        return np.concatenate([self.grid.to_metres(column_row), theta], axis=-1)


@njit(cache=True, nogil=True)
def free_way(
    squares: NDArray[np.uint8], col: float, row: float, dx: float, dy: float, wanted: float
) -> float:
    """How far a robot gets on a way of ``wanted`` [cell]; no ray is cast where there is room.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        col: Where it stands [cell].
        row: [cell].
        dx: Unit heading along the columns.
        dy: Unit heading along the rows.
        wanted: [cell].
    """
    if abs(dx) >= 1e-14 and abs(dy) >= 1e-14 and col >= 0.0 and row >= 0.0:
        c, r = int(col), int(row)
        if r < squares.shape[1] - 2 and c < squares.shape[2] - 2:
            quadrant = (0 if dx > 0.0 else 1) + (0 if dy > 0.0 else 2)
            # Wherever in the cell it stands, it stays within the square.
            if squares[quadrant, r + 1, c + 1] - 1.0 > wanted + 2.0 * MARGIN:
                return wanted
    reach = cast_ray(squares, col, row, dx, dy, wanted + 2.0 * MARGIN) - MARGIN
    return max(0.0, min(wanted, reach))


@njit(cache=True, nogil=True)
def drive(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    motions: NDArray[np.float64],
    reached: NDArray[np.float64],
    carried_out: NDArray[np.float64],
) -> None:
    """Rotate, travel until done or stopped by an obstacle, rotate.

    Args:
        squares: See :func:`free_way`.
        frame: x and y of the map's corner, and its resolution [m].
        poses: ``(N, 3)`` of x, y [m] and heading.
        motions: ``(N, 3)`` of first rotation, translation (backwards if negative), second rotation.
        reached: ``(N, 3)``, overwritten; headings are in [-pi, pi).
        carried_out: ``(N, 3)``, overwritten with the motions, their translations those achieved.
    """
    resolution, per_cell = frame[2], 1.0 / frame[2]
    for i in range(poses.shape[0]):
        col = (poses[i, 0] - frame[0]) / resolution
        row = (poses[i, 1] - frame[1]) / resolution
        heading = poses[i, 2] + motions[i, 0]
        sign = 1.0 if motions[i, 1] >= 0.0 else -1.0
        dx, dy = sign * np.cos(heading), sign * np.sin(heading)
        length = free_way(squares, col, row, dx, dy, abs(motions[i, 1] * per_cell))
        reached[i, 0] = (col + length * dx) * resolution + frame[0]
        reached[i, 1] = (row + length * dy) * resolution + frame[1]
        theta = (heading + motions[i, 2] + np.pi) % (2.0 * np.pi) - np.pi
        reached[i, 2] = -np.pi if theta >= np.pi else theta
        carried_out[i, 0], carried_out[i, 2] = motions[i, 0], motions[i, 2]
        carried_out[i, 1] = sign * length * resolution


def move(
    terrain: Terrain, poses: NDArray[np.float64], motions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """:func:`drive` without noise, into new arrays.

    Args:
        terrain: Where the robot can be.
        poses: ``(N, 3)``.
        motions: ``(N, 3)``, or ``(3,)`` for all.

    Returns:
        Poses reached ``(N, 3)``, theta in [-pi, pi), and the motions carried out ``(N, 3)``.
    """
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    given = np.asarray(motions, dtype=np.float64)
    if given.shape != poses.shape:
        given = np.broadcast_to(given, poses.shape)
    reached, carried_out = np.empty_like(poses), np.empty_like(poses)
    drive(terrain.squares, terrain.frame, poses, np.ascontiguousarray(given), reached, carried_out)
    return reached, carried_out


@njit(cache=True, nogil=True)
def slipped(u: NDArray[np.float64], turn: float, travel: float) -> tuple[float, float]:
    """First rotation and translation that a badly wrong odometry reading may stand for.

    The filters' answer to :meth:`MotionModel.misread`, and as rough as what it answers: the first
    rotation within 45 degrees of the one read, the travel anywhere from nothing to twice the one
    read or half a metre, the longer of the two; nothing if none was read.

    Args:
        u: ``(3,)`` odometry reading.
        turn: In [0, 1).
        travel: In [0, 1).
    """
    farthest = np.sign(u[1]) * max(2.0 * abs(u[1]), SLIP_TRAVEL)
    return u[0] + (2.0 * turn - 1.0) * SLIP_ANGLE, travel * farthest


@dataclass(frozen=True, slots=True)
class MotionModel:
    """The robot's body: its size, how it obeys, how well it knows what it did.

    Attributes:
        actuation: Noise between a command and the motion carried out.
        odometry: Noise between the motion carried out and the odometry's reading; to a filter, the
            noise of p(x' | u, x, m). The defaults are 4 degrees in a turn of 30, and 5 % and
            2 degrees of heading in half a metre.
        radius: Of the robot's disc [m].
        contact_ratio: A translation read as less than this share of the command was stopped by an
            obstacle.
        blunder: Probability that a step's odometry reading is badly wrong (:meth:`misread`). Only
            the simulated robot blunders; no filter reckons with it.

    Raises:
        ConfigError: If a number is out of its range.
    """

    actuation: MotionNoise = field(
        default_factory=lambda: MotionNoise(2.0 / 30.0, np.deg2rad(1.0) / 0.5 / np.sqrt(2.0), 0.02)
    )
    odometry: MotionNoise = field(
        default_factory=lambda: MotionNoise(4.0 / 30.0, np.deg2rad(2.0) / 0.5 / np.sqrt(2.0), 0.05)
    )
    radius: float = 0.2
    contact_ratio: float = 0.7
    blunder: float = 0.0

    def __post_init__(self) -> None:
        for name in ("actuation", "odometry"):
            if not isinstance(getattr(self, name), MotionNoise):
                raise ConfigError(
                    f"MotionModel.{name} must be a MotionNoise or a mapping of its fields; "
                    f"got {getattr(self, name)!r}"
                )
        checks.number("MotionModel.radius", self.radius, 0.0, 100.0)
        checks.number("MotionModel.contact_ratio", self.contact_ratio, 0.0, 1.0)
        checks.number("MotionModel.blunder", self.blunder, 0.0, 1.0)

    def execute(
        self,
        terrain: Terrain,
        poses: NDArray[np.float64],
        command: NDArray[np.float64],
        normals: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Carry a command out.

        Args:
            terrain: Where the robot can be.
            poses: ``(N, 3)``.
            command: ``(N, 3)`` or ``(3,)``.
            normals: ``(N, 3)`` of standard normal numbers.

        Returns:
            Poses reached and the motions carried out, ``(N, 3)`` each.
        """
        return move(terrain, poses, command + normals * self.actuation.sigma(command))

    def read_odometry(
        self, carried_out: NDArray[np.float64], normals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """What the odometry says of motions ``(N, 3)``: an array like them."""
        result: NDArray[np.float64] = carried_out + normals * self.odometry.sigma(carried_out)
        return result

    def misread(
        self,
        u: NDArray[np.float64],
        command: NDArray[np.float64],
        uniforms: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Odometry readings, each replaced by a badly wrong one with probability ``blunder``.

        Slipping wheels know what they were told, not what came of it: each part of the wrong
        reading is the command's, scaled by a factor uniform in [0, 2), and the first rotation is
        off by an angle uniform within 30 degrees on top. So a robot stuck at a wall may read a
        full drive, and one that drives none at all.

        Args:
            u: Readings ``(N, 3)`` as they would be.
            command: ``(N, 3)`` or ``(3,)``.
            uniforms: ``(N, 5)`` in [0, 1): whether, the three factors, the angle.

        Returns:
            ``(N, 3)``.
        """
        wrong = 2.0 * uniforms[:, 1:4] * command
        wrong[:, 0] += (2.0 * uniforms[:, 4] - 1.0) * BLUNDER_ANGLE
        result: NDArray[np.float64] = np.where(uniforms[:, :1] < self.blunder, wrong, u)
        return result

    def sample(
        self,
        terrain: Terrain,
        poses: NDArray[np.float64],
        u: NDArray[np.float64],
        normals: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw x' ~ p(x' | u, x, m): one successor of each pose, given the odometry's reading.

        Args:
            terrain: Where the robot can be.
            poses: ``(N, 3)``.
            u: Odometry reading, ``(3,)`` or ``(N, 3)``.
            normals: ``(N, 3)`` of standard normal numbers.

        Returns:
            Successors ``(N, 3)``, and ``(N,)`` how much an obstacle cut the way short [m]: where
            it did, the pose could not have made the motion that was read.
        """
        u = np.asarray(u, dtype=np.float64)
        wanted = np.broadcast_to(u + normals * self.odometry.sigma(u), poses.shape)
        reached, carried_out = move(terrain, poses, wanted)
        shortfall: NDArray[np.float64] = np.abs(wanted[:, 1]) - np.abs(carried_out[:, 1])
        return reached, shortfall

    def touched(self, command: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the robot knows that an obstacle stopped it: ``(...)`` for ``(..., 3)``.

        True when the odometry read less than ``contact_ratio`` of the commanded translation.
        """
        wanted, read = np.abs(command[..., 1]), np.abs(u[..., 1])
        result: NDArray[np.bool_] = (wanted > 0.0) & (read < self.contact_ratio * wanted)
        return result
