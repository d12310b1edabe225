"""Sonar: a beam is a cone, and the nearest echo in it wins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import ConfigError
from activeloc.sensors.proximity import ProximityModel


@dataclass(frozen=True, slots=True)
class Sonar(ProximityModel):
    """The proximity model, with a cone of rays for each beam.

    z* is the nearest of the exact ranges in ``cone_rays`` directions, spread evenly over the
    opening angle, its two ends included. The filters take the nearest at each pose, before they
    average over a cell. Parameters are :meth:`ProximityModel.sonar`'s unless given.

    Attributes:
        opening: Opening angle of a beam's cone [rad].
        cone_rays: Number of rays in it.

    Raises:
        ConfigError: If a number is out of its range, or one ray is asked for over an open cone.
    """

    sigma_hit: float = 0.15
    p_known: float = 0.8
    p_unknown: float = 0.01
    opening: float = float(np.deg2rad(25.0))
    cone_rays: int = 5

    def __post_init__(self) -> None:
        # super() without arguments is lost in a dataclass with slots.
        ProximityModel.__post_init__(self)
        checks.number("Sonar.opening", self.opening, 0.0, np.pi)
        checks.integer("Sonar.cone_rays", self.cone_rays, 1, 64)
        if self.cone_rays == 1 and self.opening > 0.0:
            raise ConfigError(
                f"Sonar: one cone_ray cannot spread over an opening of {self.opening:g} rad; "
                "allowed are 2 to 64 rays, or an opening of 0"
            )

    @property
    def cone(self) -> NDArray[np.float64]:
        """See :attr:`ExpectedRangeSensor.cone`."""
        if self.opening == 0.0:
            return np.zeros(1)
        return np.linspace(-0.5, 0.5, self.cone_rays) * self.opening
