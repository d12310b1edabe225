"""Active Markov localization: walk to where the belief is expected to be sharpest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.agents.imagination import Imagined, Plan, expected_entropy, sampled_entropy
from activeloc.envs.episodes import Knowledge
from activeloc.errors import ConfigError
from activeloc.motion import wrap


@dataclass(frozen=True, slots=True)
class Option:
    """A walk that may be chosen.

    Attributes:
        moves: Its actions, one after the other.
        utility: What it is worth [nat].
        plan: See :class:`~activeloc.agents.imagination.Plan`.
    """

    moves: list[int]
    utility: float
    plan: Plan


@dataclass
class ActiveMarkovAgent:
    """Choose a target relative to the robot, walk all the way, choose again.

    Burgard, Fox & Thrun, "Active mobile robot localization" (IJCAI 1997). A target is a bearing and
    a distance from the robot, wherever that is; its worth is the entropy that a scan there is
    expected to remove, and its cost the steps of the walk. How likely the way is open is its
    expected occupancy: the share of the belief's poses from which an obstacle would stop the walk.
    Against the paper: the way is straight, and a way that may be blocked discounts the gain.

    Attributes:
        distances: Of the targets [m].
        bearings: Number of directions around the robot.
        step_cost: Price of a step [nat].
        certainty_share: Share of a gain that depends on the way being open.
        samples: M, poses that stand for the belief.
        readings: J, scans drawn for each target.
        plan: See :class:`~activeloc.agents.imagination.Planner`: the walk, if it was just chosen.
    """

    distances: tuple[float, ...] = (1.0, 2.0, 4.0)
    bearings: int = 12
    step_cost: float = 0.05
    certainty_share: float = 0.7
    samples: int = 800
    readings: int = 16
    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)
    plan: Plan | None = field(default=None, init=False)
    _walk: list[int] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        if not isinstance(self.distances, list | tuple) or not self.distances:
            raise ConfigError(
                f"agent active.distances must be a list of numbers; got {self.distances!r}"
            )
        for distance in self.distances:
            checks.number("agent active.distances", distance, 0.0, 1e3)
        checks.integer("agent active.bearings", self.bearings, 1, 360)
        checks.number("agent active.step_cost", self.step_cost, 0.0, 1e3)
        checks.number("agent active.certainty_share", self.certainty_share, 0.0, 1.0)
        checks.integer("agent active.samples", self.samples, 2, 1_000_000)
        checks.integer("agent active.readings", self.readings, 1, 1_000_000)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng, self.plan = rng, None
        self._walk = []

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge) -> Any:
        """The next move of the walk; a new walk when it is done or an obstacle has ended it."""
        self.plan = None
        if not self._walk or knowledge.touched:
            self._walk = self._choose(knowledge)
        return action_for(knowledge.actions, self._walk.pop(0))

    def action_values(
        self, observation: Mapping[str, Any], knowledge: Knowledge
    ) -> NDArray[np.float64]:
        """Of each action the utility of the best walk that begins with it [nat]: ``(A,)``.

        The walk under way counts for nothing. -inf for an action that begins none.
        """
        values = np.full(len(knowledge.actions.commands), -np.inf)
        for option in self._options(knowledge):
            values[option.moves[0]] = max(values[option.moves[0]], option.utility)
        if not np.isfinite(values).any():
            values[LEFT] = 0.0
        return values

    def _choose(self, knowledge: Knowledge) -> list[int]:
        """The walk of the greatest utility; the first of equals."""
        options = list(self._options(knowledge))
        if not options:
            return [LEFT]
        best = max(options, key=lambda option: option.utility)
        self.plan = best.plan
        return best.moves

    def _options(self, knowledge: Knowledge) -> Iterator[Option]:
        """All walks but those that have been refused."""
        here = Imagined.here(knowledge, self.samples, self.rng)
        before = sampled_entropy(knowledge, here.poses)
        for turns in self._turns(knowledge):
            if self._seen_blocked(knowledge, turns * knowledge.actions.turn):
                continue
            turn = np.array([np.sign(turns) * knowledge.actions.turn, 0.0, 0.0])
            there = here.after(knowledge, turn, self.rng, abs(turns))
            if there.place_if_free.is_refused:
                continue
            done = 0
            for drives in self._drives(knowledge):
                drive = np.array([0.0, knowledge.actions.forward, 0.0])
                there = there.after(knowledge, drive, self.rng, drives - done)
                done = drives
                after = expected_entropy(knowledge, there, self.readings, self.rng)
                gain = sampled_entropy(knowledge, there.poses) - after
                yield Option(
                    [LEFT if turns > 0 else RIGHT] * abs(turns) + [FORWARD] * drives,
                    self._utility(there, before - after, abs(turns) + drives),
                    Plan(((turn, abs(turns)), (drive, drives)), gain),
                )

    def _seen_blocked(self, knowledge: Knowledge, bearing: float) -> bool:
        """Whether the last scan shows an obstacle that would stop half a drive."""
        off = np.abs(wrap(knowledge.sensor.bearings - bearing))
        beam = int(off.argmin())
        near = knowledge.motion.radius + 0.5 * knowledge.actions.forward
        return bool(off[beam] <= np.pi / self.bearings and knowledge.scan[beam] < near)

    def _turns(self, knowledge: Knowledge) -> list[int]:
        """Turns to each bearing, the shorter way round: positive to the left."""
        bearings = 2.0 * np.pi * np.arange(self.bearings) / self.bearings
        return [round(float(b) / knowledge.actions.turn) for b in wrap(bearings)]

    def _drives(self, knowledge: Knowledge) -> list[int]:
        """Drives to each distance, nearest first."""
        drives = {max(1, round(d / knowledge.actions.forward)) for d in self.distances}
        return sorted(drives)

    def _utility(self, there: Imagined, gain: float, steps: int) -> float:
        """Expected gain [nat] of a walk and a scan there, less the walk's cost."""
        p_open = 1.0 - float(there.stopped.mean())
        trust = 1.0 - self.certainty_share + self.certainty_share * p_open
        return gain * trust - self.step_cost * steps
