"""Kernels that sum, allocate and redraw particles.

Poses are ``(x [m], y [m], theta [rad] in [-pi, pi))``; frames are ``(x0, y0, cells per metre)``.
"""

from __future__ import annotations

from threading import local

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.particle_motion import wrapped
from activeloc.beliefs.sample_size import effective_states, power_of

BLOCK = 256  # Particles whose bins are worked out together.


@njit(cache=True, nogil=True)
def bins_of(
    poses: NDArray[np.float64],
    first: int,
    n: int,
    corner: NDArray[np.float64],
    shape: tuple[int, int, int],
    out: NDArray[np.int32],
) -> None:
    """Flat bins (row, column, heading) of n poses; off the bins, the nearest at the edge.

    Args:
        poses: ``(N, 3)``.
        first: From which on.
        n: How many.
        corner: x and y of the bins' lower left corner [m], and bins per metre.
        shape: Rows, columns and heading bins; these begin at -pi.
        out: ``(>= n,)``, overwritten.
    """
    x0, y0, per_metre, per_radian = corner[0], corner[1], corner[2], shape[2] / (2.0 * np.pi)
    top, right, last = shape[0] - 1.0, shape[1] - 1.0, shape[2] - 1.0
    cols, headings = np.int32(shape[1]), np.int32(shape[2])
    for k in range(np.uint64(n)):
        i = np.uint64(first) + k
        col = np.int32(min(max((poses[i, 0] - x0) * per_metre, 0.0), right))
        row = np.int32(min(max((poses[i, 1] - y0) * per_metre, 0.0), top))
        heading = np.int32(min((poses[i, 2] + np.pi) * per_radian, last))
        out[k] = (row * cols + col) * headings + heading


@njit(cache=True, nogil=True)
def bin_weights(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    corner: NDArray[np.float64],
    shape: tuple[int, int, int],
    out: NDArray[np.float64],
) -> None:
    """Add the weights up in bins over x, y and heading.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        corner: See :func:`bins_of`.
        shape: See :func:`bins_of`.
        out: ``(rows * cols * headings,)``, added to.
    """
    bins = np.empty(BLOCK, dtype=np.int32)
    for first in range(0, poses.shape[0], BLOCK):
        n = min(BLOCK, poses.shape[0] - first)
        bins_of(poses, first, n, corner, shape, bins)
        for k in range(np.uint64(n)):
            out[np.uint64(bins[k])] += weights[np.uint64(first) + k]


@njit(cache=True, nogil=True)
def sum_bins(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    corner: NDArray[np.float64],
    shape: tuple[int, int, int],
    slots: NDArray[np.int32],
    index: NDArray[np.int32],
    held: NDArray[np.int32],
    masses: NDArray[np.float64],
) -> int:
    """Add the weights up in those bins that hold a particle; returns how many they are.

    A cloud that is somewhere touches a few of the many bins, and no others here.

    Args:
        poses: ``(N, 3)``.
        weights: ``(N,)``.
        corner: See :func:`bins_of`.
        shape: See :func:`bins_of`.
        slots: ``(bins,)`` of zeros; they are zeros again.
        index: ``(N,)``, overwritten with each particle's place in ``held``.
        held: ``(N,)``, overwritten with the bins, in the order of the particles.
        masses: ``(N,)``, overwritten with theirs.
    """
    n_held, bins = 0, np.empty(BLOCK, dtype=np.int32)
    for first in range(0, poses.shape[0], BLOCK):
        n = min(BLOCK, poses.shape[0] - first)
        bins_of(poses, first, n, corner, shape, bins)
        for k in range(np.uint64(n)):
            i, one = np.uint64(first) + k, np.uint64(bins[k])
            slot = slots[one] - 1
            if slot < 0:
                slot = n_held
                n_held += 1
                held[slot], masses[slot], slots[one] = one, 0.0, n_held
            index[i] = slot
            masses[np.uint64(slot)] += weights[i]
    for slot in range(n_held):
        slots[held[slot]] = 0
    return n_held


@njit(cache=True, nogil=True)
def merge(held: NDArray[np.int32], masses: NDArray[np.float64], slots: NDArray[np.int32]) -> int:
    """Add up the masses of bins that are named twice, in place; returns how many are left.

    Args:
        held: ``(n,)`` of bins, overwritten.
        masses: ``(n,)`` of theirs, overwritten.
        slots: ``(bins,)`` of zeros; they are zeros again.
    """
    n = 0
    for j in range(held.shape[0]):
        slot = slots[held[j]] - 1
        if slot < 0:
            held[n], masses[n] = held[j], masses[j]
            n += 1
            slots[held[j]] = n
        else:
            masses[slot] += masses[j]
    for j in range(n):
        slots[held[j]] = 0
    return n


class _Slots(local):
    """Zeros that each thread keeps."""

    def __init__(self) -> None:
        self.zeros = np.zeros(0, dtype=np.int32)


_SLOTS = _Slots()


def empty_slots(bins: int) -> NDArray[np.int32]:
    """``(bins,)`` of zeros for :func:`sum_bins` and :func:`merge`, which leave them so."""
    if len(_SLOTS.zeros) < bins:
        _SLOTS.zeros = np.zeros(bins, dtype=np.int32)
    return _SLOTS.zeros[:bins]


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
    weights: NDArray[np.float64],
    index: NDArray[np.int32],
    masses: NDArray[np.float64],
    power: float,
    factor: NDArray[np.float64],
    wheel: NDArray[np.float64],
) -> tuple[float, float, float]:
    """How many particles each bin gets for its mass: in proportion to the mass to a power.

    Args:
        weights: ``(N,)``.
        index: ``(N,)``; bin of each particle, as in :func:`sum_bins`.
        masses: ``(n,)``; of the bins.
        power: In (0, 1].
        factor: ``(n,)``, overwritten: mass to the power less one, 0 where there is none.
        wheel: ``(N,)``, overwritten with the cumulative weights after allocation.

    Returns:
        The mass, the sum of the squares of the weights after allocation, and the effective states
        (:mod:`activeloc.beliefs.sample_size`). Zeros where nothing has a weight.
    """
    total = 0.0
    for j in range(masses.shape[0]):
        total += masses[j]
    if total == 0.0:
        return 0.0, 0.0, 0.0
    p = masses / total
    for j in range(masses.shape[0]):
        factor[j] = power_of(masses[j], power) / masses[j] if masses[j] > 0.0 else 0.0
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
        factor: ``(n,)``; see :func:`allocate`.
        mass: Sum of the weights.
        out: ``(n,)``, overwritten.
    """
    total = 0.0
    for i in range(chosen.shape[0]):
        out[i] = 1.0 / factor[index[chosen[i]]]
        total += out[i]
    for i in range(chosen.shape[0]):
        out[i] *= mass / total
