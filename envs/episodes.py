"""The state machine of a batch of episodes: reset some robots, step all; arrays in, arrays out.

Both faces of the environment, for one robot and for many, are thin: this is where an episode
happens. One step is: command -> simulator (odometry, scan) -> belief (predict, correct) -> task,
reward, observation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Summary
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.metric_view import MetricView
from activeloc.beliefs.novelty import drop_novel
from activeloc.beliefs.particles import ParticleBelief
from activeloc.configuration import unknown
from activeloc.envs.episode_config import BELIEFS, SENSORS, WORLDS, EpisodeConfig
from activeloc.envs.knowledge import Knowledge
from activeloc.envs.observations import observe
from activeloc.envs.tasks import Watch, carried, is_near, pose_error
from activeloc.errors import ActionError, ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.sharing import Pool
from activeloc.simulator import Simulator, checked_pose

RESET_OPTIONS = ("map", "grid", "pose", "kidnap_pose")

__all__ = ["BELIEFS", "SENSORS", "WORLDS", "EpisodeConfig", "Episodes", "Knowledge"]


@dataclass(slots=True)
class _Episode:
    """One robot's episode."""

    rng: np.random.Generator
    summary: Summary
    scan: NDArray[np.float64]
    kidnap_step: int
    kidnap_pose: NDArray[np.float64]
    watch: Watch
    novelty_rng: np.random.Generator
    u: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    touched: bool = False
    step: int = 0
    held: int = 0
    kidnap_given: bool = False
    impossible: int = 0
    dropped: int = 0
    over: bool = False
    right: bool = False
    wrong: bool = False
    terms: dict[str, float] = field(default_factory=dict)


class Episodes:
    """B robots, their beliefs and their episodes.

    Args:
        config: What to play.
        n_robots: B.
        threads: That share the work.
    """

    def __init__(self, config: EpisodeConfig, n_robots: int, threads: int = 1) -> None:
        self.config = config
        self.n_robots = n_robots
        self._pool = Pool(threads)
        self.filter_sensor = config.filter_sensor or config.sensor
        # Nobody tells the filter or a planner that the odometry blunders.
        self.filter_motion = config.filter_motion or replace(config.motion, blunder=0.0)
        self.simulator = Simulator(
            n_robots, config.sensor, config.motion, self._redraw(), config.people
        )
        self.belief = self._make_belief()
        look = config.observation
        self.view = MetricView(self.belief, self.filter_sensor, look.radius) if look.view else None
        self._episodes: list[_Episode | None] = [None] * n_robots

    def _redraw(self) -> tuple[float, int] | None:
        if self.config.world == "continuous":
            return None
        belief = self.config.belief
        if isinstance(belief, HistogramConfig):
            return belief.cell_size, belief.headings
        raise ConfigError("world='discrete' is the histogram filter's; belief is 'particles'")

    def _make_belief(self) -> HistogramBelief | ParticleBelief:
        belief = self.config.belief
        if self.config.task.kind == "kidnapped":
            belief = replace(belief, leak=max(belief.leak, self.config.task.kidnap_leak))
        if isinstance(belief, HistogramConfig):
            return HistogramBelief(self.n_robots, belief, self.filter_sensor, self.filter_motion)
        return ParticleBelief(self.n_robots, belief, self.filter_sensor, self.filter_motion)

    def episode(self, robot: int) -> _Episode:
        """A robot's episode.

        Raises:
            ActionError: If it has not been reset.
        """
        episode = self._episodes[robot]
        if episode is None:
            raise ActionError(f"step() before reset(): robot {robot} has no episode yet")
        return episode

    def knowledge(self, robot: int) -> Knowledge:
        """What a robot knows."""
        episode = self.episode(robot)
        return Knowledge(
            self.belief,
            robot,
            self.config.actions,
            self.filter_motion,
            self.filter_sensor,
            episode.summary,
            episode.scan.copy(),
            episode.u.copy(),
            episode.touched,
            episode.step,
        )

    def pose(self, robot: int) -> NDArray[np.float64]:
        """The true pose ``(3,)``."""
        return self.simulator.poses[robot].copy()

    def grid(self, robot: int) -> OccupancyGrid:
        """The map that a robot is on."""
        return self.belief.terrain(robot).grid

    def probability_at_truth(self, robot: int) -> float:
        """Mass of the belief near the true pose."""
        return self.belief.mass_near(robot, self.simulator.poses[robot])

    def reset(
        self, robot: int, rng: np.random.Generator, options: Mapping[str, Any] | None = None
    ) -> None:
        """Start a robot's next episode.

        Args:
            robot: Which one.
            rng: Source of all that is random in the episode.
            options: ``grid`` (an :class:`OccupancyGrid`) or ``map`` (as the environment's),
                ``pose`` ``(3,)``, to start where a caller says, and ``kidnap_pose`` ``(3,)``, where
                a kidnapped robot is carried to.

        Raises:
            ConfigError: If an option is unknown or not for this task.
            MapError: If the robot cannot be at one of the poses.
        """
        options = options or {}
        world, filter_rng = rng.spawn(2)
        grid, pose = self._start(world, options)
        self.simulator.place(robot, grid, world, pose)
        truth = self.simulator.poses[robot].copy()
        task = self.config.task
        offset = world.standard_normal(3) * [task.sigma_xy, task.sigma_xy, task.sigma_theta]
        kidnap_step = task.kidnap_step(world)
        terrain = self.simulator.terrain(robot)
        kidnap_pose = terrain.uniform_poses(world.random((1, 4)))[0]
        given = options.get("kidnap_pose")
        if given is not None:
            kidnap_pose = checked_pose(terrain, given, "kidnap_pose")
        self._start_belief(robot, grid, filter_rng, truth + offset)
        scan = self.simulator.scan(robot, world)
        novelty_rng = filter_rng.spawn(1)[0]
        impossible, dropped = self._correct(robot, scan, novelty_rng)
        episode = _Episode(
            world,
            self.belief.summarise(robot),
            scan,
            kidnap_step,
            kidnap_pose,
            Watch(task),
            novelty_rng,
            kidnap_given=given is not None,
            impossible=impossible,
            dropped=dropped,
        )
        self._episodes[robot] = episode
        self._watch(robot, episode, episode.summary.estimate)

    def _start(
        self, world: np.random.Generator, options: Mapping[str, Any]
    ) -> tuple[OccupancyGrid, NDArray[np.float64] | None]:
        for name in options:
            if name not in RESET_OPTIONS:
                raise unknown("reset options", name, RESET_OPTIONS)
        if options.get("kidnap_pose") is not None and self.config.task.kind != "kidnapped":
            raise ConfigError(
                "reset options: kidnap_pose is for a kidnapped robot; the task is "
                f"{self.config.task.kind!r}"
            )
        grid = self.config.map.draw(world) if "map" not in options else None
        if "map" in options:
            grid = MapSource.parse(options["map"]).draw(world)
        if options.get("grid") is not None:
            grid = options["grid"]
        if not isinstance(grid, OccupancyGrid):
            raise ConfigError(f"reset options: grid must be an OccupancyGrid; got {type(grid)}")
        return grid, options.get("pose")

    def _start_belief(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        near: NDArray[np.float64],
    ) -> None:
        task, belief = self.config.task, self.belief
        sigma = (task.sigma_xy, task.sigma_theta)
        if isinstance(belief, HistogramBelief):
            if task.start_known:
                belief.reset_near(robot, grid, near, sigma)
            else:
                belief.reset(robot, grid)
        elif task.start_known:
            belief.reset_near(robot, grid, rng, near, sigma)
        else:
            belief.reset(robot, grid, rng)

    def step(self, robot: int, action: object) -> None:
        """Play one step of a robot's episode; the results are read with the methods below.

        Raises:
            ActionError: If the action is not in the space or the episode is over; nothing changes.
        """
        command = self._command(robot, action)
        self._step(np.array([robot]), command[None])

    def _command(self, robot: int, action: object) -> NDArray[np.float64]:
        """The command ``(3,)`` that an action stands for, if the robot may act."""
        if self.episode(robot).over:
            raise ActionError("step() after the episode has ended: call reset()")
        return self.config.actions.command(action)

    def _step(self, robots: NDArray[np.intp], commands: NDArray[np.float64]) -> None:
        """Play one step of some episodes: the robots all at once, then each belief.

        Args:
            robots: ``(n,)``.
            commands: ``(n, 3)``.
        """
        episodes = [self.episode(robot) for robot in robots.tolist()]
        rngs = [episode.rng for episode in episodes]
        u = self.simulator.step_some(robots, commands, rngs)
        for robot, episode, command, reading in zip(
            robots.tolist(), episodes, commands, u, strict=True
        ):
            episode.step += 1
            episode.u = reading
            episode.touched = bool(self.filter_motion.touched(command, reading))
            if episode.step == episode.kidnap_step:
                self._kidnap(robot, episode)
        for episode, scan in zip(episodes, self.simulator.scan_some(robots, rngs), strict=True):
            episode.scan = scan
        self._pool.each(self._follow, robots.tolist())

    def _follow(self, robot: int) -> None:
        """Predict and correct a robot's belief, and judge it."""
        episode = self.episode(robot)
        before, last = self.entropy_fraction(robot), episode.summary.estimate
        self.belief.predict(robot, episode.u, episode.touched)
        impossible, dropped = self._correct(robot, episode.scan, episode.novelty_rng)
        episode.impossible += impossible
        episode.dropped += dropped
        episode.summary = self.belief.summarise(robot)
        self._watch(robot, episode, carried(last, episode.u))
        self._declare(robot, episode)
        episode.terms = self.config.reward.terms(
            before, self.entropy_fraction(robot), episode.right, episode.wrong
        )

    def _correct(
        self, robot: int, scan: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[int, int]:
        """Correct the belief by what the novelty filter leaves of a scan.

        Returns:
            Scans that were impossible, 0 or 1, and beams left out.
        """
        used, novelty = scan, self.config.belief.novelty
        if novelty > 0.0:
            used = drop_novel(self.belief, robot, self.filter_sensor, scan, novelty, rng)
        dropped = int((np.isnan(used) & ~np.isnan(scan)).sum())
        return int(self.belief.correct(robot, used) == -np.inf), dropped

    def _kidnap(self, robot: int, episode: _Episode) -> None:
        """Carry a robot off."""
        place = episode.kidnap_pose
        if not episode.kidnap_given:
            terrain, here = self.simulator.terrain(robot), self.simulator.poses[robot]
            place = self.config.task.kidnap_pose(terrain, here, place, episode.rng)
        self.simulator.poses[robot] = place
        episode.watch.kidnapped_at = episode.step

    def _watch(self, robot: int, episode: _Episode, reckoned: NDArray[np.float64]) -> None:
        """Take note of what a kidnapped robot believes; ``reckoned`` is by dead reckoning."""
        if self.config.task.kind == "kidnapped":
            summary = episode.summary
            near = is_near(*pose_error(summary.estimate, self.simulator.poses[robot]))
            jump = pose_error(summary.estimate, reckoned)
            episode.watch.see(episode.step, summary.mass, near, jump)

    def _declare(self, robot: int, episode: _Episode) -> None:
        """End the episode when the belief has been sure for long enough."""
        task = self.config.task
        sure = episode.summary.mass >= task.confidence
        armed = task.kind != "kidnapped" or episode.watch.noticed
        episode.held = episode.held + 1 if sure and armed else 0
        if task.declares and episode.held >= task.hold:
            near = is_near(*pose_error(episode.summary.estimate, self.simulator.poses[robot]))
            episode.over, episode.right, episode.wrong = True, near, not near

    def entropy_fraction(self, robot: int) -> float:
        """Entropy of a robot's belief as a fraction of the uniform belief's."""
        summary = self.episode(robot).summary
        return summary.entropy / max(summary.uniform_entropy, 1e-9)

    def terminated(self, robot: int) -> bool:
        """Whether a declaration has ended the episode."""
        return self.episode(robot).over

    def reward(self, robot: int) -> float:
        """The last step's reward."""
        return float(sum(self.episode(robot).terms.values()))

    def observation(self, robot: int) -> dict[str, NDArray[Any]]:
        """Of one robot: new arrays."""
        return {name: value[0] for name, value in self._observe(np.array([robot])).items()}

    def _observe(self, robots: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """See :func:`activeloc.envs.observations.observe`."""
        episodes = [self.episode(robot) for robot in robots.tolist()]
        return observe(
            self.config.observation,
            self.belief,
            robots,
            [episode.summary for episode in episodes],
            np.array([episode.scan for episode in episodes]),
            self.config.sensor.z_max,
            np.array([episode.u for episode in episodes]),
            np.array([episode.touched for episode in episodes]),
            self.view,
        )

    def info(self, robot: int) -> dict[str, Any]:
        """Scores of a robot's episode so far: plain numbers, the same keys at every step.

        ``entropy`` [nat], ``entropy_fraction`` of the uniform belief's, ``mass`` near the estimate,
        ``error_m`` and ``error_rad`` of the estimate, ``is_success`` and ``wrong`` (a declaration;
        in tracking, and while nobody carries off a robot that may be, whether the estimate is near
        the truth now, without a false alarm before, and sure but not near), ``impossible`` scans
        and ``dropped`` beams so far, ``touched``, and the reward's terms. Of a kidnapped robot
        (:mod:`activeloc.envs.tasks` defines the words): ``kidnapped``, ``noticed``,
        ``notice_steps`` and ``recover_steps`` since then (-1 for not), and ``false_alarm``.
        """
        episode = self.episode(robot)
        summary = episode.summary
        error_m, error_rad = pose_error(summary.estimate, self.simulator.poses[robot])
        right, wrong, watch = episode.right, episode.wrong, episode.watch
        if self.config.task.judges_now(watch.kidnapped):
            near = is_near(error_m, error_rad)
            right = near and not watch.false_alarm
            wrong = not near and summary.mass >= self.config.task.confidence
        terms = episode.terms or dict.fromkeys(self.config.reward.terms(0, 0, False, False), 0.0)
        return {
            "entropy": summary.entropy,
            "entropy_fraction": self.entropy_fraction(robot),
            "mass": summary.mass,
            "error_m": error_m,
            "error_rad": error_rad,
            "is_success": right,
            "wrong": wrong,
            "impossible": episode.impossible,
            "dropped": episode.dropped,
            "touched": episode.touched,
            "kidnapped": watch.kidnapped,
            "noticed": watch.noticed,
            "notice_steps": watch.notice_steps,
            "recover_steps": watch.recover_steps(episode.step, episode.right),
            "false_alarm": watch.false_alarm,
            **{f"reward_{name}": value for name, value in terms.items()},
        }

    # --- all robots at once

    @property
    def steps(self) -> NDArray[np.int64]:
        """Taken in each robot's episode ``(B,)``."""
        return np.array([self.episode(i).step for i in range(self.n_robots)])

    def demand_started(self, robots: NDArray[np.bool_]) -> None:
        """Refuse to go on while one of some robots ``(B,)`` has no episode.

        Raises:
            ActionError: With the first that has none.
        """
        for robot in np.flatnonzero(robots):
            self.episode(int(robot))

    def checked_actions(self, actions: object) -> Any:
        """Actions, one for each robot.

        Raises:
            ActionError: If there are more or fewer, or one is not in the space.
        """
        try:
            array = np.asarray(actions)
        except ValueError:
            array = np.array("ragged")
        if array.ndim == 0 or len(array) != self.n_robots:
            raise ActionError(f"actions must be {self.n_robots}, one a robot; got {actions!r}")
        given = list(array)
        for robot, action in enumerate(given):
            self.episode(robot)
            self.config.actions.command(action)
        return given

    def reset_some(
        self,
        robots: NDArray[np.intp],
        rngs: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Start the next episodes of some robots ``(n,)``, each with its own source."""
        for robot, rng in zip(robots, rngs, strict=True):
            self.reset(int(robot), rng, options)

    def step_all(self, actions: list[Any], active: NDArray[np.bool_]) -> None:
        """Play one step of many episodes.

        Args:
            actions: Of all robots; checked.
            active: ``(B,)``; the others are left alone.
        """
        robots = np.flatnonzero(active)
        commands = [self._command(robot, actions[robot]) for robot in robots.tolist()]
        self._step(robots, np.array(commands))

    def rewards(self) -> NDArray[np.float64]:
        """Of each robot's last step ``(B,)``."""
        return np.array([self.reward(robot) for robot in range(self.n_robots)])

    def ends(self) -> NDArray[np.bool_]:
        """Whether each robot's episode is over ``(B,)``."""
        return np.array([self.terminated(robot) for robot in range(self.n_robots)])

    def observations(self) -> dict[str, NDArray[Any]]:
        """Those of all robots: new arrays with a leading axis of B."""
        return self._observe(np.arange(self.n_robots))

    def infos(self) -> dict[str, NDArray[Any]]:
        """Those of all robots, ``(B,)`` each; see :meth:`info`."""
        each = [self.info(robot) for robot in range(self.n_robots)]
        return {key: np.array([one[key] for one in each]) for key in each[0]}

    def close(self) -> None:
        """Let the threads end."""
        self._pool.close()
