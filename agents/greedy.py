"""One-step greedy: the action after which a scan is expected to tell most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from activeloc import checks
from activeloc.agents.imagination import Imagined, Plan, expected_gain
from activeloc.agents.maze_greedy import least_expected_entropy
from activeloc.envs.episodes import Knowledge
from activeloc.envs.maze_episodes import MazeKnowledge
from activeloc.errors import ConfigError


@dataclass
class GreedyAgent:
    """Maximise H(x' | u) - E_z[H(x' | z, u)] over actions u.

    Burgard, Fox & Thrun, "Active mobile robot localization" (IJCAI 1997), one action deep and with
    the travel cost left out. The entropy that the motion's own noise adds is left out too: counted,
    it makes a lost robot stand still, since any turn blurs the belief by more than one scan from
    a known place tells. The expectation is estimated from samples: its own standard error falls
    with the square roots of both numbers below.

    In a maze nothing is sampled: :mod:`activeloc.agents.maze_greedy` sums over all readings.

    Attributes:
        samples: M, poses that stand for the belief.
        readings: J, scans drawn for each action.
        plan: See :class:`~activeloc.agents.imagination.Planner`: the action just chosen.
    """

    samples: int = 800
    readings: int = 16
    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)
    plan: Plan | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        checks.integer("agent greedy.samples", self.samples, 2, 1_000_000)
        checks.integer("agent greedy.readings", self.readings, 1, 1_000_000)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng, self.plan = rng, None

    def expected_gains(self, knowledge: Knowledge) -> list[float]:
        """Entropy that a scan after each action is expected to remove [nat].

        -inf for a drive that is known to be refused.

        Raises:
            ConfigError: If the action space is continuous.
        """
        if knowledge.actions.kind != "discrete":
            raise ConfigError("agent greedy needs discrete actions; got 'continuous'")
        here = Imagined.here(knowledge, self.samples, self.rng)
        refused = here.place_if_free.is_refused
        return [
            -np.inf
            if refused and command[1] != 0.0
            else expected_gain(
                knowledge, here.after(knowledge, command, self.rng), self.readings, self.rng
            )
            for command in knowledge.actions.commands
        ]

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge | MazeKnowledge) -> int:
        """The best action; the lowest-numbered one of equals, in a maze forward first."""
        if isinstance(knowledge, MazeKnowledge):
            return int(least_expected_entropy(knowledge)[0])
        gains = self.expected_gains(knowledge)
        best = int(np.argmax(gains))
        self.plan = Plan(((knowledge.actions.commands[best], 1),), gains[best])
        return best
