"""The histogram filter: dense against a plain blur, and whole steps, dense and localized."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from activeloc.beliefs.grid_tables import tables_of
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.benchmarks.clock import Call, Prepared, alternate
from activeloc.benchmarks.dense import DenseStep
from activeloc.benchmarks.floors import seconds_of_copy
from activeloc.benchmarks.report import Curve, Row, at_most, ratio_at_most
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.worlds import open_ground
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.raycast import cast_scan
from activeloc.sensors import BeamModel
from activeloc.simulator import terrain_of

TURN, DRIVE = np.array([np.pi / 6.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
SIGMAS = ((0.1, 0.1), (0.3, 0.2), (0.6, 0.4), (1.2, 0.8), (2.4, 1.6), (5.0, 3.0))
"""Spread of a belief that is localized, less and less [m], [rad]."""
BYTES = 8
"""Of a float32 that is read and written."""
SMALL = HistogramConfig(headings=24, repetition=inf)
"""Every beam counts, also a second one in its sector."""
TWELVE = BeamModel(beams=12, field_of_view=float(2.0 * np.pi * 11 / 12))


def measure(settings: Settings) -> Iterator[Row | Curve]:
    """Against scipy; a small map; the default office, by how much of the belief is alive."""
    yield from _against_a_blur(settings)
    small = MapSource.parse("rooms(width=8.3,height=8.3):0").number(0)
    yield from _steps(settings, small, SMALL, TWELVE, "40x40x24, 12 beams", (0.25, 0.03))
    spec = "rooms(width=6,height=6):0" if settings.quick else "office:0"
    office = MapSource.parse(spec).number(0)
    yield from _steps(
        settings, office, HistogramConfig(), BeamModel(), "default office", (4.0, 0.15)
    )
    yield from _by_cells(settings)


def _against_a_blur(settings: Settings) -> Iterator[Row]:
    """Predict and correct of an open map, and a Gaussian blur of as large an array."""
    side, headings = settings.size(200, 20), 36
    # The robot's radius is no place for its centre: so many cells more.
    grid = open_ground(side + 2, 0.2)
    config = HistogramConfig(headings=headings)
    step = DenseStep(tables_of(grid, config, BeamModel(beams=1, z_max=0.5), MotionModel()), 5, 2)
    bel = np.full((headings, side, side), 1.0, dtype=np.float32)
    out = np.empty_like(bel)
    sigmas, radius = (1.0, 1.0, 1.0), (2, 2, 2)

    def blur() -> None:
        ndimage.gaussian_filter(bel, sigmas, output=out, mode="wrap", radius=radius)

    calls: dict[str, Call | Prepared] = {"ours": step, "scipy": blur}
    seconds = alternate(calls, budget=settings.budget, rounds=settings.rounds)
    ours = 1e3 * seconds["ours"] * (bel.size / step.n_states)
    note = f"5 heading taps, {step.n_taps:.0f} of travel; {step.n_states:,} states, scaled"
    yield Row.of(
        "histogram", f"likelihood ready, {side}x{side}x{headings}", "ms", ours,
        "scipy gaussian_filter, radius 2", 1e3 * seconds["scipy"], ratio_at_most(1.0 / 7.0), note,
    )  # fmt: skip


class Walker:
    """A robot's filter, put back to where it was before each step that is timed."""

    def __init__(self, grid: OccupancyGrid, config: HistogramConfig, sensor: BeamModel) -> None:
        self.grid = grid
        self.belief = HistogramBelief(1, config, sensor, MotionModel())
        self.pose = terrain_of(grid, 0.2).uniform_poses(np.full((1, 4), 0.3))[0]
        angles = sensor.bearings
        self.scan = cast_scan(grid, self.pose, angles, sensor.z_max)

    def put(self, sigma: tuple[float, float] | None) -> None:
        """Everywhere, or near the pose and a step on."""
        if sigma is None:
            self.belief.reset(0, self.grid)
        else:
            self.belief.reset_near(0, self.grid, self.pose, sigma)
            self.step(np.zeros(3))

    def step(self, u: NDArray[np.float64]) -> None:
        """A whole step."""
        self.belief.predict(0, u)
        self.belief.correct(0, self.scan)
        self.belief.summarise(0)

    def timed(self, u: NDArray[np.float64], sigma: tuple[float, float] | None) -> Prepared:
        """A step from there."""
        return Prepared(lambda: self.put(sigma), lambda: self.step(u))


def _steps(
    settings: Settings,
    grid: OccupancyGrid,
    config: HistogramConfig,
    sensor: BeamModel,
    name: str,
    limits: tuple[float, float],
) -> Iterator[Row | Curve]:
    """Whole steps: dense, localized, and by the share of the cells that is alive."""
    walker = Walker(grid, config, sensor)
    calls = {"dense, drive": walker.timed(DRIVE, None), "dense, turn": walker.timed(TURN, None)}
    shares = []
    for sigma in SIGMAS:
        walker.put(sigma)
        shares.append(walker.belief.live_share(0))
        calls[str(sigma)] = walker.timed(DRIVE, sigma)
    seconds = alternate(calls, budget=2 * settings.budget, rounds=settings.rounds)
    walker.put(None)
    states = walker.belief.probabilities(0).size
    note = f"{states:,} states"
    dense = 1e3 * seconds["dense, drive"]
    yield Row.of("histogram", f"{name}, dense", "ms", dense, target=at_most(limits[0]), note=note)
    turn = 1e3 * seconds["dense, turn"]
    yield Row.of("histogram", f"{name}, dense, turn", "ms", turn, note=note)
    near = int(np.argmin(np.abs(np.log(np.array(shares) / 0.005))))
    local = 1e3 * seconds[str(SIGMAS[near])]
    note = f"{shares[near]:.1%} of the cells alive before the step"
    target = at_most(limits[1])
    yield Row.of("histogram", f"{name}, localized", "ms", local, target=target, note=note)
    costs = [float(np.median(seconds[str(sigma)])) for sigma in SIGMAS]
    x, y = (*shares, 1.0), (*costs, float(np.median(seconds["dense, drive"])))
    labels = "share of the cells alive", "a whole step [ms]"
    yield Curve("alive", *labels, name, x, tuple(1e3 * v for v in y))
    ends = (min(x), 1.0)
    y = tuple(1e3 * seconds_of_copy(BYTES * states * share) for share in ends)
    yield Curve("alive", *labels, f"{name}: its bytes", ends, y, "floor")


def _by_cells(settings: Settings) -> Iterator[Curve]:
    """Dense steps on buildings of several sizes."""
    specs = ("rooms(width=5,height=4):0", "rooms(width=8,height=6):0", "rooms:0", "office:0")
    states, costs = [], []
    for spec in specs[: settings.size(4, 2)]:
        walker = Walker(MapSource.parse(spec).number(0), HistogramConfig(), BeamModel())
        calls = {"step": walker.timed(DRIVE, None)}
        seconds = alternate(calls, budget=settings.budget / 2, rounds=settings.rounds)
        walker.put(None)
        states.append(float(walker.belief.probabilities(0).size))
        costs.append(1e3 * float(np.median(seconds["step"])))
    axes = "states", "states", "a whole step, dense [ms]"
    yield Curve(*axes, "histogram", tuple(states), tuple(costs))
    floor = tuple(1e3 * seconds_of_copy(BYTES * n) for n in states)
    yield Curve(*axes, "its bytes, read and written", tuple(states), floor, "floor")
