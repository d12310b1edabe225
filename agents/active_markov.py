"""Active Markov localization: walk to where the belief is expected to be sharpest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.agents.dead_reckoning import DeadReckoning
from activeloc.agents.expected_occupancy import ExpectedOccupancy
from activeloc.agents.imagination import Imagined, Plan, expected_entropy, sampled_entropy
from activeloc.agents.walks import Moves, Walks
from activeloc.envs.actions import Actions
from activeloc.envs.episodes import Knowledge
from activeloc.errors import ConfigError
from activeloc.motion import wrap

REACH = 6.0  # Of the window around the robot, to all four sides [m].
PITCH = 0.25  # Of its places [m].
OCCUPANCY_SHARE = 4  # One sampled pose in so many stands for the belief in the window.
CLOSED = 0.95  # Expected occupancy from which a place is not driven through.
TURN = float(np.pi / 6.0)  # Shorter turns [rad] and drives [m] are put together in the search.
DRIVE = 0.5
LONGEST = 24  # Walk that is looked for [moves].


@dataclass(frozen=True, slots=True)
class Option:
    """A walk that may be chosen.

    Attributes:
        walk: Its turns and drives.
        end: ``(2,)``; where it leads, x ahead and y to the left [m].
        plan: The same as commands, with what the scan at its end is expected to remove.
        gain: Entropy that walk and scan together are expected to remove [nat].
        p_open: Probability that no obstacle stops it.
    """

    walk: list[int]
    end: NDArray[np.float64]
    plan: Plan
    gain: float
    p_open: float


@dataclass
class ActiveMarkovAgent:
    """Choose a target relative to the robot, walk all the way, choose again.

    Burgard, Fox & Thrun, "Active mobile robot localization" (IJCAI 1997). A target is a bearing and
    a distance from the robot, wherever that is. Its worth is the entropy that a scan there is
    expected to remove; its cost the steps of the cheapest walk there through the expected occupancy
    of what is around the robot (:mod:`~activeloc.agents.expected_occupancy`), around corners and
    through doors (:mod:`~activeloc.agents.walks`). A walk that an obstacle may stop discounts the
    gain; one that an obstacle stops, or is seen to stop, is given up.

    Against the paper: places that the last scans and contacts have shown to be occupied are taken
    for occupied whatever the belief says, since the belief may be wrong; and where no target pays,
    the robot goes on patrol, to where it has not been lately, instead of staying: a robot that is
    sure of a wrong place finds out in no other way.

    Attributes:
        distances: Of the targets [m].
        bearings: Number of directions around the robot.
        step_cost: Price of a step [nat].
        certainty_share: Share of a gain that depends on the way being open.
        samples: M, poses that stand for the belief.
        readings: J, scans drawn for each target.
        penalty: What a drive through an obstacle is taken to cost when walks are searched [step].
        obstacle_steps: Steps for which a seen obstacle is remembered.
        patrol_steps: Steps for which a place counts as visited.
        patrol_cost: Price of a step on patrol [m], against the distance from all places visited.
        plan: See :class:`~activeloc.agents.imagination.Planner`: the walk, if it was just chosen.
    """

    distances: tuple[float, ...] = (1.0, 2.0, 4.0)
    bearings: int = 12
    step_cost: float = 0.05
    certainty_share: float = 0.7
    samples: int = 800
    readings: int = 16
    penalty: float = 8.0
    obstacle_steps: int = 12
    patrol_steps: int = 100
    patrol_cost: float = 0.1
    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)
    plan: Plan | None = field(default=None, init=False)
    _walk: list[int] = field(default_factory=list, init=False)
    _told: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3), init=False)

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
        checks.number("agent active.penalty", self.penalty, 0.0, 1e3)
        checks.integer("agent active.obstacle_steps", self.obstacle_steps, 1, 10_000)
        checks.integer("agent active.patrol_steps", self.patrol_steps, 1, 10_000)
        checks.number("agent active.patrol_cost", self.patrol_cost, 0.0, 1e3)
        self.reset(self.rng)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng, self.plan = rng, None
        self._walk, self._told = [], np.zeros(3)
        self._memory = DeadReckoning(self.patrol_steps, self.obstacle_steps)

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge) -> Any:
        """The next move of the walk; a new walk when it is done or has come to nothing."""
        self.plan = None
        self._memory.follow(knowledge)
        if not self._walk or self._is_given_up(knowledge):
            self._walk = self._choose(knowledge)
        move = self._walk.pop(0)
        self._told = command_of(knowledge.actions, move)
        return action_for(knowledge.actions, move)

    def action_values(
        self, observation: Mapping[str, Any], knowledge: Knowledge
    ) -> NDArray[np.float64]:
        """Of each action the worth of the best walk that begins with it: ``(A,)``.

        The walk under way counts for nothing. -inf for an action that begins none; utilities [nat],
        or on patrol novelties [m].
        """
        self._memory.follow(knowledge)
        values = np.full(len(knowledge.actions.commands), -np.inf)
        options = self._options(knowledge)
        for option, worth in zip(options, self._worths(options), strict=True):
            values[option.walk[0]] = max(values[option.walk[0]], worth)
        if not options:
            values[self._way_out(knowledge)] = 0.0
        return values

    def _is_given_up(self, knowledge: Knowledge) -> bool:
        """Whether the robot was stopped, is somewhere else, or is about to be stopped."""
        if knowledge.touched:
            return True
        actions = knowledge.actions
        off = np.abs(knowledge.u - self._told)
        if off[0] > 0.5 * actions.turn or off[1] > 0.5 * actions.forward:
            return True
        return self._walk[0] == FORWARD and is_blocked_ahead(knowledge)

    def _choose(self, knowledge: Knowledge) -> list[int]:
        """The best walk; the first of equals."""
        options = self._options(knowledge)
        if not options:
            return [self._way_out(knowledge)]
        chosen = options[int(np.argmax(self._worths(options)))]
        self.plan = chosen.plan
        return chosen.walk

    def _way_out(self, knowledge: Knowledge) -> int:
        """The move where no walk leads anywhere: ahead if nothing is known to be in the way."""
        stays = knowledge.belief.place(knowledge.robot).is_refused
        return LEFT if stays or is_blocked_ahead(knowledge) else FORWARD

    def _options(self, knowledge: Knowledge) -> list[Option]:
        """The cheapest walk to each target that can be reached."""
        here = Imagined.here(knowledge, self.samples, self.rng)
        before = sampled_entropy(knowledge, here.poses)
        walks, options = self._walks(knowledge, here.poses), []
        for node in walks.ends(self.bearings, self.distances):
            walk = walks.walk_to(node)
            commands = [
                (command_of(knowledge.actions, move), len(list(times)))
                for move, times in groupby(walk)
            ]
            there = here
            for command, times in commands:
                there = there.after(knowledge, command, self.rng, times, given_up=True)
            after = expected_entropy(knowledge, there, self.readings, self.rng)
            plan = Plan(tuple(commands), sampled_entropy(knowledge, there.poses) - after)
            p_open = 1.0 - float(there.stopped.mean())
            options.append(Option(walk, walks.place[node, :2], plan, before - after, p_open))
        return options

    def _walks(self, knowledge: Knowledge, poses: NDArray[np.float64]) -> Walks:
        """All walks through what the poses ``(M, 3)`` and the last scans say is around."""
        place = knowledge.belief.place(knowledge.robot)
        around = ExpectedOccupancy.of(
            knowledge.belief.terrain(knowledge.robot),
            poses[::OCCUPANCY_SHARE],
            round(REACH / PITCH),
            PITCH,
        ).with_obstacles(self._memory.obstacles(), knowledge.motion.radius)
        moves = Moves.of(knowledge.actions, TURN, DRIVE)
        refused = place.refused[place.sector(moves.headings)]
        return Walks.search(around, moves, refused, self.penalty, CLOSED, LONGEST)

    def _worths(self, options: list[Option]) -> list[float]:
        """What each walk is worth: its utility, or its novelty where no utility is positive."""
        utilities = [self._utility(option) for option in options]
        return utilities if max(utilities, default=0.0) > 0.0 else self._novelties(options)

    def _utility(self, option: Option) -> float:
        """Expected gain [nat] of a walk and a scan there, less the walk's cost."""
        trust = 1.0 - self.certainty_share + self.certainty_share * option.p_open
        return option.gain * trust - self.step_cost * len(option.walk)

    def _novelties(self, options: list[Option]) -> list[float]:
        """How far each walk's end is from where the robot was, less the walk's cost [m]."""
        track = self._memory.track()
        return [
            option.p_open * float(np.hypot(*(track - option.end).T).min())
            - self.patrol_cost * len(option.walk)
            for option in options
        ]


def command_of(actions: Actions, move: int) -> NDArray[np.float64]:
    """What a turn or drive commands: ``(3,)``."""
    return np.array(
        {
            LEFT: (actions.turn, 0.0, 0.0),
            RIGHT: (-actions.turn, 0.0, 0.0),
            FORWARD: (0.0, actions.forward, 0.0),
        }[move]
    )


def is_blocked_ahead(knowledge: Knowledge) -> bool:
    """Whether the last scan shows an obstacle that would stop half a drive."""
    off = np.abs(wrap(knowledge.sensor.bearings))
    beam = int(off.argmin())
    near = knowledge.motion.radius + 0.5 * knowledge.actions.forward
    return bool(off[beam] <= 0.5 * knowledge.actions.turn and knowledge.scan[beam] < near)
