"""Our vector environment as Stable-Baselines3's.

SB3 takes no Gymnasium vector environment. This adapter turns one in ``SAME_STEP`` mode, where the
step that ends an episode begins the next one, into a ``VecEnv``: infos as a list,
``terminal_observation``, ``TimeLimit.truncated``, and the statistics of each episode that ends.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from activeloc.agents.evaluation.records import penalised_area
from activeloc.errors import ConfigError

Observation = dict[str, NDArray[Any]]


def make_vec_env(
    env_id: str,
    num_envs: int,
    settings: Mapping[str, Any] | None = None,
    keys: Sequence[str] | None = None,
) -> NativeVecEnv:
    """The native vector environment of an id, for SB3.

    Args:
        env_id: Registered id.
        num_envs: B.
        settings: Keyword arguments of the environment that differ from its id's.
        keys: The parts of the observation that are kept; all if None.

    Raises:
        ConfigError: If a setting or a key is unknown or refused.
    """
    envs = gym.make_vec(
        env_id, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **dict(settings or {})
    )
    return NativeVecEnv(envs, keys)


class Histories:
    """A list of numbers for each of B robots, added to for many of them at once.

    Args:
        n_robots: B.
    """

    def __init__(self, n_robots: int) -> None:
        self._values = np.zeros((n_robots, 64))
        self._n = np.zeros(n_robots, dtype=np.intp)

    def add(self, robots: NDArray[np.bool_], values: NDArray[Any]) -> None:
        """Append their values ``(B,)`` to the lists of some robots ``(B,)``."""
        if self._n.max() == self._values.shape[1]:
            self._values = np.concatenate([self._values, np.zeros_like(self._values)], axis=1)
        where = np.flatnonzero(robots)
        self._values[where, self._n[where]] = values[where]
        self._n[where] += 1

    def clear(self, robots: NDArray[np.bool_]) -> None:
        """Empty the lists of some robots ``(B,)``."""
        self._n[robots] = 0

    def of(self, robot: int) -> list[float]:
        """One robot's."""
        result: list[float] = self._values[robot, : self._n[robot]].tolist()
        return result


class NativeVecEnv(VecEnv):
    """B robots of one Gymnasium vector environment, as SB3 wants them.

    The step that ends an episode gives, in that robot's info, ``terminal_observation``,
    ``TimeLimit.truncated`` and ``episode``: reward ``r``, length ``l``, time ``t`` [s], and what
    the last info said of ``is_success``, ``wrong`` and ``entropy``; ``area`` is the scored area
    under the entropy curve where the environment has a limit and says its entropy as a fraction.

    Attributes:
        envs: The vector environment.
        actions_taken: ``(T, B, ...)`` as a list: the actions since :meth:`begin`, so that
            :meth:`replay` can come back to where they led.

    Raises:
        ConfigError: If the environment is not in ``SAME_STEP`` mode, its observation is no Dict,
            or it has no such key.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], keys: Sequence[str] | None = None) -> None:
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ConfigError(f"SB3 needs autoreset_mode SAME_STEP; the environment has {mode}")
        space = envs.single_observation_space
        if not isinstance(space, gym.spaces.Dict):
            raise ConfigError(f"the observation must be a Dict; got {space}")
        kept = [*space.spaces] if keys is None else [*keys]
        if missing := [key for key in kept if key not in space.spaces]:
            known = ", ".join(space.spaces)
            raise ConfigError(f"the observation has no {missing[0]!r} (it has {known})")
        self.envs = envs
        self.keys = kept
        self.actions_taken: list[NDArray[Any]] = []
        self._actions: NDArray[Any] = np.zeros(0)
        self._clock = time.perf_counter()
        self._limit: int | None = getattr(envs, "max_episode_steps", None)
        self._rewards = np.zeros(envs.num_envs)
        self._entropies = Histories(envs.num_envs)
        self._steps = np.zeros(envs.num_envs, dtype=np.int64)
        chosen = gym.spaces.Dict({key: space.spaces[key] for key in kept})
        super().__init__(envs.num_envs, chosen, envs.single_action_space)

    # --- episodes

    def reset(self) -> Observation:
        """See :meth:`VecEnv.reset`; seeds given by :meth:`seed` are used once.

        Raises:
            ConfigError: If robots were given different options.
        """
        if any(options != self._options[0] for options in self._options):
            raise ConfigError(f"options must be the same for all robots; got {self._options}")
        seeded = any(seed is not None for seed in self._seeds)
        # A seed for each robot, as Gymnasium's vector environments take but do not declare.
        seeds: Any = list(self._seeds) if seeded else None
        observations, infos = self.envs.reset(seed=seeds, options=self._options[0] or None)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = self._split(infos)
        self.actions_taken = []
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        self._start(everyone)
        self._note(everyone, infos)
        return self._chosen(observations)

    def begin(self, seeds: Iterable[int]) -> Observation:
        """Reset every robot with a seed of its own; what follows depends on the actions alone."""
        self._seeds = list(seeds)
        return self.reset()

    def replay(
        self, seeds: Iterable[int], actions: Iterable[NDArray[Any]]
    ) -> tuple[Observation, NDArray[np.bool_]]:
        """Come back to where ``actions`` led after :meth:`begin`: observations and last dones."""
        observations, dones = self.begin(seeds), np.ones(self.num_envs, dtype=np.bool_)
        for chosen in actions:
            self.step_async(chosen)
            observations, _, dones, _ = self.step_wait()
        return observations, dones

    def step_async(self, actions: NDArray[Any]) -> None:
        """See :meth:`VecEnv.step_async`."""
        self._actions = np.array(actions)

    def step_wait(
        self,
    ) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """See :meth:`VecEnv.step_wait`."""
        self.actions_taken.append(self._actions)
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        dones = terminated | truncated
        each = self._split(infos)
        self._rewards += rewards
        self._steps += 1
        for info in each:
            info["TimeLimit.truncated"] = False
        self._note(~dones, infos)
        if dones.any():
            self._note(dones, infos["final_info"])
            last = self._split(infos["final_info"])
            for robot in np.flatnonzero(dones).tolist():
                del each[robot]["TimeLimit.truncated"]
                self.reset_infos[robot] = each[robot]
                final = infos["final_obs"][robot]
                each[robot] = last[robot] | {
                    "TimeLimit.truncated": bool(truncated[robot] and not terminated[robot]),
                    "terminal_observation": {key: final[key] for key in self.keys},
                }
                each[robot]["episode"] = self._statistics(robot, each[robot])
            self._start(dones)
            self._note(dones, infos)
        return self._chosen(observations), rewards.astype(np.float32), dones, each

    def _start(self, robots: NDArray[np.bool_]) -> None:
        """Begin to count anew for some robots ``(B,)``."""
        self._rewards[robots], self._steps[robots] = 0.0, 0
        self._entropies.clear(robots)

    def _note(self, robots: NDArray[np.bool_], infos: Mapping[str, Any]) -> None:
        """Take note of the entropy of some robots ``(B,)``, where the infos tell it."""
        if "entropy_fraction" in infos:
            given = robots & infos["_entropy_fraction"]
            self._entropies.add(given, infos["entropy_fraction"])

    def _statistics(self, robot: int, info: Mapping[str, Any]) -> dict[str, Any]:
        statistics = {
            "r": float(self._rewards[robot]),
            "l": int(self._steps[robot]),
            "t": time.perf_counter() - self._clock,
        }
        for key in ("is_success", "wrong", "entropy"):
            if key in info:
                statistics[key] = float(info[key])
        entropies = self._entropies.of(robot)
        if entropies and self._limit is not None:
            wrong = bool(info.get("wrong", False))
            statistics["area"] = penalised_area(entropies, wrong, self._limit)
        return statistics

    def _chosen(self, observations: Mapping[str, NDArray[Any]]) -> Observation:
        return {key: observations[key] for key in self.keys}

    def _split(self, infos: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Arrays with masks as a list of one dict a robot."""
        names, columns, others = [], [], []
        for key, values in infos.items():
            mask = infos.get(f"_{key}")
            if mask is None or key in ("final_obs", "final_info"):
                continue
            if mask.all():
                names.append(key)
                columns.append(values.tolist() if values.ndim == 1 else list(values))
            else:
                others.append((key, values, mask))
        if names:
            each = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        else:
            each = [{} for _ in range(self.num_envs)]
        for key, values, mask in others:
            for robot in np.flatnonzero(mask).tolist():
                each[robot][key] = values[robot]
        return each

    # --- the rest of SB3's interface

    def close(self) -> None:
        """See :meth:`VecEnv.close`."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the vector environment, once for each robot."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: robots of one vector environment share their attributes.

        Raises:
            ConfigError: Always.
        """
        raise ConfigError(f"{attr_name} cannot be set: robots share the environment's attributes")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``method(robot, ...)`` of the vector environment for each robot: ``knowledge``."""
        method = getattr(self.envs, method_name)
        return [method(i, *method_args, **method_kwargs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Whether it does what a wrapper does: SB3's ``Monitor``'s work is done here."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]
