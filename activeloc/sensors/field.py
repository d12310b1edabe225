"""The likelihood field: how near does a beam's end come to an obstacle?"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sensors.beam import check_beams
from activeloc.sensors.readings import ReadingBins, spread_bearings

NOTHING = 1e-12
"""A ray along which the nearness sums to no more can hit nothing."""


@njit(cache=True, nogil=True)
def _fill_masses(
    near: NDArray[np.float64],
    rays: NDArray[np.float64],
    reach: NDArray[np.float64],
    parts: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Fill ``out[i]`` with the bin probabilities of ray i.

    Args:
        near: ``(H, W)`` of exp(-d^2 / 2 sigma^2) at each cell's centre.
        rays: ``(N, 3)`` of column, row [cell], direction.
        reach: ``(Z - 1,)`` of the bins' centres [cell].
        parts: w_hit, w_max, w_rand.
        out: ``(N, Z)``, overwritten.
    """
    height, width = near.shape
    n_bins = reach.shape[0]
    for i in range(rays.shape[0]):
        dx, dy = np.cos(rays[i, 2]), np.sin(rays[i, 2])
        total = 0.0
        for z in range(n_bins):
            col, row = (
                int(np.floor(rays[i, 0] + reach[z] * dx)),
                int(np.floor(rays[i, 1] + reach[z] * dy)),
            )
            inside = 0 <= row < height and 0 <= col < width
            out[i, z] = near[row, col] if inside else 0.0
            total += out[i, z]
        # Nothing near the beam at any range: the hit's mass is a missed echo.
        scale = parts[0] / total if total > NOTHING else 0.0
        for z in range(n_bins):
            out[i, z] = scale * out[i, z] + parts[2] / n_bins
        out[i, n_bins] = parts[1] + (0.0 if total > NOTHING else parts[0])


@lru_cache(maxsize=8)
def _near(grid: OccupancyGrid, sigma_hit: float) -> NDArray[np.float64]:
    """See :meth:`LikelihoodField.near`."""
    distance = ndimage.distance_transform_edt(np.pad(grid.free, 1))[1:-1, 1:-1]
    result: NDArray[np.float64] = np.exp(-0.5 * (distance * grid.resolution / sigma_hit) ** 2)
    result.flags.writeable = False  # It is kept and shared.
    return result


@dataclass(frozen=True, slots=True)
class LikelihoodField:
    """p(z | x, m) proportional to a Gaussian of the end point's distance to the nearest obstacle.

    Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 6.4, made a probability: along
    each ray the hit part is normalised over the readings below ``z_max`` (the book leaves it
    unnormalised, which favours poses beside clutter). It sees through walls, is smooth in the
    pose, and needs no ray casting. The density is constant over each bin of ``reading_bin``.

    Attributes:
        beams: Number of beams in a scan.
        field_of_view: Angle between the first and the last beam [rad].
        z_max: Longest range the sensor reports [m].
        sigma_hit: Standard deviation of the end point's distance [m].
        w_hit: Mixture weight of a hit.
        w_max: Mixture weight of a missed echo.
        w_rand: Mixture weight of a reading from anywhere.
        reading_bin: Greatest width of the bins to which the density is resolved [m].

    Raises:
        ConfigError: If a number is out of its range or the weights do not sum to one.
    """

    beams: int = 5
    field_of_view: float = float(2.0 * np.pi / 3.0)
    z_max: float = 1.5
    sigma_hit: float = 0.1
    w_hit: float = 0.90
    w_max: float = 0.05
    w_rand: float = 0.05
    reading_bin: float = 0.05

    def __post_init__(self) -> None:
        check_beams("LikelihoodField", self.beams, self.field_of_view, self.z_max)
        checks.number("LikelihoodField.sigma_hit", self.sigma_hit, 1e-6, 1e4)
        for name in ("w_hit", "w_max", "w_rand"):
            checks.number(f"LikelihoodField.{name}", getattr(self, name), 0.0, 1.0)
        total = self.w_hit + self.w_max + self.w_rand
        if abs(total - 1.0) > 1e-6:
            raise ConfigError(f"LikelihoodField: w_hit + w_max + w_rand must be 1, got {total:g}")
        ReadingBins(self.z_max, self.reading_bin)

    @property
    def bearings(self) -> NDArray[np.float64]:
        """``(B,)``; beam angles relative to the heading, right to left [rad]."""
        return spread_bearings(self.beams, self.field_of_view)

    def near(self, grid: OccupancyGrid) -> NDArray[np.float64]:
        """exp(-d^2 / 2 sigma^2) of each cell's distance d to the nearest blocked one: ``(H, W)``.

        Measured between cell centres; the outside of the map is blocked.
        """
        return _near(grid, self.sigma_hit)

    def bin_probabilities(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], bins: ReadingBins
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.bin_probabilities`."""
        flat = np.asarray(rays, dtype=np.float64).reshape(-1, 3)
        in_cells = np.column_stack([grid.to_cells(flat[:, :2]), flat[:, 2]])
        own = ReadingBins(self.z_max, self.reading_bin)
        centres = 0.5 * (own.edges[1:] + own.edges[:-1]) / grid.resolution
        out = np.empty((len(flat), len(own)))
        parts = np.array([self.w_hit, self.w_max, self.w_rand])
        _fill_masses(self.near(grid), in_cells, centres, parts, out)
        # Whatever bins a filter sorts readings into, they are of the density that is sampled.
        below = out[:, :-1] @ own.shares(bins)
        return np.column_stack([below, out[:, -1]]).reshape(*np.shape(rays)[:-1], len(bins))

    def read(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.read`: a bin by its probability, then uniform inside it."""
        bins = ReadingBins(self.z_max, self.reading_bin)
        cumulative = self.bin_probabilities(grid, rays, bins).cumsum(axis=-1)
        chosen = (uniforms[..., :1] * cumulative[..., -1:] >= cumulative).sum(axis=-1)
        last = len(bins) - 1
        step = self.z_max / last
        return np.where(chosen >= last, self.z_max, (chosen + uniforms[..., 1]) * step)
