"""The reward: a sum of named terms, each with a weight, each in ``info``."""

from __future__ import annotations

from dataclasses import dataclass, fields

from activeloc import checks


@dataclass(frozen=True, slots=True)
class RewardWeights:
    """Weights of the terms.

    Attributes:
        information: On the share of the uniform belief's entropy that the step removed; negative
            where entropy rose. Over an episode these sum to what was removed in all.
        step: On each step taken.
        success: On a right declaration.
        wrong: On a wrong one.

    Raises:
        ConfigError: If a weight is not a finite number.
    """

    information: float = 1.0
    step: float = -0.005
    success: float = 1.0
    wrong: float = -1.0

    def __post_init__(self) -> None:
        for item in fields(self):
            checks.number(f"reward.{item.name}", getattr(self, item.name), -1e6, 1e6)

    def terms(
        self, entropy_before: float, entropy_after: float, right: bool, wrong: bool
    ) -> dict[str, float]:
        """The weighted terms of one step, entropies as fractions of the uniform belief's."""
        return {
            "information": self.information * (entropy_before - entropy_after),
            "step": self.step,
            "success": self.success * right,
            "wrong": self.wrong * wrong,
        }
