"""The three problems: tracking, global localization, the kidnapped robot.

A task says what the robot knows at the start, whether somebody carries it off, and when it has
declared where it is. A *declaration* is made when at least ``confidence`` of the belief lies within
0.5 m and 20 degrees of the estimate for ``hold`` steps running; it ends the episode, right if the
truth lies in that window too, otherwise wrong and sure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS
from activeloc.errors import ConfigError
from activeloc.motion import wrap

KINDS = ("global", "kidnapped", "tracking")


@dataclass(frozen=True, slots=True)
class Task:
    """Start, kidnapping and success.

    Attributes:
        kind: ``global`` (the belief starts uniform), ``tracking`` (it starts near the truth; no
            declaration, the robot must still know where it is at the limit) or ``kidnapped`` (it
            starts near the truth, then the robot is carried to a random place and not told; a
            declaration counts once the belief has let go).
        confidence: Probability near the estimate that a declaration needs.
        hold: Steps running for which it must last.
        sigma_xy: Standard deviation of a start that is known [m].
        sigma_theta: Standard deviation of its heading [rad].
        kidnap_first: First step after which the robot may be carried off.
        kidnap_last: Last such step; each is equally likely.
        kidnap_leak: What the filter assumes: probability per step of being carried off.

    Raises:
        ConfigError: If a value is out of its range.
    """

    kind: str = "global"
    confidence: float = 0.95
    hold: int = 3
    sigma_xy: float = 0.3
    sigma_theta: float = float(np.deg2rad(10.0))
    kidnap_first: int = 5
    kidnap_last: int = 15
    kidnap_leak: float = 1e-3

    def __post_init__(self) -> None:
        checks.choice("task.kind", self.kind, KINDS)
        checks.number("task.confidence", self.confidence, 0.0, 1.0, above_low=True)
        checks.integer("task.hold", self.hold, 1, 1_000_000)
        checks.number("task.sigma_xy", self.sigma_xy, 0.0, 1e3)
        checks.number("task.sigma_theta", self.sigma_theta, 0.0, np.pi)
        checks.integer("task.kidnap_first", self.kidnap_first, 1, 1_000_000)
        checks.integer("task.kidnap_last", self.kidnap_last, 1, 1_000_000)
        checks.number("task.kidnap_leak", self.kidnap_leak, 0.0, 1.0)
        if self.kidnap_first > self.kidnap_last:
            raise ConfigError(
                "task.kidnap_first must be at most task.kidnap_last; "
                f"got {self.kidnap_first} and {self.kidnap_last}"
            )

    @property
    def start_known(self) -> bool:
        """Whether the belief starts near the truth."""
        return self.kind != "global"

    @property
    def declares(self) -> bool:
        """Whether the robot declares where it is, and so ends the episode."""
        return self.kind != "tracking"


def pose_error(estimate: NDArray[np.float64], truth: NDArray[np.float64]) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses ``(3,)``."""
    distance = float(np.hypot(*(estimate[:2] - truth[:2])))
    return distance, float(abs(wrap(estimate[2] - truth[2])))


def is_near(error_m: float, error_rad: float) -> bool:
    """Whether an error is within 0.5 m and 20 degrees."""
    return error_m <= NEAR_RADIUS and error_rad <= NEAR_ANGLE
