"""Monte Carlo localization: a belief made of weighted poses.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), section 8.3.

Among like rooms a few lucky particles decide, and a plain filter of some thousand particles with
the true likelihood is sure of the wrong room more often than not. The defaults are honest instead:
a widened and tempered likelihood, roughening, as many particles as the belief is wide, and others
for the chance that the robot is somewhere else (:mod:`activeloc.beliefs.carried_off`). Fewer
particles are faster and lie; the choice is the user's.
"""

from __future__ import annotations

from copy import copy
from math import exp, inf

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS, Summary
from activeloc.beliefs.carried_off import search, take_in
from activeloc.beliefs.cloud import Cloud, Ground, ground_of, spread_poses
from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.monte_carlo import MonteCarlo
from activeloc.beliefs.particle_bins import bin_weights
from activeloc.beliefs.particle_motion import NORMALS, turn
from activeloc.beliefs.particle_past import Counted
from activeloc.beliefs.particle_summary import localise, peak
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.recovery import RunningMeans
from activeloc.beliefs.resampling import SCHEMES
from activeloc.beliefs.settings import ParticleConfig
from activeloc.beliefs.thinning import thin_weights
from activeloc.beliefs.view import view_frame
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain, wrap
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import check_one_scan

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
        self.model = MonteCarlo(config, sensor, motion)
        self.sensor = self.model.sensor
        self.motion = motion
        self.reading_bins = self.model.reading_bins
        self._clouds: list[Cloud | None] = [None] * n_robots

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
        turn(poses, 0.0, 0.0, np.zeros(len(poses), dtype=np.uint16), NORMALS)  # Into [-pi, pi).
        place = PlaceMemory(self.config.sectors, self.config.place_size, self.config.repetition)
        self._clouds[robot] = Cloud(
            ground,
            self.model.table(grid),
            poses,
            np.full(len(poses), -np.log(len(poses))),
            place,
            rng,
            RunningMeans(self.config.alpha_slow, self.config.alpha_fast),
            len(poses),
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
        """Poses ``(N, 3)`` and weights ``(N,)`` summing to one: copies."""
        cloud = self._cloud(robot)
        return cloud.poses.copy(), cloud.normalised().copy()

    def n_particles(self, robot: int) -> int:
        """How many particles there are now."""
        return len(self._cloud(robot).poses)

    def elsewhere(self, robot: int) -> float:
        """Probability that the robot is not where it was: it has been carried off, or was lost."""
        return self._cloud(robot).elsewhere

    def noticed(self, robot: int) -> int:
        """How often the robot has been looked for everywhere since the reset."""
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
        cloud.place.move(u)
        contact = touched and cloud.place.refuse()
        self.model.move(cloud, u, contact)
        if self.model.leak > 0.0:
            cloud.past.moved(u, contact)

    def correct(self, robot: int, scan: NDArray[np.float64]) -> float:
        """Weigh every particle by the scan, and resample when few particles carry the weight.

        A scan without a reading, or without one that counts, leaves the belief as it was; so does
        one that no particle explains, unless a robot that has just been carried off might read it.

        Args:
            robot: Which one.
            scan: ``(B,)`` [m]; NaN is "no reading", +inf a maximum-range reading.

        Returns:
            The scan's log-evidence under the powered likelihood; -inf if it is impossible.

        Raises:
            ScanError: If the scan is not one of the sensor's.
        """
        cloud = self._cloud(robot)
        readings = self.reading_bins.index(check_one_scan(scan, self.sensor))
        valid = readings >= 0
        if not valid.any():
            return 0.0
        weights = cloud.place.weigh(self.sensor.bearings, valid)
        n = float(weights.sum())
        if n == 0.0:
            cloud.place.read(self.sensor.bearings, valid)
            return 0.0
        counted = Counted(readings, weights)
        log_w = cloud.log_w.copy()
        self.model.weigh(cloud, cloud.poses, counted, log_w)
        evidence, stayed = take_in(self.model, cloud, counted, log_w)
        if evidence == -inf:
            return -inf
        cloud.place.read(self.sensor.bearings, valid)
        # Scans of which more readings count are less likely, whatever the belief.
        share = cloud.means.add(exp(stayed / n))
        if self.config.recovery == "augmented" and share > 0.0:
            self.model.inject(cloud, share, counted)
        else:
            search(self.model, cloud)
        cloud.settle()
        return evidence

    def summarise(self, robot: int) -> Summary:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        best, entropy = peak(*cloud.binned())
        pose = cloud.ground.bins.centre(best)
        mass = localise(cloud.poses, cloud.normalised(), pose, NEAR_RADIUS, NEAR_ANGLE, 3)
        return Summary(entropy, cloud.ground.uniform_entropy, pose, min(1.0, mass))

    def mass_near(
        self,
        robot: int,
        pose: NDArray[np.float64],
        radius: float = NEAR_RADIUS,
        angle: float = NEAR_ANGLE,
    ) -> float:
        """See :class:`Belief`."""
        cloud, at = self._cloud(robot), np.array(pose, dtype=np.float64)
        mass = localise(cloud.poses, cloud.normalised(), at, radius, angle, 0)
        return min(1.0, mass)

    def view(self, robot: int, headings: int, rows: int, cols: int) -> NDArray[np.float64]:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        left, bottom, pixel = view_frame(cloud.ground.grid, rows, cols)
        corner, shape = np.array([left, bottom, 1.0 / pixel]), (rows, cols, headings)
        out = np.zeros(rows * cols * headings)
        bin_weights(cloud.poses, cloud.normalised(), corner, shape, out)
        return np.ascontiguousarray(out.reshape(rows * cols, headings).T).reshape(
            headings, rows, cols
        )

    def sample(self, robot: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """See :class:`Belief`; systematic."""
        cloud = self._cloud(robot)
        chosen = SCHEMES["systematic"](cloud.normalised(), n, rng.random(1))
        return cloud.poses[rng.permutation(chosen)]

    def forecast(
        self, robot: int, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See :class:`Belief`."""
        return self.model.rows(self._cloud(robot), poses)

    def thinned(self, robot: int, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """See :class:`Belief`."""
        cloud = self._cloud(robot)
        index, count = np.empty(n, np.int64), np.empty(n, np.int64)
        m = thin_weights(cloud.normalised(), index, count)
        return cloud.poses[index[:m]], count[:m]
