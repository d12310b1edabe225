"""The histogram filter: a belief over cells and headings.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.2. ``predict`` is the factorised
odometry: a circular convolution in heading, a shift along each heading with its own stencil, a
circular convolution. ``correct`` adds up log-likelihoods from a table. Both visit only the cells
that hold mass. The rules for contact and repeated readings: :mod:`activeloc.beliefs.place`.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs import histogram_kernels as kernels
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.grid_tables import GridTables, tables_of
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.settings import HistogramConfig
from activeloc.beliefs.view import view_shares
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import check_scan, widened

__all__ = ["GridTables", "HistogramBelief", "HistogramConfig", "turn_taps"]


@dataclass(slots=True)
class _Track:
    """One robot's belief: states, the cells that live, and what is carried over between steps.

    ``left_over`` holds a turn [rad], a travel [m] and a heading variance too small to count yet.
    """

    tables: GridTables
    bel: NDArray[np.floating]
    spare: NDArray[np.floating]
    live: NDArray[np.int32]
    n_live: int
    place: PlaceMemory
    left_over: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @property
    def cells(self) -> NDArray[np.int32]:
        return self.live[: self.n_live]


def turn_taps(turn: float, sigma: float, bin_width: float) -> tuple[int, NDArray[np.float64]]:
    """Where a rotation takes the mass of a heading bin: first shift [bin] and weights.

    Starting uniform in its bin, the heading turns by ``turn`` with a Gaussian error; the weights
    are exact integrals over both.
    """
    spread = 5.0 * sigma + bin_width
    first = int(np.floor((turn - spread) / bin_width))
    last = int(np.ceil((turn + spread) / bin_width))
    edges = np.arange(first - 1, last + 2) * bin_width - turn
    if sigma > 0.0:
        density = np.exp(-0.5 * (edges / sigma) ** 2) / np.sqrt(2.0 * np.pi)
        ramp = edges * ndtr(edges / sigma) + sigma * density
    else:
        ramp = np.maximum(edges, 0.0)
    taps = (ramp[2:] - 2.0 * ramp[1:-1] + ramp[:-2]) / bin_width
    kept = np.flatnonzero(taps > 1e-7)
    taps = taps[kept[0] : kept[-1] + 1]
    return first + int(kept[0]), taps / taps.sum()


class HistogramBelief:
    """Histogram filters of B robots.

    Args:
        n_robots: B.
        config: Settings.
        sensor: The sensor that the filter assumes.
        motion: The motion model that the filter assumes.
    """

    def __init__(
        self, n_robots: int, config: HistogramConfig, sensor: RangeSensor, motion: MotionModel
    ) -> None:
        self.n_robots = n_robots
        self.config = config
        self.sensor = widened(sensor, config.sigma_factor)
        self.motion = motion
        self._tracks: list[_Track | None] = [None] * n_robots

    def _track(self, robot: int) -> _Track:
        track = self._tracks[robot]
        if track is None:
            raise ConfigError(f"robot {robot} has no belief yet: reset it first")
        return track

    def reset(
        self, robot: int, grid: OccupancyGrid, prior: NDArray[np.floating] | None = None
    ) -> None:
        """Start over on a map.

        Args:
            robot: Which one.
            grid: Its map.
            prior: ``(C, K)`` over the states of :meth:`poses`, summing to one; uniform over the
                open ground if None.
        """
        tables = tables_of(grid, self.config, self.sensor, self.motion)
        bel = np.array(tables.uniform if prior is None else prior, dtype=self.config.precision)
        live = np.flatnonzero(bel.any(axis=1)).astype(np.int32)
        buffer = np.zeros(len(bel), dtype=np.int32)
        buffer[: len(live)] = live
        place = PlaceMemory(self.config.sectors, self.config.place_size, self.config.repetition)
        self._tracks[robot] = _Track(tables, bel, np.zeros_like(bel), buffer, len(live), place)

    def reset_near(
        self, robot: int, grid: OccupancyGrid, pose: NDArray[np.float64], sigma: tuple[float, float]
    ) -> None:
        """Start over from a Gaussian around a pose, cut to the open ground.

        Args:
            robot: Which one.
            grid: Its map.
            pose: ``(3,)``.
            sigma: Standard deviation of x and y [m], and of theta [rad].
        """
        poses = tables_of(grid, self.config, self.sensor, self.motion).poses
        offset = (poses.centres - pose[:2]) / np.hypot(sigma[0], 0.3 * poses.cell_size)
        turn = wrap(poses.thetas - pose[2]) / np.hypot(sigma[1], 0.3 * poses.bin_width)
        weight = np.exp(-0.5 * (offset**2).sum(axis=1)) * poses.area
        prior = np.outer(weight, np.exp(-0.5 * turn**2))
        prior[prior < prior.max() * 1e-9] = 0.0
        self.reset(robot, grid, prior / prior.sum())

    def poses(self, robot: int) -> PoseGrid:
        """The states of a robot's belief."""
        return self._track(robot).tables.poses

    def probabilities(self, robot: int) -> NDArray[np.floating]:
        """``(C, K)``; a copy of the belief."""
        return self._track(robot).bel.copy()

    def live_share(self, robot: int) -> float:
        """Share of the cells that hold any mass."""
        track = self._track(robot)
        return track.n_live / len(track.bel)

    def terrain(self, robot: int) -> Terrain:
        """See :class:`Belief`."""
        return self._track(robot).tables.terrain

    def bins(self, robot: int) -> CommonBins:
        """See :class:`Belief`."""
        return self._track(robot).tables.bins

    def place(self, robot: int) -> PlaceMemory:
        """See :class:`Belief`."""
        return self._track(robot).place

    def copy(self) -> HistogramBelief:
        """An independent belief, to be advanced in imagination."""
        twin = copy(self)
        twin._tracks = [
            None
            if t is None
            else _Track(
                t.tables, t.bel.copy(), np.zeros_like(t.bel), t.live.copy(), t.n_live,
                t.place.copy(), t.left_over.copy(),
            )
            for t in self._tracks
        ]  # fmt: skip
        return twin

    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """bel_bar(x') = sum over x of p(x' | u, x, m) bel(x).

        Args:
            robot: Which one.
            u: ``(3,)`` odometry reading: rotation [rad], translation [m], rotation [rad].
            touched: Whether the robot knows that an obstacle stopped it.
        """
        track, noise = self._track(robot), self.motion.odometry
        sigma = noise.sigma(u)
        bend = noise.rotation_from_translation * abs(u[1])
        self._turn(track, float(u[0]), float(noise.rotation_from_rotation * abs(u[0])))
        track.left_over[1] += u[1]
        levels = round(track.left_over[1] / track.tables.travel.step)
        track.left_over[1] -= levels * track.tables.travel.step
        hops = _hops(levels, track.tables.travel.longest_level)
        for level in hops:
            self._travel(track, level, len(hops))
        # The first rotation's share of the travel's heading noise is in the stencil's reach; its
        # share of the final heading is added here, in one convolution with the second's.
        self._turn(track, float(u[2]), float(np.hypot(sigma[2], bend)))
        track.place.move(u)
        if touched and track.place.refuse() and self.config.contact_floor < 1.0:
            left = kernels.weigh(
                track.bel, track.cells, track.tables.travel.p_contact, self.config.contact_floor
            )
            self._normalise(track, left)
        if self.config.leak > 0.0:
            self._leak(track)

    def _turn(self, track: _Track, turn: float, sigma: float) -> None:
        """Rotate; turns and noise too small for the grid are added up until they count."""
        track.left_over[0] += turn
        track.left_over[2] += sigma**2
        width = track.tables.poses.bin_width
        counts = abs(track.left_over[0]) >= 0.5 * width
        sigma = float(np.sqrt(track.left_over[2]))
        if not counts and sigma < 0.2 * width:
            return
        track.left_over[2] = 0.0
        first, taps = turn_taps(track.left_over[0] if counts else 0.0, sigma, width)
        if counts:
            track.left_over[0] = 0.0
        kernels.rotate(track.bel, track.cells, first, taps)

    def _travel(self, track: _Track, level: int, hops: int) -> None:
        travel = track.tables.travel.level(abs(level), hops)
        poses = track.tables.poses
        out_live = np.empty_like(track.live)
        n = kernels.translate(
            track.bel, track.cells, track.spare, out_live,
            0 if level > 0 else poses.headings // 2, poses.cells, poses.index,
            travel.stencil_start, travel.stencil_step, travel.stencil_weight,
            travel.row_start, travel.target, travel.weight, self.config.odometry_floor,
        )  # fmt: skip
        track.bel, track.spare = track.spare, track.bel
        track.live, track.n_live = out_live, n
        self._normalise(track, float(track.bel[track.cells].sum(dtype=np.float64)))

    def _leak(self, track: _Track) -> None:
        track.bel *= 1.0 - self.config.leak
        track.bel += (self.config.leak * track.tables.uniform).astype(track.bel.dtype)
        track.n_live = len(track.bel)
        track.live[:] = np.arange(track.n_live)

    def _normalise(self, track: _Track, total: float) -> None:
        track.n_live = kernels.normalise(track.bel, track.cells, total, self.config.least)

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """bel(x) = eta p(z | x, m) bel_bar(x).

        A scan without a reading leaves the belief as it was; so does one that no state explains.

        Args:
            robot: Which one.
            scan: ``(B,)`` [m]; NaN is "no reading", +inf a maximum-range reading.

        Returns:
            The scan's log-evidence; -inf if it is impossible.

        Raises:
            ScanError: If the scan is not one of the sensor's.
        """
        track, table = self._track(robot), self._track(robot).tables.readings
        readings = table.bins.index(check_scan(scan, self.sensor))
        valid = readings >= 0
        if not valid.any():
            return 0.0
        bearings = self.sensor.bearings
        weights = np.zeros(len(readings))
        weights[valid] = self.config.likelihood_power * track.place.weigh(bearings[valid])
        score = np.empty(track.bel.shape)
        total, shift = kernels.correct(
            track.bel, track.cells, table.row, table.log_p, readings, table.offsets,
            weights, table.per_heading, score,
        )  # fmt: skip
        if total == 0.0:
            return -inf
        track.place.read(bearings[valid])
        self._normalise(track, total)
        return float(np.log(total) + shift)

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        track = self._track(robot)
        nats = entropy(track.tables.masses(track.bel, track.cells))
        estimate, mass = self._estimate(track)
        return Summary(nats, track.tables.uniform_entropy, estimate, mass)

    def _estimate(self, track: _Track) -> tuple[NDArray[np.float64], float]:
        poses = track.tables.poses
        cell, heading = kernels.most_likely(track.bel, track.cells)
        pose = np.append(poses.centres[cell], poses.thetas[heading])
        moments = np.empty(4)
        for _ in range(2):
            self._moments(track, pose, moments)
            pose = pose + moments[1:] / moments[0]
            pose[2] = wrap(pose[2])
        self._moments(track, pose, moments)
        return pose, min(1.0, float(moments[0]))

    def _moments(self, track: _Track, pose: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        poses = track.tables.poses
        kernels.local_moments(
            track.bel, track.cells, poses.centres, poses.thetas, pose, NEAR_RADIUS, NEAR_ANGLE, out
        )

    def mass_near(self, robot: int, pose: NDArray[np.float64]) -> float:
        """See :class:`Belief`."""
        moments = np.empty(4)
        self._moments(self._track(robot), np.asarray(pose, dtype=np.float64), moments)
        return min(1.0, float(moments[0]))

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        track = self._track(robot)
        shares = view_shares(track.tables.poses, headings, rows, cols)
        out = np.zeros((rows * cols, headings))
        kernels.bin_masses(track.bel, track.cells, *shares, out)
        return np.ascontiguousarray(out.T).reshape(headings, rows, cols)

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic over the cells, uniform within a state."""
        track = self._track(robot)
        live = track.bel[track.cells].astype(np.float64)
        cumulative = live.sum(axis=1).cumsum()
        pointers = (rng.random() + np.arange(n)) / n * cumulative[-1]
        rank = np.searchsorted(cumulative, pointers, side="right").clip(max=len(live) - 1)
        within = live[rank].cumsum(axis=1)
        pointers = rng.random((n, 1)) * within[:, -1:]
        heading = (pointers >= within).sum(axis=1).clip(max=within.shape[1] - 1).astype(np.int32)
        return track.tables.poses.sample_in(track.cells[rank], heading, rng.random((n, 4)))

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See :class:`Belief`."""
        tables = self._track(robot).tables
        cell, heading = tables.poses.states_of(poses)
        table = tables.readings
        direction = heading[:, None] * table.per_heading + table.offsets
        return table.row[cell[:, None], direction % table.row.shape[1]], table.log_p


def _hops(levels: int, longest: int) -> list[int]:
    """A travel of ``levels`` half cells as few, nearly equal travels of at most ``longest``."""
    if levels == 0:
        return []
    n = -(-abs(levels) // longest)
    sign = 1 if levels > 0 else -1
    return [sign * (abs(levels) // n + (i < abs(levels) % n)) for i in range(n)]
