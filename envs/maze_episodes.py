"""The state machine of the maze task: a batch of robots that start and step together.

The task is that of Chaplot, Parisotto and Salakhutdinov, "Active Neural Localization" (ICLR 2018).
A step of the whole batch is one kernel call (:mod:`activeloc.envs.maze_kernels`), whatever B; it
may be shared by threads. Robot i of a batch lives as one alone does, to the bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.lattice import Lattice, LatticeBelief
from activeloc.envs import maze_kernels as kernels
from activeloc.envs.maze_batch import new_batch
from activeloc.envs.maze_config import ACTIONS, MazeConfig, MazeTask
from activeloc.envs.maze_knowledge import MazeKnowledge, MazePlanner
from activeloc.envs.maze_starts import checked_pose, draw_starts, free_cells
from activeloc.errors import ActionError
from activeloc.grid import OccupancyGrid
from activeloc.sharing import Helpers, new_board

NOISE_BLOCK = 64
CERTAIN = 1.0 - 1e-9
N_ACTIONS = len(ACTIONS.commands)
SHARES = 2
"""Shares of the work for each thread: one that is late leaves them to the others."""
NO_CLOCK = np.zeros((0, 1), dtype=np.float32)
NO_VIEW = np.zeros((0, 0, 0, 0), dtype=np.float32)

__all__ = [
    "MazeConfig",
    "MazeEpisodes",
    "MazeKnowledge",
    "MazePlanner",
    "MazeTask",
    "checked_pose",
    "free_cells",
]


class MazeEpisodes:
    """B robots in mazes, their beliefs and their episodes.

    Episodes have no end of their own, but for the reward ``doubt``: whoever plays them truncates
    them after T steps.

    Args:
        config: What to play.
        n_robots: B.
        threads: That share the work.
    """

    def __init__(self, config: MazeConfig, n_robots: int, threads: int = 1) -> None:
        self.config = config
        self.n_robots = n_robots
        self._is_doubt = config.task.reward == "doubt"
        self.lattice = Lattice(n_robots, config.size, config.task.p_off)
        self.belief = LatticeBelief(self.lattice)
        look = config.observation
        self.view = EgocentricView(self.belief, look.radius) if look.view else None
        self.names = ["maze"] * n_robots
        shapes = look.shapes(config.size)
        self._shapes = {name: (n_robots, *shape) for name, shape in shapes.items()}
        self._everyone = np.arange(n_robots)
        self._started = np.zeros(n_robots, dtype=np.bool_)
        self._all_started = False
        self._rngs: list[np.random.Generator | None] = [None] * n_robots
        self._uniforms = np.zeros((n_robots, NOISE_BLOCK, 2))
        confidence = min(config.task.confidence, CERTAIN)
        doubt = float(self._is_doubt)
        self._batch = new_batch(self.lattice, self.belief, self.view, confidence, doubt)
        self.steps = self._batch.steps
        helpers = min(threads, n_robots) - 1
        self._shares = min(SHARES, -(-n_robots // (helpers + 1))) if helpers else 1
        self._board = new_board(0)
        work = partial(kernels.help_out, self._batch, self._shares)
        self._helpers = Helpers(helpers, work) if helpers else None

    def close(self) -> None:
        """Let the threads end."""
        if self._helpers is not None:
            self._helpers.close()

    def _run(self, order: int, active: NDArray[np.bool_] | None = None) -> None:
        """Let all threads carry out an order, for the active robots ``(B,)`` if it is for some."""
        self._batch.order[0] = order
        if active is not None:
            self._batch.active[:] = active
        board = self._board if self._helpers is None else self._helpers.call()
        kernels.run(self._batch, board, self._shares)

    def demand_started(self, robots: NDArray[np.bool_] | None = None) -> None:
        """Refuse to go on while one of some robots ``(B,)``, or of all, has no episode.

        Raises:
            ActionError: With the first that has none.
        """
        if self._all_started:
            return
        idle = ~self._started if robots is None else robots & ~self._started
        if idle.any():
            self._demand_started(int(idle.argmax()))

    def _demand_started(self, robot: int) -> None:
        if not self._started[robot]:
            raise ActionError(f"step() before reset(): robot {robot} has no episode yet")

    def knowledge(self, robot: int) -> MazeKnowledge:
        """What a robot knows."""
        self._demand_started(robot)
        return self._knowledge(np.array([robot]))

    def knowledge_of_all(self) -> MazeKnowledge:
        """What the robots know, together."""
        self.demand_started()
        return self._knowledge(self._everyone)

    def _knowledge(self, robots: NDArray[np.intp]) -> MazeKnowledge:
        reading, steps = self._batch.reading + np.int32(1), self.steps.copy()
        return MazeKnowledge(self.lattice, self.belief, robots, ACTIONS, reading, steps)

    def pose(self, robot: int) -> NDArray[np.float64]:
        """The true row, column and heading ``(3,)``."""
        return self.lattice.pose_of(robot, int(self._batch.state[robot]))

    def grid(self, robot: int) -> OccupancyGrid:
        """The maze as a map, cells of 1 m."""
        return OccupancyGrid(~self.lattice.free[robot], 1.0, name=self.names[robot])

    def probability_at_truth(self, robot: int) -> float:
        """Of the belief."""
        state = int(self._batch.state[robot])
        return float(self.belief.bel[robot, state // 4, state % 4])

    # --- start

    def reset(
        self, robot: int, rng: np.random.Generator, options: Mapping[str, Any] | None = None
    ) -> None:
        """Start a robot's next episode.

        Args:
            robot: Which one.
            rng: Source of all that is random in the episode.
            options: ``grid`` (an :class:`OccupancyGrid`, or bools ``(m, m)``, of which those on
                the rim stand for walls) or ``map`` (as the environment's); ``pose``: row, column
                and heading (0 along +column, 1 along +row, 2, 3), to start where a caller says.

        Raises:
            ConfigError: If an option is unknown.
            MapError: If the maze is of another size, or the robot cannot be at the pose.
        """
        self.reset_some(np.array([robot]), [rng], options)

    def reset_some(
        self,
        robots: NDArray[np.intp],
        rngs: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Start the next episodes of some robots; see :meth:`reset`.

        Args:
            robots: ``(n,)``.
            rngs: One for each of them.
            options: For all of them.
        """
        batch, size = self._batch, self.lattice.size
        free, names, pose = draw_starts(self.config.map, rngs, options or {}, size)
        luck = np.empty((len(robots), 2))
        for row, rng in zip(luck, rngs, strict=True):
            rng.random(out=row)
        batch.free[robots], batch.luck[robots], batch.pose[:] = free, luck, pose
        active = np.zeros(self.n_robots, dtype=np.bool_)
        active[robots] = True
        self._run(kernels.START, active)
        self._started |= active
        self._all_started = bool(self._started.all())
        for robot, rng, name in zip(robots, rngs, names, strict=True):
            self._rngs[robot], self.names[robot] = rng, name

    # --- step

    def step(self, robot: int, action: object) -> None:
        """Play one step of a robot's episode; the results are read with the methods below.

        Raises:
            ActionError: If the action is not in the space; nothing changes.
        """
        self._demand_started(robot)
        ACTIONS.command(action)
        actions = np.zeros(self.n_robots, dtype=np.int64)
        actions[robot] = int(np.asarray(action))
        self.step_all(actions, self._everyone == robot)

    def checked_actions(self, actions: object) -> Any:
        """Actions ``(B,)``, one for each robot.

        Raises:
            ActionError: If there are more or fewer, or one is not in the space.
        """
        self.demand_started()
        try:
            given = np.asarray(actions)
        except ValueError:
            given = np.array("ragged")
        if given.ndim == 0 or len(given) != self.n_robots:
            raise ActionError(f"actions must be {self.n_robots}, one a robot; got {actions!r}")
        whole = given.ndim == 1 and given.dtype.kind in "iu"
        checked = given.astype(np.int64) if whole else np.full(1, -1)
        if not kernels.are_within(checked, N_ACTIONS):
            raise ActionError(f"actions must be integers in [0, {N_ACTIONS - 1}]; got {actions!r}")
        return checked

    def step_all(self, actions: NDArray[np.int64], active: NDArray[np.bool_]) -> None:
        """Play one step of many episodes.

        Args:
            actions: ``(B,)`` of actions that have been checked.
            active: ``(B,)``; the others are left alone.
        """
        self._batch.actions[:] = actions
        if self.config.task.p_off > 0.0:
            self._draw_noise(active)
        self._run(kernels.STEP, active)

    def _draw_noise(self, active: NDArray[np.bool_]) -> None:
        """Uniform numbers of the next step, drawn in blocks from each robot's source."""
        place = self.steps % NOISE_BLOCK
        for robot in np.flatnonzero(active & (place == 0)):
            rng = self._rngs[robot]
            assert rng is not None
            rng.random(out=self._uniforms[robot])
        self._batch.uniforms[:] = self._uniforms[self._everyone, place]

    # --- results

    def terminated(self, robot: int) -> bool:
        """Whether a robot's episode is over; never with the reward ``largest``."""
        self._demand_started(robot)
        return bool(self.ends()[robot])

    def reward(self, robot: int) -> float:
        """The largest probability after the last step; see :class:`MazeTask`."""
        return float(self.rewards()[robot])

    def ends(self) -> NDArray[np.bool_]:
        """Whether each robot's episode is over ``(B,)``; see :class:`MazeTask`."""
        if not self._is_doubt:
            return np.zeros(self.n_robots, dtype=np.bool_)
        return self.belief.largest > CERTAIN

    def rewards(self) -> NDArray[np.float64]:
        """Of each robot's last step ``(B,)``, 0 before the first; see :class:`MazeTask`."""
        return self._batch.scores[5].copy()

    def entropy_fraction(self, robot: int) -> float:
        """Entropy of a robot's belief as a fraction of the uniform belief's."""
        return float(self._batch.scores[1, robot])

    def observations(self) -> dict[str, NDArray[np.float32]]:
        """Those of all robots, new; see :class:`activeloc.envs.egocentric.MazeObservation`."""
        drawn = {name: np.empty(shape, np.float32) for name, shape in self._shapes.items()}
        kernels.aim(
            self._batch.shown, drawn["belief"], drawn["map"], drawn["depth"],
            drawn.get("time", NO_CLOCK), drawn.get("view", NO_VIEW),
        )  # fmt: skip
        self._run(kernels.SHOW)
        return drawn

    def observation(self, robot: int) -> dict[str, NDArray[np.float32]]:
        """Of one robot: new arrays."""
        self._demand_started(robot)
        return {name: value[robot].copy() for name, value in self.observations().items()}

    def infos(self) -> dict[str, NDArray[Any]]:
        """Scores of the episodes so far, ``(B,)`` each.

        ``entropy`` [nat] and ``entropy_fraction`` of the uniform belief's; ``mass``, the largest
        probability; ``error_m`` [cell] and ``error_rad`` of the state that has it; ``is_success``,
        the strict accuracy: the largest probability is 1 (with noise: more than ``confidence``) and
        at the truth; ``likeliest_is_true``, the other accuracy; ``wrong``, sure but not there;
        ``success_step``, since when ``is_success`` has held without a break, -1 if it does not;
        ``impossible`` readings; ``depth`` [cell] that was read, and the reward's one term.
        """
        batch = self._batch
        scores, verdict, counts = batch.scores.copy(), batch.verdict.T.copy(), batch.counts.copy()
        return {
            "entropy": scores[0],
            "entropy_fraction": scores[1],
            "mass": scores[2],
            "error_m": scores[3],
            "error_rad": scores[4],
            "is_success": verdict[0],
            "likeliest_is_true": verdict[1],
            "wrong": verdict[2],
            "success_step": counts[0],
            "impossible": counts[1],
            "depth": counts[2],
            f"reward_{self.config.task.reward}": scores[5],
        }

    def info(self, robot: int) -> dict[str, Any]:
        """Of one robot, as plain numbers."""
        self._demand_started(robot)
        return {name: value[robot].item() for name, value in self.infos().items()}
