"""The motion model: how a robot obeys a command, and how well it knows what it did."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.motion.driving import drive_and_read, move
from activeloc.motion.noise import MotionNoise
from activeloc.motion.terrain import Terrain

# A blunder of the odometry strays from the command's heading by up to this [rad].
BLUNDER_ANGLE = float(np.deg2rad(30.0))
# What filters make of a blunder: off by up to this [rad], and by up to this, stuck or not [m].
SLIP_ANGLE = float(np.deg2rad(45.0))
SLIP_TRAVEL = 0.5


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
        commands: NDArray[np.float64],
        normals: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Carry commands out, and say what the odometry makes of it.

        Args:
            terrain: Where the robot can be.
            poses: ``(N, 3)``.
            commands: ``(N, 3)``.
            normals: ``(N, 2, 3)`` of standard normal numbers: of the motion, of the odometry.

        Returns:
            Poses reached and the odometry's readings, ``(N, 3)`` each.
        """
        reached, read = np.empty_like(poses), np.empty_like(poses)
        drive_and_read(
            terrain.squares, terrain.frame, poses, commands, normals,
            self.actuation.coefficients, self.odometry.coefficients, reached, read,
        )  # fmt: skip
        return reached, read

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
        result: NDArray[np.bool_] = read < self.contact_ratio * wanted  # Never where it is 0.
        return result
