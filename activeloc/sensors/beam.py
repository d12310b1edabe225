"""The beam model: a reading is a hit, an early hit, a missed echo or anything at all."""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, expm1, log1p, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sensors.readings import ReadingBins, nearest_range, spread_bearings


def check_beams(owner: str, beams: object, field_of_view: object, z_max: object) -> None:
    """Refuse a geometry that no scan can have.

    Raises:
        ConfigError: If the beams are not 1 to 4096, the field of view not in [0, 2 pi], the
            longest range not in (0, 10000], or one beam is asked for over a wide field of view.
    """
    checks.integer(f"{owner}.beams", beams, 1, 4096)
    checks.number(f"{owner}.field_of_view", field_of_view, 0.0, 2.0 * np.pi + 1e-9)
    checks.number(f"{owner}.z_max", z_max, 0.0, 1e4, above_low=True)


@njit(cache=True, nogil=True)
def _aim(
    z_expected: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    z_max: float,
    sigma: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (N,)`` with the probability that the normal distribution is below a hit's error.

    Args:
        z_expected: ``(N,)`` [m].
        uniforms: ``(N, 2)``; of the second: where between 0 and ``z_max`` the hit is.
        z_max: [m].
        sigma: [m].
        out: Overwritten.
    """
    for i in range(z_expected.shape[0]):
        expected = min(z_expected[i], z_max)
        low = 0.5 * erfc(expected / sigma / sqrt(2.0))
        high = 0.5 * erfc((expected - z_max) / sigma / sqrt(2.0))
        out[i] = min(max(low + uniforms[i, 1] * (high - low), 1e-300), 1.0 - 1e-16)


@njit(cache=True, nogil=True)
def _draw(
    z_expected: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    errors: NDArray[np.float64],
    z_max: float,
    rate: float,
    weights: tuple[float, float, float],
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (N,)`` with readings.

    Args:
        z_expected: ``(N,)`` [m].
        uniforms: ``(N, 2)``; which part of the mixture, where in it.
        errors: ``(N,)``; of a hit [m].
        z_max: [m].
        rate: Of early hits [1/m].
        weights: Of a hit, an early hit and a missed echo.
        out: Overwritten.
    """
    longest = np.nextafter(z_max, 0.0)
    for i in range(z_expected.shape[0]):
        expected, part, u = min(z_expected[i], z_max), uniforms[i, 0], uniforms[i, 1]
        short = weights[1] if expected > 0.0 else 0.0
        hit, missed = weights[0] + weights[1] - short, weights[2]
        if expected >= z_max:
            hit, missed = 0.0, weights[2] + weights[0]
        if part < hit:
            z = expected + errors[i]
        elif part < hit + short:
            z = -log1p(u * expm1(-rate * expected)) / rate
        elif part < hit + short + missed:
            out[i] = z_max
            continue
        else:
            z = u * z_max
        out[i] = min(max(z, 0.0), longest)


@dataclass(frozen=True, slots=True)
class BeamModel:
    """p(z | z*) = w_hit p_hit + w_short p_short + w_max p_max + w_rand p_rand.

    Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 6.3, with z* the exact expected
    range. p_hit is a Gaussian around z*, cut to ``[0, z_max)`` and normalised; p_short an
    exponential cut to ``[0, z*)``; p_max a point mass at ``z_max``; p_rand uniform. Where nothing
    is in range (z* >= z_max) a hit reads ``z_max``; where z* = 0 a short reading is a hit.

    Attributes:
        beams: Number of beams in a scan.
        field_of_view: Angle between the first and the last beam [rad].
        z_max: Longest range the sensor reports [m].
        sigma_hit: Standard deviation of a hit [m].
        lambda_short: Rate at which obstacles not on the map cut beams short [1/m].
        w_hit: Mixture weight of a hit.
        w_short: Mixture weight of an early hit.
        w_max: Mixture weight of a missed echo.
        w_rand: Mixture weight of a reading from anywhere.

    Raises:
        ConfigError: If a number is out of its range or the weights do not sum to one.
    """

    beams: int = 5
    field_of_view: float = float(2.0 * np.pi / 3.0)
    z_max: float = 1.5
    sigma_hit: float = 0.1
    lambda_short: float = 1.0
    w_hit: float = 0.90
    w_short: float = 0.05
    w_max: float = 0.03
    w_rand: float = 0.02

    def __post_init__(self) -> None:
        check_beams("BeamModel", self.beams, self.field_of_view, self.z_max)
        checks.number("BeamModel.sigma_hit", self.sigma_hit, 1e-6, 1e4)
        checks.number("BeamModel.lambda_short", self.lambda_short, 0.0, 1e4, above_low=True)
        weights = ("w_hit", "w_short", "w_max", "w_rand")
        for name in weights:
            checks.number(f"BeamModel.{name}", getattr(self, name), 0.0, 1.0)
        total = sum(getattr(self, name) for name in weights)
        if abs(total - 1.0) > 1e-6:
            raise ConfigError(f"BeamModel: {' + '.join(weights)} must be 1, got {total:g}")

    @property
    def bearings(self) -> NDArray[np.float64]:
        """``(B,)``; beam angles relative to the heading, right to left [rad]."""
        return spread_bearings(self.beams, self.field_of_view)

    @property
    def cone(self) -> NDArray[np.float64]:
        """See :attr:`ExpectedRangeSensor.cone`; a beam is thin."""
        return np.zeros(1)

    def expected(self, grid: OccupancyGrid, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """z*: exact range of each ray ``(..., 3)``, at most ``z_max`` [m]."""
        return nearest_range(grid, rays, self.cone, self.z_max)

    def _weights(
        self, z_expected: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Weights of hit, short and max once the cases z* = 0 and z* >= z_max are settled."""
        no_return = z_expected >= self.z_max
        w_short = np.where(z_expected > 0.0, self.w_short, 0.0)
        w_hit = np.where(no_return, 0.0, self.w_hit + self.w_short - w_short)
        w_max = self.w_max + np.where(no_return, self.w_hit, 0.0)
        return w_hit, w_short, w_max

    def cdf(self, z: NDArray[np.float64], z_expected: NDArray[np.float64]) -> NDArray[np.float64]:
        """P(reading <= z, below z_max | z*); the arguments broadcast.

        At ``z_max`` it is one less the point mass there.
        """
        z = np.clip(np.asarray(z, dtype=np.float64), 0.0, self.z_max)
        z_expected = np.minimum(np.asarray(z_expected, dtype=np.float64), self.z_max)
        w_hit, w_short, _ = self._weights(z_expected)
        low = ndtr(-z_expected / self.sigma_hit)
        high = ndtr((self.z_max - z_expected) / self.sigma_hit)
        hit = (ndtr((z - z_expected) / self.sigma_hit) - low) / (high - low)
        cut = np.maximum(z_expected, 1e-300)
        short = np.expm1(-self.lambda_short * np.minimum(z, cut)) / np.expm1(
            -self.lambda_short * cut
        )
        result: NDArray[np.float64] = w_hit * hit + w_short * short + self.w_rand * z / self.z_max
        return result

    def log_likelihood(
        self, z: NDArray[np.float64], z_expected: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Beam-by-beam log p(z | z*); the arguments broadcast.

        A log-density [log 1/m] below ``z_max``, a log-probability at it.
        """
        z = np.asarray(z, dtype=np.float64)
        z_expected = np.minimum(np.asarray(z_expected, dtype=np.float64), self.z_max)
        w_hit, w_short, w_max = self._weights(z_expected)
        scaled = (z - z_expected) / self.sigma_hit
        high, low = (self.z_max - z_expected) / self.sigma_hit, -z_expected / self.sigma_hit
        # ndtr(high) - ndtr(low), 1 / eta of table 6.1; one of the two is always near 0 or 1.
        kept = np.exp(log_ndtr(high)) - np.exp(log_ndtr(low))
        hit = np.exp(-0.5 * scaled**2) / (np.sqrt(2.0 * np.pi) * self.sigma_hit * kept)
        cut = np.maximum(z_expected, 1e-300)
        rate = self.lambda_short
        short = np.where(z <= z_expected, rate * np.exp(-rate * z) / -np.expm1(-rate * cut), 0.0)
        below = w_hit * hit + w_short * short + self.w_rand / self.z_max
        with np.errstate(divide="ignore"):
            result: NDArray[np.float64] = np.log(np.where(z < self.z_max, below, w_max))
        return result

    def masses(self, z_expected: NDArray[np.float64], bins: ReadingBins) -> NDArray[np.float64]:
        """P(reading in bin | z*): ``(..., Z)`` for ``(...)``; each row sums to one."""
        z_expected = np.asarray(z_expected, dtype=np.float64)[..., None]
        below = np.diff(self.cdf(bins.edges, z_expected), axis=-1)
        return np.concatenate([below, self._weights(z_expected)[2]], axis=-1)

    def bin_probabilities(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], bins: ReadingBins
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.bin_probabilities`."""
        return self.masses(self.expected(grid, rays), bins)

    def sample(
        self, z_expected: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Draw readings by inversion.

        Args:
            z_expected: ``(...)`` [m].
            uniforms: ``(..., 2)`` in [0, 1): which part of the mixture, where in it.

        Returns:
            ``(...)`` in [0, z_max] [m].
        """
        expected = np.ascontiguousarray(z_expected, dtype=np.float64).reshape(-1)
        uniforms = np.ascontiguousarray(uniforms, dtype=np.float64)
        flat = uniforms.reshape(-1, 2)
        out = np.empty(uniforms.shape[:-1])
        errors = np.empty(len(expected))
        _aim(expected, flat, self.z_max, self.sigma_hit, errors)
        ndtri(errors, out=errors)
        errors *= self.sigma_hit
        weights = self.w_hit, self.w_short, self.w_max
        _draw(expected, flat, errors, self.z_max, self.lambda_short, weights, out.reshape(-1))
        return out

    def read(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.read`."""
        return self.sample(self.expected(grid, rays), uniforms)
