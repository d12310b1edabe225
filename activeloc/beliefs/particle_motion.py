"""Kernels that move a cloud of particles.

A cloud is ``poses[i]`` = x [m], y [m], theta [rad] in [-pi, pi), and ``log_w[i]``. Frames are
``(x0, y0, cells per metre)`` of the map. Noise comes in as the 16-bit indices of ``NORMALS``;
nothing is raised.
"""

from __future__ import annotations

from math import prod

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import ndtri

from activeloc.motion import free_way, slipped
from activeloc.motion.driving import MARGIN

# Standard normal numbers of equal probability: noise is drawn as their 16-bit index, which costs a
# third of drawing it by the ziggurat and is exact to 2^-16 in probability.
_NORMALS = ndtri((np.arange(65536) + 0.5) / 65536.0)
NORMALS = np.asarray(_NORMALS / _NORMALS.std(), dtype=np.float32)

# Headings whose cosine and sine are looked up; between them they are carried on to second order,
# which is exact to 1e-9.
HEADINGS = 2048
BLOCK = 128  # Particles that are driven together.
_ANGLES = np.arange(HEADINGS + 1) * (2.0 * np.pi / HEADINGS) - np.pi
_COS, _SIN = np.cos(_ANGLES), np.sin(_ANGLES)


def noise(rng: np.random.Generator, *shape: int) -> NDArray[np.uint16]:
    """Indices of ``NORMALS``, each equally likely."""
    n = prod(shape)
    words = np.asarray(rng.bit_generator.random_raw((n + 3) // 4))
    return words.view(np.uint16)[:n].reshape(shape)


def every(share: float, n: int, start: float) -> NDArray[np.intp]:
    """Indices of as large a share of n particles, evenly spaced, so that each is equally likely.

    Args:
        share: In [0, 1].
        n: Particles.
        start: In [0, 1); the first, in their distance.
    """
    if share == 0.0:
        return np.empty(0, dtype=np.intp)
    index = ((np.arange(int(n * share) + 1) + start) * (1.0 / share)).astype(np.intp)
    return index[: int(np.searchsorted(index, n))]


@njit(cache=True, nogil=True)
def wrapped(angle: float) -> float:
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
def unit(theta: float) -> tuple[float, float]:
    """Cosine and sine of a heading in [-pi, pi), to 1e-9."""
    turned = theta + np.pi
    i = int(turned * (HEADINGS / (2.0 * np.pi)) + 0.5)
    d = turned - i * (2.0 * np.pi / HEADINGS)
    cos, sin = _COS[i], _SIN[i]
    return cos - d * (sin + 0.5 * d * cos), sin + d * (cos - 0.5 * d * sin)


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
        out[i, 2] = wrapped(2.0 * np.pi * (turns - np.floor(turns)))


@njit(cache=True, nogil=True)
def turn(
    poses: NDArray[np.float64],
    angle: float,
    sigma: float,
    noise: NDArray[np.uint16],
    normals: NDArray[np.float32],
) -> None:
    """Rotate every particle on the spot, in place.

    Args:
        poses: ``(N, 3)``.
        angle: Rotation read [rad].
        sigma: Of its noise [rad].
        noise: ``(N,)``.
        normals: ``NORMALS``.
    """
    for i in range(poses.shape[0]):
        poses[i, 2] = wrapped(poses[i, 2] + angle + sigma * normals[noise[i]])


@njit(cache=True, nogil=True)
def set_out(
    frame: NDArray[np.float64],
    x: float,
    y: float,
    heading: float,
    wanted: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (6,)`` with a way: column, row, unit heading, length wanted, length free [cell].

    Args:
        frame: Of the map.
        x: Where the particle stands [m].
        y: [m].
        heading: [rad].
        wanted: Backwards if negative [m].
        out: Overwritten; the length that is free is taken to be the one that is wanted.
    """
    cos, sin = unit(heading)
    sign = 1.0 if wanted >= 0.0 else -1.0
    out[0], out[1] = (x - frame[0]) * frame[2], (y - frame[1]) * frame[2]
    out[2], out[3] = sign * cos, sign * sin
    out[4] = out[5] = abs(wanted) * frame[2]


@njit(cache=True, nogil=True)
def list_stopped(
    squares: NDArray[np.uint8], ways: NDArray[np.float64], out: NDArray[np.int64]
) -> int:
    """Which ways ``(n, 6)`` an obstacle may stop; returns how many.

    The others end inside a free square (:func:`activeloc.motion.free_way`). Nothing is decided on
    the way, so that the look-ups of many particles are waited for together.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        ways: See :func:`set_out`.
        out: ``(>= n,)``, overwritten with their indices.
    """
    height, width, n = squares.shape[1], squares.shape[2], 0
    for k in range(ways.shape[0]):
        # Off the map is the rim, where nothing is free.
        c = int(min(max(ways[k, 0] + 1.0, 0.0), width - 1.0))
        r = int(min(max(ways[k, 1] + 1.0, 0.0), height - 1.0))
        quadrant = (0 if ways[k, 2] > 0.0 else 1) + (0 if ways[k, 3] > 0.0 else 2)
        # Unsigned, for numba looks after negative indices.
        side = squares[np.uint64(quadrant), np.uint64(r), np.uint64(c)]
        along_axis = min(abs(ways[k, 2]), abs(ways[k, 3])) < 1e-14
        out[n] = k
        n += int(along_axis or side - 1.0 <= ways[k, 4] + 2.0 * MARGIN)
    return n


@njit(cache=True, nogil=True)
def shorten(
    squares: NDArray[np.uint8], ways: NDArray[np.float64], stopped: NDArray[np.int64]
) -> None:
    """Cut ways ``(n, 6)`` short where an obstacle stops them.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        ways: See :func:`set_out`; their free lengths are overwritten.
        stopped: ``(>= n,)``, overwritten.
    """
    for m in range(list_stopped(squares, ways, stopped)):
        k = stopped[m]
        col, row, dx, dy, wanted = ways[k, 0], ways[k, 1], ways[k, 2], ways[k, 3], ways[k, 4]
        ways[k, 5] = free_way(squares, col, row, dx, dy, wanted)


@njit(cache=True, nogil=True)
def drive(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    u: NDArray[np.float64],
    sigma: NDArray[np.float64],
    noise: NDArray[np.uint16],
    normals: NDArray[np.float32],
    log_w: NDArray[np.float64],
    slack: float,
    log_floor: float,
) -> None:
    """Rotate, travel and rotate every particle, in place; those that the map stops lose weight.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        frame: Of the map.
        poses: ``(N, 3)``.
        u: ``(3,)`` odometry reading.
        sigma: ``(3,)`` of its noise.
        noise: ``(N, 3)``.
        normals: ``NORMALS``.
        log_w: ``(N,)``, overwritten.
        slack: What may be missing of the way before it counts as cut short [m].
        log_floor: Added to the log-weight of ways that were cut short.
    """
    way, stopped = np.empty((BLOCK, 6)), np.empty(BLOCK, dtype=np.int64)
    per_cell = 1.0 / frame[2]
    for first in range(0, poses.shape[0], BLOCK):
        n = min(BLOCK, poses.shape[0] - first)
        for k in range(n):
            i = first + k
            heading = wrapped(poses[i, 2] + u[0] + sigma[0] * normals[noise[i, 0]])
            wanted = u[1] + sigma[1] * normals[noise[i, 1]]
            set_out(frame, poses[i, 0], poses[i, 1], heading, wanted, way[k])
            poses[i, 2] = wrapped(heading + u[2] + sigma[2] * normals[noise[i, 2]])
        shorten(squares, way[:n], stopped)
        for k in range(n):
            i, length = first + k, way[k, 5]
            poses[i, 0] = frame[0] + (way[k, 0] + length * way[k, 2]) * per_cell
            poses[i, 1] = frame[1] + (way[k, 1] + length * way[k, 3]) * per_cell
            if (way[k, 4] - length) * per_cell > slack:
                log_w[i] += log_floor


@njit(cache=True, nogil=True)
def slip(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    before: NDArray[np.float64],
    weighed: NDArray[np.float64],
    slipping: NDArray[np.int64],
    u: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    poses: NDArray[np.float64],
    log_w: NDArray[np.float64],
) -> None:
    """Move some particles as a badly wrong odometry reading may mean it, instead.

    Args:
        squares: See :func:`drive`.
        frame: Of the map.
        before: ``(n, 3)``; where they stood.
        weighed: ``(n,)``; their log-weights there, which they keep.
        slipping: ``(n,)``; which they are.
        u: ``(3,)`` odometry reading.
        uniforms: ``(n, 2)`` in [0, 1); see :func:`activeloc.motion.slipped`.
        poses: ``(N, 3)``, overwritten at ``slipping``.
        log_w: ``(N,)``, overwritten at ``slipping``.
    """
    way, stopped = np.empty((BLOCK, 6)), np.empty(BLOCK, dtype=np.int64)
    per_cell = 1.0 / frame[2]
    for first in range(0, slipping.shape[0], BLOCK):
        n = min(BLOCK, slipping.shape[0] - first)
        for k in range(n):
            j = first + k
            rot1, trans = slipped(u, uniforms[j, 0], uniforms[j, 1])
            heading = wrapped(before[j, 2] + rot1)
            set_out(frame, before[j, 0], before[j, 1], heading, trans, way[k])
            poses[slipping[j], 2] = wrapped(heading + u[2])
            log_w[slipping[j]] = weighed[j]
        shorten(squares, way[:n], stopped)
        for k in range(n):
            i, length = slipping[first + k], way[k, 5]
            poses[i, 0] = frame[0] + (way[k, 0] + length * way[k, 2]) * per_cell
            poses[i, 1] = frame[1] + (way[k, 1] + length * way[k, 3]) * per_cell


@njit(cache=True, nogil=True)
def touch(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    reach: float,
    log_w: NDArray[np.float64],
    log_floor: float,
) -> None:
    """Lower the log-weight of particles with nothing within ``reach`` [m] ahead, in place.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        frame: Of the map.
        poses: ``(N, 3)``.
        reach: How near an obstacle explains a contact [m].
        log_w: ``(N,)``, overwritten.
        log_floor: Added where there is none.
    """
    way, stopped = np.empty((BLOCK, 6)), np.empty(BLOCK, dtype=np.int64)
    for first in range(0, poses.shape[0], BLOCK):
        n = min(BLOCK, poses.shape[0] - first)
        for k in range(n):
            i = first + k
            set_out(frame, poses[i, 0], poses[i, 1], poses[i, 2], reach, way[k])
        shorten(squares, way[:n], stopped)
        for k in range(n):
            if way[k, 5] >= way[k, 4]:
                log_w[first + k] += log_floor
