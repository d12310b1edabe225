"""What a training run is, as plain data that a checkpoint can hold."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from activeloc import checks
from activeloc.agents import make_agent
from activeloc.agents.sb3.hyperparameters import (
    ALGORITHMS,
    DQN,
    IMITATION,
    PPO,
    SETTINGS,
    hyperparameters,
)
from activeloc.agents.sb3.imitation import ImitationConfig
from activeloc.configuration import build, unknown
from activeloc.envs import ENVIRONMENTS
from activeloc.errors import ConfigError

MAX_SEED = 2**63 - 1
TRAINING, HELD_OUT = 0, 1


@dataclass(frozen=True)
class TrainingConfig:
    """A run: the same configuration gives the same weights, to the bit, on one machine.

    Attributes:
        env: Registered id.
        algorithm: ``ppo``, ``recurrent_ppo`` or ``dqn``.
        hyperparameters: The algorithm's.
        total_timesteps: Steps of all robots together, at least.
        seed: All chance follows from it.
        settings: Keyword arguments of the environment that differ from its id's, as JSON has them.
        imitate: Name of the agent whose choices are learnt first; None for nobody's.
        imitation: How.
        checkpoint_every: Updates between two checkpoints; the robots start new episodes there.
        evaluate_every: Updates between two evaluations on held-out episodes; 0 for none.
        n_eval_episodes: Episodes of an evaluation.

    Raises:
        ConfigError: If a name is unknown or a value is refused.
    """

    env: str
    algorithm: str = "ppo"
    hyperparameters: PPO | DQN = field(default_factory=PPO)
    total_timesteps: int = 1_000_000
    seed: int = 0
    settings: Mapping[str, Any] = field(default_factory=dict)
    imitate: str | None = None
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    checkpoint_every: int = 50
    evaluate_every: int = 50
    n_eval_episodes: int = 64

    def __post_init__(self) -> None:
        if self.env not in ENVIRONMENTS:
            raise unknown("--env", self.env, ENVIRONMENTS)
        if self.algorithm not in ALGORITHMS:
            raise unknown("--algo", self.algorithm, ALGORITHMS)
        if type(self.hyperparameters) is not ALGORITHMS[self.algorithm]:
            raise ConfigError(
                f"hyperparameters must be those of {self.algorithm}; got {self.hyperparameters}"
            )
        if self.imitate is not None:
            make_agent(self.imitate, env=self.env)
            if self.algorithm != "ppo":
                raise ConfigError(f"--imitate goes with ppo only, not with {self.algorithm}")
        checks.integer("total_timesteps", self.total_timesteps, 1, 10**12)
        checks.integer("seed", self.seed, 0, MAX_SEED)
        checks.integer("checkpoint_every", self.checkpoint_every, 1, 10**9)
        checks.integer("evaluate_every", self.evaluate_every, 0, 10**9)
        checks.integer("n_eval_episodes", self.n_eval_episodes, 1, 10**6)
        try:
            same = json.loads(json.dumps(dict(self.settings))) == dict(self.settings)
        except (TypeError, ValueError):
            same = False
        if not same:
            raise ConfigError(f"settings must be what JSON can hold; got {self.settings!r}")

    @classmethod
    def build(
        cls,
        env: str,
        algorithm: str = "ppo",
        changes: Mapping[str, Any] | None = None,
        **given: Any,
    ) -> TrainingConfig:
        """With the table's hyperparameters.

        Args:
            env: Registered id.
            algorithm: As above.
            changes: ``env``, a mapping of the environment's settings; ``imitation``, one of
                :class:`ImitationConfig`'s fields; fields of the run; all else are hyperparameters.
            given: Fields of the run.

        Raises:
            ConfigError: If a name is unknown or a value is refused.
        """
        rest = dict(changes or {})
        asked = rest.pop("env", {})
        if not isinstance(asked, Mapping):
            raise ConfigError(f"--set env: expected env.SETTING=VALUE; got {asked!r}")
        settings = _laid_over(SETTINGS.get(env, {}), asked)
        if "imitation" in rest or "imitation" not in given:
            how = rest.pop("imitation", {})
            if isinstance(how, Mapping):
                how = _laid_over(IMITATION.get(env, {}), how)
            given["imitation"] = build(ImitationConfig, how, "imitation")
        own = ("checkpoint_every", "evaluate_every", "n_eval_episodes")
        given |= {name: rest.pop(name) for name in own if name in rest}
        row = hyperparameters(env, algorithm, rest)
        if given.get("imitate") is not None and isinstance(row, PPO):
            careful = row.after_imitation()
            row = hyperparameters(env, algorithm, {**asdict(careful), **rest})
        return cls(env, algorithm, row, settings=settings, **given)

    def plain(self) -> dict[str, Any]:
        """As JSON holds it; :meth:`from_plain` reads it."""
        return json.loads(json.dumps(asdict(self)))

    @classmethod
    def from_plain(cls, value: object) -> TrainingConfig:
        """From what :meth:`plain` gave, every field checked again.

        Raises:
            ConfigError: If a field is missing, unknown or refused.
        """
        names = [item.name for item in fields(cls)]
        if not isinstance(value, Mapping):
            raise ConfigError(f"a training configuration must be a mapping; got {value!r:.80}")
        for name in value:
            if name not in names:
                raise unknown("training configuration", name, names)
        if missing := [name for name in names if name not in value]:
            raise ConfigError(f"training configuration: {missing[0]} is missing")
        given = dict(value)
        row, algorithm = given.pop("hyperparameters"), given["algorithm"]
        if not isinstance(row, Mapping) or not isinstance(algorithm, str):
            raise ConfigError("training configuration: hyperparameters must be a mapping")
        given["imitation"] = build(ImitationConfig, given["imitation"], "imitation")
        if not isinstance(given["settings"], Mapping):
            raise ConfigError("training configuration: settings must be a mapping")
        return cls(**given, hyperparameters=hyperparameters(str(given["env"]), algorithm, row))

    def env_seeds(self, stream: int, number: int, n_envs: int) -> list[int]:
        """Seeds of each robot's environment, different in every stream and for every number."""
        return [
            int(
                np.random.SeedSequence([self.seed, stream, number, robot]).generate_state(
                    1, np.uint64
                )[0]
            )
            for robot in range(n_envs)
        ]


def _laid_over(base: Mapping[str, Any], asked: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with others laid over them, mappings key by key."""
    merged = dict(base)
    for name, value in asked.items():
        old = merged.get(name)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        merged[name] = {**old, **value} if both and old is not None else value
    return merged
