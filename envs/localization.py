"""The environment for one robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeloc.envs.worlds import AnyKnowledge, configure, episodes_of, observation_space
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid

if TYPE_CHECKING:
    from activeloc.envs.rendering import Scene

Observation = dict[str, NDArray[Any]]


class LocalizationEnv(gym.Env[Observation, Any]):
    """Move until the belief says where you are.

    ## Description
    A round robot with a range finder stands on a known map and does not know where. A Bayes filter
    inside the environment follows it: the belief is the observation. The agent chooses the motions
    that make the belief collapse on the truth soonest.

    ## Action space
    ``Discrete(3)``: 0 turns left by 30 degrees, 1 turns right, 2 drives 0.5 m forward; with
    ``actions="discrete+stay"`` 3 stays. ``actions="continuous"``: ``Box(-1, 1, (2,))`` of turn and
    drive. Motions are noisy and stop at obstacles; the filter is told what odometry reads.

    ## Observation space
    ``Dict`` of float32: ``belief`` ``(8, 32, 32)`` in [0, 1], heading bins x rows x cols,
    sqrt(p / max p); ``map`` ``(32, 32)`` share of free ground; ``scan`` ``(B,)`` range over the
    longest, -1 for none; ``scalars`` ``(5,)``: entropy as a fraction of the uniform's, mass near
    the estimate, touched, turned [half turns], travelled [m]. With ``observation={"view": True}``
    also what may be around the robot, as seen from it: ``view`` ``(5, 17, 17)``, ``ways`` ``(2, 12,
    9)`` and ``place`` ``(24,)``: :mod:`activeloc.beliefs.metric_view`.

    ## Rewards
    The sum of ``information`` (share of the uniform belief's entropy removed by the step), ``step``
    (-0.005), ``success`` (+1) and ``wrong`` (-1), each weighted by ``reward=`` and in ``info``.

    ## Starting state
    A pose uniform over the open ground, at any heading; the belief is uniform (``global``) or a
    Gaussian near the truth (``tracking``, ``kidnapped``), corrected by a first scan.
    ``reset(options={"grid": ..., "pose": ...})`` puts the robot where a caller says;
    ``{"map": "office:7"}`` chooses a map by name, ``"kidnap_pose"`` where a kidnapped robot is
    carried to. When that happens is the task's ``kidnap``: at a step in a ``range`` (5 to 15), at a
    ``rate``, or ``never``; nobody tells the robot.

    ## Episode end
    Terminates at a declaration: at least .95 of the belief within 0.5 m and 20 degrees of its
    estimate for three steps running; ``info["is_success"]`` if the truth lies there,
    ``info["wrong"]`` if not. The tracking task never terminates, nor does a kidnapped robot's
    before it has been carried off and its belief has let go. Truncation is `TimeLimit`'s.

    ## Mazes
    ``Maze7-v0``, ``Maze15-v0``, ``Maze21-v0`` and ``NoisyMaze9-v0`` (``task="maze"``) are the task
    of Chaplot et al., "Active Neural Localization" (ICLR 2018): a spanning-tree maze of m x m
    cells, four headings, and a reading of the number of cells to the wall ahead. ``Discrete(3)``: 0
    turns left by 90 degrees, 1 turns right, 2 goes one cell forward (into a wall: stays). The
    observation: ``belief`` ``(4, m, m)``, p / max p by heading (0 along the columns, 1 along the
    rows, counter-clockwise), row and column; ``map`` ``(m, m)``, 1 where free; ``depth``, the
    reading / 19; ``time``, steps / 100; with ``observation={"view": True}`` the ``view`` ``(5, 19,
    19)`` from the robot: :mod:`activeloc.beliefs.egocentric`. The prior is uniform over the states
    that agree with a first reading. The reward of a step is the largest posterior probability. An
    episode never terminates: it lasts as many steps as ``max_episode_steps`` says (15, 20, 30, 15).
    ``task={"kind": "maze", "reward": "doubt"}``: the same reward less 1, until the belief is sure,
    which ends the episode (for training); ``observation={"time": False}`` leaves the clock out.
    ``info["is_success"]`` is the strict accuracy: the largest probability is 1 (in the noisy maze:
    more than .5, at the truth); ``info["likeliest_is_true"]`` the other. In the noisy maze a step
    forward is 0, 1 or 2 cells long with probability .106, .788, .106, clipped at walls, and
    readings are off by one likewise. ``reset(options={"grid": ..., "pose": ...})`` takes a map or
    bools ``(m, m)``, and row, column, heading.

    ## Version history
    * v0: first release.

    Args:
        task: ``global``, ``tracking``, ``kidnapped`` or ``maze``, or a :class:`Task` or
            :class:`MazeTask`, or its fields. The maze task takes ``map`` and ``observation``
            (:class:`MazeObservation`) besides, nothing else.
        map: A generator's name (``office``, ``rooms``, ``cave``, ``maze``), ``office:7`` for
            building 7, ``office:0-3`` to draw one of four, ``office:*`` for a new one every
            episode; a map file; an :class:`OccupancyGrid`.
        belief: ``histogram`` or ``particles``, or a configuration object, or its fields.
        sensor: ``beam``, ``proximity``, ``sonar`` or ``field``, or its fields, or any
            :class:`RangeSensor`.
        motion: A :class:`MotionModel` or its fields.
        actions: ``discrete``, ``discrete+stay``, ``continuous``, :class:`Actions` or its fields.
        reward: :class:`RewardWeights` or its fields.
        observation: :class:`ObservationConfig` or its fields.
        world: ``continuous``, or ``discrete``: the filter's own discretisation made true.
        filter_sensor: What the filter assumes, if that is not the truth.
        filter_motion: What the filter assumes, if that is not the truth.
        people: Probability that a beam is cut short by somebody who is not on the map.
        render_mode: ``rgb_array`` or None.

    Raises:
        ConfigError: If a setting is unknown, of a wrong type or out of its range.
        MapError: If the map cannot be read or the robot fits nowhere on it.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        *,
        task: object = "global",
        map: object = "office",
        belief: object = "histogram",
        sensor: object = None,
        motion: object = None,
        actions: object = "discrete",
        reward: object = None,
        observation: object = None,
        world: str = "continuous",
        filter_sensor: object = None,
        filter_motion: object = None,
        people: float = 0.0,
        render_mode: str | None = None,
        **unknown: object,
    ) -> None:
        settings = dict(
            task=task,
            map=map,
            belief=belief,
            sensor=sensor,
            motion=motion,
            actions=actions,
            reward=reward,
            observation=observation,
            world=world,
            filter_sensor=filter_sensor,
            filter_motion=filter_motion,
            people=people,
        )
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(f"render_mode must be 'rgb_array' or None; got {render_mode!r}")
        self.render_mode = render_mode
        self.config = configure({**settings, **unknown})
        self._episodes = episodes_of(self.config, 1)
        self._history: list[float] = []
        self.action_space = self.config.actions.space
        self.observation_space: gym.spaces.Space[Any] = observation_space(self.config)

    @property
    def knowledge(self) -> AnyKnowledge:
        """What the robot knows: what planners plan with."""
        return self._episodes.knowledge(0)

    @property
    def pose(self) -> NDArray[np.float64]:
        """The true pose ``(3,)``, for evaluation and pictures; in a maze row, column, heading."""
        return self._episodes.pose(0)

    @property
    def grid(self) -> OccupancyGrid:
        """The map that the robot is on."""
        return self._episodes.grid(0)

    @property
    def probability_at_truth(self) -> float:
        """How much of the belief is near the true pose, for evaluation only; in a maze at it."""
        return self._episodes.probability_at_truth(0)

    @property
    def scene(self) -> Scene:
        """What there is to see, the truth included: for pictures and recordings."""
        from activeloc.envs.picture import scene_of

        return scene_of(self._episodes, 0, self._history)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """See :meth:`gymnasium.Env.reset`; options: see the starting state above."""
        super().reset(seed=seed)
        self._episodes.reset(0, self.np_random, options)
        self._history = [self._episodes.entropy_fraction(0)]
        return self._episodes.observation(0), self._episodes.info(0)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """See :meth:`gymnasium.Env.step`.

        Raises:
            ActionError: If the action is not in the space or the episode is over.
        """
        episodes = self._episodes
        episodes.step(0, action)
        self._history.append(episodes.entropy_fraction(0))
        return (
            episodes.observation(0),
            episodes.reward(0),
            episodes.terminated(0),
            False,
            episodes.info(0),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as ``(H, W, 3)``, without a display; None if no render mode was chosen."""
        if self.render_mode is None:
            gym.logger.warn("render() needs render_mode='rgb_array' at make()")
            return None
        from activeloc.envs.rendering import draw

        return draw(self.scene)
