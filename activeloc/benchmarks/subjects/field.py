"""The likelihood field under a particle filter."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.benchmarks.clock import Prepared, alternate
from activeloc.benchmarks.report import Row, at_most
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.worlds import Z_MAX, large_map, local_poses
from activeloc.motion import MotionModel
from activeloc.raycast import cast_scan
from activeloc.sensors import LikelihoodField

BEAMS = 60


def measure(settings: Settings) -> Iterator[Row]:
    """A correction of a localized cloud."""
    grid = large_map(settings.maps)
    n = settings.size(2_000, 20)
    sensor = LikelihoodField(BEAMS, float(np.pi), Z_MAX, sigma_hit=0.2)
    config = ParticleConfig(
        n_min=n, n_max=n, n_start=n, recovery="none", ess_ratio=1e-6, repetition=inf
    )
    belief = ParticleBelief(1, config, sensor, MotionModel())
    poses = local_poses(grid, n)
    scan = cast_scan(grid, local_poses(grid, 1)[0], sensor.bearings, Z_MAX)

    def put() -> None:
        belief.reset(0, grid, np.random.default_rng(0), poses)

    call = Prepared(put, lambda: belief.correct(0, scan))
    rounds = settings.rounds[0], min(settings.rounds[1], 15)
    seconds = alternate({"": call}, budget=settings.budget, rounds=rounds)[""]
    ns = 1e9 * seconds / (n * BEAMS)
    note = f"a correction of {n:,} particles without resampling, all of it"
    yield Row.of(
        "field", f"{BEAMS} beams, localized", "ns/beam/particle", ns, target=at_most(3.0), note=note
    )
