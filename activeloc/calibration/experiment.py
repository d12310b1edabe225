"""One experiment of calibration: a world, a filter, and the replicates that are drawn of them.

Replicate i follows from the seed, its start and i alone. A robot's commands are drawn blindly (a
turn to either side or a drive, each as likely), so that they say nothing of where it is.

The *control* is what the filter is given as u. ``command``: the robot carries its command out with
the noise that the filter assumes, and the filter knows the command; then p(x' | u, x, m) of world
and filter are one. ``odometry``: as in the environments, the filter knows what the odometry read
of a motion that had noise of its own, and feels contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS
from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.calibration.defects import make_defective
from activeloc.calibration.posterior import QUANTITIES, likelihoods, posterior_of, seen
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, wrap
from activeloc.sensors import RangeSensor
from activeloc.simulator import Simulator, terrain_of

STARTS = ("global", "tracking")
WORLDS = ("continuous", "discrete")
CONTROLS = ("command", "odometry")


@dataclass(frozen=True)
class Experiment:
    """What is replicated.

    Attributes:
        grid: The map.
        belief: Settings of the filter.
        sensor: The true sensor.
        motion: The true motion model.
        filter_sensor: What the filter assumes.
        filter_motion: What the filter assumes.
        world: ``continuous``, or the histogram filter's ``discrete`` one.
        control: ``command`` or ``odometry``.
        commands: ``(A, 3)``; rotation [rad], translation [m], rotation [rad] of each.
        steps: T; commands in a replicate. There is a scan before the first and after each.
        sigma: Standard deviations of a known start: x and y [m], theta [rad].
        seed: All chance follows from it.
        defect: Name of one that is planted in the filter; none if None.

    Raises:
        ConfigError: If a value is refused.
    """

    grid: OccupancyGrid
    belief: HistogramConfig | ParticleConfig
    sensor: RangeSensor
    motion: MotionModel
    filter_sensor: RangeSensor
    filter_motion: MotionModel
    commands: tuple[tuple[float, float, float], ...]
    world: str = "discrete"
    control: str = "command"
    steps: int = 8
    sigma: tuple[float, float] = (0.3, float(np.deg2rad(10.0)))
    seed: int = 0
    defect: str | None = None

    def __post_init__(self) -> None:
        checks.choice("world", self.world, WORLDS)
        checks.choice("control", self.control, CONTROLS)
        checks.integer("steps", self.steps, 1, 10_000)
        checks.integer("seed", self.seed, 0, 2**63 - 1)
        if self.world == "discrete" and isinstance(self.belief, ParticleConfig):
            raise ConfigError("world='discrete' is the histogram filter's; belief is 'particles'")


class Outcome(NamedTuple):
    """What one replicate gave.

    Attributes:
        ranks: ``(5,)``; the truth's, at the end, by :data:`QUANTITIES`.
        mass: ``(T + 1,)``; belief near the estimate after each scan.
        right: ``(T + 1,)``; whether the truth was near it.
        nees: ``(2, T + 1)``; the truth's and its variance under the belief; NaN unless the start
            was known.
        impossible: Scans that no hypothesis explained.
    """

    ranks: NDArray[np.float64]
    mass: NDArray[np.float64]
    right: NDArray[np.bool_]
    nees: NDArray[np.float64]
    impossible: int


class Bench:
    """An experiment set up: it runs replicates, one after another.

    Args:
        experiment: What is replicated.

    Raises:
        ActiveLocError: If the robot fits nowhere, or the defect is none of the filter's.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = given = experiment
        motion = given.motion
        if given.control == "command":
            motion = replace(motion, actuation=given.filter_motion.odometry)
        redraw = None
        if given.world == "discrete":
            assert isinstance(given.belief, HistogramConfig)
            redraw = given.belief.cell_size, given.belief.headings
        self.simulator = Simulator(1, given.sensor, motion, redraw)
        models = given.filter_sensor, given.filter_motion
        self.grid, self.belief = make_defective(given.defect, given.grid, given.belief, *models)
        self._terrain = terrain_of(given.grid, given.motion.radius)
        self._commands = np.array(given.commands)

    @cached_property
    def _prior(self) -> HistogramBelief | ParticleBelief:
        """A sound filter that is never shown a scan; a cloud of one is a draw of the prior."""
        given = self.experiment
        models = given.filter_sensor, given.filter_motion
        if isinstance(given.belief, HistogramConfig):
            return HistogramBelief(1, given.belief, *models)
        return ParticleBelief(1, replace(given.belief, n_min=1, n_max=1, n_start=1), *models)

    def run(self, start: str, index: int) -> Outcome:
        """Replicate ``index`` of those with a ``global`` or a ``tracking`` start."""
        given, belief = self.experiment, self.belief
        seed = np.random.SeedSequence(given.seed, spawn_key=(STARTS.index(start), index))
        world, filter_rng, draw = (np.random.default_rng(s) for s in seed.spawn(3))
        truth, near = self._start(start, world)
        self._reset(belief, filter_rng, near)
        self.simulator.place(0, given.grid, world, truth)

        outcome = Outcome(
            np.empty(len(QUANTITIES)),
            np.empty(given.steps + 1),
            np.empty(given.steps + 1, dtype=np.bool_),
            np.full((2, given.steps + 1), np.nan),
            0,
        )
        impossible = 0
        for t in range(given.steps + 1):
            if t > 0:
                self._move(world)
            scan = self.simulator.scan(0, world)
            evidence = belief.correct(0, scan)
            impossible += evidence == -np.inf
            outcome.mass[t], outcome.right[t] = self._declared()
            if near is not None:
                pose = self._placed(draw.random((1, 4)))
                outcome.nees[:, t] = posterior_of(belief, pose).nees(pose)
        posterior = posterior_of(belief, self.simulator.poses[0])
        p = likelihoods(belief, np.vstack([posterior.poses, posterior.truth]), scan).prod(axis=1)
        zero, shares = 2.0 * np.pi * draw.random(), draw.random(len(QUANTITIES))
        ranks = posterior.ranks((p[:-1], float(p[-1])), zero, shares)
        return outcome._replace(ranks=ranks, impossible=int(impossible))

    def _start(
        self, start: str, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """A pose drawn from the prior, and the pose that the prior lies around, if any."""
        near = None
        if start == "tracking":
            near = self._terrain.uniform_poses(rng.random((1, 4)))[0]
        self._reset(self._prior, rng, near, self.experiment.grid)
        return self._prior.sample(0, 1, rng)[0], near

    def _reset(
        self,
        belief: HistogramBelief | ParticleBelief,
        rng: np.random.Generator,
        near: NDArray[np.float64] | None,
        grid: OccupancyGrid | None = None,
    ) -> None:
        """Give a belief its prior, on the filter's map unless another is given."""
        grid = self.grid if grid is None else grid
        if isinstance(belief, HistogramBelief):
            if near is None:
                belief.reset(0, grid)
            else:
                belief.reset_near(0, grid, near, self.experiment.sigma)
        elif near is None:
            belief.reset(0, grid, rng)
        else:
            belief.reset_near(0, grid, rng, near, self.experiment.sigma)

    def _move(self, rng: np.random.Generator) -> None:
        """One blind command: the robot carries it out, the filter hears of it."""
        command = self._commands[rng.integers(len(self._commands))]
        u, touched = self.simulator.step(0, command, rng), False
        if self.experiment.control == "command":
            u = command
        else:
            touched = bool(self.experiment.filter_motion.touched(command, u))
        self.belief.predict(0, u, touched)

    def _declared(self) -> tuple[float, bool]:
        """Belief near the estimate, and whether the truth is."""
        summary = self.belief.summarise(0)
        error = seen(self.belief, self.simulator.poses[0]) - summary.estimate
        near = np.hypot(error[0], error[1]) <= NEAR_RADIUS and abs(wrap(error[2])) <= NEAR_ANGLE
        return summary.mass, bool(near)

    def _placed(self, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """The true pose; in the discrete world, where only its state counts, one drawn in that."""
        pose = self.simulator.poses[0]
        if self.experiment.world == "continuous" or not isinstance(self.belief, HistogramBelief):
            return pose
        grid = self.belief.poses(0)
        result: NDArray[np.float64] = grid.sample_in(*grid.states_of(pose[None]), uniforms)[0]
        return result
