"""Filters with a known fault, to show that the tests of calibration find it.

Each is a fault that public localization code has had.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Summary
from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.resampling import SCHEMES, effective_sample_size
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.calibration.posterior import likelihoods
from activeloc.configuration import unknown
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel
from activeloc.sensors import RangeSensor

DEFECTS = {
    "sigma": "the filter takes the sensor for a fifth better than it is",
    "cubed": "a scan's likelihood is the sum of its beams' cubes, not their product",
    "kept-weights": "particles keep their weights when they are resampled",
    "half-cell": "cells are taken to lie half a cell to the right of where they are",
    "flipped": "turns are taken the wrong way round",
}
"""What can be planted, by name."""

HALF_CELL = 0.1  # For a filter without cells [m].


class _FlippedHistogram(HistogramBelief):
    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """As if counter-clockwise were clockwise."""
        super().predict(robot, u * [-1.0, 1.0, -1.0], touched)


class _FlippedParticles(ParticleBelief):
    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """As if counter-clockwise were clockwise."""
        super().predict(robot, u * [-1.0, 1.0, -1.0], touched)


class _CubedHistogram(HistogramBelief):
    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """Weigh by sum over beams of p(z_b | x)^3."""
        grid, bel = self.poses(robot), self.probabilities(robot).astype(np.float64)
        cell, heading = np.divmod(np.arange(bel.size), grid.headings)
        poses = np.column_stack([grid.centres[cell], grid.thetas[heading]])
        p = likelihoods(self, poses, scan)
        bel *= (p**3).sum(axis=1).reshape(bel.shape)
        total = bel.sum()
        self.reset(robot, grid.terrain.grid, bel / total)
        return float(np.log(total))


class _OwnWeights(ParticleBelief):
    """Particles whose weights are kept beside them, by the subclass's own rule.

    Resampling draws as the sound filter does, and always as many.
    """

    def reset(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        poses: NDArray[np.float64] | None = None,
    ) -> None:
        """As the sound filter's."""
        super().reset(robot, grid, rng, poses)
        self._grid, self._rng = grid, rng
        n = len(super().particles(robot)[0])
        self._own = np.full(n, 1.0 / n)

    def particles(self, robot: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses and the own weights."""
        return super().particles(robot)[0], self._own.copy()

    def summarise(self, robot: int) -> Summary:
        """Of a cloud of equal particles drawn by the own weights."""
        poses, weights = self.particles(robot)
        twin = ParticleBelief(1, self.config, self.sensor, self.motion)
        chosen = SCHEMES["systematic"](weights, len(weights), np.array([0.5]))
        twin.reset(0, self._grid, self._rng, poses[chosen])
        return twin.summarise(0)

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """Weigh by :meth:`_joint`, then resample if need be."""
        poses, weights = self.particles(robot)
        weights *= self._joint(likelihoods(self, poses, scan))
        total = weights.sum()
        self._own = weights = weights / total
        n = len(weights)
        if effective_sample_size(weights) < self.config.ess_ratio * n:
            chosen = SCHEMES[self.config.resampling](weights, n, self._rng.random(n))
            self.reset(robot, self._grid, self._rng, poses[chosen])
            self._own = self._after(weights[chosen])
        return float(np.log(total))

    def _joint(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """A scan's likelihood ``(N,)`` from its beams' ``(N, B)``."""
        return np.asarray(p.prod(axis=1))

    def _after(self, chosen: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weights after resampling, from those that the survivors had."""
        return np.full(len(chosen), 1.0 / len(chosen))


class _CubedParticles(_OwnWeights):
    def _joint(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((p**3).sum(axis=1))


class _KeptWeights(_OwnWeights):
    def _after(self, chosen: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(chosen / chosen.sum())


_HISTOGRAMS = {"cubed": _CubedHistogram, "flipped": _FlippedHistogram}
_PARTICLES = {
    "cubed": _CubedParticles,
    "flipped": _FlippedParticles,
    "kept-weights": _KeptWeights,
}


def make_defective(
    defect: str | None,
    grid: OccupancyGrid,
    config: HistogramConfig | ParticleConfig,
    sensor: RangeSensor,
    motion: MotionModel,
) -> tuple[OccupancyGrid, HistogramBelief | ParticleBelief]:
    """The filter of one robot with a defect, and the map that it believes in.

    Args:
        defect: Name; a sound filter if None.
        grid: The true map.
        config: Settings.
        sensor: What a sound filter would assume.
        motion: What a sound filter would assume.

    Raises:
        ConfigError: If there is no such defect, or not in this filter or for this sensor.
    """
    if defect is not None and defect not in DEFECTS:
        raise unknown("defect", defect, DEFECTS)
    if defect == "sigma":
        sensor = _sharpened(sensor)
    if defect == "half-cell":
        shift = HALF_CELL if isinstance(config, ParticleConfig) else config.cell_size / 2.0
        grid = replace(grid, origin=(grid.origin[0] + shift, grid.origin[1]))
    if isinstance(config, ParticleConfig):
        return grid, _PARTICLES.get(str(defect), ParticleBelief)(1, config, sensor, motion)
    if defect == "kept-weights":
        raise ConfigError("defect kept-weights is the particle filter's; belief is 'histogram'")
    return grid, _HISTOGRAMS.get(str(defect), HistogramBelief)(1, config, sensor, motion)


def _sharpened(sensor: RangeSensor) -> RangeSensor:
    given: Any = sensor
    if not hasattr(given, "sigma_hit"):
        raise ConfigError(f"defect sigma: {type(given).__name__} has no sigma_hit")
    result: RangeSensor = replace(given, sigma_hit=0.8 * given.sigma_hit)
    return result
