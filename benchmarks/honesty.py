"""What honesty costs: the default filters beside plain ones, in milliseconds an update.

Robots walk through a generated office, once from the uniform belief and once from near the truth,
and every filter gets the same odometry and scans, one after the other at each step. The plain ones
take sensor and odometry at their word and count every reading in full; they look for nobody who was
carried off, and the plain cloud has 2,000 particles at least and draws them by their weights.
``python -m benchmarks.honesty``.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.cli.calibrate import PLAIN
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel
from benchmarks import selective
from benchmarks.selective import Walk, walk

FIRST = 20
"""Steps from the uniform belief that count as dense: a turn around, then drives."""
PLAIN_PARTICLES = ParticleConfig(
    **PLAIN, recovery="none", allocation=1.0, n_min=2_000, roughening_xy=0.02, roughening_theta=0.02
)

Filter = HistogramBelief | ParticleBelief


def filters() -> dict[str, Filter]:
    """By name: each default, and the plain one."""
    sensor, motion = BeamModel(), MotionModel()
    return {
        "histogram": HistogramBelief(1, HistogramConfig(), sensor, motion),
        "histogram, plain": HistogramBelief(1, HistogramConfig(**PLAIN), sensor, motion),
        "particles": ParticleBelief(1, ParticleConfig(), sensor, motion),
        "particles, plain": ParticleBelief(1, PLAIN_PARTICLES, sensor, motion),
    }


def start(belief: Filter, path: Walk, known: bool, seed: int) -> None:
    """From the uniform, or from near the truth; the first scan is read."""
    if isinstance(belief, HistogramBelief):
        selective.start(belief, path, known)
        return
    rng = np.random.default_rng(seed)
    if known:
        belief.reset_near(0, path.grid, rng, path.poses[0], selective.NEAR)
    else:
        belief.reset(0, path.grid, rng)
    belief.correct(0, path.scans[0])


def milliseconds(path: Walk, known: bool, seed: int, steps: int) -> dict[str, NDArray[np.float64]]:
    """``(steps,)`` of each filter [ms]: predict, correct and summarise, in turns; CPU time."""
    all_of_them = filters()
    took = {name: np.empty(steps) for name in all_of_them}
    for belief in all_of_them.values():
        start(belief, path, known, seed)
    for step in range(steps):
        for name, belief in all_of_them.items():
            begun = time.thread_time()
            selective.update(belief, path, step)
            belief.summarise(0)
            took[name][step] = 1e3 * (time.thread_time() - begun)
    return took


def cost(walks: int, steps: int) -> Table:
    """Means over the walks, and how much more the defaults take."""
    grid = MapSource.parse("office").number(0)
    table = Table(title=f"{grid.name}: ms an update, {walks} walks")
    for column in ("", "default", "plain", "times"):
        table.add_column(column, justify="right")
    for known in (False, True):  # Kernels are compiled, and the tables of all travels worked out.
        milliseconds(walk(grid, steps, 0), known, 0, steps)
    for known, what, n in ((False, f"first {FIRST} steps from everywhere", FIRST),
                           (True, f"{steps} steps, localized", steps)):  # fmt: skip
        runs = [milliseconds(walk(grid, n, seed), known, seed, n) for seed in range(walks)]
        mean = {name: float(np.mean([run[name] for run in runs])) for name in runs[0]}
        for name in ("histogram", "particles"):
            ours, plain = mean[name], mean[f"{name}, plain"]
            table.add_row(f"{name}, {what}", f"{ours:.2f}", f"{plain:.2f}", f"{ours / plain:.1f}")
    return table


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--walks", type=int, default=6)
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    Console(width=120).print(cost(options.walks, options.steps))


if __name__ == "__main__":
    main()
