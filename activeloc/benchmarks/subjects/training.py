"""How much of the time that training takes is torch's: the rest is what this package costs it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from activeloc.benchmarks.report import Absent, Row, at_least
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.yardsticks import is_installed


class Stopwatch:
    """Seconds of the clock that methods took."""

    def __init__(self) -> None:
        self.seconds = 0.0

    @contextmanager
    def on(self, owner: Any, name: str) -> Iterator[None]:
        """Count the calls of a class's method."""
        method = getattr(owner, name)

        def timed(*args: Any, **given: Any) -> Any:
            begun = time.perf_counter()
            try:
                return method(*args, **given)
            finally:
                self.seconds += time.perf_counter() - begun

        setattr(owner, name, timed)
        try:
            yield
        finally:
            setattr(owner, name, method)


def _warm_up(config: Any) -> None:
    """One update: what is imported and compiled at the first is so before."""
    from activeloc.agents.sb3.training import train

    with tempfile.TemporaryDirectory() as folder:
        train(replace(config, total_timesteps=1), Path(folder) / "run")


def measure(settings: Settings) -> Iterator[Row | Absent]:
    """A short run of PPO in mazes, as train.py makes it."""
    if not (is_installed("torch") and is_installed("stable_baselines3")):
        yield Absent("training", "share of torch", "activeloc[train] is not installed")
        return
    from stable_baselines3 import PPO
    from stable_baselines3.common.policies import ActorCriticPolicy

    from activeloc.agents.sb3.configuration import TrainingConfig
    from activeloc.agents.sb3.training import train

    steps = settings.size(40_000, 256)
    changes = {"evaluate_every": 0, "checkpoint_every": 10_000}
    if settings.quick:
        changes |= {"n_steps": 8, "n_envs": 4, "batch_size": 32, "n_epochs": 1}
    config = TrainingConfig.build(
        "activeloc/Maze15-v0", "ppo", changes, total_timesteps=steps, seed=0
    )
    _warm_up(config)
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        for owner, name in (
            (PPO, "train"),
            (ActorCriticPolicy, "forward"),
            (ActorCriticPolicy, "predict_values"),
        ):
            stack.enter_context(watch.on(owner, name))
        begun = time.perf_counter()
        train(config, Path(folder) / "run")
        total = time.perf_counter() - begun
    note = (
        f"{steps:,} steps in {total:.1f} s, after an update that is not counted: the policy's "
        "forward passes and PPO's updates"
    )
    target = at_least(0.6)
    share = watch.seconds / total
    yield Row.of(
        "training", "Maze15, share of torch", "of the wall", share, target=target, note=note
    )
    yield Row.of("training", "Maze15, all of it", "steps/s", steps / total)
