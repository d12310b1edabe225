"""Kernels that find out where particles stand."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import wrapped


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
    chosen, out = np.empty(poses.shape[0], dtype=np.int32), np.empty(4)
    near = chosen[: within(poses, pose[0], pose[1], 3.0 * radius, chosen)]
    for _ in range(rounds):
        local_moments(poses, weights, near, pose, radius, angle, out)
        if out[0] == 0.0:
            break
        for axis in range(3):
            pose[axis] += out[1 + axis] / out[0]
        pose[2] = wrapped(pose[2])
    local_moments(poses, weights, near, pose, radius, angle, out)
    return out[0]
