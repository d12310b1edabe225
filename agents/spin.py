"""What robots do today when lost: turn on the spot, then wander."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from activeloc import checks
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.envs.episodes import Knowledge


@dataclass
class SpinAgent:
    """Turn once around, then drive forward and turn away at walls, to a side drawn at each wall.

    It is the recovery behaviour of common navigation stacks. It looks at the scan, not the belief.

    Attributes:
        clearance: It turns when the way ahead reads less than this [m].
    """

    clearance: float = 0.45
    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)
    _turned: float = field(default=0.0, init=False)
    _side: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        checks.number("agent spin.clearance", self.clearance, 0.0, 1e3)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng = rng
        self._turned, self._side = 0.0, None

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge) -> Any:
        """See :class:`Agent`."""
        actions = knowledge.actions
        if self._turned < 2.0 * np.pi - 1e-9:
            self._turned += actions.turn
            return action_for(actions, LEFT)
        if knowledge.touched or self._ahead(knowledge) < self.clearance:
            if self._side is None:
                self._side = LEFT if self.rng.random() < 0.5 else RIGHT
            return action_for(actions, self._side)
        self._side = None
        return action_for(actions, FORWARD)

    @staticmethod
    def _ahead(knowledge: Knowledge) -> float:
        """The reading of the beam nearest to straight ahead; far if it gave none."""
        z = knowledge.scan[np.abs(knowledge.sensor.bearings).argmin()]
        return np.inf if np.isnan(z) else float(z)
