"""What a map costs that has not been seen before."""

from __future__ import annotations

from collections.abc import Iterator
from time import thread_time

import numpy as np

from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.histogram import HistogramConfig
from activeloc.benchmarks.report import Curve, Row, at_most
from activeloc.benchmarks.settings import Settings
from activeloc.envs.localization import LocalizationEnv
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel

STEPS = 100


def measure(settings: Settings) -> Iterator[Row | Curve]:
    """Episodes in buildings that are new, against the same in one that is known."""
    for belief, target in (("histogram", at_most(0.5)), ("particles", None)):
        yield from _episodes(settings, belief, target)
    yield from _by_size(settings)


def _episodes(settings: Settings, belief: str, target: object) -> Iterator[Row]:
    """The same episode twice, in a building nobody has tables of, and again."""
    spec = "rooms(width=6,height=6)" if settings.quick else "office"
    env = LocalizationEnv(
        map=f"{spec}:*", belief=belief, task={"kind": "global", "confidence": 1.0, "hold": 10**6}
    )
    steps, again, new = settings.size(STEPS, 4), [], []
    for seed in range(-1, settings.size(3, 1)):  # The first compiles.
        times = [_seconds(env, seed + 1, steps) for _ in range(2)]
        if seed >= 0:
            new.append(times[0])
            again.append(times[1])
    share = (np.array(new) - np.array(again)) / np.array(new)
    share = np.maximum(share, 0.0)
    note = f"{steps} random steps, {np.median(new):.2f} s with the tables"
    name = f"tables' share of an episode, {belief}"
    yield Row.of("maps", name, "of the time", share, target=target, note=note)  # type: ignore[arg-type]


def _seconds(env: LocalizationEnv, seed: int, steps: int) -> float:
    actions = np.random.default_rng(seed).integers(0, 3, steps)
    begun = thread_time()
    env.reset(seed=seed)
    for action in actions:
        env.step(action)
    return thread_time() - begun


def _by_size(settings: Settings) -> Iterator[Row | Curve]:
    """All tables of a histogram filter, and a travel's transition, by number of states."""
    specs = ("rooms(width=5,height=4):0", "rooms(width=8,height=6):0", "rooms:0", "office:0")
    states, costs = [], []
    for spec in specs[: settings.size(4, 2)]:
        grid = MapSource.parse(spec).number(0)
        begun = thread_time()
        tables = GridTables(grid, HistogramConfig(), BeamModel(), MotionModel())
        tables.travel.level(5)
        costs.append(thread_time() - begun)
        states.append(float(tables.uniform.size))
    yield Curve("tables", "states", "tables of a map [s]", "histogram", tuple(states), tuple(costs))
    name, note = "tables of a map, per state", f"{grid.name}, {states[-1]:,.0f} states"
    yield Row.of("maps", name, "us", 1e6 * costs[-1] / states[-1], note=note)
