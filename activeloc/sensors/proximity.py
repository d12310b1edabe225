"""The proximity model: a reading comes from an obstacle on the map or from one that is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sensors.beam import check_beams
from activeloc.sensors.readings import ReadingBins, nearest_range, spread_bearings


@dataclass(frozen=True, slots=True)
class ProximityModel:
    """P(d_i | l): reflected by a known or by an unknown obstacle, step of range by step of range.

    Fox, Burgard & Thrun, "Markov localization for mobile robots in dynamic environments", JAIR 11
    (1999), section 3.2, and the localization lectures after it::

        P(d_i | l) = 1 - (1 - (1 - sum_{j<i} P_u(d_j)) c_d P_m(d_i | l))
                         (1 - (1 - sum_{j<i} P(d_j | l)) c_r)

        P_u(d_i)   = c_r (1 - sum_{j<i} P_u(d_j)),  so  1 - sum_{j<i} P_u(d_j) = (1 - c_r)^i
        P(z_max)   = 1 - sum_i P(d_i | l)

    A reading is in step d_i if the known obstacle is seen there, no unknown one having been met
    before, or if an unknown one is, nothing having been read before; what is left over at the end
    is a maximum-range reading. P_m(d_i | l) is a Gaussian around the expected range z*, integrated
    over the step, cut to ``[0, z_max)`` and normalised; where nothing is in range (z* >= z_max)
    there is no known obstacle. The formula joins the two causes as if they were independent, and
    stays a probability for sure only while c_d <= 1 - c_r, which is therefore asked for. Within a
    step the density is constant.

    The defaults are those of :meth:`laser`.

    Attributes:
        beams: Number of beams in a scan.
        field_of_view: Angle between the first and the last beam [rad].
        z_max: Longest range the sensor reports [m].
        sigma_hit: Standard deviation of a known obstacle's range [m].
        p_known: c_d; probability that the sensor sees the known obstacle.
        p_unknown: c_r; probability that an unknown obstacle is in a step of range.
        step: Greatest length of a step of range [m]; the steps divide ``z_max`` evenly.

    Raises:
        ConfigError: If a number is out of its range, or ``p_known + p_unknown`` is above one.
    """

    beams: int = 5
    field_of_view: float = float(2.0 * np.pi / 3.0)
    z_max: float = 1.5
    sigma_hit: float = 0.05
    p_known: float = 0.95
    p_unknown: float = 0.002
    step: float = 0.05

    def __post_init__(self) -> None:
        owner = type(self).__name__
        check_beams(owner, self.beams, self.field_of_view, self.z_max)
        checks.number(f"{owner}.sigma_hit", self.sigma_hit, 1e-6, 1e4)
        checks.number(f"{owner}.p_known", self.p_known, 0.0, 1.0)
        checks.number(f"{owner}.p_unknown", self.p_unknown, 0.0, 1.0)
        total = self.p_known + self.p_unknown
        if total > 1.0 + 1e-12:
            raise ConfigError(f"{owner}: p_known + p_unknown must be at most 1, got {total:g}")
        checks.number(f"{owner}.step", self.step, 0.0, self.z_max, above_low=True)
        if self.z_max / self.step > 4096:
            raise ConfigError(
                f"{owner}.step {self.step:g} m gives {self.z_max / self.step:.0f} steps up to "
                f"z_max {self.z_max:g} m; at most 4096 are allowed"
            )

    @classmethod
    def laser(cls) -> ProximityModel:
        """A laser range finder: narrow, and it sees nearly every wall."""
        return cls(sigma_hit=0.05, p_known=0.95, p_unknown=0.002)

    @classmethod
    def sonar(cls) -> ProximityModel:
        """A sonar's law along a thin beam: wide, with many echoes missed and many too early."""
        return cls(sigma_hit=0.15, p_known=0.8, p_unknown=0.01)

    @property
    def bearings(self) -> NDArray[np.float64]:
        """``(B,)``; beam angles relative to the heading, right to left [rad]."""
        return spread_bearings(self.beams, self.field_of_view)

    @property
    def cone(self) -> NDArray[np.float64]:
        """See :attr:`ExpectedRangeSensor.cone`; a beam is thin."""
        return np.zeros(1)

    @property
    def steps(self) -> ReadingBins:
        """The steps of range d_i, and after them ``z_max``."""
        return ReadingBins(self.z_max, self.step)

    def expected(self, grid: OccupancyGrid, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """See :meth:`ExpectedRangeSensor.expected`."""
        return nearest_range(grid, rays, self.cone, self.z_max)

    def known(self, z_expected: NDArray[np.float64]) -> NDArray[np.float64]:
        """P_m(d_i | z*): ``(..., n)`` over the n steps of range for ``(...)``.

        Each row sums to one, or to zero where nothing is in range.
        """
        z_expected = np.asarray(z_expected, dtype=np.float64)[..., None]
        scaled = (self.steps.edges - np.minimum(z_expected, self.z_max)) / self.sigma_hit
        mass = np.diff(ndtr(scaled), axis=-1)
        result: NDArray[np.float64] = np.where(
            z_expected >= self.z_max, 0.0, mass / mass.sum(axis=-1, keepdims=True)
        )
        return result

    def step_probabilities(self, z_expected: NDArray[np.float64]) -> NDArray[np.float64]:
        """P(d_i | z*) and after them P(z_max | z*): ``(..., n + 1)`` for ``(...)``."""
        known = self.known(z_expected)
        n = known.shape[-1]
        result = np.empty((*known.shape[:-1], n + 1))
        unread = np.ones(known.shape[:-1])
        for i in range(n):
            seen = (1.0 - self.p_unknown) ** i * self.p_known * known[..., i]
            result[..., i] = 1.0 - (1.0 - seen) * (1.0 - unread * self.p_unknown)
            unread = unread - result[..., i]
        # At p_known + p_unknown = 1 what is left over is zero but for rounding.
        result[..., n] = np.maximum(unread, 0.0)
        return result

    def masses(self, z_expected: NDArray[np.float64], bins: ReadingBins) -> NDArray[np.float64]:
        """See :meth:`ExpectedRangeSensor.masses`."""
        p = self.step_probabilities(z_expected)
        below = p[..., :-1] @ self.steps.shares(bins)
        return np.concatenate([below, p[..., -1:]], axis=-1)

    def bin_probabilities(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], bins: ReadingBins
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.bin_probabilities`."""
        return self.masses(self.expected(grid, rays), bins)

    def sample(
        self, z_expected: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Draw readings: a step by its probability, then uniform inside it.

        Args:
            z_expected: ``(...)`` [m].
            uniforms: ``(..., 2)`` in [0, 1): which step, where in it.

        Returns:
            ``(...)`` in [0, z_max] [m].
        """
        cumulative = self.step_probabilities(z_expected).cumsum(axis=-1)
        n = cumulative.shape[-1] - 1
        chosen = (uniforms[..., :1] * cumulative[..., -1:] >= cumulative).sum(axis=-1)
        z = (chosen + uniforms[..., 1]) * (self.z_max / n)
        result: NDArray[np.float64] = np.where(
            chosen >= n, self.z_max, np.minimum(z, np.nextafter(self.z_max, 0.0))
        )
        return result

    def read(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.read`."""
        return self.sample(self.expected(grid, rays), uniforms)
