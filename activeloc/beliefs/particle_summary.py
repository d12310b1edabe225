"""Kernels that find out where particles stand."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import wrapped

CHUNK = 256  # Particles that are added up side by side.


@njit(cache=True, nogil=True)
def offsets_near(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    out: NDArray[np.float64],
) -> int:
    """Gather the particles within ``radius`` [m] of a pose; returns how many they are.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        pose: ``(3,)``.
        radius: [m].
        out: ``(4, N + 1)``, overwritten: offsets in x, y and theta, the last less than a turn
            either way, and weights.
    """
    x, y, theta, n = pose[0], pose[1], pose[2], 0
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - x, poses[i, 1] - y
        out[0, n], out[1, n], out[2, n], out[3, n] = dx, dy, poses[i, 2] - theta, weights[i]
        n += 1 if dx * dx + dy * dy <= radius * radius else 0
    return n


@njit(cache=True, nogil=True)
def local_moments(
    near: NDArray[np.float64],
    n: int,
    centre: NDArray[np.float64],
    radius: float,
    angle: float,
    out: NDArray[np.float64],
) -> None:
    """Mass within ``radius`` [m] and ``angle`` [rad] of a centre, and its first moments about it.

    Args:
        near: ``(4, >= n)``; offsets and weights, see :func:`offsets_near`.
        n: How many.
        centre: ``(3,)``; an offset too, its heading in [-pi, pi).
        radius: Of the window.
        angle: Of the window.
        out: ``(4,)``, overwritten: mass, and mass times mean offset in x, y and theta.
    """
    dx, dy, turned, weights = near[0], near[1], near[2], near[3]
    mass, in_x, in_y, in_theta = np.zeros(CHUNK), np.zeros(CHUNK), np.zeros(CHUNK), np.zeros(CHUNK)
    chunk, end, circle = np.uint64(CHUNK), np.uint64(n), 2.0 * np.pi
    x0, y0, theta0, limit = centre[0], centre[1], centre[2], radius * radius
    for first in range(np.uint64(0), end, chunk):
        for k in range(min(chunk, end - first)):
            x, y, theta = dx[first + k] - x0, dy[first + k] - y0, turned[first + k] - theta0
            theta = theta - circle if theta >= np.pi else theta
            theta = theta + circle if theta < -np.pi else theta
            inside = (x * x + y * y <= limit) & (abs(theta) <= angle)
            w = weights[first + k] if inside else 0.0
            mass[k] += w
            in_x[k] += w * x
            in_y[k] += w * y
            in_theta[k] += w * theta
    out[0], out[1], out[2], out[3] = mass.sum(), in_x.sum(), in_y.sum(), in_theta.sum()


@njit(cache=True, nogil=True)
def peak(held: NDArray[np.int32], masses: NDArray[np.float64]) -> tuple[int, float]:
    """The bin with the most mass, the first of equals, and the Shannon entropy of all [nat].

    Args:
        held: ``(n,)`` of bins.
        masses: ``(n,)`` of theirs, probabilities.
    """
    best, entropy = 0, 0.0
    for j in range(masses.shape[0]):
        p = masses[j]
        if p > 0.0:
            entropy -= p * np.log(p)
        if p > masses[best] or (p == masses[best] and held[j] < held[best]):
            best = j
    return held[best], entropy


@njit(cache=True, nogil=True)
def localise(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    angle: float,
    rounds: int,
) -> float:
    """Move a pose to the mean of the mass around it, a few times.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        pose: ``(3,)``, overwritten.
        radius: Of the window [m]; the pose is taken to stay within two of them.
        angle: Of the window [rad].
        rounds: How often.

    Returns:
        The mass within the window around the last.
    """
    near, out, centre = np.empty((4, poses.shape[0] + 1)), np.empty(4), np.zeros(3)
    n = offsets_near(poses, weights, pose, 3.0 * radius, near)
    for _ in range(rounds):
        local_moments(near, n, centre, radius, angle, out)
        if out[0] == 0.0:
            break
        for axis in range(3):
            centre[axis] += out[1 + axis] / out[0]
        centre[2] = wrapped(centre[2])
    local_moments(near, n, centre, radius, angle, out)
    for axis in range(3):
        pose[axis] += centre[axis]
    pose[2] = wrapped(pose[2])
    return out[0]
