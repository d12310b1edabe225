"""A wrapper that takes down what happens in an environment, to be shown afterwards."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from activeloc.envs.localization import LocalizationEnv, Observation
from activeloc.envs.rendering import Recording, Tape
from activeloc.errors import ConfigError


class Recorder(gym.Wrapper[Observation, Any, Observation, Any]):
    """Keeps the episode that is being played, whoever plays it.

    >>> env = Recorder(gym.make("activeloc/GlobalLocalization-v0"))  # doctest: +SKIP
    >>> write_page([env.recording("mine")], "episode.html")  # doctest: +SKIP

    Args:
        env: One of ours, wrapped or not; it needs no render mode.

    Raises:
        ConfigError: If it is another.
    """

    def __init__(self, env: gym.Env[Observation, Any]) -> None:
        super().__init__(env)
        core = env.unwrapped
        if not isinstance(core, LocalizationEnv):
            raise ConfigError(f"only activeloc's environments can be recorded; got {core!r}")
        self._core = core
        self._tape = Tape()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """See :meth:`gymnasium.Env.reset`; the episode before is forgotten."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._tape = Tape()
        self._tape.start(self._core.scene, info)
        return observation, info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """See :meth:`gymnasium.Env.step`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        words = self._core.config.actions.words(action)
        self._tape.step(self._core.scene, info, action, words)
        return observation, float(reward), terminated, truncated, info

    def recording(self, agent: str) -> Recording:
        """The episode so far.

        Args:
            agent: What to call who played.

        Raises:
            ConfigError: If there is none: the environment has not been reset.
        """
        return self._tape.recording(agent)
