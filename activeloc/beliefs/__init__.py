"""Beliefs: p(x | z, u), the robot's knowledge of its pose.

A belief object holds B robots; each has its own map, its own prior and its own past. A step of one
is :meth:`~Belief.predict` with the odometry's reading, then :meth:`~Belief.correct` with the scan.

======================================================  ===========================================
:class:`~activeloc.beliefs.histogram.HistogramBelief`   A grid over the map and all headings.
:class:`~activeloc.beliefs.particles.ParticleBelief`    Monte Carlo localization.
======================================================  ===========================================

Sources: Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), chapters 4 and 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.place import PlaceMemory
from activeloc.motion import Terrain

NEAR_RADIUS = 0.5
NEAR_ANGLE = float(np.deg2rad(20.0))


@dataclass(frozen=True, slots=True)
class Summary:
    """What a belief says in short.

    Attributes:
        entropy: On the common bins [nat].
        uniform_entropy: Entropy of the uniform belief over the open ground, on the same bins [nat].
        estimate: ``(3,)``; the most likely pose: the mean of the mass around the mode.
        mass: Probability within 0.5 m and 20 degrees of the estimate.
    """

    entropy: float
    uniform_entropy: float
    estimate: NDArray[np.float64]
    mass: float


class Belief(Protocol):
    """What environments and planners need of a belief over B robots."""

    n_robots: int

    def terrain(self, robot: int) -> Terrain:
        """Where the robot can be on its map."""
        ...

    def bins(self, robot: int) -> CommonBins:
        """The bins of its entropy."""
        ...

    def place(self, robot: int) -> PlaceMemory:
        """What it has read and touched where it stands."""
        ...

    def predict(self, robot: int, u: NDArray[np.float64], touched: bool) -> None:
        """bel_bar(x') = sum over x of p(x' | u, x, m) bel(x)."""
        ...

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """bel(x) = eta p(z | x, m) bel_bar(x); returns the log-evidence, -inf if impossible."""
        ...

    def summarise(self, robot: int) -> Summary:
        """Entropy, estimate and the mass around it."""
        ...

    def mass_near(
        self,
        robot: int,
        pose: NDArray[np.float64],
        radius: float = NEAR_RADIUS,
        angle: float = NEAR_ANGLE,
    ) -> float:
        """Probability within ``radius`` [m] and ``angle`` [rad] of a pose ``(3,)``."""
        ...

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """The belief summed on ``(headings, rows, cols)`` over the map's bounding square."""
        ...

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Poses ``(n, 3)`` drawn from the belief."""
        ...

    def thinned(self, robot: int, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The belief as n hypotheses: poses ``(m, 3)``, and how many of them are at each ``(m,)``.

        They follow from the belief alone: nothing random is used up.
        """
        ...

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """What the beams would read from poses ``(N, 3)``, as this belief weighs readings.

        Returns:
            Row ``(N, B)`` for each pose and beam, and ``(Z, R)`` of log P(reading in bin | row).
        """
        ...

    def copy(self) -> Any:
        """An independent belief, to be advanced in imagination."""
        ...
