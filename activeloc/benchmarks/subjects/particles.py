"""Monte Carlo localization: a whole update against Nav2's, and resampling."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.resampling import systematic
from activeloc.benchmarks.clock import Call, alternate
from activeloc.benchmarks.floors import seconds_of_look_up
from activeloc.benchmarks.report import Curve, Row, at_most, ratio_at_least
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.worlds import Z_MAX, bearings, large_map, local_poses
from activeloc.benchmarks.yardsticks import is_installed, named, nav2
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel
from activeloc.raycast import cast_scan
from activeloc.sensors import BeamModel

BEAMS = 60
SENSOR = BeamModel(beams=BEAMS, field_of_view=float(np.pi), z_max=Z_MAX, sigma_hit=0.2)


def measure(settings: Settings) -> Iterator[Row | Curve]:
    """Updates by number of particles and of beams; resampling."""
    grid = large_map(settings.maps)
    sizes = (2_000, 20_000) if not settings.quick else (100, 200)
    curves: dict[str, list[float]] = {}
    for n in sizes:
        for row, name in _updates(settings, grid, n):
            yield row
            curves.setdefault(name, []).append(1e3 * n / row.ours.median)
            if row.theirs is not None:
                curves.setdefault(nav2.NAME, []).append(1e3 * n / row.theirs.median)
    yield from _resampling(settings)
    yield from _by_size(settings, grid)


def update_of(grid: OccupancyGrid, n: int, sensor: BeamModel = SENSOR, **settings: object) -> Call:
    """A whole update of n particles around a pose: there and back, the scan, the estimate.

    Every beam counts, as in the yardstick.
    """
    given = {"n_min": n, "n_max": n, "n_start": n, "recovery": "none", "repetition": inf} | settings
    belief = ParticleBelief(1, ParticleConfig(**given), sensor, MotionModel())  # type: ignore[arg-type]
    poses = local_poses(grid, n)
    belief.reset(0, grid, np.random.default_rng(0), poses)
    scan = cast_scan(grid, local_poses(grid, 1)[0], sensor.bearings, sensor.z_max)
    ways = [np.array([0.0, nav2.STEP, 0.0]), np.array([0.0, -nav2.STEP, 0.0])]

    def update() -> None:
        ways.reverse()
        belief.predict(0, ways[0])
        belief.correct(0, scan)
        belief.summarise(0)

    return update


def _updates(settings: Settings, grid: OccupancyGrid, n: int) -> Iterator[tuple[Row, str]]:
    """Ours with exact rays, with the table of ranges, and as it is by default."""
    kinds = {
        "exact rays": update_of(grid, n, directions=0),
        "table of ranges": update_of(grid, n),
        "with recovery": update_of(grid, n, recovery="background"),
    }
    calls: dict[str, Call] = dict(kinds)
    if is_installed(nav2.NAME):
        pose, angles = local_poses(grid, 1)[0], bearings(BEAMS)
        scan = cast_scan(grid, pose, angles, Z_MAX)
        calls[nav2.NAME] = nav2.update_of(grid, pose, angles, scan, n)
    seconds = alternate(calls, budget=2 * settings.budget, rounds=settings.rounds)
    rates = {what: n / values for what, values in seconds.items()}
    for kind in kinds:
        target = None if kind == "with recovery" else ratio_at_least(2.5)
        yield (
            Row.of(
                "particles", f"{n:,} x {BEAMS} beams, {kind}", "particles/s", rates[kind],
                named(nav2.NAME, nav2.NAME), rates.get(nav2.NAME), target,
            ),
            kind,
        )  # fmt: skip


def _resampling(settings: Settings) -> Iterator[Row]:
    rng = np.random.default_rng(0)
    for n in (2_000, 20_000):
        weights, uniforms = rng.random(n), rng.random(1)
        calls = {"ours": lambda w=weights, n=n, u=uniforms: systematic(w, n, u)}
        seconds = alternate(calls, budget=settings.budget / 4, rounds=settings.rounds)["ours"]
        name = f"systematic resampling of {n:,}"
        yield Row.of("particles", name, "ns/particle", 1e9 * seconds / n, target=at_most(15.0))


def _by_size(settings: Settings, grid: OccupancyGrid) -> Iterator[Curve]:
    """Cost of an update by particles, and by beams."""
    budget, rounds = settings.budget / 4, settings.rounds
    sizes = (500, 2_000, 8_000, 32_000) if not settings.quick else (50, 100)
    calls = {str(n): update_of(grid, n) for n in sizes}
    costs = [
        np.median(alternate({"": c}, budget=budget, rounds=rounds)[""]) for c in calls.values()
    ]
    y = tuple(1e3 * float(cost) for cost in costs)
    axes = "particles", "particles", "an update [ms]"
    yield Curve(*axes, f"{BEAMS} beams", sizes, y)
    look_up = 1e3 * seconds_of_look_up(coherent=False)
    floor = tuple(look_up * n * BEAMS for n in sizes)
    yield Curve(*axes, "a look-up a beam", sizes, floor, "floor")
    beams = (3, 12, 60, 180)[: settings.size(4, 2)]
    n = settings.size(2_000, 100)
    for directions, label in ((128, "table of ranges"), (0, "exact rays")):
        y_beams = []
        for count in beams:
            fan = BeamModel(beams=count, field_of_view=float(np.pi), z_max=Z_MAX, sigma_hit=0.2)
            call = update_of(grid, n, fan, directions=directions)
            y_beams.append(1e3 * np.median(alternate({"": call}, budget=budget, rounds=rounds)[""]))
        yield Curve("beams", "beams", f"an update of {n:,} [ms]", label, beams, tuple(y_beams))
    floor = tuple(look_up * n * count for count in beams)
    yield Curve(
        "beams", "beams", f"an update of {n:,} [ms]", "a look-up a beam", beams, floor, "floor"
    )
