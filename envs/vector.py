"""The environment for many robots at once: the same episodes, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from activeloc import checks
from activeloc.envs.worlds import AnyKnowledge, configure, episodes_of, observation_space
from activeloc.errors import ConfigError

if TYPE_CHECKING:
    from activeloc.envs.maze_knowledge import MazeKnowledge

Observation = dict[str, NDArray[Any]]
MOST_THREADS = 256
MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class LocalizationVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """B copies of :class:`LocalizationEnv` in one object.

    Robot i seeded ``s + i`` lives the episode that the single environment lives with that seed.
    What is computed for a map is kept for the 8 to 64 maps used last, and for those that robots are
    on: memory does not grow with new maps.

    Args:
        num_envs: B.
        max_episode_steps: Steps after which an episode is truncated; None or -1 (Gymnasium's word)
            for never.
        autoreset_mode: ``NEXT_STEP`` (Gymnasium's default) or ``SAME_STEP`` (what SB3 needs); the
            enumeration or its name.
        render_mode: None; pictures are the single environment's.
        threads: That share the work, at least 1. Results are the same bits for any number. They are
            made when they are first needed, in every process that needs them; :meth:`close` ends
            them.
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
        threads: int = 1,
        **settings: object,
    ) -> None:
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ConfigError(f"num_envs must be a positive integer; got {num_envs!r}")
        if render_mode is not None:
            raise ConfigError(f"render_mode must be None in a vector env; got {render_mode!r}")
        checks.integer("threads", threads, 1, MOST_THREADS)
        self.num_envs = num_envs
        self.render_mode = None
        self.metadata = {**self.metadata, "autoreset_mode": _mode(autoreset_mode)}
        if max_episode_steps == -1:
            max_episode_steps = None
        if max_episode_steps is not None:
            checks.integer("max_episode_steps", max_episode_steps, 1, 2**31)
        self.max_episode_steps = max_episode_steps
        self._limit = np.iinfo(np.int64).max if max_episode_steps is None else max_episode_steps
        self.config = configure(settings)
        self._episodes = episodes_of(self.config, num_envs, threads)
        self._rngs = [seeding.np_random()[0] for _ in range(num_envs)]
        self._done = np.zeros(num_envs, dtype=np.bool_)
        self._everyone = np.ones(num_envs, dtype=np.bool_)
        self.single_action_space = self.config.actions.space
        self.single_observation_space = observation_space(self.config)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def knowledge(self, robot: int) -> AnyKnowledge:
        """What a robot knows: what planners plan with."""
        return self._episodes.knowledge(robot)

    @property
    def batch_knowledge(self) -> MazeKnowledge:
        """What all robots know, for planners that choose for all of them at once.

        Raises:
            ConfigError: If they are in no mazes.
        """
        from activeloc.envs.maze_episodes import MazeEpisodes

        if not isinstance(self._episodes, MazeEpisodes):
            raise ConfigError("batch_knowledge is the maze task's; use knowledge(robot)")
        return self._episodes.knowledge_of_all()

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
        self._episodes.demand_started(~mask)
        for robot in np.flatnonzero(mask):
            given = seeds[robot]
            if given is not None:
                self._rngs[robot] = seeding.np_random(given)[0]
        self._start(mask, options)
        self._done[mask] = False
        return self._episodes.observations(), self._infos()

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
        rewards, terminated = self._play(actions, self._done)
        # Episodes that have just begun have no steps.
        truncated = self._episodes.steps >= self._limit
        self._done = terminated | truncated
        same_step = self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        if same_step and np.count_nonzero(self._done):
            return self._reset_done(rewards, terminated, truncated)
        return self._episodes.observations(), rewards, terminated, truncated, self._infos()

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads end; see :meth:`gymnasium.vector.VectorEnv.close`."""
        self._episodes.close()

    def _start(self, which: NDArray[np.bool_], options: dict[str, Any] | None = None) -> None:
        """Start the next episodes of some robots, ``(B,)``."""
        robots = np.flatnonzero(which)
        if len(robots):
            self._episodes.reset_some(robots, [self._rngs[robot] for robot in robots], options)

    def _play(
        self, actions: NDArray[Any], again: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """One step of all robots but those whose next episode starts; rewards and ends."""
        checked = self._episodes.checked_actions(actions)
        n_again = np.count_nonzero(again)
        if n_again == 0:
            self._episodes.step_all(checked, ~again)
            return self._episodes.rewards(), self._episodes.ends()
        if n_again < self.num_envs:
            self._episodes.step_all(checked, ~again)
        self._start(again)
        return np.where(again, 0.0, self._episodes.rewards()), self._episodes.ends() & ~again

    def _reset_done(
        self,
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Any]:
        """Start the next episodes at once; the last observations and infos go into ``info``."""
        done = self._done
        final_obs = np.full(self.num_envs, None, dtype=object)
        last = self._episodes.observations()
        for robot in np.flatnonzero(done):
            final_obs[robot] = {key: value[robot] for key, value in last.items()}
        final_info = self._infos(done)
        self._start(done)
        infos = self._infos()
        infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
        infos |= {"final_info": final_info, "_final_info": done.copy()}
        self._done = np.zeros(self.num_envs, dtype=np.bool_)
        return self._episodes.observations(), rewards, terminated, truncated, infos

    def _infos(self, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """The infos as arrays, with a ``_key`` mask of the robots that each is given for."""
        given = self._everyone.copy() if mask is None else mask.copy()
        infos: dict[str, Any] = {}
        for key, values in self._episodes.infos().items():
            infos[key] = values if mask is None else np.where(given, values, np.zeros_like(values))
            infos[f"_{key}"] = given
        return infos


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    for known in MODES:
        if mode is known or mode in (known.name, known.value):
            return known
    raise ConfigError(
        f"autoreset_mode must be one of {', '.join(m.name for m in MODES)}; got {mode!r}"
    )
