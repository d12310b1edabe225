"""Memory: what stepping adds, and what a map's tables hold."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.histogram import HistogramConfig
from activeloc.beliefs.particles import ParticleConfig
from activeloc.beliefs.track import Track
from activeloc.benchmarks.report import Absent, Row, at_most
from activeloc.benchmarks.settings import Settings
from activeloc.envs.localization import LocalizationEnv
from activeloc.range_table import RangeTable
from activeloc.sensors.readings import widened

MAZE, METRIC = "activeloc/Maze21-v0", "activeloc/GlobalLocalization-v0"
STATUS = Path("/proc/self/statm")


def resident() -> int:
    """Bytes of this process that are in memory."""
    return int(STATUS.read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def bytes_of(value: object) -> int:
    """Bytes of every array that hangs on an object, each counted once."""
    seen: set[int] = set()
    total, waiting = 0, [value]
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if isinstance(one.base, np.ndarray):
                waiting.append(one.base)
            else:
                total += one.nbytes
        elif isinstance(one, dict):
            waiting.extend(one.values())
        elif isinstance(one, list | tuple):
            waiting.extend(one)
        elif type(one).__module__.startswith("activeloc."):
            slots = [n for c in type(one).__mro__ for n in getattr(c, "__slots__", ())]
            waiting.extend(getattr(one, name) for name in slots if hasattr(one, name))
            waiting.extend(getattr(one, "__dict__", {}).values())
    return total


def measure(settings: Settings) -> Iterator[Row | Absent]:
    """A million steps in mazes; a map's tables; what each environment holds of its own."""
    if STATUS.is_file():
        yield _growth(settings)
    else:
        yield Absent("memory", "growth", f"there is no {STATUS} on this system")
    office = "rooms(width=6,height=6):0" if settings.quick else "office:0"
    yield from _tables(office)
    for name, env_id, given in (
        ("an environment, Maze21", MAZE, {}),
        ("an environment, default task, histogram", METRIC, {"map": office}),
        ("an environment, default task, particles", METRIC, {"map": office, "belief": "particles"}),
    ):
        held = [_held(env_id, n, given) for n in (1, 3)]
        yield Row.of("memory", name, "kB", 1e-3 * (held[1] - held[0]) / 2)


def _tables(office: str) -> Iterator[Row]:
    """What robots on one map share."""
    env = LocalizationEnv(map=office)
    env.reset(seed=0)
    given: Any = env.config
    config, grid = HistogramConfig(), env.grid
    # Of its own: on those that are shared, other subjects have left what they needed.
    tables = GridTables(grid, config, widened(given.sensor, config.sigma_factor), given.motion)
    track = Track(tables, config, GridBelief(tables, tables.everywhere))
    track.predict(np.array([0.0, 0.5, 0.0]), given.motion.odometry, touched=False)
    note = f"{tables.uniform.size:,} states of {grid.name}, {grid.shape[0]} x {grid.shape[1]} cells"
    held = 1e-6 * bytes_of(tables)
    yield Row.of("memory", "tables of a map, histogram", "MB", held, note=note)
    ranges = RangeTable(grid, given.sensor.z_max, ParticleConfig().directions)
    note = "pages are taken as they are filled"
    yield Row.of("memory", "table of ranges", "MB", 1e-6 * bytes_of(ranges), note=note)


def _held(env_id: str, n: int, given: dict[str, Any]) -> int:
    """Bytes of a vector environment that has made a step."""
    env: Any = gym.make_vec(env_id, num_envs=n, **given)
    env.reset(seed=0)
    env.step(np.full(n, 2))
    return bytes_of(env.unwrapped)


def _growth(settings: Settings) -> Row:
    """Resident bytes that steps in new mazes add, after as many as a tenth of them."""
    n, steps = 64, settings.size(15_625, 40)
    mazes: Any = gym.make_vec(MAZE, num_envs=n)
    mazes.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, 3, (64, n))
    before = 0
    for step in range(-steps // 10, steps):
        if step == 0:
            before = resident()
        mazes.step(actions[step % 64])
    grown = (resident() - before) / 1e6
    note = "Maze21, 64 environments, a new maze every 30 steps"
    name = f"growth over {n * steps:,} steps"
    return Row.of("memory", name, "MB", max(grown, 0.0), target=at_most(1.0), note=note)
