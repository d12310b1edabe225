"""What each algorithm uses in each environment: one table.

The maze's PPO row was measured (256 robots, 16 steps, learning rate falling to zero; from scratch
.999 right on mazes of 15 x 15 after 4 million steps); others start from it. A metric step costs a
hundred times a maze step, so that there fewer robots collect longer rollouts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

from activeloc import checks
from activeloc.configuration import unknown
from activeloc.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Network:
    """Shape of the network, of any algorithm.

    Attributes:
        reader: ``egocentric``, ``world`` or ``auto``; see :mod:`activeloc.agents.sb3.features`.
        hidden: Widths of the features extractor's layers; action and value heads stand on it.
        n_envs: Robots that collect.
        learning_rate: At the start; falls linearly to zero.
        gamma: Discount.
    """

    reader: str = "auto"
    hidden: tuple[int, ...] = (192, 192)
    n_envs: int = 256
    learning_rate: float = 1e-3
    gamma: float = 0.99

    def __post_init__(self) -> None:
        checks.choice("reader", self.reader, ("auto", "egocentric", "world"))
        if not isinstance(self.hidden, list | tuple) or not self.hidden:
            raise ConfigError(f"hidden must be one width or more; got {self.hidden!r}")
        for width in self.hidden:
            checks.integer("hidden", width, 1, 65536)
        object.__setattr__(self, "hidden", tuple(self.hidden))
        checks.integer("n_envs", self.n_envs, 1, 65536)
        checks.number("learning_rate", self.learning_rate, 0.0, 1.0, above_low=True)
        checks.number("gamma", self.gamma, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class PPO(Network):
    """Proximal policy optimisation (Schulman et al., 2017).

    Attributes:
        n_steps: Steps of each robot in a rollout.
        batch_size: Transitions in a minibatch; divides those of a rollout.
        n_epochs: Passes over a rollout.
        gae_lambda: Of the advantage estimate.
        ent_coef: Weight of the policy's entropy.
        vf_coef: Weight of the value's error.
        clip_range: Of the probability ratio.
        max_grad_norm: Longest gradient.
    """

    name: ClassVar[str] = "ppo"
    n_steps: int = 16
    batch_size: int = 1024
    n_epochs: int = 4
    gae_lambda: float = 0.95
    ent_coef: float = 0.01
    vf_coef: float = 0.5
    clip_range: float = 0.2
    max_grad_norm: float = 0.5

    def __post_init__(self) -> None:
        Network.__post_init__(self)
        checks.integer("n_steps", self.n_steps, 1, 2**20)
        checks.integer("batch_size", self.batch_size, 2, 2**24)
        checks.integer("n_epochs", self.n_epochs, 1, 1000)
        checks.number("gae_lambda", self.gae_lambda, 0.0, 1.0)
        checks.number("ent_coef", self.ent_coef, 0.0, 100.0)
        checks.number("vf_coef", self.vf_coef, 0.0, 100.0)
        checks.number("clip_range", self.clip_range, 0.0, 10.0, above_low=True)
        checks.number("max_grad_norm", self.max_grad_norm, 0.0, 1e6, above_low=True)
        if self.steps_per_update % self.batch_size:
            raise ConfigError(
                f"batch_size must divide n_envs * n_steps = {self.steps_per_update}; "
                f"got {self.batch_size}"
            )

    @property
    def steps_per_update(self) -> int:
        """Transitions between two updates."""
        return self.n_envs * self.n_steps

    def after_imitation(self) -> PPO:
        """Careful steps, so as not to forget what was imitated."""
        return replace(self, learning_rate=3e-4, ent_coef=1e-3, clip_range=0.1, gamma=0.995)


@dataclass(frozen=True, slots=True)
class RecurrentPPO(PPO):
    """PPO with a memory (an LSTM) between features and heads.

    Attributes:
        memory: Width of the LSTM.
    """

    name: ClassVar[str] = "recurrent_ppo"
    memory: int = 128

    def __post_init__(self) -> None:
        PPO.__post_init__(self)
        checks.integer("memory", self.memory, 1, 65536)


@dataclass(frozen=True, slots=True)
class DQN(Network):
    """Deep Q-learning (Mnih et al., 2015).

    Attributes:
        buffer_size: Transitions kept, of all robots together; a checkpoint holds them too.
        learning_starts: Transitions before the first update.
        batch_size: Transitions in a minibatch.
        train_freq: Steps of each robot between updates.
        gradient_steps: Minibatches at an update.
        target_interval: Transitions between copies to the target network.
        exploration_fraction: Share of the run over which random actions become rare.
        exploration_final: Share of random actions after that.
    """

    name: ClassVar[str] = "dqn"
    n_envs: int = 16
    learning_rate: float = 5e-4
    buffer_size: int = 50_000
    learning_starts: int = 2_000
    batch_size: int = 128
    train_freq: int = 4
    gradient_steps: int = 8
    target_interval: int = 4_000
    exploration_fraction: float = 0.3
    exploration_final: float = 0.02

    def __post_init__(self) -> None:
        Network.__post_init__(self)
        checks.integer("buffer_size", self.buffer_size, 2 * self.n_envs, 10**8)
        checks.integer("learning_starts", self.learning_starts, 0, 10**9)
        checks.integer("batch_size", self.batch_size, 1, 2**24)
        checks.integer("train_freq", self.train_freq, 1, 2**20)
        checks.integer("gradient_steps", self.gradient_steps, 1, 2**20)
        checks.integer("target_interval", self.target_interval, 1, 10**9)
        checks.number("exploration_fraction", self.exploration_fraction, 0.0, 1.0, above_low=True)
        checks.number("exploration_final", self.exploration_final, 0.0, 1.0)

    @property
    def steps_per_update(self) -> int:
        """Transitions between two updates."""
        return self.n_envs * self.train_freq


ALGORITHMS: dict[str, type[PPO | DQN]] = {"ppo": PPO, "recurrent_ppo": RecurrentPPO, "dqn": DQN}

_METRIC: dict[str, PPO | DQN] = {
    "ppo": PPO(n_envs=16, n_steps=128, batch_size=512, hidden=(192, 128)),
    "recurrent_ppo": RecurrentPPO(n_envs=32, n_steps=64, batch_size=512, hidden=(128, 128)),
    "dqn": DQN(buffer_size=10_000, hidden=(128, 128)),
}
_MAZE: dict[str, PPO | DQN] = {"ppo": PPO(), "recurrent_ppo": RecurrentPPO(), "dqn": DQN()}

#: Environment id -> algorithm -> what it uses there.
TABLE: dict[str, dict[str, PPO | DQN]] = {
    "activeloc/GlobalLocalization-v0": _METRIC,
    "activeloc/KidnappedRobot-v0": _METRIC,
    "activeloc/PositionTracking-v0": _METRIC,
    "activeloc/Maze7-v0": _MAZE,
    "activeloc/Maze15-v0": _MAZE,
    # Larger mazes have longer episodes; the view is larger too, and the network narrower for it.
    "activeloc/Maze21-v0": {
        "ppo": PPO(hidden=(160, 192)),
        "recurrent_ppo": RecurrentPPO(hidden=(160, 192)),
        "dqn": DQN(hidden=(160, 192)),
    },
    "activeloc/NoisyMaze9-v0": _MAZE,
}


# A window of 11 x 11 cells carries over to larger mazes better than one of 19 x 19 (measured), and
# so does a policy that does not see the clock.
_SEEN_OF_A_MAZE = {"view": True, "radius": 5, "time": False}
_MAZE_SETTINGS: dict[str, Any] = {
    "observation": _SEEN_OF_A_MAZE,
    "task": {"kind": "maze", "reward": "doubt"},
}

# A histogram filter's tables take seconds a building, so that training shares twelve buildings; its
# cells are coarse, for speed. What the policy sees is of one kind whatever the filter.
_BUILDINGS: dict[str, Any] = {
    "map": "office:100-111",
    "belief": {"kind": "histogram", "cell_size": 0.3, "headings": 36},
    "observation": {"view": True, "headings": 1, "rows": 1, "cols": 1},
    "reward": {"step": -0.01},
}

#: Environment id -> settings that training changes, laid over the id's own.
SETTINGS: dict[str, dict[str, Any]] = {
    "activeloc/GlobalLocalization-v0": _BUILDINGS,
    "activeloc/Maze7-v0": _MAZE_SETTINGS,
    "activeloc/Maze15-v0": _MAZE_SETTINGS,
    "activeloc/Maze21-v0": _MAZE_SETTINGS,
    "activeloc/NoisyMaze9-v0": {"observation": _SEEN_OF_A_MAZE},
}

# In a maze values are means over seven steps or more, and differ by hundredths.
_MAZE_IMITATION: dict[str, Any] = {
    "tau": 0.007,
    "labels": 100_000,
    "rounds": 3,
    "epochs": 10,
    "values": 30_000,
}

#: Environment id -> maps of the evaluation while training, if training is on those above.
HELD_OUT: dict[str, str] = {"activeloc/GlobalLocalization-v0": "office:200-203"}

#: Environment id -> how a planner is imitated there, where not as ImitationConfig says.
IMITATION: dict[str, dict[str, Any]] = {
    "activeloc/GlobalLocalization-v0": {"tau": 0.1, "epochs": 8, "rounds": 3},
    "activeloc/Maze7-v0": _MAZE_IMITATION,
    "activeloc/Maze15-v0": _MAZE_IMITATION,
    "activeloc/Maze21-v0": _MAZE_IMITATION,
    "activeloc/NoisyMaze9-v0": _MAZE_IMITATION,
}


def hyperparameters(
    env: str, algorithm: str, changes: Mapping[str, Any] | None = None
) -> PPO | DQN:
    """The table's row with some values changed; the algorithm's defaults where there is no row.

    Raises:
        ConfigError: If the algorithm or a name is unknown, or a value is refused.
    """
    if algorithm not in ALGORITHMS:
        raise unknown("--algo", algorithm, ALGORITHMS)
    row = TABLE.get(env, {}).get(algorithm, ALGORITHMS[algorithm]())
    names = [item.name for item in fields(row)]
    for name in changes or {}:
        if name not in names:
            raise unknown(f"{algorithm} hyperparameter", name, names)
    return replace(row, **dict(changes or {}))
