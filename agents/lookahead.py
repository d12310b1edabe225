"""Lookahead: the action that begins the plan whose belief is sharpest at every step.

What is maximised is the *sum* over the steps of what the readings so far are expected to have told.
A planner that looks at the last step alone puts everything off: it can always look next time.

A plan is a sequence of actions, and only its first is carried out. Hypotheses drawn from the belief
are moved along each sequence; readings are drawn as if some of them were true, step after step, and
each draw's posterior is followed down the tree of sequences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.agents.imagination import Imagined, Plan, law_of, sampled_entropy
from activeloc.agents.maze_search import first_actions, plan_values
from activeloc.envs.episodes import Knowledge
from activeloc.envs.maze_episodes import MazeKnowledge
from activeloc.errors import ConfigError

CONTACT_FLOOR = 0.05  # How likely the odometry misses or invents an obstacle.


@njit(cache=True, nogil=True)
def weigh_draws(
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    stopped: NDArray[np.bool_],
    weights: NDArray[np.float64],
    log_contact: float,
    bins: NDArray[np.int64],
    n_bins: int,
    chosen: NDArray[np.int64],
    uniforms: NDArray[np.float64],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
) -> float:
    """Posteriors of drawn readings on top of earlier ones; returns their mean entropy [nat].

    Args:
        rows: ``(M, B)``; row of the table for each hypothesis and beam.
        log_p: ``(Z, R)``; each column a distribution.
        stopped: ``(M,)``; whether an obstacle has stopped each hypothesis.
        weights: ``(2, B)``; how much each reading counts if the robot was free, and if stopped.
        log_contact: Added where a hypothesis was stopped and the truth was not, or the other way.
        bins: ``(M,)`` in ``0 ... n_bins - 1``; the entropy is over these.
        n_bins: Number of bins.
        chosen: ``(J,)``; the hypothesis that is true in each draw.
        uniforms: ``(J, B)`` in [0, 1), from which readings are drawn.
        before: ``(J, M)``; log-weights of the hypotheses in each draw so far.
        after: ``(J, M)``, overwritten.
    """
    n, n_beams = rows.shape
    n_readings = log_p.shape[0]
    mass = np.empty(n_bins)
    mean = 0.0
    for j in range(chosen.shape[0]):
        truth = chosen[j]
        case = 1 if stopped[truth] else 0
        for m in range(n):
            after[j, m] = before[j, m]
            if stopped[m] != stopped[truth]:
                after[j, m] += log_contact
        for b in range(n_beams):
            w = weights[case, b]
            if w == 0.0:
                continue
            z, cumulative = 0, np.exp(log_p[0, rows[truth, b]])
            while cumulative <= uniforms[j, b] and z < n_readings - 1:
                z += 1
                cumulative += np.exp(log_p[z, rows[truth, b]])
            for m in range(n):
                after[j, m] += w * log_p[z, rows[m, b]]
        shift = after[j].max()
        mass[:] = 0.0
        total = 0.0
        for m in range(n):
            if after[j, m] > shift - 30.0:
                p = np.exp(after[j, m] - shift)
                mass[bins[m]] += p
                total += p
        for i in range(n_bins):
            if mass[i] > 0.0:
                p = mass[i] / total
                mean -= p * np.log(p)
    return mean / chosen.shape[0]


@dataclass
class LookaheadAgent:
    """Maximise sum over k of H(x_k | u_1..k) - E[H(x_k | z_1..k, u_1..k)] over plans of K actions.

    The expectation is estimated from ``samples`` hypotheses and ``readings`` draws. A turn is not
    followed by the turn back: what it shows has been seen. A drive that the place has refused is
    not planned first.

    In a maze nothing is sampled: :mod:`activeloc.agents.maze_search` follows every reading.

    Attributes:
        steps: K; by default 3, and 7 in a maze without noise.
        samples: M, poses that stand for the belief.
        readings: J, draws of the readings along each plan.
        seconds: Time for a decision [s]: once it is over, plans are not made deeper; 0 for no
            limit. With one, results depend on the machine.
        plan: See :class:`~activeloc.agents.imagination.Planner`: the first action and what its scan
            is expected to remove.
    """

    steps: int | None = None
    samples: int = 400
    readings: int = 12
    seconds: float = 0.0
    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)
    plan: Plan | None = field(default=None, init=False)
    _until: float = field(default=np.inf, init=False)

    def __post_init__(self) -> None:
        if self.steps is not None:
            checks.integer("agent lookahead.steps", self.steps, 1, 12)
        checks.integer("agent lookahead.samples", self.samples, 2, 1_000_000)
        checks.integer("agent lookahead.readings", self.readings, 1, 1_000_000)
        checks.number("agent lookahead.seconds", self.seconds, 0.0, 1e6)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng, self.plan = rng, None

    def action_values_all(self, knowledge: MazeKnowledge) -> NDArray[np.float64]:
        """Worth of each action to the robots asked for, in mazes: ``(n, 3)``; the best exact."""
        steps = self.steps or (3 if knowledge.lattice.p_off > 0.0 else 7)
        return plan_values(knowledge, steps)

    def act_all(self, knowledge: MazeKnowledge) -> NDArray[np.int64]:
        """See :class:`activeloc.envs.maze_episodes.MazePlanner`."""
        return first_actions(self.action_values_all(knowledge))

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge | MazeKnowledge) -> int:
        """First action of the best plan; the lowest-numbered one of equals, in a maze forward.

        Raises:
            ConfigError: If the action space is continuous.
        """
        if isinstance(knowledge, MazeKnowledge):
            return int(self.act_all(knowledge)[0])
        if knowledge.actions.kind != "discrete":
            raise ConfigError("agent lookahead needs discrete actions; got 'continuous'")
        self._until = perf_counter() + self.seconds if self.seconds > 0.0 else np.inf
        here = Imagined.here(knowledge, self.samples, self.rng)
        m = len(here.poses)
        stretch = (np.arange(self.readings) + self.rng.random(self.readings)) / self.readings
        chosen = self.rng.permutation(m)[(stretch * m).astype(np.int64)]
        worth = np.full(len(knowledge.actions.commands), -np.inf)
        gains = np.zeros(len(worth))
        nothing = np.zeros((self.readings, m))
        for action, command in enumerate(knowledge.actions.commands):
            if command[1] != 0.0 and here.place_if_free.is_refused:
                continue
            there = here.after(knowledge, command, self.rng)
            gains[action], log_w = self._look(knowledge, there, command, chosen, nothing)
            worth[action] = gains[action] + self._deeper(
                knowledge, there, command, (self.steps or 3) - 1, chosen, log_w, gains[action]
            )
        best = int(np.argmax(worth))
        self.plan = Plan(((knowledge.actions.commands[best], 1),), float(gains[best]))
        return best

    def _deeper(
        self,
        knowledge: Knowledge,
        imagined: Imagined,
        last: NDArray[np.float64],
        steps: int,
        chosen: NDArray[np.int64],
        log_w: NDArray[np.float64],
        so_far: float,
    ) -> float:
        """The most that the steps left can add; ``so_far`` a step where there is no time."""
        if steps == 0:
            return 0.0
        if perf_counter() > self._until:
            return so_far * steps
        best = -np.inf
        for command in knowledge.actions.commands:
            back = command[0] != 0.0 and command[0] == -last[0]
            if back or (command[1] != 0.0 and imagined.place_if_free.is_refused):
                continue
            there = imagined.after(knowledge, command, self.rng)
            gain, after = self._look(knowledge, there, command, chosen, log_w)
            deeper = self._deeper(knowledge, there, command, steps - 1, chosen, after, gain)
            best = max(best, gain + deeper)
        return best if best > -np.inf else so_far * steps

    def _look(
        self,
        knowledge: Knowledge,
        imagined: Imagined,
        command: NDArray[np.float64],
        chosen: NDArray[np.int64],
        log_w: NDArray[np.float64],
    ) -> tuple[float, NDArray[np.float64]]:
        """What the readings up to here are expected to have told [nat], and each draw's weights.

        The directions are remembered as read: looking there again is no news.
        """
        rows, log_p, power = law_of(knowledge, imagined.poses)
        bins = knowledge.belief.bins(knowledge.robot).index(imagined.poses)
        distinct, compact = np.unique(bins, return_inverse=True)
        bearings = knowledge.sensor.bearings
        weights = power * np.stack(
            [imagined.place_if_free.weigh(bearings), imagined.place_if_stopped.weigh(bearings)]
        )
        imagined.place_if_free.read(bearings)
        imagined.place_if_stopped.read(bearings)
        # Being stopped or not is news in the step in which it happens.
        log_contact = float(np.log(CONTACT_FLOOR)) if command[1] != 0.0 else 0.0
        after = np.empty_like(log_w)
        left = weigh_draws(
            rows, log_p, imagined.stopped, weights, log_contact,
            compact.astype(np.int64), len(distinct), chosen,
            self.rng.random((len(chosen), len(bearings))), log_w, after,
        )  # fmt: skip
        return sampled_entropy(knowledge, imagined.poses) - left, after
