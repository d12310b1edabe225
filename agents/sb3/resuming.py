"""Where a run stands at the boundary between two updates, and how to come back there.

SB3 restores neither the random generators nor the environments. Both are cheap to restore exactly:
the generators' states are arrays, and an environment is a function of its seeds and the actions
taken since. So a checkpoint holds these: seeds are drawn anew every ``checkpoint_every`` updates,
and the actions since then are played again. A run that is killed and resumed ends with the weights
of one that was not, to the bit.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import DictReplayBuffer

from activeloc.agents.sb3.checkpoint import Arrays
from activeloc.agents.sb3.configuration import TRAINING, TrainingConfig
from activeloc.agents.sb3.vec_env import NativeVecEnv
from activeloc.errors import CheckpointError

COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "exploration_rate")
REPLAY = ("actions", "rewards", "dones", "timeouts")


@dataclass(frozen=True)
class Boundary:
    """All that a run needs to go on, but for the weights.

    Attributes:
        progress: Counters, as JSON has them.
        arrays: States of the generators and of the policy's memory.
        n_actions: Actions taken since the environments were seeded.
    """

    progress: dict[str, Any]
    arrays: Arrays
    n_actions: int


def boundary_of(
    model: BaseAlgorithm, env: NativeVecEnv, seeded_at: int, best_mean_reward: float | None
) -> Boundary:
    """Where a run stands now.

    Args:
        model: Between two updates.
        env: Its environment.
        seeded_at: Number of the update before which the environments were seeded.
        best_mean_reward: Of the evaluations so far.
    """
    progress: dict[str, Any] = {
        name: getattr(model, name) for name in COUNTERS if hasattr(model, name)
    }
    progress |= {"seeded_at": seeded_at, "best_mean_reward": best_mean_reward}
    progress["action_space"] = model.action_space.np_random.bit_generator.state
    arrays = _generators()
    states = getattr(model, "_last_lstm_states", None)
    if isinstance(states, RNNStates):
        for name, pair in (("pi", states.pi), ("vf", states.vf)):
            for part, tensor in zip("hc", pair, strict=True):
                arrays[f"memory.{name}.{part}"] = tensor.detach().cpu().numpy().copy()
    return Boundary(progress, arrays, len(env.actions_taken))


def state_of(model: BaseAlgorithm, env: NativeVecEnv, boundary: Boundary) -> Arrays:
    """The arrays of a boundary with what is too large to copy at every one."""
    state = dict(boundary.arrays)
    shape = (boundary.n_actions, env.num_envs)
    taken = env.actions_taken[: boundary.n_actions]
    state["actions"] = np.array(taken, dtype=np.int64).reshape(shape)
    buffer = getattr(model, "replay_buffer", None)
    if isinstance(buffer, DictReplayBuffer):
        end = buffer.buffer_size if buffer.full else buffer.pos
        for name, array in _replay_arrays(buffer).items():
            state[f"replay.{name}"] = array[:end]
        state["replay.position"] = np.array([buffer.pos, int(buffer.full)])
    return state


def come_back(
    model: BaseAlgorithm,
    env: NativeVecEnv,
    config: TrainingConfig,
    progress: Mapping[str, Any],
    state: Arrays,
) -> int:
    """Put model, environments and generators where a checkpoint says.

    Returns:
        The number of the update before which the environments were seeded.

    Raises:
        CheckpointError: If something is missing or does not go with the run.
    """
    try:
        seeded_at = int(progress["seeded_at"])
        for name in COUNTERS:
            if hasattr(model, name):
                setattr(model, name, progress[name])
        _restore_memory(model, state)
        _restore_replay(model, state)
        seeds = config.env_seeds(TRAINING, seeded_at, env.num_envs)
        observations, dones = env.replay(seeds, state["actions"])
        model._last_obs = observations
        model._last_episode_starts = dones
        model.action_space.np_random.bit_generator.state = progress["action_space"]
        _restore_generators(state)
    except (KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError) as error:
        raise CheckpointError(f"the checkpoint's state does not go with the run: {error}") from None
    return seeded_at


# --- the weights


def weights_of(model: BaseAlgorithm) -> tuple[Arrays, Arrays]:
    """Arrays of the network and of its optimiser."""
    policy = {name: t.detach().cpu().numpy() for name, t in model.policy.state_dict().items()}
    moments = model.policy.optimizer.state_dict()["state"]
    optimizer = {
        f"{index}.{name}": tensor.detach().cpu().numpy()
        for index, values in moments.items()
        for name, tensor in values.items()
    }
    return policy, optimizer


def load_weights(model: BaseAlgorithm, policy: Arrays, optimizer: Arrays | None = None) -> None:
    """Put arrays into the network and its optimiser.

    Raises:
        CheckpointError: If names, shapes or types are not the model's.
    """
    wanted = {name: tuple(tensor.shape) for name, tensor in model.policy.state_dict().items()}
    given = {name: array.shape for name, array in policy.items()}
    if wanted != given:
        wrong = sorted(set(wanted.items()) ^ set(given.items()))[0][0]
        raise CheckpointError(
            f"policy: {wrong}: expected shape {wanted.get(wrong)}, got {given.get(wrong)}"
        )
    model.policy.load_state_dict({name: torch.tensor(array) for name, array in policy.items()})
    if optimizer is None:
        return
    parameters = [p for group in model.policy.optimizer.param_groups for p in group["params"]]
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for key, array in optimizer.items():
        index, _, name = key.partition(".")
        known = index.isdecimal() and int(index) < len(parameters)
        shape = tuple(parameters[int(index)].shape) if known else ()
        if not known or name not in ("step", "exp_avg", "exp_avg_sq"):
            raise CheckpointError(f"optimizer: unknown name {key!r:.80}")
        if array.shape != (() if name == "step" else shape):
            raise CheckpointError(f"optimizer: {key}: expected shape {shape}, got {array.shape}")
        moments.setdefault(int(index), {})[name] = torch.tensor(array)
    groups = model.policy.optimizer.state_dict()["param_groups"]
    model.policy.optimizer.load_state_dict({"state": moments, "param_groups": groups})


# --- parts of the state


def _generators() -> Arrays:
    """States of the global generators of torch, NumPy and Python."""
    legacy: Any = np.random.get_state()  # noqa: NPY002  (SB3 draws from it)
    python = random.getstate()
    return {
        "random.torch": torch.get_rng_state().numpy().copy(),
        "random.numpy": legacy[1].copy(),
        "random.numpy.position": np.array([legacy[2], legacy[3]]),
        "random.numpy.gauss": np.array([legacy[4]]),
        "random.python": np.array(python[1], dtype=np.int64),
        "random.python.gauss": np.array([np.nan if python[2] is None else python[2]]),
    }


def _restore_generators(state: Arrays) -> None:
    position = state["random.numpy.position"]
    gauss = float(state["random.python.gauss"][0])
    torch.set_rng_state(torch.from_numpy(state["random.torch"].copy()))
    np.random.set_state(  # noqa: NPY002  (SB3 draws from it)
        (
            "MT19937",
            state["random.numpy"],
            int(position[0]),
            int(position[1]),
            float(state["random.numpy.gauss"][0]),
        )
    )
    words = tuple(int(word) for word in state["random.python"])
    random.setstate((3, words, None if np.isnan(gauss) else gauss))


def _restore_memory(model: BaseAlgorithm, state: Arrays) -> None:
    states = getattr(model, "_last_lstm_states", None)
    if not isinstance(states, RNNStates):
        return
    pairs = []
    for name, pair in (("pi", states.pi), ("vf", states.vf)):
        arrays = [state[f"memory.{name}.{part}"] for part in "hc"]
        if any(a.shape != tuple(t.shape) for a, t in zip(arrays, pair, strict=True)):
            raise ValueError(f"memory of shape {arrays[0].shape}")
        pairs.append((torch.tensor(arrays[0]), torch.tensor(arrays[1])))
    model._last_lstm_states = RNNStates(*pairs)  # type: ignore[attr-defined]


def _replay_arrays(buffer: DictReplayBuffer) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {name: getattr(buffer, name) for name in REPLAY}
    arrays |= {f"observations.{key}": array for key, array in buffer.observations.items()}
    return arrays | {f"next.{key}": array for key, array in buffer.next_observations.items()}


def _restore_replay(model: BaseAlgorithm, state: Arrays) -> None:
    buffer = getattr(model, "replay_buffer", None)
    if not isinstance(buffer, DictReplayBuffer):
        return
    position, full = (int(value) for value in state["replay.position"])
    if not 0 <= position < buffer.buffer_size:
        raise ValueError(f"position {position} in the replay buffer")
    end = buffer.buffer_size if full else position
    for name, array in _replay_arrays(buffer).items():
        array[:end] = state[f"replay.{name}"]
    buffer.pos, buffer.full = position, bool(full)
