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
    """A robot's filter, put back to where it was before what is timed.

    What is timed goes round: a turn and back, a drive and back, and reads true scans. Before it a
    step is made that is not timed, so that the pages of memory are there.
    """

    def __init__(self, grid: OccupancyGrid, config: HistogramConfig, sensor: BeamModel) -> None:
        self.grid = grid
        self.belief = HistogramBelief(1, config, sensor, MotionModel())
        terrain = terrain_of(grid, 0.2)
        poses = terrain.uniform_poses(np.random.default_rng(0).random((500, 4)))
        col, row = np.floor(grid.to_cells(poses[:, :2])).astype(int).T
        self.pose = poses[grid.clearance[row, col].argmax()]
        self.scans = cast_scan(grid, self._round(), sensor.bearings, sensor.z_max)
        self.shares: list[float] = []

    def _round(self) -> NDArray[np.float64]:
        """Poses ``(4, 3)`` after each step."""
        turned, driven = self.pose.copy(), self.pose.copy()
        turned[2] += TURN[0]
        driven[:2] += DRIVE[1] * np.array([np.cos(self.pose[2]), np.sin(self.pose[2])])
        return np.array([turned, self.pose, driven, self.pose])

    def put(self, sigma: tuple[float, float] | None) -> None:
        """Everywhere, or near the pose; then a step."""
        if sigma is None:
            self.belief.reset(0, self.grid)
            self.belief.predict(0, TURN)
        else:
            self.belief.reset_near(0, self.grid, self.pose, sigma)
            self.step(TURN, 0)
            self.step(-TURN, 1)
        self.belief.summarise(0)
        self.shares.clear()

    def step(self, u: NDArray[np.float64], i: int) -> None:
        """A whole step; the i-th scan."""
        self.shares.append(self.belief.live_share(0))
        self.belief.predict(0, u)
        self.belief.correct(0, self.scans[i])
        self.belief.summarise(0)

    def once(self, u: NDArray[np.float64]) -> Prepared:
        """The first step of a belief that is everywhere."""
        return Prepared(lambda: self.put(None), lambda: self.step(u, 2))

    def around(self, sigma: tuple[float, float]) -> Prepared:
        """A round of four steps near the pose."""

        def walk() -> None:
            for i, u in enumerate((TURN, -TURN, DRIVE, -DRIVE)):
                self.step(u, i)

        return Prepared(lambda: self.put(sigma), walk)


def _steps(
    settings: Settings,
    grid: OccupancyGrid,
    config: HistogramConfig,
    sensor: BeamModel,
    name: str,
    limits: tuple[float, float],
) -> Iterator[Row | Curve]:
    """Whole steps: dense, localized, and by the share of the cells that is alive."""
    walker, shares = Walker(grid, config, sensor), []
    calls = {"drive": walker.once(DRIVE), "turn": walker.once(TURN)}
    for sigma in SIGMAS:
        around = walker.around(sigma)
        around.prepare()
        around.call()
        shares.append(float(np.mean(walker.shares)))
        calls[str(sigma)] = around
    ms = {
        what: 1e3 * seconds / (1 if what in ("drive", "turn") else 4)
        for what, seconds in alternate(
            calls, budget=2 * settings.budget, rounds=settings.rounds
        ).items()
    }
    states = walker.belief.probabilities(0).size
    note, target = f"{states:,} states", at_most(limits[0])
    yield Row.of("histogram", f"{name}, dense", "ms", ms["drive"], target=target, note=note)
    yield Row.of("histogram", f"{name}, dense, turn", "ms", ms["turn"], note=note)
    near = int(np.argmin(np.abs(np.log(np.array(shares) / 0.005))))
    note = f"mean of a turn and back, a drive and back; {shares[near]:.1%} of the cells alive"
    local, target = ms[str(SIGMAS[near])], at_most(limits[1])
    yield Row.of("histogram", f"{name}, localized", "ms", local, target=target, note=note)
    x = (*shares, 1.0)
    y = (*(float(np.median(ms[str(sigma)])) for sigma in SIGMAS), float(np.median(ms["drive"])))
    labels = "share of the cells alive", "a whole step [ms]"
    yield Curve("alive", *labels, name, x, y)
    ends = (min(x), 1.0)
    y = tuple(1e3 * seconds_of_copy(BYTES * states * share) for share in ends)
    yield Curve("alive", *labels, f"{name}: its bytes", ends, y, "floor")


def _by_cells(settings: Settings) -> Iterator[Curve]:
    """Dense steps on buildings of several sizes."""
    specs = ("rooms(width=5,height=4):0", "rooms(width=8,height=6):0", "rooms:0", "office:0")
    states, costs = [], []
    for spec in specs[: settings.size(4, 2)]:
        walker = Walker(MapSource.parse(spec).number(0), HistogramConfig(), BeamModel())
        calls = {"step": walker.once(DRIVE)}
        seconds = alternate(calls, budget=settings.budget / 2, rounds=settings.rounds)
        states.append(float(walker.belief.probabilities(0).size))
        costs.append(1e3 * float(np.median(seconds["step"])))
    axes = "states", "states", "a whole step, dense [ms]"
    yield Curve(*axes, "histogram", tuple(states), tuple(costs))
    floor = tuple(1e3 * seconds_of_copy(BYTES * n) for n in states)
    yield Curve(*axes, "its bytes, read and written", tuple(states), floor, "floor")
