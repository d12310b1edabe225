"""The training loop: SB3's own, with what it lacks around it.

Into the run's folder go ``checkpoints/`` (:mod:`activeloc.agents.sb3.checkpoint`) and
``tensorboard/``. A signal ends the run at the next step with a checkpoint; the same configuration
goes on from there and ends with the same weights.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, EvalCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy

from activeloc.agents.evaluation.lock import locked
from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.checkpoint import (
    Checkpoint,
    latest_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from activeloc.agents.sb3.configuration import HELD_OUT, TRAINING, TrainingConfig
from activeloc.agents.sb3.hyperparameters import HELD_OUT as HELD_OUT_MAPS
from activeloc.agents.sb3.hyperparameters import PPO, SETTINGS
from activeloc.agents.sb3.imitation import imitate, labels_of_agent
from activeloc.agents.sb3.resuming import (
    Boundary,
    boundary_of,
    come_back,
    load_weights,
    state_of,
    weights_of,
)
from activeloc.agents.sb3.value_head import fit_values
from activeloc.agents.sb3.vec_env import NativeVecEnv
from activeloc.errors import CheckpointError, ConfigError

CHECKPOINTS, TENSORBOARD = "checkpoints", "tensorboard"
SCORES = {
    "entropy": "belief/entropy",
    "is_success": "episodes/right",
    "wrong": "episodes/wrong_and_sure",
    "area": "episodes/area_under_entropy",
}


class Stopped(KeyboardInterrupt):
    """A signal ended the run; its checkpoint is written.

    Attributes:
        exit_code: 128 and the signal's number.
    """

    def __init__(self, number: int, path: Path) -> None:
        super().__init__(f"stopped by signal {number}; {path} goes on with --resume")
        self.exit_code = 128 + number


@dataclass
class Stop:
    """Which signal asked the run to end, if one did."""

    number: int | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """As a signal's handler: the first is noted, the second ends the process at once."""
        if self.number is not None:
            os._exit(128 + number)
        self.number = number


@contextmanager
def stopping() -> Iterator[Stop]:
    """Note SIGINT and SIGTERM instead of dying of them, in the main thread."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, stop) for number in numbers]
    try:
        yield stop
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def train(
    config: TrainingConfig,
    folder: Path,
    *,
    resume: bool = False,
    progress_bar: bool = False,
) -> Path:
    """Train a policy, or go on with it.

    One thread and deterministic algorithms, so that the same configuration gives the same weights
    to the bit, however often the run was stopped.

    Args:
        config: What the run is.
        folder: Where to; made if there is none.
        resume: Whether to go on with the run in ``folder``, which must have this configuration.
        progress_bar: Whether SB3's progress bar is shown.

    Returns:
        The last checkpoint.

    Raises:
        ActiveLocError: If a setting is refused, the folder holds a run and ``resume`` is false, or
            there is no run to resume, or it is another one.
        OSError: If the folder cannot be written to.
        Stopped: If SIGINT or SIGTERM ended the run; a checkpoint is written then.
    """
    checkpoints = folder / CHECKPOINTS
    if checkpoints.exists() and any(checkpoints.glob("step-*")) and not resume:
        raise ConfigError(f"{folder} holds a run already; go on with --resume or choose another")
    stored = latest_checkpoint(checkpoints)[1] if resume else None
    if stored is not None:
        _demand_same(stored, config, folder)
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    env = training_env(config)
    model = build_model(config, env)
    if stored is not None:
        load_weights(model, stored.policy, stored.optimizer)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot make the folder: {error.strerror}") from None
    with locked(folder), stopping() as stop:
        keeper = Keeper(config, env, checkpoints, stop, stored)
        if stored is None and config.imitate is not None:
            _imitate(config, model, env, stop)
        _learn(config, model, keeper, folder, progress_bar)
        assert keeper.path is not None
        if keeper.stopped:
            assert stop.number is not None
            raise Stopped(stop.number, folder)
    return keeper.path


def _demand_same(stored: Checkpoint, config: TrainingConfig, folder: Path) -> None:
    """Refuse to go on with a run of another configuration."""
    theirs, ours = stored.config.get("training"), config.plain()
    if not isinstance(theirs, dict) or not isinstance(stored.config.get("progress"), dict):
        raise CheckpointError(f"{folder}: the checkpoint's config.json is not a run's")
    for name, value in ours.items():
        if theirs.get(name) != value:
            raise ConfigError(
                f"{folder} holds a run with {name} {theirs.get(name)!r}; asked for {value!r}"
            )


def _imitate(config: TrainingConfig, model: BaseAlgorithm, env: NativeVecEnv, stop: Stop) -> None:
    assert config.imitate is not None
    assert isinstance(model.policy, ActorCriticPolicy)
    labeller = labels_of_agent(config.imitate, config.seed, config.env)
    rng = np.random.default_rng([config.seed, 3])

    def go_on() -> bool:
        return stop.number is None

    imitate(model.policy, env, labeller, config.imitation, rng, go_on)
    if config.imitation.values:
        gamma = config.hyperparameters.gamma
        fit_values(model.policy, env, config.imitation.values, gamma, rng, go_on)


def _learn(
    config: TrainingConfig,
    model: BaseAlgorithm,
    keeper: Keeper,
    folder: Path,
    progress_bar: bool,
) -> None:
    left = config.total_timesteps - keeper.done
    model.num_timesteps = keeper.done
    model.set_logger(configure(str(folder / TENSORBOARD), ["tensorboard"]))
    callbacks: list[BaseCallback] = [keeper, Scores()]
    if config.evaluate_every > 0:
        callbacks.append(held_out_evaluation(config, keeper))
    try:
        model.learn(
            max(left, 0),
            CallbackList(callbacks),
            log_interval=1 if isinstance(model, OnPolicyAlgorithm) else 100,
            reset_num_timesteps=keeper.stored is None,
            progress_bar=progress_bar,
        )
    finally:
        model.logger.close()


class Keeper(BaseCallback):
    """Keeps checkpoints at the boundaries between updates, and comes back to one.

    Every ``checkpoint_every`` updates the robots get new seeds, and a checkpoint is kept. A signal
    is heeded at the next step: what is kept then is the boundary before it, whose weights are still
    the model's, because an update comes only when all steps are taken.

    Args:
        config: Of the run.
        env: Its environment.
        folder: Of its checkpoints.
        stop: Whether a signal has come.
        stored: What to go on with.
    """

    def __init__(
        self,
        config: TrainingConfig,
        env: NativeVecEnv,
        folder: Path,
        stop: Stop,
        stored: Checkpoint | None,
    ) -> None:
        super().__init__()
        self.config, self.env, self.folder, self.stop = config, env, folder, stop
        self.stored = stored
        self.path: Path | None = None
        self.stopped = False
        self.best_mean_reward = -np.inf
        self._seeded_at = 0
        self._steps = 0
        self._came_back = False
        self._last: Boundary | None = None
        if stored is not None and stored.config["progress"].get("best_mean_reward") is not None:
            self.best_mean_reward = float(stored.config["progress"]["best_mean_reward"])

    @property
    def done(self) -> int:
        """Steps taken before this run."""
        if self.stored is None:
            return 0
        return int(self.stored.config["progress"].get("num_timesteps", 0))

    def _on_training_start(self) -> None:
        if self.stored is not None:
            progress, state = self.stored.config["progress"], self.stored.state
            self._seeded_at = come_back(self.model, self.env, self.config, progress, state)
            self._came_back = True
        # A run that is complete takes no step, and keeps what it has.
        self._note()

    def _on_rollout_start(self) -> None:
        due = self._update % self.config.checkpoint_every == 0 and not self._came_back
        if due:
            self._seeded_at = self._update
            seeds = self.config.env_seeds(TRAINING, self._update, self.env.num_envs)
            self.model._last_obs = self.env.begin(seeds)
            self.model._last_episode_starts = np.ones(self.env.num_envs, dtype=np.bool_)
        self._came_back = False
        self._steps = 0
        self._note()
        if due:
            self.save()

    def _on_step(self) -> bool:
        self._steps += 1
        # Off policy, steps go into the replay buffer at once: only the first can be taken back.
        untouched = isinstance(self.model, OnPolicyAlgorithm) or self._steps == 1
        if self.stop.number is not None and untouched:
            self.stopped = True
            return False
        return True

    def _on_training_end(self) -> None:
        if not self.stopped:
            self._note()
        self.save()

    @property
    def _update(self) -> int:
        return self.model.num_timesteps // self.config.hyperparameters.steps_per_update

    def _note(self) -> None:
        best = None if np.isinf(self.best_mean_reward) else self.best_mean_reward
        self._last = boundary_of(self.model, self.env, self._seeded_at, best)

    def save(self, *, best: bool = False) -> None:
        """Keep the last boundary."""
        assert self._last is not None
        progress = self._last.progress
        policy, optimizer = weights_of(self.model)
        config = {"training": self.config.plain(), "progress": progress}
        state = state_of(self.model, self.env, self._last)
        checkpoint = Checkpoint(config, policy, optimizer, state)
        path = write_checkpoint(self.folder, progress["num_timesteps"], checkpoint, best=best)
        if not best:
            self.path = path


class Scores(BaseCallback):
    """What episodes ended with, for TensorBoard: entropy, right, wrong and sure, area."""

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            for key, value in info.get("episode", {}).items():
                if key in SCORES:
                    self.logger.record_mean(SCORES[key], value)
        return True


class HeldOut(EvalCallback):
    """SB3's evaluation, on the same episodes every time: seeds that training never uses."""

    def __init__(self, config: TrainingConfig, keeper: Keeper, env: NativeVecEnv) -> None:
        row: Any = config.hyperparameters
        per_update = row.steps_per_update // row.n_envs
        super().__init__(
            env,
            callback_on_new_best=_Best(keeper),
            n_eval_episodes=config.n_eval_episodes,
            eval_freq=config.evaluate_every * per_update,
            verbose=0,
            warn=False,
        )
        self.keeper, self.held_out = keeper, env
        self.seeds = config.env_seeds(HELD_OUT, 0, env.num_envs)

    def _on_training_start(self) -> None:
        self.n_calls = self.model.num_timesteps // self.keeper.env.num_envs
        self.best_mean_reward = self.keeper.best_mean_reward

    def _on_step(self) -> bool:
        if self.n_calls % self.eval_freq == 0:
            self.held_out._seeds = [*self.seeds]
        return super()._on_step()


class _Best(BaseCallback):
    """Keeps the model that was just found to be the best."""

    parent: EvalCallback

    def __init__(self, keeper: Keeper) -> None:
        super().__init__()
        self.keeper = keeper

    def _on_step(self) -> bool:
        self.keeper.best_mean_reward = self.parent.best_mean_reward
        self.keeper.save(best=True)
        return True


def held_out_evaluation(config: TrainingConfig, keeper: Keeper) -> HeldOut:
    """The evaluation of a run, on maps of its own if it trains on those that the table names."""
    n_envs = min(config.n_eval_episodes, config.hyperparameters.n_envs)
    spec = HELD_OUT_MAPS.get(config.env)
    if spec is not None and config.settings.get("map") == SETTINGS[config.env]["map"]:
        config = replace(config, settings={**config.settings, "map": spec})
    return HeldOut(config, keeper, training_env(config, n_envs))


def load_policy(path: Path) -> tuple[TrainingConfig, BaseAlgorithm]:
    """Configuration and model of a checkpoint, to act or to export, not to go on training.

    Raises:
        ActiveLocError: If the checkpoint or its configuration is refused.
    """
    stored = read_checkpoint(path)
    config = TrainingConfig.from_plain(stored.config.get("training"))
    row = config.hyperparameters
    batch = row.n_steps if isinstance(row, PPO) else row.batch_size
    alone = replace(config, hyperparameters=replace(row, n_envs=1, batch_size=batch))
    model = build_model(alone, training_env(alone))
    load_weights(model, stored.policy)
    return config, model
