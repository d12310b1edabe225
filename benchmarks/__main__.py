"""Cost of a belief's update and of a decision, on a generated office.

CPU time of the calling thread: medians over repetitions, with the spread between the tenth and the
ninetieth percentile; each row also as a multiple of the first row of its table, since machines
differ.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from activeloc.agents import make_agent
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.envs.localization import LocalizationEnv
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.raycast import cast_scan
from activeloc.sensors import BeamModel
from activeloc.simulator import terrain_of

TURN, DRIVE = np.array([np.pi / 6.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
SCAN = np.array([0.7, 1.2, 1.5, 0.9, 0.6])


def times_of(call: Callable[[], object], repeats: int) -> np.ndarray:
    """Seconds of each of ``repeats`` calls, after one that does not count."""
    call()
    result = []
    for _ in range(repeats):
        start = time.thread_time()
        call()
        result.append(time.thread_time() - start)
    return np.array(result)


def table_of(title: str, rows: dict[str, np.ndarray], unit: float, name: str) -> Table:
    """Median, spread and multiple of the first row."""
    table = Table(title=title)
    for column in ("what", f"median [{name}]", "10 % ... 90 %", "ratio"):
        table.add_column(column, justify="left" if column == "what" else "right")
    first = np.median(next(iter(rows.values())))
    for what, seconds in rows.items():
        low, high = np.quantile(seconds, [0.1, 0.9]) / unit
        middle = np.median(seconds)
        table.add_row(
            what, f"{middle / unit:.3g}", f"{low:.3g} ... {high:.3g}", f"{middle / first:.2f}"
        )
    return table


def rays() -> Table:
    """Exact rays, from one pose and from many."""
    grid = MapSource.parse("office").number(0)
    terrain = terrain_of(grid, 0.2)
    poses = terrain.uniform_poses(np.random.default_rng(0).random((2000, 4)))
    bearings = np.linspace(-np.pi / 2, np.pi / 2, 60)
    rows = {
        f"range to {z_max:g} m": times_of(lambda z=z_max: cast_scan(grid, poses, bearings, z), 10)
        / (2000 * 60)
        for z_max in (1.5, 5.0, 25.0)
    }
    return table_of("One exact ray", rows, 1e-9, "ns")


def histogram() -> Table:
    """One step of the grid, from uniform to localized."""
    grid = MapSource.parse("office").number(0)
    belief = HistogramBelief(1, HistogramConfig(), BeamModel(), MotionModel())
    pose = terrain_of(grid, 0.2).uniform_poses(np.full((1, 4), 0.3))[0]
    rows = {}
    for name, sigma in {
        "all": None,
        "3 m": (3.0, 3.0),
        "1 m": (1.0, 0.5),
        "0.2 m": (0.2, 0.1),
    }.items():
        for what, u in {"turn": TURN, "drive": DRIVE}.items():

            def step(sigma: tuple[float, float] | None = sigma, u: np.ndarray = u) -> float:
                if sigma is None:
                    belief.reset(0, grid)
                else:
                    belief.reset_near(0, grid, pose, sigma)
                start = time.thread_time()
                belief.predict(0, u)
                belief.correct(0, SCAN)
                belief.summarise(0)
                return time.thread_time() - start

            step()
            rows[f"{what}, belief spread over {name}"] = np.array([step() for _ in range(20)])
    return table_of("Histogram: predict, correct, summarise", rows, 1e-3, "ms")


def particles() -> Table:
    """One step of the cloud by its size."""
    grid = MapSource.parse("office").number(0)
    rows = {}
    for n in (2_000, 10_000, 50_000, 200_000):
        config = ParticleConfig(n_min=n, n_max=n)
        belief = ParticleBelief(1, config, BeamModel(), MotionModel())
        belief.reset(0, grid, np.random.default_rng(0))

        def step(belief: ParticleBelief = belief) -> None:
            belief.predict(0, DRIVE)
            belief.correct(0, SCAN)
            belief.summarise(0)

        rows[f"{n} particles"] = times_of(step, 8)
    return table_of("Particles: predict, correct, summarise", rows, 1e-3, "ms")


def decisions() -> Table:
    """One choice of each agent, averaged over the first 30 steps of an episode."""
    env = LocalizationEnv(map="office")
    rows = {}
    for name in ("random", "spin", "greedy", "active"):
        agent = make_agent(name)
        observation, _ = env.reset(seed=0)
        agent.reset(np.random.default_rng(0))
        agent.act(observation, env.knowledge)
        spent = []
        for _ in range(30):
            start = time.thread_time()
            action = agent.act(observation, env.knowledge)
            spent.append(time.thread_time() - start)
            observation, _, over, _, _ = env.step(action)
            if over:
                break
        rows[name] = np.array([np.mean(spent)])
    return table_of("A decision", rows, 1e-3, "ms")


def main() -> None:
    """Print every table."""
    console = Console()
    console.print(f"{platform.machine()}, Python {platform.python_version()}, one thread")
    for part in (rays, histogram, particles, decisions):
        console.print(part())


if __name__ == "__main__":
    main()
