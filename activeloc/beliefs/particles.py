"""Monte Carlo localization: a belief made of weighted poses.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.3.

Among like rooms a few lucky particles decide, and a plain filter of some thousand particles with
the true likelihood is sure of the wrong room more often than not. The defaults are honest instead:
a widened and tempered likelihood, roughening, and as many particles as the belief is wide,
``N = 100 exp(H)``. Fewer particles are faster and lie; the choice is the user's.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.resampling import SCHEMES, effective_sample_size
from activeloc.beliefs.settings import ParticleConfig
from activeloc.beliefs.view import view_pixels
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, move, wrap
from activeloc.sensors import BeamModel, RangeSensor, ReadingBins
from activeloc.sensors.readings import check_scan, rays_of, widened

__all__ = ["ParticleBelief", "ParticleConfig"]

RANGE_STEP = 0.02  # Expected ranges are rounded to this when a reading is looked up [m].


@njit(cache=True, nogil=True)
def add_log_likelihoods(
    log_w: NDArray[np.float64],
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        log_w: ``(N,)``.
        rows: ``(N, B)``; row of the table for each particle and beam.
        log_p: ``(Z, R)``.
        readings: ``(B,)`` of bins; -1 for no reading.
        weights: ``(B,)``; how much each reading counts.
    """
    for b in range(readings.shape[0]):
        if readings[b] >= 0 and weights[b] > 0.0:
            for i in range(log_w.shape[0]):
                log_w[i] += weights[b] * log_p[readings[b], rows[i, b]]


@lru_cache(maxsize=16)
def _ground(grid: OccupancyGrid, radius: float) -> tuple[Terrain, CommonBins, float]:
    """Terrain, common bins and the uniform belief's entropy on a map."""
    terrain, bins = Terrain(grid, radius), CommonBins(grid)
    middle = grid.to_metres(terrain.open_cells[:, ::-1].astype(np.float64) + 0.5)
    poses = np.column_stack([middle, np.zeros(len(middle))])
    place = np.bincount(bins.index(poses) // bins.n_headings)
    return terrain, bins, entropy(place / place.sum()) + float(np.log(bins.n_headings))


@dataclass(slots=True)
class _Cloud:
    """One robot's particles."""

    grid: OccupancyGrid
    poses: NDArray[np.float64]
    log_w: NDArray[np.float64]
    place: PlaceMemory
    rng: np.random.Generator

    @property
    def weights(self) -> NDArray[np.float64]:
        w = np.exp(self.log_w - self.log_w.max())
        return np.asarray(w / w.sum())


class ParticleBelief:
    """Particle filters of B robots.

    Args:
        n_robots: B.
        config: Settings.
        sensor: The sensor that the filter assumes, before it is widened.
        motion: The motion model that the filter assumes.
    """

    def __init__(
        self, n_robots: int, config: ParticleConfig, sensor: RangeSensor, motion: MotionModel
    ) -> None:
        self.n_robots = n_robots
        self.config = config
        self.sensor = widened(sensor, config.sigma_factor)
        self.motion = motion
        self.reading_bins = ReadingBins(sensor.z_max, config.reading_bin)
        self._log_p = self._range_table()
        self._clouds: list[_Cloud | None] = [None] * n_robots

    def _range_table(self) -> NDArray[np.float32] | None:
        """``(Z, R)``; powered log P(bin | expected range) of a beam model, by rounded range."""
        if not isinstance(self.sensor, BeamModel):
            return None
        steps = int(np.ceil(self.sensor.z_max / RANGE_STEP))
        z_expected = np.append((np.arange(steps) + 0.5) * RANGE_STEP, self.sensor.z_max)
        return self._powered(self.sensor.masses(z_expected, self.reading_bins))

    def _powered(self, p: NDArray[np.float64]) -> NDArray[np.float32]:
        with np.errstate(divide="ignore"):
            log_p = self.config.likelihood_power * np.log(p)
        return np.ascontiguousarray(log_p.T.astype(np.float32))

    def _cloud(self, robot: int) -> _Cloud:
        cloud = self._clouds[robot]
        if cloud is None:
            raise ConfigError(f"robot {robot} has no belief yet: reset it first")
        return cloud

    def reset(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        poses: NDArray[np.float64] | None = None,
    ) -> None:
        """Start over on a map with equal weights.

        Args:
            robot: Which one.
            grid: Its map.
            rng: Source of the filter's noise from here on.
            poses: ``(N, 3)``; ``n_max`` uniform over the open ground if None.
        """
        if poses is None:
            terrain = _ground(grid, self.motion.radius)[0]
            poses = terrain.uniform_poses(rng.random((self.config.n_max, 4)))
        poses = np.array(poses, dtype=np.float64)
        place = PlaceMemory(self.config.sectors, self.config.place_size, self.config.repetition)
        self._clouds[robot] = _Cloud(grid, poses, np.zeros(len(poses)), place, rng)

    def reset_near(
        self,
        robot: int,
        grid: OccupancyGrid,
        rng: np.random.Generator,
        pose: NDArray[np.float64],
        sigma: tuple[float, float],
    ) -> None:
        """Start over with ``n_min`` particles from a Gaussian around a pose, on open ground.

        Args:
            robot: Which one.
            grid: Its map.
            rng: Source of the filter's noise from here on.
            pose: ``(3,)``.
            sigma: Standard deviation of x and y [m], and of theta [rad].
        """
        terrain = _ground(grid, self.motion.radius)[0]
        spread = np.array([sigma[0], sigma[0], sigma[1]])
        poses = pose + rng.normal(size=(self.config.n_min, 3)) * spread
        for _ in range(100):
            closed = ~terrain.contains(poses)
            if not closed.any():
                break
            poses[closed] = pose + rng.normal(size=(int(closed.sum()), 3)) * spread
        poses[~terrain.contains(poses)] = pose
        poses[:, 2] = wrap(poses[:, 2])
        self.reset(robot, grid, rng, poses)

    def particles(self, robot: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses ``(N, 3)`` and weights ``(N,)`` summing to one: copies."""
        cloud = self._cloud(robot)
        return cloud.poses.copy(), cloud.weights

    def n_particles(self, robot: int) -> int:
        """How many particles there are now."""
        return len(self._cloud(robot).poses)

    def terrain(self, robot: int) -> Terrain:
        """See :class:`Belief`."""
        return _ground(self._cloud(robot).grid, self.motion.radius)[0]

    def bins(self, robot: int) -> CommonBins:
        """See :class:`Belief`."""
        return _ground(self._cloud(robot).grid, self.motion.radius)[1]

    def place(self, robot: int) -> PlaceMemory:
        """See :class:`Belief`."""
        return self._cloud(robot).place

    def copy(self) -> ParticleBelief:
        """An independent belief with the same future noise, to be advanced in imagination."""
        twin = copy(self)
        twin._clouds = [
            None
            if c is None
            else _Cloud(c.grid, c.poses.copy(), c.log_w.copy(), c.place.copy(), _twin(c.rng))
            for c in self._clouds
        ]
        return twin

    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """Move every particle by the odometry's reading, with its noise.

        Args:
            robot: Which one.
            u: ``(3,)`` odometry reading: rotation [rad], translation [m], rotation [rad].
            touched: Whether the robot knows that an obstacle stopped it.
        """
        cloud, terrain = self._cloud(robot), self.terrain(robot)
        normals = cloud.rng.standard_normal(cloud.poses.shape)
        cloud.poses, shortfall = self.motion.sample(terrain, cloud.poses, u, normals)
        # A tenth of the way, or five centimetres, may be missing: the odometry is noisy too.
        cut = shortfall > max(0.05, 0.1 * abs(u[1]))
        cloud.log_w[cut] += np.log(self.config.odometry_floor)
        cloud.place.move(u)
        if touched and cloud.place.refuse() and self.config.contact_floor < 1.0:
            reach = np.array([0.0, self.config.contact_reach, 0.0])
            ahead = move(terrain, cloud.poses, reach)[1][:, 1]
            cloud.log_w[ahead >= self.config.contact_reach] += np.log(self.config.contact_floor)
        if self.config.leak > 0.0:
            self._leak(cloud, terrain)

    def _leak(self, cloud: _Cloud, terrain: Terrain) -> None:
        """Give a share of the particles a uniform pose and their average weight."""
        n = int(np.ceil(self.config.leak * len(cloud.poses)))
        taken = cloud.rng.choice(len(cloud.poses), n, replace=False)
        cloud.log_w -= np.logaddexp.reduce(cloud.log_w) - np.log(len(cloud.log_w))
        cloud.poses[taken] = terrain.uniform_poses(cloud.rng.random((n, 4)))
        cloud.log_w[taken] = 0.0

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """Weigh every particle by the scan, and resample when few particles carry the weight.

        A scan without a reading leaves the belief as it was; so does one that no particle explains.

        Args:
            robot: Which one.
            scan: ``(B,)`` [m]; NaN is "no reading", +inf a maximum-range reading.

        Returns:
            The scan's log-evidence under the powered likelihood; -inf if it is impossible.

        Raises:
            ScanError: If the scan is not one of the sensor's.
        """
        cloud = self._cloud(robot)
        readings = self.reading_bins.index(check_scan(scan, self.sensor))
        valid = readings >= 0
        if not valid.any():
            return 0.0
        bearings = self.sensor.bearings
        weights = np.zeros(len(readings))
        weights[valid] = cloud.place.weigh(bearings[valid])
        before = np.logaddexp.reduce(cloud.log_w)
        log_w = cloud.log_w.copy()
        rows, log_p = self.forecast(robot, cloud.poses)
        add_log_likelihoods(log_w, rows, log_p, readings, weights)
        after = np.logaddexp.reduce(log_w)
        if after == -inf:
            return -inf
        cloud.place.read(bearings[valid])
        cloud.log_w = log_w - after
        self._resample(cloud)
        return float(after - before)

    def _resample(self, cloud: _Cloud) -> None:
        weights = cloud.weights
        if effective_sample_size(weights) >= self.config.ess_ratio * len(weights):
            return
        n = self._count(cloud, weights)
        chosen = SCHEMES[self.config.resampling](weights, n, cloud.rng.random(n))
        spread = np.array(
            [self.config.roughening_xy, self.config.roughening_xy, self.config.roughening_theta]
        )
        old = cloud.poses[chosen]
        poses = old + cloud.rng.standard_normal(old.shape) * spread
        poses[:, 2] = wrap(poses[:, 2])
        off = ~_ground(cloud.grid, self.motion.radius)[0].contains(poses)
        poses[off] = old[off]
        cloud.poses, cloud.log_w = poses, np.zeros(n)

    def _count(self, cloud: _Cloud, weights: NDArray[np.float64]) -> int:
        """How many particles a belief as wide as this one needs."""
        wanted = self.config.per_state * np.exp(entropy(self._masses(cloud, weights)))
        return int(np.clip(wanted, self.config.n_min, self.config.n_max))

    def _masses(self, cloud: _Cloud, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        bins = _ground(cloud.grid, self.motion.radius)[1]
        masses = np.bincount(bins.index(cloud.poses), weights, minlength=len(bins))
        return masses.astype(np.float64)

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        _, bins, uniform = _ground(cloud.grid, self.motion.radius)
        weights = cloud.weights
        masses = self._masses(cloud, weights)
        pose = bins.centres(np.array([masses.argmax()]))[0]
        for _ in range(3):
            near, offset = self._near(cloud, pose)
            if not near.any():
                break
            pose = pose + weights[near] @ offset[near] / weights[near].sum()
            pose[2] = wrap(pose[2])
        near, _ = self._near(cloud, pose)
        return Summary(entropy(masses), uniform, pose, min(1.0, float(weights[near].sum())))

    def _near(
        self, cloud: _Cloud, pose: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        offset = cloud.poses - pose
        offset[:, 2] = wrap(offset[:, 2])
        near = (np.hypot(offset[:, 0], offset[:, 1]) <= NEAR_RADIUS) & (
            np.abs(offset[:, 2]) <= NEAR_ANGLE
        )
        return near, offset

    def mass_near(self, robot: int, pose: NDArray[np.float64]) -> float:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        return min(1.0, float(cloud.weights[self._near(cloud, np.asarray(pose))[0]].sum()))

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        pixel = view_pixels(cloud.poses[:, :2], cloud.grid, rows, cols)
        heading = np.floor((cloud.poses[:, 2] + np.pi) / (2.0 * np.pi) * headings).astype(np.int64)
        flat = (heading % headings) * (rows * cols) + pixel
        masses = np.bincount(flat, cloud.weights, minlength=headings * rows * cols)
        return masses.reshape(headings, rows, cols).astype(np.float64)

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic."""
        cloud = self._cloud(robot)
        chosen = SCHEMES["systematic"](cloud.weights, n, rng.random(1))
        return cloud.poses[rng.permutation(chosen)]

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See :class:`Belief`."""
        rays = rays_of(poses, self.sensor.bearings)
        grid = self._cloud(robot).grid
        if self._log_p is not None and isinstance(self.sensor, BeamModel):
            expected = self.sensor.expected(grid, rays)
            rows = (expected / RANGE_STEP).astype(np.int32)
            rows[expected >= self.sensor.z_max] = self._log_p.shape[1] - 1
            return rows, self._log_p
        p = self.sensor.bin_probabilities(grid, rays, self.reading_bins)
        rows = np.arange(p.shape[0] * p.shape[1], dtype=np.int32).reshape(p.shape[:2])
        return rows, self._powered(p.reshape(-1, p.shape[-1]))


def _twin(rng: np.random.Generator) -> np.random.Generator:
    """A generator in the same state."""
    twin = np.random.Generator(type(rng.bit_generator)())
    twin.bit_generator.state = rng.bit_generator.state
    return twin
