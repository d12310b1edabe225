"""A posterior as weighted poses, and where the truth stands in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.grid import OccupancyGrid
from activeloc.motion import wrap
from activeloc.sensors import ReadingBins
from activeloc.sensors.readings import check_scan

QUANTITIES = ("x", "y", "heading", "posterior", "likelihood")

# Bins in which a cloud's probability is read [m, rad]: so wide that it is not the cloud's scatter
# which decides what is probable.
_BIN_SIZE, _BIN_ANGLE = 1.0, float(np.pi / 3.0)
# A cloud that has collapsed onto one pose still has the covariance of a millimetre.
_LEAST_VARIANCE = 1e-6


@dataclass(frozen=True)
class Posterior:
    """A belief and the truth on one footing.

    To a histogram filter the truth is its state, by the pose that stands for that state; to a
    particle filter it is the pose, and its probability that of its bin of 1 m and 60 degrees.

    Attributes:
        poses: ``(N, 3)``; where the belief has its mass.
        weights: ``(N,)``, summing to one.
        p: ``(N,)``; posterior probability of the state or bin that each pose lies in.
        within: ``(3, 3)``; mean covariance within a state.
        truth: ``(3,)``, as the belief sees it.
        p_truth: Posterior probability of the truth's state or bin.
    """

    poses: NDArray[np.float64]
    weights: NDArray[np.float64]
    p: NDArray[np.float64]
    within: NDArray[np.float64]
    truth: NDArray[np.float64]
    p_truth: float

    def ranks(
        self,
        likelihoods: tuple[NDArray[np.float64], float],
        zero: float,
        shares: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Randomised rank of the truth in each of the quantities: ``(5,)`` in [0, 1].

        Args:
            likelihoods: Of the last scan, at each pose ``(N,)`` and at the truth.
            zero: Where the circle is cut open; drawn uniformly, it leaves headings no seam [rad].
            shares: ``(5,)`` in [0, 1): place of the truth among its equals.
        """
        circle = 2.0 * np.pi
        pairs = (
            (self.poses[:, 0], self.truth[0]),
            (self.poses[:, 1], self.truth[1]),
            ((self.poses[:, 2] - zero) % circle, (self.truth[2] - zero) % circle),
            (self.p, self.p_truth),
            likelihoods,
        )
        return np.array(
            [
                rank(values, self.weights, float(value), float(share))
                for (values, value), share in zip(pairs, shares, strict=True)
            ]
        )

    def nees(self, pose: NDArray[np.float64]) -> tuple[float, float]:
        """Normalised estimation error squared: (x - mu)^T P^-1 (x - mu); its mean is 3.

        The mean heading is that of the deviations from the circular mean, so that the expectation
        is exact for any belief, not only for narrow ones.

        Args:
            pose: ``(3,)``; x, with its place inside the state.

        Returns:
            The truth's, and the variance that it has under the belief: 6 for a Gaussian, more for
            a belief with tails.
        """
        mean = self.weights @ self.poses
        turns = self.weights @ np.exp(1j * self.poses[:, 2])
        mean[2] = np.angle(turns)
        offsets, error = self.poses - mean, pose - mean
        offsets[:, 2], error[2] = wrap(offsets[:, 2]), wrap(error[2])
        rest = self.weights @ offsets
        covariance = (offsets * self.weights[:, None]).T @ offsets - np.outer(rest, rest)
        covariance += self.within + _LEAST_VARIANCE * np.eye(3)
        information = np.linalg.inv(covariance)
        offsets -= rest
        spread = ((offsets @ information) * offsets).sum(axis=1)
        variance = self.weights @ spread**2 - (self.weights @ spread) ** 2
        return float((error - rest) @ information @ (error - rest)), float(variance)


def rank(
    values: NDArray[np.float64], weights: NDArray[np.float64], truth: float, share: float
) -> float:
    """P(value < truth) + share P(value = truth): uniform if the truth is a draw from the weights.

    Args:
        values: ``(N,)``.
        weights: ``(N,)``, summing to one.
        truth: The true value.
        share: Uniform in [0, 1).
    """
    below, equal = weights[values < truth].sum(), weights[values == truth].sum()
    return float(np.clip(below + share * equal, 0.0, 1.0))


@lru_cache(maxsize=4)
def _states(grid: PoseGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pose ``(C K, 3)`` of each state, and covariance ``(C, 3, 3)`` within the states of a cell."""
    n_cells = len(grid.cells)
    poses = np.column_stack(
        [np.repeat(grid.centres, grid.headings, axis=0), np.tile(grid.thetas, n_cells)]
    )
    share = grid.is_open / grid.is_open.sum(axis=-1, keepdims=True)
    offsets = grid.sub_poses() - grid.centres[:, None]
    within = np.zeros((n_cells, 3, 3))
    within[:, :2, :2] = np.einsum("cs,csi,csj->cij", share, offsets, offsets)
    within[:, [0, 1], [0, 1]] += (grid.cell_size / SUB) ** 2 / 12.0
    within[:, 2, 2] = grid.bin_width**2 / 12.0
    return poses, within


@lru_cache(maxsize=4)
def _bins(grid: OccupancyGrid) -> CommonBins:
    return CommonBins(grid, _BIN_SIZE, _BIN_ANGLE)


def seen(
    belief: HistogramBelief | ParticleBelief, pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A pose ``(3,)`` as a belief can tell it: a histogram filter only knows its state."""
    if not isinstance(belief, HistogramBelief):
        return pose
    grid = belief.poses(0)
    cell, heading = grid.states_of(pose[None])
    return np.append(grid.centres[cell[0]], grid.thetas[heading[0]])


def posterior_of(belief: HistogramBelief | ParticleBelief, pose: NDArray[np.float64]) -> Posterior:
    """The posterior of a belief over one robot, beside the truth.

    Args:
        belief: Of robot 0.
        pose: ``(3,)``; the truth.
    """
    if isinstance(belief, HistogramBelief):
        grid = belief.poses(0)
        bel = belief.probabilities(0).astype(np.float64)
        bel /= bel.sum()
        poses, within = _states(grid)
        cell, heading = grid.states_of(pose[None])
        state = int(cell[0]) * grid.headings + int(heading[0])
        p = bel.ravel()
        mean_within = np.tensordot(bel.sum(axis=1), within, axes=1)
        return Posterior(poses, p, p, mean_within, poses[state], float(p[state]))
    poses, weights = belief.particles(0)
    bins = _bins(belief.terrain(0).grid)
    index = bins.index(poses)
    masses = np.bincount(index, weights, minlength=len(bins)).astype(np.float64)
    p_truth = float(masses[bins.index(pose[None])[0]])
    return Posterior(poses, weights, masses[index], np.zeros((3, 3)), pose, p_truth)


def likelihoods(
    belief: HistogramBelief | ParticleBelief,
    poses: NDArray[np.float64],
    scan: NDArray[np.float64],
) -> NDArray[np.float64]:
    """``(N, B)``; probability of each beam's reading from each pose; 1 where there is no reading.

    Args:
        belief: Whose sensor model it is, of robot 0.
        poses: ``(N, 3)``.
        scan: ``(B,)`` [m].
    """
    rows, log_p = belief.forecast(0, poses)
    bins = ReadingBins(belief.sensor.z_max, belief.config.reading_bin)
    readings = bins.index(check_scan(scan, belief.sensor))
    p = np.exp(log_p[np.maximum(readings, 0), rows].astype(np.float64))
    return np.where(readings >= 0, p, 1.0)
