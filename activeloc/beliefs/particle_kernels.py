"""Kernels of the particle filter, for one robot.

A cloud is ``poses[i]`` = x [m], y [m], theta [rad] in [-pi, pi), and ``log_w[i]``. Frames are
``(x0, y0, cells per metre)`` of the map. Noise comes in; nothing is raised.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.motion import MARGIN
from activeloc.range_table import cast_level, cell_of, directions_of
from activeloc.raycast import cast_ray

# From a point of a cell to its centre, and from a blocked cell's centre to its corner [cell]; the
# float32 of ``room`` is off by up to a thousandth.
SLACK = float(np.sqrt(2.0)) + 1e-3


@njit(cache=True, nogil=True)
def _wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    if angle >= np.pi:
        angle -= 2.0 * np.pi
        if angle >= np.pi:
            angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    elif angle < -np.pi:
        angle += 2.0 * np.pi
        if angle < -np.pi or angle >= np.pi:
            angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
            if angle >= np.pi:
                angle = -np.pi
    return angle


@njit(cache=True, nogil=True)
def spread(
    cells: NDArray[np.intp],
    frame: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    start: float,
    out: NDArray[np.float64],
) -> None:
    """Poses spread over cells and headings: places by equal strata, headings by golden section.

    Args:
        cells: ``(C, 2)`` of row and column.
        frame: x and y of the map's corner, and its resolution [m].
        uniforms: ``(N, 3)`` in [0, 1): place in the stratum, and in the cell along x and y.
        start: In [0, 1); the first heading, in turns.
        out: ``(N, 3)``, overwritten.
    """
    n = out.shape[0]
    for i in range(n):
        # The sum may be rounded up to the next stratum, past the last one.
        c = min(int((i + uniforms[i, 0]) * cells.shape[0] / n), cells.shape[0] - 1)
        out[i, 0] = frame[0] + (cells[c, 1] + uniforms[i, 1]) * frame[2]
        out[i, 1] = frame[1] + (cells[c, 0] + uniforms[i, 2]) * frame[2]
        turns = start + i * 0.6180339887498949
        out[i, 2] = _wrapped(2.0 * np.pi * (turns - np.floor(turns)))


@njit(cache=True, nogil=True)
def turn(
    poses: NDArray[np.float64], angle: float, sigma: float, normals: NDArray[np.float32]
) -> None:
    """Rotate every particle on the spot, in place.

    Args:
        poses: ``(N, 3)``.
        angle: Rotation read [rad].
        sigma: Of its noise [rad].
        normals: ``(N,)``.
    """
    for i in range(poses.shape[0]):
        poses[i, 2] = _wrapped(poses[i, 2] + angle + sigma * normals[i])


@njit(cache=True, nogil=True)
def free_way(
    squares: NDArray[np.uint8],
    room: NDArray[np.float32],
    col: float,
    row: float,
    dx: float,
    dy: float,
    wanted: float,
) -> float:
    """How far a robot gets on a way of ``wanted`` [cell]; no ray is cast where there is room."""
    c, r = int(np.floor(col)), int(np.floor(row))
    if 0 <= r < room.shape[0] and 0 <= c < room.shape[1] and room[r, c] - SLACK > wanted:
        return wanted
    reach = cast_ray(squares, col, row, dx, dy, wanted + 2.0 * MARGIN) - MARGIN
    return max(0.0, min(wanted, reach))


@njit(cache=True, nogil=True)
def drive(
    squares: NDArray[np.uint8],
    room: NDArray[np.float32],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    u: NDArray[np.float64],
    sigma: NDArray[np.float64],
    normals: NDArray[np.float32],
    cos: NDArray[np.float32],
    sin: NDArray[np.float32],
    log_w: NDArray[np.float64],
    slack: float,
    log_floor: float,
) -> None:
    """Travel and turn every particle, in place; those that the map stops short lose weight.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        room: ``(H, W)``; distance from a cell's centre to the nearest blocked one's [cell].
        frame: Of the map.
        poses: ``(N, 3)``; the first rotation has been made.
        u: ``(3,)`` odometry reading.
        sigma: ``(3,)`` of its noise.
        normals: ``(N, 2)``, for the travel and the second rotation.
        cos: ``(N,)`` of the headings.
        sin: ``(N,)``.
        log_w: ``(N,)``, overwritten.
        slack: What may be missing of the way before it counts as cut short [m].
        log_floor: Added to the log-weight of ways that were cut short.
    """
    for i in range(poses.shape[0]):
        wanted = u[1] + sigma[1] * normals[i, 0]
        sign = 1.0 if wanted >= 0.0 else -1.0
        dx, dy = sign * cos[i], sign * sin[i]
        scale = 1.0 / np.sqrt(dx * dx + dy * dy)  # float32 headings are not quite unit.
        dx, dy = dx * scale, dy * scale
        col = (poses[i, 0] - frame[0]) * frame[2]
        row = (poses[i, 1] - frame[1]) * frame[2]
        length = free_way(squares, room, col, row, dx, dy, abs(wanted) * frame[2])
        poses[i, 0] = frame[0] + (col + length * dx) / frame[2]
        poses[i, 1] = frame[1] + (row + length * dy) / frame[2]
        poses[i, 2] = _wrapped(poses[i, 2] + u[2] + sigma[2] * normals[i, 1])
        if abs(wanted) - length / frame[2] > slack:
            log_w[i] += log_floor


@njit(cache=True, nogil=True)
def touch(
    squares: NDArray[np.uint8],
    room: NDArray[np.float32],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    reach: float,
    log_w: NDArray[np.float64],
    log_floor: float,
) -> None:
    """Lower the log-weight of particles with nothing within ``reach`` [m] ahead, in place.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        room: ``(H, W)``; see :func:`drive`.
        frame: Of the map.
        poses: ``(N, 3)``.
        reach: How near an obstacle explains a contact [m].
        log_w: ``(N,)``, overwritten.
        log_floor: Added where there is none.
    """
    wanted = reach * frame[2]
    for i in range(poses.shape[0]):
        col = (poses[i, 0] - frame[0]) * frame[2]
        row = (poses[i, 1] - frame[1]) * frame[2]
        dx, dy = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        if free_way(squares, room, col, row, dx, dy, wanted) >= wanted:
            log_w[i] += log_floor


@njit(cache=True, nogil=True)
def weigh_by_table(
    table: NDArray[np.uint8],
    index: NDArray[np.int32],
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    reach: float,
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    log_p: NDArray[np.float32],
    log_w: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        table: ``(C, D)``; see :class:`activeloc.range_table.RangeTable` for these five.
        index: ``(H, W)``.
        squares: ``(4, H + 2, W + 2)``; of the map.
        frame: ``(3,)``.
        reach: [cell].
        poses: ``(N, 3)``.
        bearings: ``(B,)`` of the readings that count [rad].
        log_p: ``(B, LEVELS)``; weighted log P(what beam b read | level of the range).
        log_w: ``(N,)``, overwritten.
    """
    n_directions = table.shape[1]
    offset = np.empty(bearings.shape[0])
    directions_of(bearings, n_directions, offset)
    per_radian = n_directions / (2.0 * np.pi)
    for i in range(poses.shape[0]):
        cell, row, col = cell_of(index, frame, poses[i, 0], poses[i, 1])
        ahead = poses[i, 2] * per_radian + 0.5
        if ahead < 0.5:
            ahead += n_directions
        total = 0.0
        for b in range(bearings.shape[0]):
            if cell < 0:
                total += log_p[b, 0]
                continue
            direction = int(ahead + offset[b])
            while direction >= n_directions:
                direction -= n_directions
            level = table[cell, direction]
            if level == 0:
                angle = 2.0 * np.pi * direction / n_directions
                level = cast_level(squares, row, col, angle, reach)
                table[cell, direction] = level
            total += log_p[b, level - 1]
        log_w[i] += total


@njit(cache=True, nogil=True)
def weigh_by_rows(
    log_w: NDArray[np.float64],
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        log_w: ``(N,)``.
        rows: ``(N, B)``; row of the table for each particle and beam.
        log_p: ``(Z, R)``.
        readings: ``(B,)`` of bins; -1 for no reading.
        weights: ``(B,)``; how much each reading counts.
    """
    for b in range(readings.shape[0]):
        if readings[b] >= 0 and weights[b] > 0.0:
            for i in range(log_w.shape[0]):
                log_w[i] += weights[b] * log_p[readings[b], rows[i, b]]


@njit(cache=True, nogil=True)
def roughen(
    open_: NDArray[np.bool_],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    chosen: NDArray[np.intp],
    normals: NDArray[np.float32],
    sigma_xy: float,
    sigma_theta: float,
    out: NDArray[np.float64],
) -> None:
    """Copy the chosen particles with noise; where it would leave the open ground, x and y stay.

    Args:
        open_: ``(H, W)``; where the robot's centre can be.
        frame: Of the map.
        poses: ``(M, 3)``.
        chosen: ``(N,)`` of indices.
        normals: ``(N, 3)``.
        sigma_xy: [m].
        sigma_theta: [rad].
        out: ``(N, 3)``, overwritten.
    """
    for i in range(chosen.shape[0]):
        j = chosen[i]
        x = poses[j, 0] + sigma_xy * normals[i, 0]
        y = poses[j, 1] + sigma_xy * normals[i, 1]
        col = int(np.floor((x - frame[0]) * frame[2]))
        row = int(np.floor((y - frame[1]) * frame[2]))
        if 0 <= row < open_.shape[0] and 0 <= col < open_.shape[1] and open_[row, col]:
            out[i, 0], out[i, 1] = x, y
        else:
            out[i, 0], out[i, 1] = poses[j, 0], poses[j, 1]
        out[i, 2] = _wrapped(poses[j, 2] + sigma_theta * normals[i, 2])


@njit(cache=True, nogil=True)
def bin_of(
    x: float, y: float, theta: float, corner: NDArray[np.float64], shape: tuple[int, int, int]
) -> int:
    """Flat bin (row, column, heading) of a pose; off the bins, the nearest at the edge.

    Args:
        x: [m].
        y: [m].
        theta: In [-pi, pi) [rad].
        corner: x and y of the bins' lower left corner [m], and bins per metre.
        shape: Rows, columns and heading bins; these begin at -pi.
    """
    col = int(min(max((x - corner[0]) * corner[2], 0.0), shape[1] - 1.0))
    row = int(min(max((y - corner[1]) * corner[2], 0.0), shape[0] - 1.0))
    heading = min(int((theta + np.pi) * (shape[2] / (2.0 * np.pi))), shape[2] - 1)
    return (row * shape[1] + col) * shape[2] + heading


@njit(cache=True, nogil=True)
def bin_weights(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    corner: NDArray[np.float64],
    shape: tuple[int, int, int],
    out: NDArray[np.float64],
    index: NDArray[np.int32],
) -> None:
    """Add the weights up in bins over x, y and heading.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        corner: See :func:`bin_of`.
        shape: See :func:`bin_of`.
        out: ``(rows * cols * headings,)``, added to.
        index: ``(N,)``, overwritten with each particle's bin, or ``(0,)``.
    """
    keep = index.shape[0] > 0
    for i in range(poses.shape[0]):
        k = bin_of(poses[i, 0], poses[i, 1], poses[i, 2], corner, shape)
        out[k] += weights[i]
        if keep:
            index[i] = k


@njit(cache=True, nogil=True)
def wheel_of(
    weights: NDArray[np.float64],
    index: NDArray[np.int32],
    factor: NDArray[np.float64],
    out: NDArray[np.float64],
) -> float:
    """Cumulative sum of each weight times its bin's factor; returns the sum of their squares.

    Args:
        weights: ``(N,)``.
        index: ``(N,)``; bin of each particle.
        factor: ``(bins,)``.
        out: ``(N,)``, overwritten.
    """
    total, squares = 0.0, 0.0
    for i in range(weights.shape[0]):
        w = weights[i] * factor[index[i]]
        total += w
        squares += w * w
        out[i] = total
    return squares


@njit(cache=True, nogil=True)
def within(
    poses: NDArray[np.float64], x: float, y: float, radius: float, out: NDArray[np.int32]
) -> int:
    """Indices of the particles within ``radius`` [m] of a place; returns how many.

    Args:
        poses: ``(N, 3)``.
        x: [m].
        y: [m].
        radius: [m].
        out: ``(N,)``, overwritten.
    """
    n = 0
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - x, poses[i, 1] - y
        if dx * dx + dy * dy <= radius * radius:
            out[n] = i
            n += 1
    return n


@njit(cache=True, nogil=True)
def local_moments(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    chosen: NDArray[np.int32],
    pose: NDArray[np.float64],
    radius: float,
    angle: float,
    out: NDArray[np.float64],
) -> None:
    """Mass within ``radius`` [m] and ``angle`` [rad] of a pose, and its first moments about it.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        chosen: ``(n,)`` of the particles that are looked at.
        pose: ``(3,)``.
        radius: Of the window.
        angle: Of the window.
        out: ``(4,)``, overwritten: mass, and mass times mean offset in x, y and theta.
    """
    out[:] = 0.0
    for i in chosen:
        dx, dy = poses[i, 0] - pose[0], poses[i, 1] - pose[1]
        if dx * dx + dy * dy > radius * radius:
            continue
        offset = poses[i, 2] - pose[2]
        if offset >= np.pi:
            offset -= 2.0 * np.pi
        elif offset < -np.pi:
            offset += 2.0 * np.pi
        if abs(offset) <= angle:
            out[0] += weights[i]
            out[1] += weights[i] * dx
            out[2] += weights[i] * dy
            out[3] += weights[i] * offset
