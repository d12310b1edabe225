"""The histogram filter: a belief over cells and headings.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.2. ``predict`` is the factorised
odometry: a circular convolution in heading, a shift along each heading with its own stencil, a
circular convolution. ``correct`` weighs by likelihoods from a table. Both visit only the cells that
hold mass; the chance of being anywhere else is one number: :mod:`activeloc.beliefs.background`. The
rules for contact and repeated readings: :mod:`activeloc.beliefs.place`.
"""

from __future__ import annotations

from copy import copy
from math import inf, log, log1p

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs.background import elsewhere_after
from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_tables import GridTables, tables_of
from activeloc.beliefs.past import Read
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.scan_likelihood import ScanLikelihood
from activeloc.beliefs.settings import HistogramConfig
from activeloc.beliefs.track import Track, turn_taps
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import check_one_scan, widened

__all__ = ["GridTables", "HistogramBelief", "HistogramConfig", "turn_taps"]


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
        self._tracks: list[Track | None] = [None] * n_robots

    @property
    def carries_background(self) -> bool:
        """Whether the chance of being elsewhere is one number, and not in every state."""
        return self.config.leak > 0.0 and self.config.least > 0.0

    def _track(self, robot: int) -> Track:
        track = self._tracks[robot]
        if track is None:
            raise ConfigError(f"robot {robot} has no belief yet: reset it first")
        track.config = self.config
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

        Raises:
            ConfigError: If the prior has another shape, a number below zero or none, or no mass.
        """
        tables = tables_of(grid, self.config, self.sensor, self.motion)
        if prior is None:
            bel = GridBelief(tables, tables.everywhere)
        else:
            bel = GridBelief.of(tables, _checked(np.asarray(prior), tables))
        before = self._tracks[robot]
        if before is not None:
            before.bel.drop()
        self._tracks[robot] = Track(tables, self.config, bel)

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
        log_weight = np.log(poses.area) - 0.5 * (offset**2).sum(axis=1)
        # Far from the open ground what is nearest counts, however little that is.
        prior = np.outer(np.exp(log_weight - log_weight.max()), np.exp(-0.5 * turn**2))
        prior[prior < prior.max() * 1e-9] = 0.0
        self.reset(robot, grid, prior / prior.sum())

    def poses(self, robot: int) -> PoseGrid:
        """The states of a robot's belief."""
        return self._track(robot).tables.poses

    def probabilities(self, robot: int) -> NDArray[np.floating]:
        """``(C, K)``; a copy of the belief."""
        track = self._track(robot)
        bel, w = track.bel.by_cell, track.elsewhere
        if w == 0.0:
            return bel
        p: NDArray[np.floating] = (1.0 - w) * bel + w * track.tables.uniform
        return p.astype(bel.dtype)

    def live_share(self, robot: int) -> float:
        """Share of the cells that hold any mass; what a step costs follows it."""
        return self._track(robot).live_share()

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
        twin._tracks = [None if track is None else track.copy() for track in self._tracks]
        return twin

    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """bel_bar(x') = sum over x of p(x' | u, x, m) bel(x).

        Args:
            robot: Which one.
            u: ``(3,)`` odometry reading: rotation [rad], translation [m], rotation [rad].
            touched: Whether the robot knows that an obstacle stopped it.
        """
        track = self._track(robot)
        track.predict(np.asarray(u, dtype=np.float64), self.motion.odometry, touched)

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """bel(x) = eta p(z | x, m) bel_bar(x).

        A scan without a reading, or without one that counts, leaves the belief as it was; so does
        one that no state explains.
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
        track = self._track(robot)
        table, place, bearings = track.tables.readings, track.place, self.sensor.bearings
        readings = table.bins.index(check_one_scan(scan, self.sensor))
        valid = readings >= 0
        if not valid.any():
            return 0.0
        weights = place.weigh(bearings, valid) * self.config.likelihood_power
        likelihood = ScanLikelihood.of(table, track.tables.powered, readings, weights)
        track.has_news, track.has_widened = len(likelihood.beams) > 0, False
        if not track.has_news:
            place.read(bearings, valid)
            track.normalise(1.0)  # What turns have spread thin is let go all the same.
            return 0.0
        total, shift = track.bel.read(likelihood)
        evidence = log(total) + shift if total > 0.0 else -inf
        if self.carries_background:
            evidence = self._watch(track, likelihood, total, evidence)
        if evidence == -inf:
            return -inf
        place.read(bearings, valid)
        if not track.has_widened:
            track.normalise(total)
        return evidence

    def _watch(
        self, track: Track, likelihood: ScanLikelihood, total: float, log_local: float
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

    def _widen(self, track: Track, scan: Read, total: float) -> float:
        """Lay the background out over all cells; returns the last scan's log-evidence.

        Args:
            track: Its ``bel`` is weighed by the scan already, unless that is impossible there.
            scan: The scan.
            total: Sum of ``bel``.
        """
        track.past.add(scan)
        background, here, evidence = track.past.relive(track.tables)
        if evidence == -inf:
            track.past.steps[-1][1].pop()
            return -inf
        background.add(track.bel, here / total if total > 0.0 else 0.0)
        track.bel.drop()
        track.bel = background
        track.elsewhere, track.has_widened = 0.0, True
        track.noticed += 1
        track.past.steps.clear()
        track.normalise(background.mass())
        return evidence

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        track = self._track(robot)
        nats = track.bel.entropy(track.elsewhere)
        estimate, mass = track.bel.estimate(NEAR_RADIUS, NEAR_ANGLE)
        mass = self._with_elsewhere(track, estimate, mass, NEAR_RADIUS, NEAR_ANGLE)
        return Summary(nats, track.tables.uniform_entropy, estimate, mass)

    def mass_near(
        self,
        robot: int,
        pose: NDArray[np.float64],
        radius: float = NEAR_RADIUS,
        angle: float = NEAR_ANGLE,
    ) -> float:
        """See :class:`Belief`."""
        track, pose = self._track(robot), np.asarray(pose, dtype=np.float64)
        mass = track.bel.near(pose, radius, angle)
        return self._with_elsewhere(track, pose, mass, radius, angle)

    def _with_elsewhere(
        self, track: Track, pose: NDArray[np.float64], mass: float, radius: float, angle: float
    ) -> float:
        """Mass near a pose in the whole belief, of which the local part has ``mass`` there."""
        w = track.elsewhere
        if w > 0.0:
            there = track.tables.background.mass_near(pose, radius, angle)
            mass = (1.0 - w) * mass + w * there
        return min(1.0, mass)

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        track = self._track(robot)
        bins = track.tables.view_bins(headings, rows, cols)
        w = track.elsewhere
        elsewhere = w * track.tables.background.view(bins) if w > 0.0 else None
        out = track.bel.masses(bins, 1.0 - w, elsewhere)
        return out.reshape(headings, rows, cols)

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic over the states, uniform within each."""
        track = self._track(robot)
        tables, here = track.tables, 1.0 - track.elsewhere
        pointers, uniforms = (rng.random() + np.arange(n)) / n, rng.random(n)
        away = pointers >= here
        cell, heading = track.bel.at_shares(np.where(away, 0.0, pointers / here)[~away])
        if away.any():
            others = tables.background.cells_at((pointers[away] - here) / track.elsewhere)
            turned = (uniforms[away] * tables.poses.headings).astype(heading.dtype)
            cell, heading = np.append(cell, others), np.append(heading, turned)
        return tables.poses.sample_in(cell, heading.astype(np.int32), rng.random((n, 4)))

    def thinned(self, robot: int, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """See :class:`Belief`; centres of states. The background, kept small, is left out."""
        return self._track(robot).bel.thinned(n)

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See :class:`Belief`."""
        tables = self._track(robot).tables
        cell, heading = tables.poses.states_of(poses)
        rows = tables.readings.rows_of(cell, heading).astype(np.int32)
        return rows, tables.readings.log_p


def _checked(prior: NDArray[np.floating], tables: GridTables) -> NDArray[np.floating]:
    """A prior that is one."""
    shape = len(tables.layout.place), tables.layout.headings
    if prior.shape != shape:
        raise ConfigError(f"the prior must have shape {shape}, got {prior.shape}")
    if not (np.isfinite(prior).all() and (prior >= 0.0).all() and prior.any()):
        raise ConfigError(
            f"the prior must be finite, not below zero and not zero everywhere; it lies in "
            f"[{prior.min():g}, {prior.max():g}] and sums to {prior.sum():g}"
        )
    return prior
