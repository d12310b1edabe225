"""One robot's episode on a metric map: what has happened, and how it is judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Summary
from activeloc.envs.rewards import RewardWeights
from activeloc.envs.tasks import Task, Watch, carried, distance, is_near, pose_error


@dataclass(slots=True)
class Episode:
    """One robot's episode.

    Attributes:
        task: The problem.
        rng: Source of all that is random in the world.
        novelty_rng: And in the novelty filter.
        summary: What the belief says in short.
        scan: ``(B,)`` last scan [m].
        kidnap_step: The step after which the robot is carried off; 0 for never.
        kidnap_pose: ``(3,)``; where to, if
        kidnap_given: a caller has said so; otherwise the first that is tried.
        u: ``(3,)`` last odometry reading; zeros at the start.
        touched: Whether the last motion was stopped by an obstacle.
        step: Steps taken.
        held: For how many steps running the belief has been sure.
        impossible: Scans so far that no pose explained.
        dropped: Beams that the novelty filter has left out so far.
        over: Whether a declaration has ended the episode,
        right: rightly,
        wrong: or wrongly.
        terms: Of the last step's reward.
        watch: What happens to a robot that may be carried off.
    """

    task: Task
    rng: np.random.Generator
    novelty_rng: np.random.Generator
    summary: Summary
    scan: NDArray[np.float64]
    kidnap_step: int
    kidnap_pose: NDArray[np.float64]
    kidnap_given: bool = False
    u: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    touched: bool = False
    step: int = 0
    held: int = 0
    impossible: int = 0
    dropped: int = 0
    over: bool = False
    right: bool = False
    wrong: bool = False
    terms: dict[str, float] = field(default_factory=dict)
    watch: Watch = field(init=False)

    def __post_init__(self) -> None:
        self.watch = Watch(self.task)

    @property
    def entropy_fraction(self) -> float:
        """Entropy of the belief as a fraction of the uniform belief's."""
        return self.summary.entropy / max(self.summary.uniform_entropy, 1e-9)

    @property
    def reward(self) -> float:
        """The last step's."""
        return float(sum(self.terms.values()))

    def begin(self, held: float, truth: NDArray[np.float64]) -> None:
        """Take note of the belief after the first scan.

        Args:
            held: See :meth:`judge`.
            truth: ``(3,)``; where the robot is.
        """
        self._watch(self.summary.estimate, held, truth)

    def judge(
        self,
        summary: Summary,
        held: float,
        weights: RewardWeights,
        truth: NDArray[np.float64],
    ) -> None:
        """Take in the belief after a step: has it declared, and what is that worth?

        Args:
            summary: Of the belief.
            held: Its mass within ``task.leap`` of the estimate; of a robot that may be carried off.
            weights: Of the reward's terms.
            truth: ``(3,)``; where the robot is.
        """
        before, last = self.entropy_fraction, self.summary.estimate
        self.summary = summary
        self._watch(carried(last, self.u), held, truth)
        self._declare(truth)
        self.terms = weights.terms(before, self.entropy_fraction, self.right, self.wrong)

    def _watch(
        self, reckoned: NDArray[np.float64], held: float, truth: NDArray[np.float64]
    ) -> None:
        """Take note of what a robot believes that may be carried off.

        Args:
            reckoned: ``(3,)``; where the odometry takes the estimate before.
            held: See :meth:`judge`.
            truth: ``(3,)``; where it is.
        """
        if self.task.kind == "kidnapped":
            estimate, sure = self.summary.estimate, self.summary.mass >= self.task.confidence
            near = is_near(*pose_error(estimate, truth))
            self.watch.see(self.step, sure and near, held, near, distance(estimate, reckoned))

    def _declare(self, truth: NDArray[np.float64]) -> None:
        """End the episode when the belief has been sure for long enough."""
        task = self.task
        sure = self.summary.mass >= task.confidence
        near = is_near(*pose_error(self.summary.estimate, truth))
        armed = task.kind != "kidnapped" or self.watch.may_declare(near)
        self.held = self.held + 1 if sure and armed else 0
        if task.declares and self.held >= task.hold:
            self.over, self.right, self.wrong = True, near, not near

    def info(self, weights: RewardWeights, truth: NDArray[np.float64]) -> dict[str, Any]:
        """See :meth:`activeloc.envs.episodes.Episodes.info`.

        Args:
            weights: Of the reward's terms.
            truth: ``(3,)``; where the robot is.
        """
        summary, watch = self.summary, self.watch
        error_m, error_rad = pose_error(summary.estimate, truth)
        right, wrong = self.right, self.wrong
        if self.task.judges_now(watch.kidnapped):
            near = is_near(error_m, error_rad)
            right = near and not watch.false_alarm
            wrong = not near and summary.mass >= self.task.confidence
        terms = self.terms or dict.fromkeys(weights.terms(0, 0, False, False), 0.0)
        return {
            "entropy": summary.entropy,
            "entropy_fraction": self.entropy_fraction,
            "mass": summary.mass,
            "error_m": error_m,
            "error_rad": error_rad,
            "is_success": right,
            "wrong": wrong,
            "impossible": self.impossible,
            "dropped": self.dropped,
            "touched": self.touched,
            "kidnapped": watch.kidnapped,
            "noticed": watch.noticed,
            "notice_steps": watch.notice_steps,
            "recover_steps": watch.recover_steps(self.step, self.right),
            "false_alarm": watch.false_alarm,
            **{f"reward_{name}": value for name, value in terms.items()},
        }
