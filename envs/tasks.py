"""The three problems: tracking, global localization, the kidnapped robot.

A task says what the robot knows at the start, whether somebody carries it off, and when it has
declared where it is. A *declaration* is made when at least ``confidence`` of the belief lies within
0.5 m and 20 degrees of the estimate for ``hold`` steps running; it ends the episode, right if the
truth lies in that window too, otherwise wrong and sure.

Of a kidnapped robot it is told besides (:class:`Watch`):

- *let go*: less than ``let_go`` of the belief lies within ``leap`` of the estimate, or the estimate
  has leapt ``leap`` or more from where the odometry takes the last one. A belief that is merely
  less than sure holds on: a robot that turns on open ground, where it sees nothing, forgets how it
  is turned, and remembers at the next wall.
- *noticed*: the belief let go at the step at which the robot was carried off, or later. Only then
  can it declare a wrong place: before, it is sure of where the robot has been. It can declare the
  right one at any time, for a robot carried a few steps away may be followed there.
- *recovered*: a right declaration after the kidnapping.
- *false alarm*: with nobody having carried it off, the belief was sure and right for ``hold`` steps
  running, and let go at a later step, of the truth: a leap to the truth, and a slow drift, is no
  alarm.

A robot that nobody carries off has nothing to declare. With ``kidnap="never"``, and with ``"rate"``
until it happens, the episode goes on to the limit; success is to be near the truth then without a
false alarm on the way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS
from activeloc.errors import ConfigError
from activeloc.motion import Terrain

KINDS = ("global", "kidnapped", "tracking")
KIDNAPS = ("never", "range", "rate")
FAR_TRIES = 1000
"""Poses drawn for one that is ``kidnap_distance`` away; if none is, the farthest is taken."""


@dataclass(frozen=True, slots=True)
class Task:
    """Start, kidnapping and success.

    Attributes:
        kind: ``global`` (the belief starts uniform), ``tracking`` (it starts near the truth; no
            declaration, the robot must still know where it is at the limit) or ``kidnapped`` (it
            starts near the truth, then the robot is carried to a random place and not told; a
            wrong declaration counts once the belief has let go).
        confidence: Probability near the estimate that a declaration needs.
        hold: Steps running for which it must last.
        let_go: A kidnapped robot's belief has let go when less than this is as near the estimate as
        leap: [m], or its estimate moves at least so far at once: farther than a belief that holds
            on is bent to fit a like place nearby.
        sigma_xy: Standard deviation of a start that is known [m].
        sigma_theta: Standard deviation of its heading [rad].
        kidnap: When a kidnapped robot is carried off, once: at a step in a ``range``, at a ``rate``
            per step, or ``never`` (the filter expects it all the same, so that its false alarms
            can be counted).
        kidnap_first: First step after which the robot may be carried off, of a range.
        kidnap_last: Last such step; each is equally likely.
        kidnap_rate: Probability that it happens at a step at which it has not happened yet.
        kidnap_distance: It is carried at least this far [m]; over the open ground that is so far
            away the new place is uniform. 0 for anywhere.
        kidnap_leak: What the filter of a kidnapped robot assumes at least: probability per step of
            being carried off.

    Raises:
        ConfigError: If a value is out of its range.
    """

    kind: str = "global"
    confidence: float = 0.95
    hold: int = 3
    let_go: float = 0.3
    leap: float = 2.0
    sigma_xy: float = 0.3
    sigma_theta: float = float(np.deg2rad(10.0))
    kidnap: str = "range"
    kidnap_first: int = 5
    kidnap_last: int = 15
    kidnap_rate: float = 0.02
    kidnap_distance: float = 0.0
    kidnap_leak: float = 1e-3

    def __post_init__(self) -> None:
        checks.choice("task.kind", self.kind, KINDS)
        checks.number("task.confidence", self.confidence, 0.0, 1.0, above_low=True)
        checks.integer("task.hold", self.hold, 1, 1_000_000)
        checks.number("task.let_go", self.let_go, 0.0, 1.0)
        checks.number("task.leap", self.leap, 0.0, 1e6, above_low=True)
        checks.number("task.sigma_xy", self.sigma_xy, 0.0, 1e3)
        checks.number("task.sigma_theta", self.sigma_theta, 0.0, np.pi)
        checks.choice("task.kidnap", self.kidnap, KIDNAPS)
        checks.integer("task.kidnap_first", self.kidnap_first, 1, 1_000_000)
        checks.integer("task.kidnap_last", self.kidnap_last, 1, 1_000_000)
        checks.number("task.kidnap_rate", self.kidnap_rate, 0.0, 1.0, above_low=True)
        checks.number("task.kidnap_distance", self.kidnap_distance, 0.0, 1e6)
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
        """Whether the robot may declare where it is, and so end the episode."""
        return self.kind != "tracking" and not (self.kind == "kidnapped" and self.kidnap == "never")

    def judges_now(self, kidnapped: bool) -> bool:
        """Whether right and wrong are a matter of the moment, for want of a declaration to come.

        Args:
            kidnapped: Whether the robot has been carried off.
        """
        if self.kind == "kidnapped":
            return self.kidnap != "range" and not kidnapped
        return not self.declares

    def kidnap_step(self, rng: np.random.Generator) -> int:
        """The step after which the robot is carried off; 0 for never.

        A range takes one draw from ``rng``, whether it is the task's or not, so that a robot that
        is never carried off lives as one that is, until then. A rate has a stream of its own.
        """
        step = int(rng.integers(self.kidnap_first, self.kidnap_last + 1))
        if self.kind != "kidnapped" or self.kidnap == "never":
            return 0
        return step if self.kidnap == "range" else int(rng.spawn(1)[0].geometric(self.kidnap_rate))

    def kidnap_pose(
        self,
        terrain: Terrain,
        pose: NDArray[np.float64],
        first: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Where a robot is carried to: ``(3,)``.

        Args:
            terrain: Where it can be.
            pose: Where it is.
            first: A pose uniform over the open ground: the answer if it is far enough away.
            rng: Source of others, in a stream of their own.
        """
        if distance(first, pose) >= self.kidnap_distance:
            return first
        poses = terrain.uniform_poses(rng.spawn(1)[0].random((FAR_TRIES, 4)))
        far = np.hypot(*(poses[:, :2] - pose[:2]).T)
        enough = np.flatnonzero(far >= self.kidnap_distance)
        return np.asarray(poses[enough[0] if len(enough) else far.argmax()])


@dataclass(slots=True)
class Watch:
    """What happens to one robot that may be carried off: the module's definitions, step by step.

    Attributes:
        task: The problem.
        kidnapped_at: Step at which it was carried off; -1 while it has not been.
        noticed_at: Step at which its belief let go after that; -1 while it has not.
        false_alarm: Whether its belief, sure and right, gave up with nobody having touched it.
    """

    task: Task
    kidnapped_at: int = -1
    noticed_at: int = -1
    false_alarm: bool = False
    _knew: int = field(default=0)

    @property
    def kidnapped(self) -> bool:
        """Whether it has been carried off."""
        return self.kidnapped_at >= 0

    @property
    def noticed(self) -> bool:
        """Whether its belief has let go since."""
        return self.noticed_at >= 0

    @property
    def notice_steps(self) -> int:
        """Steps from the kidnapping to letting go: 0 if the first scan did it; -1 for not."""
        return self.noticed_at - self.kidnapped_at if self.noticed else -1

    def recover_steps(self, step: int, right: bool) -> int:
        """Steps from the kidnapping to a right declaration; -1 for none.

        Args:
            step: The last step.
            right: Whether a right declaration was made at it.
        """
        return step - self.kidnapped_at if right and self.kidnapped else -1

    def may_declare(self, near: bool) -> bool:
        """Whether a declaration counts now; ``near`` says whether it would be right."""
        return self.noticed or (self.kidnapped and near)

    def see(self, step: int, knows: bool, held: float, near: bool, leapt: float) -> None:
        """Take note of a belief.

        Args:
            step: Steps taken.
            knows: Whether it is sure, and right.
            held: Its mass within ``leap`` of the estimate.
            near: Whether the truth is near the estimate.
            leapt: How far the estimate is from where the odometry takes the one before [m].
        """
        scattered, leaps = held < self.task.let_go, leapt >= self.task.leap
        if self.kidnapped:
            if (scattered or leaps) and not self.noticed:
                self.noticed_at = step
        elif self._knew >= self.task.hold:
            self.false_alarm |= scattered or (leaps and not near)
        else:
            self._knew = self._knew + 1 if knows else 0


def distance(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Between two poses ``(3,)`` [m]."""
    return hypot(one[0] - other[0], one[1] - other[1])


def pose_error(estimate: NDArray[np.float64], truth: NDArray[np.float64]) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses ``(3,)``."""
    return distance(estimate, truth), abs(_wrapped(float(estimate[2] - truth[2])))


def carried(pose: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the odometry's reading ``(3,)`` takes a pose ``(3,)``."""
    x, y, theta = pose.tolist()
    rot1, trans, rot2 = u.tolist()
    heading = theta + rot1
    step = trans * cos(heading), trans * sin(heading)
    return np.array([x + step[0], y + step[1], _wrapped(heading + rot2)])


def _wrapped(angle: float) -> float:
    """:func:`activeloc.motion.wrap` of one number."""
    result = (angle + pi) % (2.0 * pi) - pi
    return -pi if result >= pi else result


def is_near(error_m: float, error_rad: float) -> bool:
    """Whether an error is within 0.5 m and 20 degrees."""
    return error_m <= NEAR_RADIUS and error_rad <= NEAR_ANGLE
