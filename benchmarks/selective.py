"""What the selective update of the histogram filter leaves out, and what it saves.

Robots walk through generated offices. Their odometry and scans go to three filters: the default,
which updates listed cells only; one that updates every state (``least=0``); and, where the robot is
carried off, one that lays the leak out over every state. ``python -m benchmarks.selective``.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel
from activeloc.simulator import Simulator

TURN, DRIVE = np.array([np.pi / 6.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
CLEARANCE = 0.45  # A walk turns away where it reads less than this ahead [m].
TURNS = 5  # As many times when it does.
NEAR = 0.3, float(np.deg2rad(10.0))  # How well a robot that is known is known [m], [rad].


@dataclass(frozen=True, slots=True)
class Walk:
    """What one robot did and saw.

    Attributes:
        grid: The map.
        poses: ``(T + 1, 3)``; the truth, the start first.
        u: ``(T, 3)`` of odometry readings.
        touched: ``(T,)``; whether an obstacle stopped it.
        scans: ``(T + 1, B)``.
    """

    grid: OccupancyGrid
    poses: NDArray[np.float64]
    u: NDArray[np.float64]
    touched: NDArray[np.bool_]
    scans: NDArray[np.float64]


def walk(grid: OccupancyGrid, steps: int, seed: int, kidnap: int = -1) -> Walk:
    """Turn once around, then drive, and turn away at walls; carried off after step ``kidnap``."""
    rng = np.random.default_rng(seed)
    sensor, motion = BeamModel(), MotionModel()
    robot = Simulator(1, sensor, motion)
    robot.place(0, grid, rng)
    poses, scans, u, touched = [robot.poses[0].copy()], [robot.scan(0, rng)], [], []
    turns = 12
    for step in range(steps):
        ahead = scans[-1][np.abs(sensor.bearings).argmin()]
        if turns == 0 and (ahead < CLEARANCE or (touched and touched[-1])):
            turns = TURNS
        command = TURN if turns > 0 else DRIVE
        turns = max(0, turns - 1)
        u.append(robot.step(0, command, rng))
        touched.append(bool(motion.touched(command, u[-1])))
        if step + 1 == kidnap:
            robot.poses[0] = robot.terrain(0).uniform_poses(rng.random((1, 4)))[0]
        scans.append(robot.scan(0, rng))
        poses.append(robot.poses[0].copy())
    return Walk(grid, *(np.array(part) for part in (poses, u, touched, scans)))


def belief_of(**settings: Any) -> HistogramBelief:
    """A filter of one robot with other than the default settings, the odometry taken at its word.

    Slips are let in only while few cells are listed, so a full update would know of none.
    """
    config = HistogramConfig(**{"slip": 0.0} | settings)
    return HistogramBelief(1, config, BeamModel(), MotionModel())


def start(belief: HistogramBelief, path: Walk, known: bool) -> None:
    """From the uniform, or from near the truth; the first scan is read."""
    if known:
        belief.reset_near(0, path.grid, path.poses[0], NEAR)
    else:
        belief.reset(0, path.grid)
    belief.correct(0, path.scans[0])


def update(belief: HistogramBelief | ParticleBelief, path: Walk, step: int) -> None:
    """One step of a filter along a walk."""
    belief.predict(0, path.u[step], bool(path.touched[step]))
    belief.correct(0, path.scans[step + 1])


def distance(one: HistogramBelief, other: HistogramBelief) -> float:
    """Total variation between the beliefs of two filters."""
    p, q = (belief.probabilities(0).astype(np.float64) for belief in (one, other))
    return float(0.5 * np.abs(p - q).sum())


def compare(path: Walk, known: bool) -> dict[str, NDArray[np.float64]]:
    """By step: total variation, share of the cells touched, seconds of either filter.

    The accuracy is of float64 without a leak; the times are of float32, of a second walk along the
    path, by when every travel's transition has been made.
    """
    exact: dict[str, Any] = {"precision": "float64", "leak": 0.0}
    pair = belief_of(**exact), belief_of(**exact, least=0.0)
    timed = {"selective": belief_of(), "full": belief_of(leak=0.0, least=0.0)}
    steps: dict[str, list[float]] = {"tv": [], "cells": []}
    for belief in pair:
        start(belief, path, known)
    for step in range(len(path.u)):
        for belief in pair:
            update(belief, path, step)
        steps["tv"].append(distance(*pair))
        steps["cells"].append(pair[0].live_share(0))
    for name, belief in timed.items():
        for _ in range(2):
            steps[name] = []
            start(belief, path, known)
            for step in range(len(path.u)):
                begun = time.thread_time()
                update(belief, path, step)
                steps[name].append(time.thread_time() - begun)
    return {name: np.array(values) for name, values in steps.items()}


def accuracy(maps: int, steps: int) -> Table:
    """Selective against full, from the uniform and from a known start."""
    table = Table(title=f"Selective update against the full one, {steps} steps a walk")
    for column in (
        "walk", "largest TV", "cells touched", "selective [ms]", "its median", "full [ms]", "times"
    ):  # fmt: skip
        table.add_column(column, justify="left" if column == "walk" else "right")
    for number in range(maps):
        grid = MapSource.parse("office:*").number(number)
        for known in (False, True):
            steps_of = compare(walk(grid, steps, number), known)
            mean = {name: values.mean() for name, values in steps_of.items()}
            table.add_row(
                f"office {number}, {'tracking' if known else 'global'}",
                f"{steps_of['tv'].max():.1e}",
                f"{mean['cells']:.2%}",
                f"{mean['selective'] * 1e3:.2f}",
                f"{np.median(steps_of['selective']) * 1e3:.2f}",
                f"{mean['full'] * 1e3:.2f}",
                f"{mean['full'] / mean['selective']:.1f}",
            )
    return table


def notice(belief: HistogramBelief, path: Walk, kidnap: int) -> int:
    """Steps from the kidnapping until under half of the belief follows the old place.

    The old place is where the odometry leads on from it; -1 if the belief holds on to it.
    """
    start(belief, path, known=True)
    old = path.poses[kidnap - 1]
    for step in range(len(path.u)):
        update(belief, path, step)
        if step >= kidnap - 1:
            rot1, trans, rot2 = path.u[step]
            heading = old[2] + rot1
            moved = trans * np.array([np.cos(heading), np.sin(heading)])
            old = np.array([*(old[:2] + moved), heading + rot2])
            if belief.mass_near(0, old) < 0.5:
                return step + 1 - kidnap
    return -1


def recovery(maps: int, walks: int, leak: float) -> Table:
    """The leak kept as one number against the leak laid out over every state."""
    table = Table(title=f"Leak {leak:g} in one number against one in every state")
    columns = ("office", "largest TV, not carried off", "widenings", "steps to notice", "within 2")
    for column in columns:
        table.add_column(column, justify="right")
    for number in range(maps):
        grid = MapSource.parse("office:*").number(number)
        apart, widenings, both = [], 0, []
        for seed in range(walks):
            pair = [belief_of(leak=leak, precision="float64", least=x) for x in (1e-10, 0.0)]
            path = walk(grid, 60, seed)
            for belief in pair:
                start(belief, path, known=True)
            for step in range(len(path.u)):
                for belief in pair:
                    update(belief, path, step)
                apart.append(distance(*pair))
            widenings += pair[0].noticed(0)
            path = walk(grid, 80, seed, kidnap=20)
            both.append([notice(belief, path, 20) for belief in pair])
        steps = np.array(both)
        table.add_row(
            str(number),
            f"{max(apart):.1e} (median {np.median(apart):.1e})",
            f"{widenings / walks:.1f} in 60 steps",
            " ".join(f"{a}/{b}" for a, b in steps),
            f"{(np.abs(np.diff(steps, axis=1)) <= 2).mean():.0%}",
        )
    return table


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=int, default=2)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--walks", type=int, default=4, help="per map, with the leak")
    parser.add_argument("--leak", type=float, default=1e-3)
    options = parser.parse_args()
    console = Console(width=120)
    if options.steps:
        console.print(accuracy(options.maps, options.steps))
    if options.walks:
        console.print(recovery(options.maps, options.walks, options.leak))


if __name__ == "__main__":
    main()
