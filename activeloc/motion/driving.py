"""A robot drives until it is done or an obstacle stops it: kernels, without noise."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.motion.noise import fill_sigmas
from activeloc.motion.terrain import Terrain
from activeloc.raycast import cast_ray

# A robot stops this far before the square that it touches [cell], and so never stands on its edge.
MARGIN = 1e-6


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


@njit(cache=True, nogil=True)
def drive_and_read(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    commands: NDArray[np.float64],
    normals: NDArray[np.float64],
    actuation: tuple[float, float, float, float],
    odometry: tuple[float, float, float, float],
    reached: NDArray[np.float64],
    read: NDArray[np.float64],
) -> None:
    """:func:`drive` as commands say, with the actuation's noise, and read the odometry.

    Args:
        squares: See :func:`free_way`.
        frame: x and y of the map's corner, and its resolution [m].
        poses: ``(N, 3)``.
        commands: ``(N, 3)``.
        normals: ``(N, 2, 3)`` of standard normal numbers: of the actuation, of the odometry.
        actuation: The four coefficients of its noise.
        odometry: Likewise.
        reached: ``(N, 3)``, overwritten.
        read: ``(N, 3)``, overwritten with the odometry's readings.
    """
    wanted, done = np.empty_like(commands), np.empty_like(commands)
    fill_sigmas(commands, actuation[0], actuation[1], actuation[2], actuation[3], wanted)
    for i in range(commands.shape[0]):
        for j in range(3):
            wanted[i, j] = commands[i, j] + normals[i, 0, j] * wanted[i, j]
    drive(squares, frame, poses, wanted, reached, done)
    fill_sigmas(done, odometry[0], odometry[1], odometry[2], odometry[3], read)
    for i in range(commands.shape[0]):
        for j in range(3):
            read[i, j] = done[i, j] + normals[i, 1, j] * read[i, j]


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
