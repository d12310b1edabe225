"""The state machine of a batch of episodes: reset some robots, step all; arrays in, arrays out.

Both faces of the environment, for one robot and for many, are thin: this is where an episode
happens. One step is: command -> simulator (odometry, scan) -> belief (predict, correct) -> task,
reward, observation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Summary
from activeloc.beliefs.novelty import drop_novel
from activeloc.beliefs.settings import HistogramConfig
from activeloc.envs.episode import Episode
from activeloc.envs.episode_config import BELIEFS, SENSORS, WORLDS, EpisodeConfig
from activeloc.envs.knowledge import Knowledge
from activeloc.envs.observations import observe
from activeloc.envs.starts import draw_kidnapping, draw_map
from activeloc.errors import ActionError, ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sharing import Pool
from activeloc.simulator import Simulator

if TYPE_CHECKING:
    from activeloc.beliefs.histogram import HistogramBelief
    from activeloc.beliefs.metric_view import MetricView
    from activeloc.beliefs.particles import ParticleBelief

__all__ = ["BELIEFS", "SENSORS", "WORLDS", "EpisodeConfig", "Episodes", "Knowledge"]


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
        self.view: MetricView | None = None
        if look.view:
            from activeloc.beliefs.metric_view import MetricView

            self.view = MetricView(self.belief, self.filter_sensor, look.radius)
        self._episodes: list[Episode | None] = [None] * n_robots

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
        # A process that needs one filter loads nothing of the other.
        if isinstance(belief, HistogramConfig):
            from activeloc.beliefs.histogram import HistogramBelief

            return HistogramBelief(self.n_robots, belief, self.filter_sensor, self.filter_motion)
        from activeloc.beliefs.particles import ParticleBelief

        return ParticleBelief(self.n_robots, belief, self.filter_sensor, self.filter_motion)

    def episode(self, robot: int) -> Episode:
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
        options, task = options or {}, self.config.task
        world, filter_rng = rng.spawn(2)
        grid = draw_map(self.config.map, task, world, options)
        self.simulator.place(robot, grid, world, options.get("pose"))
        truth = self.simulator.poses[robot].copy()
        offset = world.standard_normal(3) * [task.sigma_xy, task.sigma_xy, task.sigma_theta]
        step, pose, given = draw_kidnapping(self.simulator, robot, task, world, options)
        self._start_belief(robot, grid, filter_rng, truth + offset)
        scan = self.simulator.scan(robot, world)
        novelty_rng = filter_rng.spawn(1)[0]
        impossible, dropped = self._correct(robot, scan, novelty_rng)
        summary = self.belief.summarise(robot)
        episode = Episode(task, world, novelty_rng, summary, scan, step, pose, given)
        episode.impossible, episode.dropped = impossible, dropped
        episode.begin(self._held(robot, episode.summary), truth)
        self._episodes[robot] = episode

    def _start_belief(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        near: NDArray[np.float64],
    ) -> None:
        task, belief = self.config.task, cast("Any", self.belief)
        # Particles need a source of their own noise.
        source = () if isinstance(self.config.belief, HistogramConfig) else (rng,)
        if task.start_known:
            belief.reset_near(robot, grid, *source, near, (task.sigma_xy, task.sigma_theta))
        else:
            belief.reset(robot, grid, *source)

    def step(self, robot: int, action: object) -> None:
        """Play one step of a robot's episode; the results are read with the methods below.

        Raises:
            ActionError: If the action is not in the space or the episode is over; nothing changes.
        """
        self._demand_going(robot)
        self._step(np.array([robot]), self.config.actions.command(action)[None])

    def _demand_going(self, robot: int) -> None:
        """Refuse to go on with an episode that has not begun, or is over."""
        if self.episode(robot).over:
            raise ActionError("step() after the episode has ended: call reset()")

    def _step(self, robots: NDArray[np.intp], commands: NDArray[np.float64]) -> None:
        """Play one step of some episodes: the robots all at once, then each belief.

        Args:
            robots: ``(n,)``.
            commands: ``(n, 3)``.
        """
        episodes = [self.episode(robot) for robot in robots.tolist()]
        rngs = [episode.rng for episode in episodes]
        u = self.simulator.step_some(robots, commands, rngs)
        touched = self.filter_motion.touched(commands, u).tolist()
        for robot, episode, reading, stopped in zip(
            robots.tolist(), episodes, u, touched, strict=True
        ):
            episode.step += 1
            episode.u, episode.touched = reading, stopped
            if episode.step == episode.kidnap_step:
                self._kidnap(robot, episode)
        for episode, scan in zip(episodes, self.simulator.scan_some(robots, rngs), strict=True):
            episode.scan = scan
        self._pool.each(self._follow, robots.tolist())

    def _follow(self, robot: int) -> None:
        """Predict and correct a robot's belief, and judge it."""
        episode = self.episode(robot)
        self.belief.predict(robot, episode.u, episode.touched)
        impossible, dropped = self._correct(robot, episode.scan, episode.novelty_rng)
        episode.impossible += impossible
        episode.dropped += dropped
        summary = self.belief.summarise(robot)
        held = self._held(robot, summary)
        episode.judge(summary, held, self.config.reward, self.simulator.poses[robot])

    def _held(self, robot: int, summary: Summary) -> float:
        """Mass of a belief about its estimate, wide enough that a robot carried off is outside."""
        task = self.config.task
        if task.kind != "kidnapped":
            return 1.0
        return self.belief.mass_near(robot, summary.estimate, task.leap, pi)

    def _correct(
        self, robot: int, scan: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[int, int]:
        """Correct the belief by what the novelty filter leaves of a scan.

        Returns:
            Scans that were impossible, 0 or 1, and beams left out.
        """
        used, novelty, dropped = scan, self.config.belief.novelty, 0
        if novelty > 0.0:
            used = drop_novel(self.belief, robot, self.filter_sensor, scan, novelty, rng)
            dropped = int((np.isnan(used) & ~np.isnan(scan)).sum())
        return int(self.belief.correct(robot, used) == -np.inf), dropped

    def _kidnap(self, robot: int, episode: Episode) -> None:
        """Carry a robot off."""
        place = episode.kidnap_pose
        if not episode.kidnap_given:
            terrain, here = self.simulator.terrain(robot), self.simulator.poses[robot]
            place = self.config.task.kidnap_pose(terrain, here, place, episode.rng)
        self.simulator.poses[robot] = place
        episode.watch.kidnapped_at = episode.step

    def entropy_fraction(self, robot: int) -> float:
        """Entropy of a robot's belief as a fraction of the uniform belief's."""
        return self.episode(robot).entropy_fraction

    def terminated(self, robot: int) -> bool:
        """Whether a declaration has ended the episode."""
        return self.episode(robot).over

    def reward(self, robot: int) -> float:
        """The last step's reward."""
        return self.episode(robot).reward

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
        return self.episode(robot).info(self.config.reward, self.simulator.poses[robot])

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
        """The commands ``(B, 3)`` that actions, one for each robot, stand for.

        Raises:
            ActionError: If there are more or fewer, or one is not in the space.
        """
        try:
            array = np.asarray(actions)
        except ValueError:
            array = np.array("ragged")
        if array.ndim == 0 or len(array) != self.n_robots:
            raise ActionError(f"actions must be {self.n_robots}, one a robot; got {actions!r}")
        commands = np.empty((self.n_robots, 3))
        for robot, action in enumerate(array):
            self.episode(robot)
            commands[robot] = self.config.actions.command(action)
        return commands

    def reset_some(
        self,
        robots: NDArray[np.intp],
        rngs: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Start the next episodes of some robots ``(n,)``, each with its own source."""
        for robot, rng in zip(robots, rngs, strict=True):
            self.reset(int(robot), rng, options)

    def step_all(self, commands: NDArray[np.float64], active: NDArray[np.bool_]) -> None:
        """Play one step of many episodes.

        Args:
            commands: ``(B, 3)``; of all robots.
            active: ``(B,)``; the others are left alone.

        Raises:
            ActionError: If an active robot's episode is over; nothing changes.
        """
        robots = np.flatnonzero(active)
        for robot in robots.tolist():
            self._demand_going(robot)
        self._step(robots, commands[robots])

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
