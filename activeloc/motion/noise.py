"""How far a motion strays from what was asked or read."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import hypot

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks


@njit(cache=True, nogil=True)
def fill_sigmas(
    u: NDArray[np.float64],
    rotation_from_rotation: float,
    rotation_from_translation: float,
    translation_from_translation: float,
    translation_from_rotation: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (N, 3)`` with the standard deviations of motions ``(N, 3)``."""
    for i in range(u.shape[0]):
        by_travel = rotation_from_translation * u[i, 1]
        out[i, 0] = hypot(rotation_from_rotation * u[i, 0], by_travel)
        out[i, 1] = hypot(
            translation_from_translation * u[i, 1],
            translation_from_rotation * hypot(u[i, 0], u[i, 2]),
        )
        out[i, 2] = hypot(rotation_from_rotation * u[i, 2], by_travel)


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """How far a motion strays: four coefficients, each a standard deviation per unit of motion.

    The odometry model of Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), table 5.6; the
    squares of the fields are the book's alpha_1 ... alpha_4, in its order. The two contributions
    to one motion add up in variance.

    Attributes:
        rotation_from_rotation: Of a rotation, per radian rotated [rad / rad].
        rotation_from_translation: Of each rotation, per metre travelled [rad / m].
        translation_from_translation: Of the translation, per metre travelled [m / m].
        translation_from_rotation: Of the translation, per radian rotated [m / rad].

    Raises:
        ConfigError: If a coefficient is not a number in [0, 10].
    """

    rotation_from_rotation: float = 0.0
    rotation_from_translation: float = 0.0
    translation_from_translation: float = 0.0
    translation_from_rotation: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            checks.number(f"{type(self).__name__}.{item.name}", getattr(self, item.name), 0.0, 10.0)

    @property
    def coefficients(self) -> tuple[float, float, float, float]:
        """The four, in the order above."""
        return (
            float(self.rotation_from_rotation),
            float(self.rotation_from_translation),
            float(self.translation_from_translation),
            float(self.translation_from_rotation),
        )

    def sigma(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviations of the three parts of motions ``(..., 3)``: an array like ``u``."""
        u = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty_like(u)
        fill_sigmas(u.reshape(-1, 3), *self.coefficients, out.reshape(-1, 3))
        return out
