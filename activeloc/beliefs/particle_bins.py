"""Kernels that sum, allocate and redraw particles.

Poses are ``(x [m], y [m], theta [rad] in [-pi, pi))``; frames are ``(x0, y0, cells per metre)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import wrapped
from activeloc.beliefs.sample_size import effective_states


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
def allocate(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    corner: NDArray[np.float64],
    shape: tuple[int, int, int],
    power: float,
    index: NDArray[np.int32],
    masses: NDArray[np.float64],
    factor: NDArray[np.float64],
    wheel: NDArray[np.float64],
) -> tuple[float, float, float]:
    """How many particles each bin gets for its mass: in proportion to the mass to a power.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``, their sum positive.
        corner: See :func:`bin_of`.
        shape: See :func:`bin_of`.
        power: In (0, 1].
        index: ``(N,)``, overwritten with each particle's bin.
        masses: ``(bins,)`` of zeros, overwritten.
        factor: ``(bins,)`` of zeros, overwritten where there is mass: mass to the power less one.
        wheel: ``(N,)``, overwritten with the cumulative weights after allocation.

    Returns:
        The mass, the sum of the squares of the weights after allocation, and the effective states
        (:mod:`activeloc.beliefs.sample_size`). Zeros where nothing has a weight.
    """
    held = np.empty(min(poses.shape[0], masses.shape[0]), dtype=np.int32)
    n_held, total = 0, 0.0
    for i in range(poses.shape[0]):
        k = bin_of(poses[i, 0], poses[i, 1], poses[i, 2], corner, shape)
        index[i] = k
        if weights[i] > 0.0:
            if masses[k] == 0.0:
                held[n_held] = k
                n_held += 1
            masses[k] += weights[i]
            total += weights[i]
    if total == 0.0:
        return 0.0, 0.0, 0.0
    p = np.empty(n_held)
    for j in range(n_held):
        p[j] = masses[held[j]] / total
        factor[held[j]] = masses[held[j]] ** (power - 1.0)
    return total, wheel_of(weights, index, factor, wheel), effective_states(p, power)


@njit(cache=True, nogil=True)
def roughen(
    open_: NDArray[np.bool_],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    chosen: NDArray[np.intp],
    noise: NDArray[np.uint16],
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
        noise: ``(N, 3)``; see :mod:`activeloc.beliefs.particle_motion`.
        normals: ``NORMALS``.
        sigma_xy: [m].
        sigma_theta: [rad].
        out: ``(N, 3)``, overwritten.
    """
    for i in range(chosen.shape[0]):
        j = chosen[i]
        x = poses[j, 0] + sigma_xy * normals[noise[i, 0]]
        y = poses[j, 1] + sigma_xy * normals[noise[i, 1]]
        col = int(np.floor((x - frame[0]) * frame[2]))
        row = int(np.floor((y - frame[1]) * frame[2]))
        if 0 <= row < open_.shape[0] and 0 <= col < open_.shape[1] and open_[row, col]:
            out[i, 0], out[i, 1] = x, y
        else:
            out[i, 0], out[i, 1] = poses[j, 0], poses[j, 1]
        out[i, 2] = wrapped(poses[j, 2] + sigma_theta * normals[noise[i, 2]])


@njit(cache=True, nogil=True)
def shares(
    chosen: NDArray[np.intp],
    index: NDArray[np.int32],
    factor: NDArray[np.float64],
    mass: float,
    out: NDArray[np.float64],
) -> None:
    """Weights of the survivors: in inverse proportion to their bins' factors, summing to a mass.

    Args:
        chosen: ``(n,)``.
        index: ``(N,)``; bin of each particle.
        factor: ``(bins,)``; see :func:`allocate`.
        mass: Sum of the weights.
        out: ``(n,)``, overwritten.
    """
    total = 0.0
    for i in range(chosen.shape[0]):
        out[i] = 1.0 / factor[index[chosen[i]]]
        total += out[i]
    for i in range(chosen.shape[0]):
        out[i] *= mass / total
