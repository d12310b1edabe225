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
"""About the longest that a call without a target may take [s]."""


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


def _metric(settings: Settings) -> Iterator[Row | Curve | Absent]:
    """Both beliefs, by number of environments and of threads, against ap-gym."""
    n, steps = settings.size(64, 8), settings.size(150, 3)
    where: dict[str, Any] = {"map": "rooms(width=6,height=6):0"} if settings.quick else {}
    where |= {"max_episode_steps": steps}
    few = {"kind": "particles", "n_start": 500, "n_min": 100, "n_max": 200}
    coarse = {"kind": "histogram", "headings": 24}
    rooms = None
    if is_installed(active_perception.NAME):
        rooms = active_perception.Rooms(8, settings.size(60, 2))
    theirs: list[float] = []
    for belief, small, target in (
        ("histogram", coarse, ratio_at_least(3.0)),
        ("particles", few, ratio_at_least(1.0)),
    ):
        given = where | {"belief": small if settings.quick else belief}
        for count in threads_of(settings):
            wanted = {8: target, n: target} if count == 1 else {}
            for item in _by_number(settings, belief, steps, given, count, rooms, wanted):
                if isinstance(item, Row) and item.theirs is not None:
                    theirs.append(item.theirs.median)
                yield item
    if rooms is not None:
        rooms.close()
    if theirs:
        rate = float(np.median(theirs))
        yield Curve(*AXES, "ap-gym, 8 envs", (1, 512), (rate, rate), "yardstick")


def _by_number(
    settings: Settings,
    belief: str,
    steps: int,
    given: dict[str, Any],
    threads: int,
    rooms: active_perception.Rooms | None,
    targets: dict[int, Target],
) -> Iterator[Row | Curve | Absent]:
    """Whole episodes of 1, 8, 64 and 512 environments.

    Args:
        settings: Of the run.
        belief: Its name.
        steps: Of an episode.
        given: Settings of the environments.
        threads: That step them.
        rooms: The yardstick, if it is installed.
        targets: By number of environments, for those that are held against it.
    """
    sizes = (1, 8, 64, 512)[: settings.size(4, 2)]
    episode = settings.size(active_perception.STEPS, 5)
    rates: list[float] = []
    for size in sizes:
        # What a call would take, going by the last; a part of an episode is not the whole.
        expected = size * steps / rates[-1] if rates else 0.0
        if expected > PATIENCE and size not in targets:
            name = f"default task, {belief}, {size} envs, {_threads(threads)}"
            yield Absent("environments", name, f"episodes would take {expected:.0f} s")
            break
        calls = {"ours": playing(make(METRIC, size, threads, **given), steps + 1)}
        if rooms is not None and size in targets:
            calls["theirs"] = rooms.stepping(episode)
        # The first episode makes the map's tables, for all sizes.
        seconds = alternate(
            calls, budget=settings.budget, rounds=(1, 5), clock=clock_of(threads),
            warm_up=size == 1,
        )  # fmt: skip
        ours, other = size * steps / seconds["ours"], None
        if "theirs" in seconds:
            other = 8 * episode / seconds["theirs"]
        rates.append(float(np.median(ours)))
        yardstick = named("ap-gym, 8 envs", active_perception.NAME) if size in targets else ""
        yield Row.of(
            "environments", f"default task, {belief}, {size} envs, {_threads(threads)}", "steps/s",
            ours, yardstick, other, targets.get(size),
        )  # fmt: skip
    yield Curve(*AXES, f"{belief}, {_threads(threads)}", sizes[: len(rates)], tuple(rates))


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"
