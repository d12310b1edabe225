"""The histogram filter: a belief over cells and headings.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.2. ``predict`` is the factorised
odometry: a circular convolution in heading, a shift along each heading with its own stencil, a
circular convolution. ``correct`` weighs by likelihoods from a table. Both visit only the cells that
hold mass; the chance of being anywhere else is one number: :mod:`activeloc.beliefs.background`. The
rules for contact and repeated readings: :mod:`activeloc.beliefs.place`.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from math import inf, log, log1p

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs import histogram_kernels as kernels
from activeloc.beliefs.background import elsewhere_after
from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.grid_tables import GridTables, tables_of
from activeloc.beliefs.past import Absorbed, Leaked, Past, Read, Touched, Travelled, Turn
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.scan_likelihood import ScanLikelihood
from activeloc.beliefs.settings import HistogramConfig
from activeloc.beliefs.thinning import thin_weights
from activeloc.beliefs.view import view_shares
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import SLIP_ANGLE, SLIP_TRAVEL, MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import check_scan, widened

# A belief that lists more than this share of the cells is spared the mass that a slip brings.
SPARSE = 0.25

__all__ = ["GridTables", "HistogramBelief", "HistogramConfig", "turn_taps"]


@dataclass(slots=True)
class _Track:
    """One robot's belief: states, the cells that live, and what is carried over between steps.

    ``elsewhere`` is w of :mod:`activeloc.beliefs.background`: the belief is
    ``(1 - w) bel + w uniform``. ``left_over`` holds a turn [rad], a travel [m] and a heading
    variance too small to count yet. ``masses`` are the common bins, all zero between calls.
    """

    tables: GridTables
    bel: NDArray[np.floating]
    spare: NDArray[np.floating]
    live: NDArray[np.int32]
    n_live: int
    place: PlaceMemory
    masses: NDArray[np.float64]
    elsewhere: float = 0.0
    noticed: int = 0
    has_widened: bool = False
    past: Past = field(default_factory=Past)
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

    @property
    def carries_background(self) -> bool:
        """Whether the chance of being elsewhere is one number, and not in every state."""
        return self.config.leak > 0.0 and self.config.least > 0.0

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
        masses = np.zeros_like(tables.uniform_masses)
        self._tracks[robot] = _Track(
            tables, bel, np.zeros_like(bel), buffer, len(live), place, masses
        )

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
        track = self._track(robot)
        if track.elsewhere == 0.0:
            return track.bel.copy()
        w = track.elsewhere
        p: NDArray[np.floating] = (1.0 - w) * track.bel + w * track.tables.uniform
        return p.astype(track.bel.dtype)

    def live_share(self, robot: int) -> float:
        """Share of the cells that are listed, and updated at each step."""
        track = self._track(robot)
        return track.n_live / len(track.bel)

    def elsewhere(self, robot: int) -> float:
        """w: probability that the robot is not where the listed cells say, but anywhere.

        0 right after the belief has widened, since all cells are listed then.
        """
        return self._track(robot).elsewhere

    def noticed(self, robot: int) -> int:
        """How many times since the reset the belief has widened to the whole map.

        It has let go of where it lived only if :meth:`summarise` says so: most of the times it
        looks around and comes back.
        """
        return self._track(robot).noticed

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
                t.place.copy(), np.zeros_like(t.masses), t.elsewhere, t.noticed, t.has_widened,
                t.past.copy(), t.left_over.copy(),
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
        track.past.begin(track.elsewhere)
        slipping = self._slipping(track, u)
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
        if slipping is not None:
            self._slip(track, *slipping, u)
        track.place.move(u)
        if touched and track.place.refuse() and self.config.contact_floor < 1.0:
            left = kernels.weigh(
                track.bel, track.cells, track.tables.travel.p_contact, self.config.contact_floor
            )
            if self.carries_background:
                elsewhere = track.tables.background.contact(self.config.contact_floor)
                track.elsewhere = elsewhere_after(track.elsewhere, log(elsewhere), log(left))
                track.past.add(Touched(self.config.contact_floor, left))
            self._normalise(track, left)
        if self.config.leak > 0.0:
            self._leak(track)

    def _slipping(
        self, track: _Track, u: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.floating]] | None:
        """Cells and states that may not take the odometry at its word; None where none need to.

        A belief that is all over the map has the mass that a slip would bring there already.
        """
        if self.config.slip == 0.0 or track.n_live > SPARSE * len(track.bel) or not np.any(u):
            return None
        return track.cells.copy(), track.bel[track.cells]

    def _slip(
        self,
        track: _Track,
        cells: NDArray[np.int32],
        was: NDArray[np.floating],
        u: NDArray[np.float64],
    ) -> None:
        """Mix in what a badly wrong reading may stand for: :func:`activeloc.motion.slipped`.

        Of its travels only two: none, and half a metre the way that was read.

        Args:
            track: Predicted as read.
            cells: ``(n,)``; where mass was before.
            was: ``(n, K)``; that mass, overwritten.
            u: ``(3,)`` odometry reading.
        """
        share, width = self.config.slip, track.tables.poses.bin_width
        reach = round(SLIP_ANGLE / width)
        taps = np.full(2 * reach + 1, 1.0 / (2 * reach + 1))
        first = round((u[0] + u[2]) / width) - reach
        kernels.rotate(was, np.arange(len(was), dtype=np.int32), first, taps)
        track.bel[track.cells] *= 1.0 - share
        reached, drives = [track.cells, cells], abs(u[1]) > 0.0
        track.bel[cells] += was * (0.5 * share if drives else share)
        if drives:
            travel = track.tables.travel
            level = min(round(SLIP_TRAVEL / travel.step), travel.longest_level)
            moved, out = np.zeros_like(track.bel), np.zeros_like(track.bel)
            moved[cells] = 0.5 * share * was
            live = np.empty_like(track.live)
            n = track.tables.carry(moved, cells, out, live, level if u[1] > 0.0 else -level, 1, 1.0)
            track.bel[live[:n]] += out[live[:n]]
            reached.append(live[:n])
        listed = np.unique(np.concatenate(reached))
        track.n_live = len(listed)
        track.live[: len(listed)] = listed

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
        if self.carries_background:
            track.past.add(Turn(first, taps))

    def _travel(self, track: _Track, level: int, hops: int) -> None:
        floor, out_live = self.config.odometry_floor, np.empty_like(track.live)
        n = track.tables.carry(track.bel, track.cells, track.spare, out_live, level, hops, floor)
        track.bel, track.spare = track.spare, track.bel
        track.live, track.n_live = out_live, n
        left = kernels.mass(track.bel, track.cells)
        if self.carries_background:
            elsewhere = track.tables.background.travel(track.tables.travel, abs(level), hops, floor)
            track.elsewhere = elsewhere_after(track.elsewhere, log(elsewhere), log(left))
            track.past.add(Travelled(level, hops, floor, left))
        self._normalise(track, left)

    def _leak(self, track: _Track) -> None:
        """Let the robot be carried off: in one number, or state by state if all are updated."""
        if self.carries_background:
            track.elsewhere += self.config.leak * (1.0 - track.elsewhere)
            track.past.add(Leaked(self.config.leak))
            return
        track.bel *= 1.0 - self.config.leak
        track.bel += (self.config.leak * track.tables.uniform).astype(track.bel.dtype)
        track.n_live = len(track.bel)
        track.live[:] = np.arange(track.n_live)

    def _normalise(self, track: _Track, total: float) -> None:
        least = self.config.least
        if self.carries_background:
            # A state with less than a step's leak brings to it is background, and counts there.
            least = max(least, self.config.leak / track.bel.size)
        track.n_live, kept = kernels.normalise(track.bel, track.cells, total, least)
        if self.carries_background:
            track.elsewhere += (1.0 - track.elsewhere) * (1.0 - kept)
            if kept < 1.0 and track.past.steps:
                track.past.add(Absorbed(kept))

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """bel(x) = eta p(z | x, m) bel_bar(x).

        A scan without a reading leaves the belief as it was; so does one that no state explains.
        One that makes it likely enough that the robot is elsewhere widens the belief to the whole
        map.

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
        likelihood = ScanLikelihood.of(table, track.tables.powered, readings, weights)
        total, shift = likelihood.weigh(track.bel, track.cells)
        evidence = log(total) + shift if total > 0.0 else -inf
        track.has_widened = False
        if self.carries_background:
            evidence = self._watch(track, likelihood, total, evidence)
        if evidence == -inf:
            return -inf
        track.place.read(bearings[valid])
        if not track.has_widened:
            self._normalise(track, total)
        return evidence

    def _watch(
        self, track: _Track, likelihood: ScanLikelihood, total: float, log_local: float
    ) -> float:
        """Weigh the background by a scan, and widen if need be; returns the log-evidence.

        Args:
            track: Its ``bel`` is weighed by the scan already, unless that is impossible there.
            likelihood: Of the scan.
            total: Sum of ``bel``; 0 if the scan is impossible there.
            log_local: Log-evidence of the scan there.
        """
        if not track.past.steps:
            track.past.begin(track.elsewhere)
        w = track.elsewhere
        if w == 0.0:
            if total > 0.0:
                track.past.add(Read(likelihood, log_local))
            return log_local
        expected = track.tables.background.log_evidence(likelihood)
        w_after = elsewhere_after(w, expected, log_local)
        if total > 0.0 and w_after <= self.config.widen:
            track.elsewhere = w_after
            track.past.add(Read(likelihood, log_local))
            return float(np.logaddexp(log(w) + expected, log1p(-w) + log_local))
        return self._widen(track, Read(likelihood, log_local), total)

    def _widen(self, track: _Track, scan: Read, total: float) -> float:
        """Lay the background out over all cells; returns the last scan's log-evidence.

        Args:
            track: Its ``bel`` is weighed by the scan already, unless that is impossible there.
            scan: The scan.
            total: Sum of ``bel``.
        """
        track.past.add(scan)
        background, here, evidence = track.past.relive(track.tables, self.config.precision)
        if evidence == -inf:
            track.past.steps[-1][1].pop()
            return -inf
        track.bel *= here / total if total > 0.0 else 0.0
        track.bel += background
        track.live[:] = np.arange(len(track.bel))
        track.n_live = len(track.bel)
        track.elsewhere, track.has_widened = 0.0, True
        track.noticed += 1
        track.past.steps.clear()
        self._normalise(track, kernels.mass(track.bel, track.cells))
        return evidence

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        track = self._track(robot)
        tables = track.tables
        kernels.bin_masses(
            track.bel, track.cells, *tables.places, *tables.bin_headings, track.masses
        )
        nats = kernels.mixed_entropy(
            track.cells, *tables.places, track.masses,
            track.elsewhere, tables.uniform_masses, tables.uniform_entropy,
        )  # fmt: skip
        estimate = self._estimate(track)
        return Summary(nats, tables.uniform_entropy, estimate, self.mass_near(robot, estimate))

    def _estimate(self, track: _Track) -> NDArray[np.float64]:
        """The mean of the local belief's mass around its mode."""
        poses = track.tables.poses
        cell, heading = kernels.most_likely(track.bel, track.cells)
        pose = np.append(poses.centres[cell], poses.thetas[heading])
        moments = np.empty(4)
        for _ in range(2):
            self._moments(track, pose, moments)
            pose = pose + moments[1:] / moments[0]
            pose[2] = wrap(pose[2])
        return pose

    def _moments(self, track: _Track, pose: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        poses = track.tables.poses
        kernels.local_moments(
            track.bel, track.cells, poses.centres, poses.thetas, pose, NEAR_RADIUS, NEAR_ANGLE, out
        )

    def mass_near(self, robot: int, pose: NDArray[np.float64]) -> float:
        """See :class:`Belief`."""
        track, pose, moments = self._track(robot), np.asarray(pose, dtype=np.float64), np.empty(4)
        self._moments(track, pose, moments)
        mass, w = float(moments[0]), track.elsewhere
        if w > 0.0:
            elsewhere = track.tables.background.mass_near(pose, NEAR_RADIUS, NEAR_ANGLE)
            mass = (1.0 - w) * mass + w * elsewhere
        return min(1.0, mass)

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        track = self._track(robot)
        shares = view_shares(track.tables.poses, headings, rows, cols)
        out = np.zeros((rows * cols, headings))
        kernels.bin_masses(track.bel, track.cells, *shares, out)
        w = track.elsewhere
        if w > 0.0:
            out = (1.0 - w) * out + w * track.tables.background.view(headings, rows, cols)
        return np.ascontiguousarray(out.T).reshape(headings, rows, cols)

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic over the cells, uniform within a state."""
        track = self._track(robot)
        tables, here = track.tables, 1.0 - track.elsewhere
        live = track.bel[track.cells].astype(np.float64)
        cumulative = live.sum(axis=1).cumsum()
        pointers, uniforms = (rng.random() + np.arange(n)) / n, rng.random((n, 1))
        away = pointers >= here
        at = np.where(away, 0.0, pointers / here) * cumulative[-1]
        rank = np.searchsorted(cumulative, at, side="right").clip(max=len(live) - 1)
        within = live[rank].cumsum(axis=1)
        heading = (uniforms * within[:, -1:] >= within).sum(axis=1).clip(max=within.shape[1] - 1)
        cell = track.cells[rank]
        if away.any():
            cell[away] = tables.background.cells_at((pointers[away] - here) / track.elsewhere)
            heading[away] = (uniforms[away, 0] * within.shape[1]).astype(heading.dtype)
        return tables.poses.sample_in(cell, heading.astype(np.int32), rng.random((n, 4)))

    def thinned(self, robot: int, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """See :class:`Belief`; centres of states. The background, kept small, is left out."""
        track = self._track(robot)
        poses, index, count = track.tables.poses, np.empty(n, np.int64), np.empty(n, np.int64)
        m = thin_weights(track.bel[track.cells].ravel(), index, count)
        rank, heading = np.divmod(index[:m], poses.headings)
        places = poses.centres[track.cells[rank]]
        return np.column_stack([places, poses.thetas[heading]]), count[:m]

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
