"""What a robot may expect to learn: hypotheses moved and scanned in imagination.

A belief is stood for by M poses drawn from it. A motion is carried out on each of them by the
motion model; a scan is predicted for each by the belief's own forecast. Then J readings are drawn
as if one of the poses were true, each turns the M poses into a posterior, and the mean entropy of
these is what the motion is expected to leave. Readings are drawn from the sensor's law and counted
as the filter counts them, tempered by its ``likelihood_power``: a planner that counts them in full
expects more than it will get. The filter's rules for repeated readings and for contact hold here as
there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.common_bins import entropy
from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.place import PlaceMemory
from activeloc.envs.episodes import Knowledge
from activeloc.motion import move, wrap

EXACT_UP_TO = 64  # Joint readings that are summed over one by one; more are drawn.


Walk = tuple[tuple[NDArray[np.float64], int], ...]
"""Commands ``(3,)`` and how often each is given."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What an agent has set out to do, and what it expects of it.

    Attributes:
        walk: The commands, until an obstacle ends them.
        expected_gain: Entropy that the scan at the end is expected to remove from the belief that
            the walk alone would leave, without a look on the way [nat]: :func:`expected_gain`.
    """

    walk: Walk
    expected_gain: float


@runtime_checkable
class Planner(Protocol):
    """An agent that says what it expects.

    Attributes:
        plan: What the last decision set out to do; None where it went on with an earlier plan.
    """

    plan: Plan | None


def plan_of(agent: object) -> Plan | None:
    """What an agent has just set out to do; None for one that does not plan."""
    return agent.plan if isinstance(agent, Planner) else None


@dataclass(frozen=True, slots=True)
class Imagined:
    """Hypotheses on a walk.

    Attributes:
        poses: ``(M, 3)``.
        stopped: ``(M,)``; whether an obstacle has stopped each.
        place_if_free: What the robot remembers of its place if nothing stopped it.
        place_if_stopped: And if something did.
        news: Whether being stopped or not is news.
    """

    poses: NDArray[np.float64]
    stopped: NDArray[np.bool_]
    place_if_free: PlaceMemory
    place_if_stopped: PlaceMemory
    news: bool

    @classmethod
    def here(cls, knowledge: Knowledge, samples: int, rng: np.random.Generator) -> Imagined:
        """The belief as it is: ``samples`` poses drawn from it."""
        poses = knowledge.belief.sample(knowledge.robot, samples, rng)
        place = knowledge.belief.place(knowledge.robot)
        return cls(poses, np.zeros(len(poses), dtype=np.bool_), place, place, False)

    def after(
        self,
        knowledge: Knowledge,
        command: NDArray[np.float64],
        rng: np.random.Generator,
        times: int = 1,
        given_up: bool = False,
    ) -> Imagined:
        """The hypotheses after a command given ``times`` times over.

        A hypothesis that meets an obstacle stays there. A drive that the place has refused before
        is refused again: it moves nothing and is no news.

        Args:
            knowledge: What the robot knows.
            command: ``(3,)``.
            rng: Source of the motion's noise.
            times: How often.
            given_up: Whether an obstacle ends the walk: what it has stopped does not turn either.
        """
        command = np.asarray(command, dtype=np.float64)
        drives = bool(command[1] != 0.0)
        if times == 0 or (drives and self.place_if_free.is_refused):
            return self
        total = command * times
        spread = knowledge.motion.odometry.sigma(command) * np.sqrt(times)
        wanted = total + rng.standard_normal(self.poses.shape) * spread
        if drives or given_up:
            wanted[self.stopped] = 0.0
        stopped = self.stopped
        if wanted[:, 1].any():
            terrain = knowledge.belief.terrain(knowledge.robot)
            poses, carried_out = move(terrain, self.poses, wanted)
            missing = np.abs(total[1]) - np.abs(carried_out[:, 1])
            if drives:
                least = (1.0 - knowledge.motion.contact_ratio) * abs(command[1])
                stopped = stopped | (missing > least)
        else:
            theta = wrap(self.poses[:, 2] + wanted[:, 0] + wanted[:, 2])
            poses = np.column_stack([self.poses[:, :2], theta])
        free, held = self.place_if_free.copy(), self.place_if_stopped.copy()
        free.move(total)
        if not (given_up and self.news):
            held.move(np.array([total[0], 0.0, total[2]]))
        return Imagined(poses, stopped, free, held, self.news or drives)


@njit(cache=True, nogil=True)
def posterior_entropies(
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    stopped: NDArray[np.bool_],
    weights: NDArray[np.float64],
    log_contact: float,
    bins: NDArray[np.int64],
    n_bins: int,
    chosen: NDArray[np.int64],
    uniforms: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Fill ``out[j]`` with the entropy of the posterior after the j-th drawn reading [nat].

    Args:
        rows: ``(M, B)``; row of the table for each hypothesis and beam.
        log_p: ``(Z, R)``.
        stopped: ``(M,)``; whether each hypothesis was stopped by an obstacle.
        weights: ``(2, B)``; how much each reading counts if the robot was free, and if stopped.
        log_contact: Logarithm of how likely a hypothesis is that was not stopped when the robot
            was, or the other way round; 0 where that is no news.
        bins: ``(M,)`` in ``0 ... n_bins - 1``; the entropy is over these.
        n_bins: Number of bins.
        chosen: ``(J,)``; the hypothesis that is true in each draw.
        uniforms: ``(J, B)`` in [0, 1), from which readings are drawn.
        out: ``(J,)``, overwritten.
    """
    n, n_beams = rows.shape
    n_readings = log_p.shape[0]
    score = np.empty(n)
    mass = np.empty(n_bins)
    for j in range(chosen.shape[0]):
        truth = chosen[j]
        case = 1 if stopped[truth] else 0
        for m in range(n):
            score[m] = 0.0 if stopped[m] == stopped[truth] else log_contact
        for b in range(n_beams):
            total = 0.0
            for z in range(n_readings):
                total += np.exp(log_p[z, rows[truth, b]])
            pointer = uniforms[j, b] * total
            z = 0
            cumulative = np.exp(log_p[0, rows[truth, b]])
            while cumulative <= pointer and z < n_readings - 1:
                z += 1
                cumulative += np.exp(log_p[z, rows[truth, b]])
            w = weights[case, b]
            if w > 0.0:
                for m in range(n):
                    score[m] += w * log_p[z, rows[m, b]]
        shift = score.max()
        mass[:] = 0.0
        total = 0.0
        for m in range(n):
            if score[m] > shift - 30.0:
                p = np.exp(score[m] - shift)
                mass[bins[m]] += p
                total += p
        h = 0.0
        for i in range(n_bins):
            if mass[i] > 0.0:
                p = mass[i] / total
                h -= p * np.log(p)
        out[j] = h


@njit(cache=True, nogil=True)
def exact_entropy(
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    stopped: NDArray[np.bool_],
    weights: NDArray[np.float64],
    log_contact: float,
    bins: NDArray[np.int64],
    n_bins: int,
) -> float:
    """Mean posterior entropy, summed over every joint reading instead of drawn [nat].

    Arguments as :func:`posterior_entropies`; for few beams and readings, since there are Z^B sums.
    """
    n, n_beams = rows.shape
    n_readings = log_p.shape[0]
    joint = np.empty(n)
    mass = np.empty(n_bins)
    expected = 0.0
    for code in range(2 * n_readings**n_beams):
        case, rest = code % 2, code // 2
        p_case = 0.0
        joint[:] = 0.0
        for m in range(n):
            log_likelihood, left = 0.0, rest
            for b in range(n_beams):
                value = log_p[left % n_readings, rows[m, b]]
                left //= n_readings
                log_likelihood += value
                if weights[case, b] > 0.0:
                    joint[m] += weights[case, b] * value
            if stopped[m] == (case == 1):
                p_case += np.exp(log_likelihood) / n
            else:
                joint[m] += log_contact
        if p_case == 0.0:
            continue
        shift = joint.max()
        mass[:] = 0.0
        for m in range(n):
            mass[bins[m]] += np.exp(joint[m] - shift)
        total = mass.sum()
        for i in range(n_bins):
            if mass[i] > 0.0:
                p = mass[i] / total
                expected -= p_case * p * np.log(p)
    return expected


def law_of(
    knowledge: Knowledge, poses: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float32], float]:
    """What the beams would read from poses ``(M, 3)``, and how the filter counts a reading.

    Returns:
        Row ``(M, B)`` for each pose and beam; ``(Z, R)`` of log P(reading in bin | row), each
        column a distribution; the exponent that the filter puts on it.
    """
    belief = knowledge.belief
    rows, log_p = belief.forecast(knowledge.robot, poses)
    power = 1.0
    if isinstance(belief, HistogramBelief | ParticleBelief):
        power = belief.config.likelihood_power
    if isinstance(belief, ParticleBelief):  # Its table holds powers already.
        log_p = log_p / np.float32(power)
    return rows, log_p, power


def expected_entropy(
    knowledge: Knowledge,
    imagined: Imagined,
    readings: int,
    rng: np.random.Generator,
    contact_floor: float = 0.05,
) -> float:
    """Entropy that a scan is expected to leave, on the common bins [nat].

    Exact over the readings where there are at most ``EXACT_UP_TO`` joint ones, drawn otherwise.

    Args:
        knowledge: What the robot knows.
        imagined: The hypotheses, where they will be.
        readings: J, draws of the scan.
        rng: Source of the draws.
        contact_floor: How likely the odometry misses or invents an obstacle.
    """
    belief, robot = knowledge.belief, knowledge.robot
    rows, log_p, power = law_of(knowledge, imagined.poses)
    bins = belief.bins(robot).index(imagined.poses)
    distinct, compact = np.unique(bins, return_inverse=True)
    bearings = knowledge.sensor.bearings
    weights = power * np.stack(
        [imagined.place_if_free.weigh(bearings), imagined.place_if_stopped.weigh(bearings)]
    )
    log_contact = float(np.log(contact_floor)) if imagined.news else 0.0
    if log_p.shape[0] ** len(bearings) <= EXACT_UP_TO:
        return float(
            exact_entropy(
                rows, log_p, imagined.stopped, weights, log_contact, compact, len(distinct)
            )
        )
    m, out = len(imagined.poses), np.empty(readings)
    # Every stretch of the hypotheses is the truth once: a stratified draw.
    chosen = ((np.arange(readings) + rng.random(readings)) / readings * m).astype(np.int64)
    chosen = rng.permutation(m)[chosen]
    posterior_entropies(
        rows,
        log_p,
        imagined.stopped,
        weights,
        log_contact,
        compact.astype(np.int64),
        len(distinct),
        chosen,
        rng.random((readings, len(bearings))),
        out,
    )
    return float(out.mean())


def sampled_entropy(knowledge: Knowledge, poses: NDArray[np.float64]) -> float:
    """Entropy of equally weighted hypotheses ``(M, 3)`` on the common bins [nat]."""
    count = np.unique(knowledge.belief.bins(knowledge.robot).index(poses), return_counts=True)[1]
    return entropy(count / count.sum())


def expected_gain(
    knowledge: Knowledge, imagined: Imagined, readings: int, rng: np.random.Generator
) -> float:
    """Entropy that a scan is expected to remove from the belief it is read in [nat].

    The mutual information of the scan and the pose's bin; arguments as :func:`expected_entropy`.
    """
    before = sampled_entropy(knowledge, imagined.poses)
    return before - expected_entropy(knowledge, imagined, readings, rng)
