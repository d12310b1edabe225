"""Steps a second of the vector environments, resets, beliefs and observations included.

A call plays whole episodes of all environments with random actions. Steps are counted, resets not.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

from activeloc.benchmarks.clock import alternate
from activeloc.benchmarks.report import Absent, Curve, Row, Target, at_least, ratio_at_least
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.yardsticks import active_perception, is_installed, named
from activeloc.envs.vector import LocalizationVectorEnv

MAZE, METRIC = "activeloc/Maze21-v0", "activeloc/GlobalLocalization-v0"
AXES = "environments", "environments", "steps a second"
PATIENCE = 60.0
"""About the longest that one call for a curve may take [s]."""


def measure(settings: Settings) -> Iterator[Row | Curve | Absent]:
    """Mazes, then the metric task."""
    yield from _mazes(settings)
    yield from _metric(settings)


def takes_threads() -> bool:
    """Whether the vector environment can use several threads."""
    return "threads" in inspect.signature(LocalizationVectorEnv.__init__).parameters


def make(env_id: str, n: int, threads: int, **settings: Any) -> Any:
    """The native vector environment."""
    if threads > 1:
        settings["threads"] = threads
    return gym.make_vec(env_id, num_envs=n, **settings)


def playing(env: Any, steps: int, seed: int = 0) -> Callable[[], None]:
    """So many steps of all environments with random actions; what is compiled is so before."""
    actions = np.random.default_rng(seed).integers(0, 3, (64, env.num_envs))
    env.reset(seed=seed)
    for action in (0, 2):
        env.step(np.full(env.num_envs, action))
    env.reset(seed=seed)

    def run() -> None:
        for step in range(steps):
            env.step(actions[step % 64])

    return run


def clock_of(threads: int) -> Callable[[], float]:
    """Of the calling thread, or of the wall."""
    return time.thread_time if threads == 1 else time.perf_counter


def threads_of(settings: Settings) -> list[int]:
    """One thread, and as many as may be used."""
    return [1, settings.threads] if settings.threads > 1 and takes_threads() else [1]


def _mazes(settings: Settings) -> Iterator[Row | Curve | Absent]:
    """Native against Gymnasium's SyncVectorEnv over the single environment."""
    n, episode = settings.size(64, 4), settings.size(30, 3)
    steps = episode + 1  # One more starts the next episode.
    single = [lambda: gym.make(MAZE, disable_env_checker=True, max_episode_steps=episode)] * n
    sync = SyncVectorEnv(single)
    threads = threads_of(settings)
    for count in threads:
        calls = {
            "ours": playing(make(MAZE, n, count, max_episode_steps=episode), 4 * steps),
            "sync": playing(sync, steps),
        }
        seconds = alternate(
            calls, budget=settings.budget, rounds=settings.rounds, clock=clock_of(count)
        )
        ours, theirs = 4 * n * episode / seconds["ours"], n * episode / seconds["sync"]
        name = f"Maze21, {n} envs, {_threads(count)}"
        last = count == threads[-1]
        target = at_least(300_000.0) if last else None
        yield Row.of("environments", name, "steps/s", ours, target=target)
        yield Row.of(
            "environments", name, "steps/s", ours, "SyncVectorEnv", theirs,
            ratio_at_least(20.0) if last else None,
        )  # fmt: skip
    if len(threads) == 1 and settings.threads > 1:
        yield Absent("environments", "threads", "the vector environment takes no threads")
    yield from _mazes_by_number(settings, episode)


def _mazes_by_number(settings: Settings, episode: int) -> Iterator[Curve]:
    """Steps a second of 1, 8, 64 and 512 mazes, by threads, and of copies of what is observed."""
    sizes = (1, 8, 64, 512)[: settings.size(4, 2)]
    axes = "mazes", "environments", "steps a second"
    budget, rounds = settings.budget / 8, settings.rounds
    for count in threads_of(settings):
        rates = []
        for size in sizes:
            call = playing(make(MAZE, size, count, max_episode_steps=episode), episode + 1)
            took = alternate({"": call}, budget=budget, rounds=rounds, clock=clock_of(count))[""]
            rates.append(size * episode / float(np.median(took)))
        yield Curve(*axes, f"Maze21, {_threads(count)}", sizes, tuple(rates))
    floor = []
    for size in sizes:
        copy = copying_of(make(MAZE, size, 1))
        floor.append(size / float(np.median(alternate({"": copy}, budget=budget)[""])))
    yield Curve(*axes, "copies of the observations", sizes, tuple(floor), "floor")


def copying_of(env: Any) -> Callable[[], object]:
    """A copy of the observations of all environments: the least that a step does."""
    arrays = list(env.reset(seed=0)[0].values())
    return lambda: [array.copy() for array in arrays]


def _metric(settings: Settings) -> Iterator[Row | Curve]:
    """Both beliefs against ap-gym, then by number of environments and of threads."""
    n, steps = settings.size(64, 2), settings.size(150, 3)
    where: dict[str, Any] = {"map": "rooms(width=6,height=6):0"} if settings.quick else {}
    where |= {"max_episode_steps": steps}
    few = {"kind": "particles", "n_start": 500, "n_min": 100, "n_max": 200}
    histogram: Any = {"kind": "histogram", "headings": 24} if settings.quick else "histogram"
    beliefs: tuple[tuple[str, dict[str, Any], Target], ...] = (
        ("histogram", where | {"belief": histogram}, ratio_at_least(3.0)),
        (
            "particles",
            where | {"belief": few if settings.quick else "particles"},
            ratio_at_least(1.0),
        ),
    )
    rooms = None
    if is_installed(active_perception.NAME):
        rooms = active_perception.Rooms(8, settings.size(60, 2))
    for belief, given, target in beliefs:
        for size, wanted in ((8, target), (n, target)):
            yield _against_ap_gym(settings, rooms, belief, size, steps, given, wanted)
    for belief, given, _ in beliefs:
        yield from _by_number(settings, belief, steps, given)
    if rooms is not None:
        call, theirs = rooms.stepping(settings.size(100, 5)), settings.size(100, 5)
        rate = 8 * theirs / float(np.median(alternate({"": call}, budget=1.0, rounds=(1, 5))[""]))
        yield Curve(*AXES, "ap-gym, 8 envs", (1, 512), (rate, rate), "yardstick")
        rooms.close()


def _against_ap_gym(
    settings: Settings,
    rooms: active_perception.Rooms | None,
    belief: str,
    n: int,
    steps: int,
    given: dict[str, Any],
    target: Target,
) -> Row:
    """Whole episodes of ours and theirs, one thread."""
    calls = {"ours": playing(make(METRIC, n, 1, **given), steps + 1)}
    theirs = settings.size(active_perception.STEPS, 5)
    if rooms is not None:
        calls["theirs"] = rooms.stepping(theirs)
    seconds = alternate(calls, budget=settings.budget, rounds=(1, 7), warm_up=False)
    rates = n * steps / seconds["ours"]
    yardstick = 8 * theirs / seconds["theirs"] if rooms is not None else None
    return Row.of(
        "environments", f"default task, {belief}, {n} envs, 1 thread", "steps/s", rates,
        named("ap-gym, 8 envs", active_perception.NAME), yardstick, target,
    )  # fmt: skip


def _by_number(
    settings: Settings, belief: str, steps: int, given: dict[str, Any]
) -> Iterator[Row | Curve]:
    """Steps a second of 1, 8, 64 and 512 environments, by threads."""
    sizes = (1, 8, 64, 512)[: settings.size(4, 2)]
    for count in threads_of(settings):
        rates: list[float] = []
        for size in sizes:
            # What one call would take, going by the last; a part of an episode is not the whole.
            if rates and size * steps / rates[-1] > PATIENCE:
                break
            call = playing(make(METRIC, size, count, **given), steps + 1)
            took = alternate(
                {"": call}, budget=settings.budget, rounds=(1, 5), clock=clock_of(count),
                warm_up=size < 64,
            )[""]  # fmt: skip
            rates.append(size * steps / float(np.median(took)))
            name = f"default task, {belief}, {size} envs, {_threads(count)}, alone"
            yield Row.of("environments", name, "steps/s", size * steps / took)
        yield Curve(*AXES, f"{belief}, {_threads(count)}", sizes[: len(rates)], tuple(rates))


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"
