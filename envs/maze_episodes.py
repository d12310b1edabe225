"""The state machine of the maze task: a batch of robots that start and step together.

The task is that of Chaplot, Parisotto and Salakhutdinov, "Active Neural Localization" (ICLR 2018).
It has the face of :class:`activeloc.envs.episodes.Episodes` for one robot at a time, and besides
methods for all of them at once (:meth:`MazeEpisodes.step_all` and the plurals), which the vector
environment uses: a step of the whole batch is a handful of kernel calls, whatever B.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.lattice import Lattice, LatticeBelief, check_mazes
from activeloc.configuration import build, unknown
from activeloc.envs.actions import Actions
from activeloc.envs.egocentric import MazeObservation, observe_mazes
from activeloc.errors import ActionError, ConfigError, MapError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.maps.maze import Maze

RESET_OPTIONS = ("map", "grid", "pose")
NOISE_BLOCK = 64
CERTAIN = 1.0 - 1e-9
ACTIONS = Actions(turn=float(np.pi / 2.0), forward=1.0)
N_ACTIONS = len(ACTIONS.commands)


@dataclass(frozen=True, slots=True)
class MazeTask:
    """The maze task's own settings.

    Attributes:
        kind: ``maze``.
        p_off: Probability that a step forward is one cell short, and of being one long, clipped at
            walls; that a reading is one too small, and one too large. 0: no noise.
        confidence: The belief is sure when its largest probability is more than this; 1 for when
            it is 1.
        reward: ``largest``, the largest probability after a step; or ``doubt``, that less 1, and
            the episode ends once it is 1, since no doubt is to come. Returns differ by T, and
            training does not wait for the rest of the episode.

    Raises:
        ConfigError: If a value is out of its range.
    """

    kind: str = "maze"
    p_off: float = 0.0
    confidence: float = 1.0
    reward: str = "largest"

    def __post_init__(self) -> None:
        checks.choice("task.kind", self.kind, ("maze",))
        checks.choice("task.reward", self.reward, ("largest", "doubt"))
        checks.number("task.p_off", self.p_off, 0.0, 0.5)
        checks.number("task.confidence", self.confidence, 0.0, 1.0, above_low=True)


@dataclass(frozen=True)
class MazeConfig:
    """Everything that defines a maze environment, typed and checked.

    Attributes:
        task: Noise, and what counts as success.
        map: Where the mazes come from: ``maze(size=15):*``, or one map with walls around it.
        observation: What is observed.
    """

    task: MazeTask = field(default_factory=MazeTask)
    map: MapSource = field(default_factory=lambda: MapSource.parse("maze(size=15):*"))
    observation: MazeObservation = field(default_factory=MazeObservation)

    @classmethod
    def build(cls, settings: Mapping[str, Any]) -> MazeConfig:
        """From the environment's keyword arguments.

        Raises:
            ConfigError: If a name is unknown, or a value is refused or not for a maze.
            MapError: If a map cannot be read.
        """
        usual = {"belief": "histogram", "actions": "discrete", "world": "continuous", "people": 0.0}
        others = ("sensor", "motion", "reward", "filter_sensor", "filter_motion", *usual)
        for name, value in settings.items():
            if name not in cls.__dataclass_fields__ and name not in others:
                raise unknown("environment", name, [*cls.__dataclass_fields__, *others])
            if name in others and value not in (None, usual.get(name), {"kind": usual.get(name)}):
                raise ConfigError(
                    f"{name} is not for the maze task, which has one sensor, motion, filter and "
                    f"reward; got {value!r}"
                )
        task = settings.get("task")
        spec = settings.get("map")
        config = cls(
            build(MazeTask, {"kind": task} if isinstance(task, str) else task, "task"),
            MapSource.parse("maze(size=15):*" if spec is None else spec),
            build(MazeObservation, settings.get("observation"), "observation"),
        )
        _ = config.size
        return config

    @property
    def size(self) -> int:
        """m, cells along a side.

        Raises:
            ConfigError: If the maps are no mazes of one size.
        """
        if isinstance(self.map.generator, Maze):
            return self.map.generator.size
        if self.map.grid is None or len({*self.map.grid.shape}) != 1:
            raise ConfigError(
                f"map {self.map.spec!r} is not for the maze task; expected maze(size=15):*, or a "
                "map with as many rows as columns"
            )
        check_mazes(self.map.grid.free[None], 1, self.map.grid.shape[0])
        return self.map.grid.shape[0]

    @property
    def actions(self) -> Actions:
        """Turn left, turn right, one cell forward."""
        return ACTIONS


@dataclass(frozen=True, slots=True)
class MazeKnowledge:
    """What robots in mazes know: all that an agent may look at. The truth is not in it.

    It holds the whole batch, so that a planner may choose for all robots in one call: arrays have a
    leading axis of B. ``robots`` are those that it is asked for (all of them, or one). Belief and
    tables are the environment's own: read them before the next step, and write into none.

    Attributes:
        lattice: The mazes as tables: free cells, depths, and the state that each action means to
            lead to (:class:`Lattice`: ``free, n_cells, cells, index, depth, successor``), the law
            of steps and readings (``steps, p_step, sensor, target``).
        belief: Its ``candidates()`` are the states that hold mass, with their probabilities;
            ``bel`` ``(B, C, 4)`` the same as an array; ``largest``, ``likeliest``, ``entropy``.
        robots: ``(n,)``.
        actions: 0 turns left, 1 right, 2 goes forward.
        reading: ``(B,)``; last depths read [cell], at least 1.
        step: ``(B,)``; steps taken.
    """

    lattice: Lattice
    belief: LatticeBelief
    robots: NDArray[np.intp]
    actions: Actions
    reading: NDArray[np.int32]
    step: NDArray[np.int64]


class MazePlanner(Protocol):
    """An agent that plays mazes, one robot or a batch."""

    def act_all(self, knowledge: MazeKnowledge) -> NDArray[np.int64]:
        """An action for each of ``knowledge.robots``: ``(n,)``."""
        ...


@dataclass(frozen=True, slots=True)
class _Scores:
    """How the beliefs of B robots stand against the truth: see :meth:`MazeEpisodes.infos`.

    Attributes:
        fraction: ``(B,)``; entropy over the uniform belief's.
        error: ``(2, B)``; of the most likely state: distance [cell] and angle [rad].
        verdict: ``(3, B)``; sure and right, the most likely state is true, sure and wrong.
        success_step: ``(B,)``; since when it has been sure and right, or -1.
    """

    fraction: NDArray[np.float64]
    error: NDArray[np.float64]
    verdict: NDArray[np.bool_]
    success_step: NDArray[np.int64]

    @classmethod
    def of(cls, n_robots: int) -> _Scores:
        """Of robots that have not begun."""
        verdict = np.zeros((3, n_robots), dtype=np.bool_)
        since = np.full(n_robots, -1, dtype=np.int64)
        return cls(np.zeros(n_robots), np.zeros((2, n_robots)), verdict, since)


class MazeEpisodes:
    """B robots in mazes, their beliefs and their episodes.

    Episodes have no end of their own, but for the reward ``doubt``: whoever plays them truncates
    them after T steps.

    Args:
        config: What to play.
        n_robots: B.
    """

    def __init__(self, config: MazeConfig, n_robots: int) -> None:
        self.config = config
        self.n_robots = n_robots
        self._is_doubt = config.task.reward == "doubt"
        self.lattice = Lattice(n_robots, config.size, config.task.p_off)
        self.belief = LatticeBelief(self.lattice)
        look = config.observation
        self.view = EgocentricView(self.belief, look.radius) if look.view else None
        self.names = ["maze"] * n_robots
        self._maps = np.zeros(self.lattice.free.shape, dtype=np.float32)
        self.steps = np.zeros(n_robots, dtype=np.int64)
        self._everyone = np.arange(n_robots)
        self._started = np.zeros(n_robots, dtype=np.bool_)
        self._rngs: list[np.random.Generator | None] = [None] * n_robots
        self._uniforms = np.zeros((n_robots, NOISE_BLOCK, 2))
        self._silence = np.zeros((n_robots, 2))
        self._state = np.zeros(n_robots, dtype=np.int32)
        self._reading = np.zeros(n_robots, dtype=np.int32)
        self._scores = _Scores.of(n_robots)

    def _demand_started(self, robot: int) -> None:
        if not self._started[robot]:
            raise ActionError(f"step() before reset(): robot {robot} has no episode yet")

    def _demand_all_started(self) -> None:
        if not self._started.all():
            self._demand_started(int(self._started.argmin()))

    def knowledge(self, robot: int) -> MazeKnowledge:
        """What a robot knows."""
        self._demand_started(robot)
        return self._knowledge(np.array([robot]))

    def knowledge_of_all(self) -> MazeKnowledge:
        """What the robots know, together."""
        self._demand_all_started()
        return self._knowledge(self._everyone)

    def _knowledge(self, robots: NDArray[np.intp]) -> MazeKnowledge:
        reading, steps = self._reading + np.int32(1), self.steps.copy()
        return MazeKnowledge(self.lattice, self.belief, robots, ACTIONS, reading, steps)

    def pose(self, robot: int) -> NDArray[np.float64]:
        """The true row, column and heading ``(3,)``."""
        return self.lattice.pose_of(robot, int(self._state[robot]))

    def grid(self, robot: int) -> OccupancyGrid:
        """The maze as a map, cells of 1 m."""
        return OccupancyGrid(~self.lattice.free[robot], 1.0, name=self.names[robot])

    def probability_at_truth(self, robot: int) -> float:
        """Of the belief."""
        state = int(self._state[robot])
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
        options = options or {}
        for name in options:
            if name not in RESET_OPTIONS:
                raise unknown("reset options", name, RESET_OPTIONS)
        source = MapSource.parse(options["map"]) if "map" in options else self.config.map
        drawn = [_draw(source, rng) for rng in rngs]
        free, name = np.stack([maze for maze, _ in drawn]), ""
        if options.get("grid") is not None:
            given, name = free_cells(options["grid"])
            free = np.stack([given] * len(robots))
        check_mazes(free, len(robots), self.lattice.size)
        pose = checked_pose(options.get("pose"), free)
        luck = np.array([rng.random(2) for rng in rngs])
        self.lattice.place(robots, free)
        self._maps[robots] = free
        n_states = 4 * self.lattice.n_cells[robots]
        self._state[robots] = (luck[:, 0] * n_states).astype(np.int32)
        if pose is not None:
            self._state[robots] = [self.lattice.state_of(int(robot), *pose) for robot in robots]
        self._begin(robots, rngs, luck[:, 1])
        for robot, (_, own) in zip(robots, drawn, strict=True):
            self.names[robot] = name or own

    def _begin(
        self,
        robots: NDArray[np.intp],
        rngs: Sequence[np.random.Generator],
        luck: NDArray[np.float64],
    ) -> None:
        """First readings, beliefs and scores of robots that have been placed."""
        active = np.zeros(self.n_robots, dtype=np.bool_)
        active[robots] = True
        for robot, rng in zip(robots, rngs, strict=True):
            self._rngs[robot] = rng
        uniforms = np.zeros((self.n_robots, 2))
        uniforms[robots, 1] = luck
        stay = np.full(self.n_robots, N_ACTIONS)
        self.lattice.move_and_read(active, stay, uniforms, self._state, self._reading)
        self.belief.reset(robots, self._reading)
        if self.view is not None:
            self.view.place(robots)
        self.steps[robots] = 0
        self._started[robots] = True
        self._scores.success_step[robots] = -1
        self._score(active)

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

    def checked_actions(self, actions: object) -> NDArray[np.int64]:
        """Actions ``(B,)``, one for each robot.

        Raises:
            ActionError: If there are more or fewer, or one is not in the space.
        """
        self._demand_all_started()
        try:
            given = np.asarray(actions)
        except ValueError:
            given = np.array("ragged")
        if given.ndim == 0 or len(given) != self.n_robots:
            raise ActionError(f"actions must be {self.n_robots}, one a robot; got {actions!r}")
        whole = given.ndim == 1 and given.dtype.kind in "iu"
        checked = given.astype(np.int64) if whole else np.full(1, -1)
        # A number below zero is a very large one without its sign.
        if checked.view(np.uint64).max() >= N_ACTIONS:
            raise ActionError(f"actions must be integers in [0, {N_ACTIONS - 1}]; got {actions!r}")
        return checked

    def step_all(self, actions: NDArray[np.int64], active: NDArray[np.bool_]) -> None:
        """Play one step of many episodes.

        Args:
            actions: ``(B,)`` of actions that have been checked.
            active: ``(B,)``; the others are left alone.
        """
        uniforms = self._noise(active)
        self.lattice.move_and_read(active, actions, uniforms, self._state, self._reading)
        self.belief.step(active, actions, self._reading)
        self.steps += active
        self._score(active)

    def _noise(self, active: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Uniform numbers ``(B, 2)`` of the next step, drawn in blocks from each robot's source."""
        if self.config.task.p_off == 0.0:
            return self._silence
        place = self.steps % NOISE_BLOCK
        for robot in np.flatnonzero(active & (place == 0)):
            rng = self._rngs[robot]
            assert rng is not None
            rng.random(out=self._uniforms[robot])
        return self._uniforms[self._everyone, place]

    def _score(self, active: NDArray[np.bool_]) -> None:
        """Hold the beliefs against the truth; see :meth:`infos`."""
        on, belief, scores = self.lattice, self.belief, self._scores
        _hold_against_truth(
            active, min(self.config.task.confidence, CERTAIN), self.steps, self._state,
            on.n_cells, on.cells, belief.largest, belief.likeliest, belief.entropy,
            scores.fraction, scores.error, scores.verdict, scores.success_step,
        )  # fmt: skip

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
        return self._is_doubt & (self.belief.largest > CERTAIN)

    def rewards(self) -> NDArray[np.float64]:
        """Of each robot's last step ``(B,)``; see :class:`MazeTask`."""
        return self.belief.largest - float(self._is_doubt)

    def entropy_fraction(self, robot: int) -> float:
        """Entropy of a robot's belief as a fraction of the uniform belief's."""
        return float(self._scores.fraction[robot])

    def observations(self) -> dict[str, NDArray[Any]]:
        """Those of all robots: see :func:`activeloc.envs.egocentric.observe_mazes`."""
        clock = self.steps if self.config.observation.time else None
        return observe_mazes(self.belief, self._maps, self.view, self._reading, clock)

    def observation(self, robot: int) -> dict[str, NDArray[Any]]:
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
        belief, scores = self.belief, self._scores
        error, verdict = scores.error.copy(), scores.verdict.copy()
        return {
            "entropy": belief.entropy.copy(),
            "entropy_fraction": scores.fraction.copy(),
            "mass": belief.largest.copy(),
            "error_m": error[0],
            "error_rad": error[1],
            "is_success": verdict[0],
            "likeliest_is_true": verdict[1],
            "wrong": verdict[2],
            "success_step": scores.success_step.copy(),
            "impossible": belief.impossible.astype(np.int64),
            "depth": self._reading.astype(np.int64) + 1,
            f"reward_{self.config.task.reward}": np.where(self.steps > 0, self.rewards(), 0.0),
        }

    def info(self, robot: int) -> dict[str, Any]:
        """Of one robot, as plain numbers."""
        self._demand_started(robot)
        return {name: value[robot].item() for name, value in self.infos().items()}


def _draw(source: MapSource, rng: np.random.Generator) -> tuple[NDArray[np.bool_], str]:
    """A maze's free cells and its name; one of endless mazes is drawn without a number."""
    if isinstance(source.generator, Maze) and source.n_maps is None:
        return source.generator.draw(rng) == 0, "maze"
    grid = source.draw(rng)
    return grid.free, grid.name


def free_cells(maze: object) -> tuple[NDArray[np.bool_], str]:
    """Free cells ``(m, m)`` and name of a maze that a caller gives.

    Args:
        maze: A map, or bools, true for walls or for free cells: the rim, which is wall, says which.

    Raises:
        MapError: If it is neither, or the rim is not of one kind.
    """
    if isinstance(maze, OccupancyGrid):
        return maze.free, maze.name
    cells = np.asarray(maze)
    if cells.dtype != np.bool_ or cells.ndim != 2 or cells.size == 0:
        raise MapError(
            f"a maze must be an OccupancyGrid or bools (m, m); got {cells.dtype} of shape "
            f"{cells.shape}"
        )
    wall = cells[0, 0]
    if not ((cells[[0, -1]] == wall).all() and (cells[:, [0, -1]] == wall).all()):
        raise MapError("a maze must have walls along its rim; the rim is partly true, partly false")
    return cells != wall, "given"


def checked_pose(pose: object, free: NDArray[np.bool_]) -> tuple[int, int, int] | None:
    """Row, column and heading as integers; None where none is given.

    Args:
        pose: What a caller gave.
        free: ``(n, m, m)``; the mazes that the pose must be a free cell of.

    Raises:
        MapError: If it is no place in one of them.
    """
    if pose is None:
        return None
    try:
        given = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape != (3,):
        raise MapError(f"pose must be three numbers: row, column, heading; got {pose!r}")
    if not np.isfinite(given).all() or (given != np.round(given)).any():
        raise MapError(f"pose must be three finite whole numbers; got {pose!r}")
    row, col, heading = (int(value) for value in given)
    size = free.shape[1]
    inside = 0 <= row < size and 0 <= col < size and 0 <= heading < 4
    if not (inside and free[:, row, col].all()):
        raise MapError(
            f"pose: ({row}, {col}, {heading}) is in an obstacle or outside of the map; expected "
            f"row and column of a free cell of {size} x {size} and a heading 0 to 3"
        )
    return row, col, heading


@njit(cache=True, nogil=True)
def _hold_against_truth(
    active: NDArray[np.bool_],
    confidence: float,
    steps: NDArray[np.int64],
    state: NDArray[np.int32],
    n_cells: NDArray[np.int32],
    cells: NDArray[np.int32],
    largest: NDArray[np.float64],
    likeliest: NDArray[np.int32],
    entropy: NDArray[np.float64],
    fraction: NDArray[np.float64],
    error: NDArray[np.float64],
    verdict: NDArray[np.bool_],
    success_step: NDArray[np.int64],
) -> None:
    """Score the beliefs of the active robots; the last four arguments are :class:`_Scores`."""
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        fraction[b] = entropy[b] / np.log(4.0 * n_cells[b])
        here, there = cells[b, state[b] // 4], cells[b, likeliest[b] // 4]
        error[0, b] = np.hypot(here[0] - there[0], here[1] - there[1])
        quarters = (state[b] - likeliest[b]) % 4
        error[1, b] = min(quarters, 4 - quarters) * (0.5 * np.pi)
        sure, is_true = largest[b] > confidence, state[b] == likeliest[b]
        verdict[0, b] = sure and is_true
        verdict[1, b] = is_true
        verdict[2, b] = sure and not is_true
        if not verdict[0, b]:
            success_step[b] = -1
        elif success_step[b] < 0:
            success_step[b] = steps[b]
