"""The histogram filter's likelihood of a scan, over all states and over few."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.benchmarks.clock import Prepared, alternate
from activeloc.benchmarks.report import Row, at_most, ratio_at_most
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.subjects.histogram import TWELVE
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.raycast import cast_scan
from activeloc.simulator import terrain_of

BEAMS = len(TWELVE.bearings)


def measure(settings: Settings) -> Iterator[Row]:
    """A correction of a uniform belief, and of one that holds a hundredth of the cells."""
    spec = "rooms(width=6,height=6):0" if settings.quick else "office(rooms=14,corridors=6):0"
    grid = MapSource.parse(spec).number(0)
    # Every beam counts; without a leak nothing is reckoned beside the likelihood.
    config = HistogramConfig(headings=36, leak=0.0, repetition=inf)
    belief = HistogramBelief(1, config, TWELVE, MotionModel())
    pose = terrain_of(grid, 0.2).uniform_poses(np.full((1, 4), 0.3))[0]
    scan = cast_scan(grid, pose, TWELVE.bearings, TWELVE.z_max)
    belief.reset(0, grid)
    uniform = belief.probabilities(0)
    few = np.zeros_like(uniform)
    centres = belief.poses(0).centres
    near = np.argsort(((centres - pose[:2]) ** 2).sum(axis=1))[: max(1, len(uniform) // 100)]
    few[near] = 1.0 / (len(near) * uniform.shape[1])
    calls = {
        "all": Prepared(lambda: belief.reset(0, grid), lambda: belief.correct(0, scan)),
        "few": Prepared(lambda: belief.reset(0, grid, few), lambda: belief.correct(0, scan)),
    }
    seconds = alternate(calls, budget=settings.budget, rounds=settings.rounds)
    ns = 1e9 * seconds["all"] / (uniform.size * BEAMS)
    note = f"{uniform.size:,} states of {grid.name}; normalised"
    name = f"{BEAMS} beams, all states"
    yield Row.of("likelihood", name, "ns/state/beam", ns, target=at_most(0.4), note=note)
    yield Row.of(
        "likelihood", f"{BEAMS} beams, {len(near):,} of {len(uniform):,} cells", "us",
        1e6 * seconds["few"], "all states", 1e6 * seconds["all"], ratio_at_most(1.0 / 30.0),
    )  # fmt: skip
