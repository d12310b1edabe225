"""Whether planners earn what they expect: gains of information, expected and realised.

A planner says of every walk what it expects of its end (:class:`Plan`): how much the scan there,
and whether an obstacle ended the walk, will narrow the belief that the commands alone would leave.
What it gets is measured with the filter's own means on two copies of the belief.

- The *blind* one carries the commands out, without a scan and without the odometry's evidence of
  the ways being open: H(x' | commands), every blur of the filter's motion included.
- The *twin* makes the walk with the robot, told the odometry but no scan on the way, and is
  corrected by the scan at the end: H(x' | z, u). After a walk of one step it is the belief itself.

The realised gain is the difference. A walk that the episode's end cuts short counts for nothing.
The twin reads the whole scan: where the novelty filter leaves beams out, it is not the belief.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

from activeloc.agents.imagination import Plan
from activeloc.beliefs.particles import ParticleBelief
from activeloc.envs.episodes import Knowledge


class GainMeter:
    """Expected and realised gains of one episode.

    Attributes:
        gains: ``(expected, realised)`` of every walk that was finished [nat].
    """

    def __init__(self) -> None:
        self.gains: list[tuple[float, float]] = []
        self._left = 0

    def decided(self, knowledge: Knowledge, plan: Plan | None) -> None:
        """Take note of a decision before it is carried out; None for one that follows a plan."""
        if plan is None:
            return
        self._expected = float(plan.expected_gain)
        self._before = blind_entropy(knowledge, plan)
        self._twin = knowledge.belief.copy()
        self._left = sum(times for _, times in plan.walk)

    def moved(self, knowledge: Knowledge) -> None:
        """Take note of a step that has been made."""
        if self._left == 0:
            return
        self._twin.predict(knowledge.robot, knowledge.u, knowledge.touched)
        self._left = 0 if knowledge.touched else self._left - 1
        if self._left == 0:
            self._twin.correct(knowledge.robot, knowledge.scan)
            after = self._twin.summarise(knowledge.robot).entropy
            self.gains.append((self._expected, self._before - after))


def blind_entropy(knowledge: Knowledge, plan: Plan) -> float:
    """H(x' | commands): entropy of the belief when only the commands of a walk are known [nat]."""
    blind: Any = knowledge.belief.copy()
    if isinstance(blind, ParticleBelief):
        blind.model = copy(blind.model)
        blind.model.config = replace(blind.config, odometry_floor=1.0)
    else:
        blind.config = replace(blind.config, odometry_floor=1.0)
    for command, times in plan.walk:
        for _ in range(times):
            blind.predict(knowledge.robot, command, False)
    return float(blind.summarise(knowledge.robot).entropy)
