"""Choose among the straight ways that the egocentric view shows, by what each would tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.beliefs.metric_view import (
    BEARINGS,
    DISTANCES,
    HYPOTHESES,
    PIXEL,
    MetricView,
)
from activeloc.envs.episodes import Knowledge
from activeloc.errors import ConfigError
from activeloc.motion import wrap


@dataclass
class GlanceAgent:
    """Take the first action of the best straight way, and look again.

    The idea of Burgard, Fox & Thrun, "Active mobile robot localization" (IJCAI 1997), on the
    ``ways`` of :mod:`activeloc.beliefs.metric_view`: what a scan at the end of a way tells, less
    what the way costs. Nothing is sampled and no scan drawn: readings count as if there were no
    noise, which makes gains larger than they are, and so is the price of a step.

    Attributes:
        step_cost: Price of a step [nat].
        certainty_share: Share of a gain that depends on the way being open.
        distances: Of the targets [m], up to 4.
    """

    step_cost: float = 0.2
    certainty_share: float = 0.7
    distances: tuple[float, ...] = (1.0, 2.0, 4.0)
    _view: MetricView | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        checks.number("agent glance.step_cost", self.step_cost, 0.0, 1e3)
        checks.number("agent glance.certainty_share", self.certainty_share, 0.0, 1.0)
        if not isinstance(self.distances, list | tuple) or not self.distances:
            raise ConfigError(
                f"agent glance.distances must be a list of numbers; got {self.distances!r}"
            )
        for distance in self.distances:
            checks.number("agent glance.distances", distance, PIXEL, PIXEL * (DISTANCES - 1))

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`; nothing here is left to chance."""
        self._view = None

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge) -> Any:
        """The action of the largest value; the lowest-numbered of equals."""
        best = int(np.argmax(self.action_values(observation, knowledge)[: FORWARD + 1]))
        return action_for(knowledge.actions, best)

    def action_values(
        self, observation: Mapping[str, Any], knowledge: Knowledge
    ) -> NDArray[np.float64]:
        """Of each action the utility of the best way that begins with it [nat]: ``(A,)``.

        -inf for an action that begins none; it may be the one to stay.
        """
        seen = observation if "ways" in observation else self._drawn(knowledge)
        p_open, told = seen["ways"].astype(np.float64)
        k = np.unique(np.round(np.array(self.distances) / PIXEL).astype(np.intp))
        angles = wrap(2.0 * np.pi * np.arange(BEARINGS) / BEARINGS)
        turns = np.round(np.abs(angles) / knowledge.actions.turn)
        steps = turns[:, None] + np.ceil(k * PIXEL / knowledge.actions.forward - 1e-9)
        share = self.certainty_share
        trust = 1.0 - share + share * p_open[:, k]
        utility = told[:, k] * np.log(HYPOTHESES) * trust - self.step_cost * steps
        refused = seen["place"][BEARINGS:] > 0.0
        best = np.where(refused, -np.inf, utility.max(axis=1))
        half = BEARINGS // 2
        values = np.full(max(len(knowledge.actions.commands), FORWARD + 1), -np.inf)
        values[LEFT] = best[1 : half + 1].max()
        values[RIGHT] = best[half:].max()
        values[FORWARD] = best[0]
        if not np.isfinite(values).any():
            values[LEFT] = 0.0
        return values

    def _drawn(self, knowledge: Knowledge) -> Mapping[str, NDArray[np.float32]]:
        """The view, where it is no part of the observation."""
        if self._view is None:
            self._view = MetricView(knowledge.belief, knowledge.sensor, 1)
        return self._view.draw(knowledge.robot)
