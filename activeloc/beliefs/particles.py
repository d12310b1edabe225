"""Monte Carlo localization: a belief made of weighted poses.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.3.

Among like rooms a few lucky particles decide, and a plain filter of some thousand particles with
the true likelihood is sure of the wrong room more often than not. The defaults are honest instead:
a widened and tempered likelihood, roughening, as many particles as the belief is wide, and a
background that takes over when the scans say that the robot is somewhere else
(:mod:`activeloc.beliefs.recovery`). Fewer particles are faster and lie; the choice is the user's.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs import particle_kernels as kernels
from activeloc.beliefs.cloud import FAINT, Cloud, Ground, ground_of, log_sum, normals, spread_poses
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.recovery import RunningMeans, background_after
from activeloc.beliefs.resampling import SCHEMES
from activeloc.beliefs.sample_size import draw_until, effective_states
from activeloc.beliefs.settings import ParticleConfig
from activeloc.beliefs.thinning import thin_weights
from activeloc.beliefs.view import view_frame
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, move, slipped, wrap
from activeloc.range_table import level_ranges, levels_of, range_table
from activeloc.sensors import RangeSensor, ReadingBins
from activeloc.sensors.readings import ExpectedRangeSensor, check_scan, rays_of, widened

__all__ = ["ParticleBelief", "ParticleConfig"]


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
        self._clouds: list[Cloud | None] = [None] * n_robots

    def _powered(self, p: NDArray[np.float64]) -> NDArray[np.float32]:
        """``(Z, R)`` of powered log-probabilities for ``(R, Z)`` of probabilities."""
        with np.errstate(divide="ignore"):
            log_p = self.config.likelihood_power * np.log(p)
        return np.ascontiguousarray(log_p.T.astype(np.float32))

    @cached_property
    def _law(self) -> NDArray[np.float32] | None:
        """``(Z, LEVELS)``; powered log P(bin | level of the expected range), if it has one."""
        if not isinstance(self.sensor, ExpectedRangeSensor):
            return None
        return self._powered(self.sensor.masses(level_ranges(self.sensor.z_max), self.reading_bins))

    def _cloud(self, robot: int) -> Cloud:
        cloud = self._clouds[robot]
        if cloud is None:
            raise ConfigError(f"robot {robot} has no belief yet: reset it first")
        return cloud

    def _ground(self, grid: OccupancyGrid) -> Ground:
        kld = (self.config.kld_size, self.config.kld_angle)
        return ground_of(grid, self.motion.radius, kld)

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
            poses: ``(N, 3)``; spread evenly over the open ground if None.

        Raises:
            ConfigError: If the poses are not N >= 1 rows of three finite numbers.
        """
        ground = self._ground(grid)
        if poses is None:
            poses = spread_poses(ground.terrain, self.config.n_start, rng)
        poses = np.array(poses, dtype=np.float64)
        if poses.ndim != 2 or poses.shape[1] != 3 or not poses.size or not np.isfinite(poses).all():
            raise ConfigError(f"poses must be (N, 3) finite numbers, N >= 1; got {poses.shape}")
        kernels.turn(poses, 0.0, 0.0, np.zeros(len(poses), dtype=np.float32))  # Into [-pi, pi).
        table = None
        thin = isinstance(self.sensor, ExpectedRangeSensor) and len(self.sensor.cone) == 1
        if thin and self.config.directions:
            table = range_table(grid, self.sensor.z_max, self.config.directions)
        place = PlaceMemory(self.config.sectors, self.config.place_size, self.config.repetition)
        self._clouds[robot] = Cloud(
            ground,
            table,
            poses,
            np.full(len(poses), -np.log(len(poses))),
            place,
            rng,
            RunningMeans(self.config.alpha_slow, self.config.alpha_fast),
            weights=np.full(len(poses), 1.0 / len(poses)),
        )

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
        terrain = self._ground(grid).terrain
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
        """Poses ``(N, 3)`` and weights ``(N,)`` summing to one: copies, without the background."""
        cloud = self._cloud(robot)
        return cloud.poses.copy(), cloud.normalised().copy()

    def n_particles(self, robot: int) -> int:
        """How many particles there are now."""
        return len(self._cloud(robot).poses)

    def background(self, robot: int) -> float:
        """Probability that the robot is where the particles are not: anywhere."""
        return self._cloud(robot).background

    def noticed(self, robot: int) -> int:
        """How often the belief has let go since the reset, and begun to look everywhere."""
        return self._cloud(robot).noticed

    def terrain(self, robot: int) -> Terrain:
        """See :class:`Belief`."""
        return self._cloud(robot).ground.terrain

    def bins(self, robot: int) -> CommonBins:
        """See :class:`Belief`."""
        return self._cloud(robot).ground.bins

    def place(self, robot: int) -> PlaceMemory:
        """See :class:`Belief`."""
        return self._cloud(robot).place

    def copy(self) -> ParticleBelief:
        """An independent belief with the same future noise, to be advanced in imagination."""
        twin = copy(self)
        twin._clouds = [None if c is None else c.copy() for c in self._clouds]
        return twin

    def predict(self, robot: int, u: NDArray[np.float64], touched: bool = False) -> None:
        """Move every particle by the odometry's reading, with its noise.

        Args:
            robot: Which one.
            u: ``(3,)`` odometry reading: rotation [rad], translation [m], rotation [rad].
            touched: Whether the robot knows that an obstacle stopped it.
        """
        cloud = self._cloud(robot)
        u = np.asarray(u, dtype=np.float64)
        sigma = self.motion.odometry.sigma(u)
        n = len(cloud.poses)
        cloud.masses = None
        slipping = cloud.rng.integers(0, n, int(self.config.slip * n + cloud.rng.random()))
        before, weighed = cloud.poses[slipping], cloud.log_w[slipping]
        if u[1] == 0.0 and sigma[1] == 0.0:
            spread = float(np.hypot(sigma[0], sigma[2]))
            kernels.turn(cloud.poses, float(u[0] + u[2]), spread, normals(cloud.rng, n))
        else:
            if u[0] != 0.0 or sigma[0] > 0.0:
                kernels.turn(cloud.poses, float(u[0]), float(sigma[0]), normals(cloud.rng, n))
            self._drive(cloud, u, sigma)
        if len(slipping):
            motions = slipped(u, cloud.rng.random((len(slipping), 2)))
            cloud.poses[slipping] = move(cloud.ground.terrain, before, motions)[0]
            cloud.log_w[slipping] = weighed  # They drove another way than the one cut short.
        cloud.place.move(u)
        if touched and cloud.place.refuse() and self.config.contact_floor < 1.0:
            ground = cloud.ground
            kernels.touch(
                ground.terrain.blocked, ground.terrain.room, ground.frame, cloud.poses,
                self.config.contact_reach, cloud.log_w, float(np.log(self.config.contact_floor)),
            )  # fmt: skip
            cloud.weights = None

    def _drive(self, cloud: Cloud, u: NDArray[np.float64], sigma: NDArray[np.float64]) -> None:
        """Travel and the second rotation."""
        ground = cloud.ground
        theta = cloud.poses[:, 2].astype(np.float32)
        # A tenth of the way, or five centimetres, may be missing: the odometry is noisy too.
        slack = max(0.05, 0.1 * abs(float(u[1])))
        kernels.drive(
            ground.terrain.blocked, ground.terrain.room, ground.frame, cloud.poses, u, sigma,
            normals(cloud.rng, len(theta), 2), np.cos(theta), np.sin(theta), cloud.log_w, slack,
            float(np.log(self.config.odometry_floor)),
        )  # fmt: skip
        cloud.weights = None

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """Weigh every particle by the scan, and resample when few particles carry the weight.

        A scan without a reading leaves the belief as it was; so does one that no particle explains,
        unless the background does.

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
        weights = np.zeros(len(readings))
        weights[valid] = cloud.place.weigh(self.sensor.bearings[valid])
        cloud.normalised()
        log_w = cloud.log_w.copy()
        self._weigh(cloud, cloud.poses, readings, weights, log_w)
        local = log_sum(log_w) - cloud.log_total
        evidence = self._weigh_background(cloud, readings, weights, local)
        if evidence == -inf:
            return -inf
        cloud.place.read(self.sensor.bearings[valid])
        if local > -inf:
            cloud.log_w, cloud.weights, cloud.masses = log_w, None, None
        # Scans of which more readings count are less likely, whatever the belief.
        counted = float(weights.sum())
        share = cloud.means.add(float(np.exp(local / counted))) if counted > 0.0 else 0.0
        if self.config.recovery == "augmented" and share > 0.0:
            self._inject(cloud, share, readings, weights)
        elif cloud.background > self.config.widen or local == -inf:
            self._widen(cloud, readings, weights)
        else:
            self._resample(cloud)
        return evidence

    def _weigh(
        self,
        cloud: Cloud,
        poses: NDArray[np.float64],
        readings: NDArray[np.int32],
        weights: NDArray[np.float64],
        log_w: NDArray[np.float64],
    ) -> None:
        """Add the scan's weighted log-likelihood at each pose to ``log_w (N,)``, in place."""
        table, law = cloud.table, self._law
        if table is None or law is None:
            rows, log_p = self._rows(cloud, poses)
            kernels.weigh_by_rows(log_w, rows, log_p, readings, weights)
            return
        counts = (readings >= 0) & (weights > 0.0)
        read = law[readings[counts]] * weights[counts, None]
        kernels.weigh_by_table(
            table.table, table.index, table.blocked, table.frame, table.reach, poses,
            self.sensor.bearings[counts], read.astype(np.float32), log_w,
        )  # fmt: skip

    def _weigh_background(
        self,
        cloud: Cloud,
        readings: NDArray[np.int32],
        weights: NDArray[np.float64],
        local: float,
    ) -> float:
        """Weigh the background against the particles; returns the evidence of both."""
        leak = self.config.leak if self.config.recovery == "background" else 0.0
        if leak == 0.0:
            cloud.background = 0.0
            return local
        probes = cloud.ground.probes
        log_p = np.zeros(len(probes))
        self._weigh(cloud, probes, readings, weights, log_p)
        anywhere = log_sum(log_p) - float(np.log(len(probes)))
        w = cloud.background + leak * (1.0 - cloud.background)
        cloud.background = background_after(cloud.background, leak, anywhere, local)
        if anywhere == -inf:
            return local
        kept = np.log1p(-w) + local if w < 1.0 else -inf
        return float(np.logaddexp(np.log(w) + anywhere, kept))

    def _widen(
        self, cloud: Cloud, readings: NDArray[np.int32], weights: NDArray[np.float64]
    ) -> None:
        """Draw the background as particles, weighed by the scan."""
        poses = spread_poses(cloud.ground.terrain, self.config.n_start, cloud.rng)
        log_p = np.zeros(len(poses))
        self._weigh(cloud, poses, readings, weights, log_p)
        if log_p.max() == -inf:  # Too few to find a pose that explains the scan.
            return
        anywhere = np.exp(log_p - log_p.max())
        w = np.concatenate([
            (1.0 - cloud.background) * cloud.normalised(),
            cloud.background * anywhere / anywhere.sum(),
        ])  # fmt: skip
        cloud.poses = np.concatenate([cloud.poses, poses])
        with np.errstate(divide="ignore"):
            cloud.log_w = np.log(w)
        cloud.weights, cloud.masses = None, None
        cloud.background = 0.0
        cloud.noticed += 1
        cloud.place.clear()
        self._resample(cloud)

    def _inject(
        self,
        cloud: Cloud,
        share: float,
        readings: NDArray[np.int32],
        weights: NDArray[np.float64],
    ) -> None:
        """Resample, and put poses drawn anew in the place of a share of the particles."""
        self._resample(cloud, always=True)
        n = int(share * len(cloud.poses))
        if self.config.injection == "scan":
            candidates = spread_poses(cloud.ground.terrain, max(20 * n, 1000), cloud.rng)
            log_p = np.zeros(len(candidates))
            self._weigh(cloud, candidates, readings, weights, log_p)
            if log_p.max() == -inf:  # Too few to find a pose that explains the scan.
                return
            p = np.exp(log_p - log_p.max())
            drawn = candidates[SCHEMES["systematic"](p, n, cloud.rng.random(1))]
        else:
            drawn = spread_poses(cloud.ground.terrain, n, cloud.rng)
        cloud.poses[cloud.rng.choice(len(cloud.poses), n, replace=False)] = drawn
        cloud.masses = None

    def _resample(self, cloud: Cloud, always: bool = False) -> None:
        """Draw the particles anew by their weights, as many as the belief needs.

        With an ``allocation`` a under one, a bin that holds mass m gets particles in proportion to
        m^a instead of m, and they keep weights in proportion to m^(1 - a): an unlikely place is
        followed by more of them than its share, so that its evidence is known better and the truth
        does not die out among like places. The belief is the same.
        """
        n, a = len(cloud.poses), self.config.allocation
        weights, index = cloud.normalised(), np.empty(n, dtype=np.int32)
        cloud.masses = cloud.bin(index)
        held = np.flatnonzero(cloud.masses)
        factor = np.ones_like(cloud.masses)
        factor[held] = cloud.masses[held] ** (a - 1.0)
        wheel = np.empty(n)
        squares = kernels.wheel_of(weights, index, factor, wheel)
        if not always and wheel[-1] ** 2 >= self.config.ess_ratio * n * squares:
            return
        chosen = self._choose(cloud, wheel)
        out, ground, n = np.empty((len(chosen), 3)), cloud.ground, len(chosen)
        kernels.roughen(
            ground.terrain.open, ground.frame, cloud.poses, chosen, normals(cloud.rng, n, 3),
            self.config.roughening_xy, self.config.roughening_theta, out,
        )  # fmt: skip
        weights = 1.0 / factor[index[chosen]]
        cloud.poses, cloud.weights = out, weights / weights.sum()
        cloud.log_w, cloud.log_total = np.log(cloud.weights), 0.0

    def _choose(self, cloud: Cloud, wheel: NDArray[np.float64]) -> NDArray[np.intp]:
        """Indices of the survivors, by cumulative weights."""
        config = self.config
        if config.sizing == "kld":
            bins = cloud.ground.kld_bins
            out = np.empty(config.n_max, dtype=np.intp)
            n = draw_until(
                wheel, bins.index(cloud.poses), cloud.rng.random(config.n_max),
                float(ndtri(config.kld_confidence)), config.kld_error, config.n_min,
                np.zeros(len(bins), dtype=np.bool_), out,
            )  # fmt: skip
            return out[:n]
        wanted = config.per_state * effective_states(cloud.binned(), config.allocation)
        n = int(np.clip(wanted, config.n_min, config.n_max))
        return SCHEMES[config.resampling](np.diff(wheel, prepend=0.0), n, cloud.rng.random(n))

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        ground, w = cloud.ground, cloud.background
        masses = cloud.binned()
        pose = ground.bins.centres(np.array([masses.argmax()]))[0]
        chosen = np.empty(len(cloud.poses), dtype=np.int32)
        n = kernels.within(cloud.poses, pose[0], pose[1], 3.0 * NEAR_RADIUS, chosen)
        moments = np.empty(4)
        for _ in range(3):
            self._moments(cloud, chosen[:n], pose, moments)
            if moments[0] == 0.0:
                break
            pose = pose + moments[1:] / moments[0]
            pose[2] = wrap(pose[2])
        self._moments(cloud, chosen[:n], pose, moments)
        if w > FAINT:
            masses = (1.0 - w) * masses + w * ground.uniform
        mass = min(1.0, (1.0 - w) * float(moments[0]))
        return Summary(entropy(masses), ground.uniform_entropy, pose, mass)

    def _moments(
        self,
        cloud: Cloud,
        chosen: NDArray[np.int32],
        pose: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        kernels.local_moments(
            cloud.poses, cloud.normalised(), chosen, pose, NEAR_RADIUS, NEAR_ANGLE, out
        )

    def mass_near(self, robot: int, pose: NDArray[np.float64]) -> float:
        """See :class:`Belief`; the background, spread over the whole map, is not counted."""
        cloud, moments = self._cloud(robot), np.empty(4)
        everyone = np.arange(len(cloud.poses), dtype=np.int32)
        self._moments(cloud, everyone, np.asarray(pose, dtype=np.float64), moments)
        return min(1.0, (1.0 - cloud.background) * float(moments[0]))

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        left, bottom, pixel = view_frame(cloud.ground.grid, rows, cols)
        corner, shape = np.array([left, bottom, 1.0 / pixel]), (rows, cols, headings)
        out, unused = np.zeros(rows * cols * headings), np.empty(0, dtype=np.int32)
        kernels.bin_weights(cloud.poses, cloud.normalised(), corner, shape, out, unused)
        w, probes = cloud.background, cloud.ground.probes
        if w > FAINT:
            anywhere, even = np.zeros_like(out), np.full(len(probes), 1.0 / len(probes))
            kernels.bin_weights(probes, even, corner, shape, anywhere, unused)
            out = (1.0 - w) * out + w * anywhere
        return np.ascontiguousarray(out.reshape(rows * cols, headings).T).reshape(
            headings, rows, cols
        )

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic."""
        cloud = self._cloud(robot)
        chosen = SCHEMES["systematic"](cloud.normalised(), n, rng.random(1))
        poses = cloud.poses[rng.permutation(chosen)]
        elsewhere = round(cloud.background * n) if cloud.background > FAINT else 0
        if elsewhere:
            poses[:elsewhere] = spread_poses(cloud.ground.terrain, elsewhere, rng)
        return poses

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See :class:`Belief`."""
        return self._rows(self._cloud(robot), poses)

    def _rows(
        self, cloud: Cloud, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        rays = rays_of(poses, self.sensor.bearings)
        if self._law is not None and isinstance(self.sensor, ExpectedRangeSensor):
            if cloud.table is not None:
                return cloud.table.levels(poses, self.sensor.bearings), self._law
            expected = self.sensor.expected(cloud.ground.grid, rays)
            return levels_of(expected, self.sensor.z_max), self._law
        p = self.sensor.bin_probabilities(cloud.ground.grid, rays, self.reading_bins)
        rows = np.arange(p.shape[0] * p.shape[1], dtype=np.int32).reshape(p.shape[:2])
        return rows, self._powered(p.reshape(-1, p.shape[-1]))

    def thinned(self, robot: int, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        index, count = np.empty(n, np.int64), np.empty(n, np.int64)
        m = thin_weights(cloud.normalised(), index, count)
        return cloud.poses[index[:m]], count[:m]
