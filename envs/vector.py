"""The environment for many robots at once: the same episodes, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from activeloc import checks
from activeloc.envs.episodes import EpisodeConfig, Episodes, Knowledge
from activeloc.errors import ActionError, ConfigError

Observation = dict[str, NDArray[Any]]
MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class LocalizationVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """B copies of :class:`LocalizationEnv` in one object.

    Robot i seeded ``s + i`` lives the episode that the single environment lives with that seed.

    Args:
        num_envs: B.
        max_episode_steps: Steps after which an episode is truncated; None or -1 (Gymnasium's word)
            for never.
        autoreset_mode: ``NEXT_STEP`` (Gymnasium's default) or ``SAME_STEP`` (what SB3 needs); the
            enumeration or its name.
        render_mode: None; pictures are the single environment's.
        settings: As :class:`LocalizationEnv`.

    Raises:
        ConfigError: If a setting is unknown, of a wrong type or out of its range.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **settings: object,
    ) -> None:
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ConfigError(f"num_envs must be a positive integer; got {num_envs!r}")
        if render_mode is not None:
            raise ConfigError(f"render_mode must be None in a vector env; got {render_mode!r}")
        self.num_envs = num_envs
        self.render_mode = None
        self.metadata = {**self.metadata, "autoreset_mode": _mode(autoreset_mode)}
        if max_episode_steps == -1:
            max_episode_steps = None
        if max_episode_steps is not None:
            checks.integer("max_episode_steps", max_episode_steps, 1, 2**31)
        self.max_episode_steps = max_episode_steps
        self.config = EpisodeConfig.build(settings)
        self._episodes = Episodes(self.config, num_envs)
        self._rngs = [seeding.np_random()[0] for _ in range(num_envs)]
        self._done = np.zeros(num_envs, dtype=np.bool_)
        self.single_action_space = self.config.actions.space
        self.single_observation_space = self.config.observation.space(
            len(self.config.sensor.bearings)
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def knowledge(self, robot: int) -> Knowledge:
        """What a robot knows: what planners plan with."""
        return self._episodes.knowledge(robot)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """See :meth:`gymnasium.vector.VectorEnv.reset`; options as the single environment's.

        ``options={"reset_mask": (B,) of bool}`` resets only some of the robots.
        """
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ConfigError(f"reset_mask must be {self.num_envs} bools, one true; got {mask!r}")
        seeds = self._seeds(seed)
        for robot in np.flatnonzero(~mask):
            self._episodes.episode(int(robot))
        for robot in np.flatnonzero(mask):
            given = seeds[robot]
            if given is not None:
                self._rngs[robot] = seeding.np_random(given)[0]
            self._episodes.reset(int(robot), self._rngs[robot], options)
        self._done[mask] = False
        return self._observations(), self._infos()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ConfigError(f"seed must be one or {self.num_envs}; got {len(seed)}")
        return list(seed)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Any]:
        """See :meth:`gymnasium.vector.VectorEnv.step`.

        Raises:
            ActionError: If there is not one action for each robot, or one is not in the space;
                nothing has changed then.
        """
        given = self._checked(actions)
        rewards = np.zeros(self.num_envs)
        again = self._done.copy()
        for robot in range(self.num_envs):
            if again[robot]:
                self._episodes.reset(robot, self._rngs[robot])
            else:
                self._episodes.step(robot, given[robot])
                rewards[robot] = self._episodes.reward(robot)
        terminated = np.array([self._episodes.terminated(i) for i in range(self.num_envs)])
        truncated = ~again & (self._steps() >= self._limit)
        self._done = terminated | truncated
        if self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and self._done.any():
            return self._reset_done(rewards, terminated, truncated)
        return self._observations(), rewards, terminated, truncated, self._infos()

    def _reset_done(
        self,
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Any]:
        """Start the next episodes at once; the last observations and infos go into ``info``."""
        done = self._done
        final_obs = np.full(self.num_envs, None, dtype=object)
        for robot in np.flatnonzero(done):
            final_obs[robot] = self._episodes.observation(int(robot))
        final_info = self._infos(done)
        for robot in np.flatnonzero(done):
            self._episodes.reset(int(robot), self._rngs[robot])
        infos = self._infos()
        infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
        infos |= {"final_info": final_info, "_final_info": done.copy()}
        self._done = np.zeros(self.num_envs, dtype=np.bool_)
        return self._observations(), rewards, terminated, truncated, infos

    def _checked(self, actions: object) -> list[Any]:
        try:
            array = np.asarray(actions)
        except ValueError:
            array = np.array("ragged")
        if array.ndim == 0 or len(array) != self.num_envs:
            raise ActionError(f"actions must be {self.num_envs}, one a robot; got {actions!r}")
        given = list(array)
        for robot, action in enumerate(given):
            self._episodes.episode(robot)
            self.config.actions.command(action)
        return given

    @property
    def _limit(self) -> float:
        return np.inf if self.max_episode_steps is None else self.max_episode_steps

    def _steps(self) -> NDArray[np.int64]:
        return np.array([self._episodes.episode(i).step for i in range(self.num_envs)])

    def _observations(self) -> Observation:
        each = [self._episodes.observation(i) for i in range(self.num_envs)]
        return {key: np.stack([one[key] for one in each]) for key in each[0]}

    def _infos(self, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """The infos as arrays, with a ``_key`` mask of the robots that each is given for."""
        given = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask
        each = [self._episodes.info(i) for i in range(self.num_envs)]
        infos: dict[str, Any] = {}
        for key in each[0]:
            values = np.array([one[key] for one in each])
            infos[key] = np.where(given, values, np.zeros_like(values))
            infos[f"_{key}"] = given.copy()
        return infos


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    for known in MODES:
        if mode is known or mode in (known.name, known.value):
            return known
    raise ConfigError(
        f"autoreset_mode must be one of {', '.join(m.name for m in MODES)}; got {mode!r}"
    )
