"""One step of Monte Carlo localization: particles are moved and weighed.

Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), tables 8.2 and 8.3; how they are drawn anew
is in :mod:`activeloc.beliefs.redrawing`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import hypot, inf, log

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.cloud import Cloud, spread_poses
from activeloc.beliefs.field_weighing import FieldWeigher, field_weigher
from activeloc.beliefs.particle_motion import NORMALS, drive, every, noise, slip, touch, turn
from activeloc.beliefs.particle_past import Counted
from activeloc.beliefs.particle_weighing import weigh_by_rays, weigh_by_rows, weigh_by_table
from activeloc.beliefs.redrawing import resample
from activeloc.beliefs.resampling import comb
from activeloc.beliefs.settings import ParticleConfig
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel
from activeloc.range_levels import level_ranges, levels_of
from activeloc.range_table import RangeTable, range_table
from activeloc.sensors import LikelihoodField, RangeSensor, ReadingBins
from activeloc.sensors.readings import ExpectedRangeSensor, rays_of, widened


def drawn_by(log_p: NDArray[np.float64], n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices ``(n,)``, drawn systematically in proportion to exp of ``log_p (N,)``."""
    return comb(np.exp(log_p - log_p.max()).cumsum(), n, rng.random())


class MonteCarlo:
    """The models of a particle filter, and what they do to a cloud.

    Args:
        config: Settings.
        sensor: The sensor that the filter assumes, before it is widened.
        motion: The motion model that the filter assumes.
    """

    def __init__(self, config: ParticleConfig, sensor: RangeSensor, motion: MotionModel) -> None:
        self.config = config
        self.sensor = widened(sensor, config.sigma_factor)
        self.motion = motion
        self.reading_bins = ReadingBins(sensor.z_max, config.reading_bin)
        if isinstance(self.sensor, LikelihoodField):
            # The field resolved to the bins that readings are sorted into, and they to it.
            width = max(self.sensor.reading_bin, config.reading_bin)
            self.sensor = replace(self.sensor, reading_bin=width)
            self.reading_bins = ReadingBins(sensor.z_max, width)

    @property
    def leak(self) -> float:
        """Probability per step that the robot is carried off, as far as it is reckoned with."""
        return self.config.leak if self.config.recovery == "background" else 0.0

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

    @cached_property
    def is_thin(self) -> bool:
        """Whether a reading depends on one ray."""
        return isinstance(self.sensor, ExpectedRangeSensor) and not np.any(self.sensor.cone)

    def table(self, grid: OccupancyGrid) -> RangeTable | FieldWeigher | None:
        """What the sensor is looked up in on a map; None where it is asked."""
        if not self.config.directions:
            return None
        if isinstance(self.sensor, LikelihoodField):
            return field_weigher(grid, self.sensor, self.config.likelihood_power)
        if self.is_thin:
            return range_table(grid, self.sensor.z_max, self.config.directions)
        return None

    def move(self, cloud: Cloud, u: NDArray[np.float64], contact: bool) -> None:
        """Move every particle by the odometry's reading, with its noise.

        Args:
            cloud: The particles; their weights change where the map contradicts the odometry.
            u: ``(3,)`` odometry reading: rotation [rad], translation [m], rotation [rad].
            contact: Whether the robot has felt an obstacle, and it is news.
        """
        sigma, ground = self.motion.odometry.sigma(u), cloud.ground
        n, rng, cloud.masses = len(cloud.poses), cloud.rng, None
        slipping = every(self.config.slip, n, rng.random())
        before, weighed = cloud.poses[slipping], cloud.log_w[slipping]
        if u[1] == 0.0 and sigma[1] == 0.0:
            angle, spread = float(u[0] + u[2]), hypot(sigma[0], sigma[2])
            turn(cloud.poses, angle, spread, noise(rng, n), NORMALS)
        else:
            # A tenth of the way, or five centimetres, may be missing: the odometry is noisy too.
            slack = max(0.05, 0.1 * abs(float(u[1])))
            drive(
                ground.terrain.squares, ground.frame, cloud.poses, u, sigma, noise(rng, n, 3),
                NORMALS, cloud.log_w, slack, log(self.config.odometry_floor),
            )  # fmt: skip
            cloud.weights = None
        if len(slipping):
            # They drove another way than the one that may have been cut short.
            slip(
                ground.terrain.squares, ground.frame, before, weighed, slipping, u,
                rng.random((len(slipping), 2)), cloud.poses, cloud.log_w,
            )  # fmt: skip
        if contact and self.config.contact_floor < 1.0:
            touch(
                ground.terrain.squares, ground.frame, cloud.poses, self.config.contact_reach,
                cloud.log_w, log(self.config.contact_floor),
            )  # fmt: skip
            cloud.weights = None

    def weigh(
        self, cloud: Cloud, poses: NDArray[np.float64], scan: Counted, log_w: NDArray[np.float64]
    ) -> None:
        """Add the scan's weighted log-likelihood at each pose to ``log_w (N,)``, in place."""
        counts = (scan.readings >= 0) & (scan.weights > 0.0)
        if not counts.any():
            return
        table, law = cloud.table, self._law
        if isinstance(table, FieldWeigher):
            table.weigh(poses, scan.readings, scan.weights, log_w)
            return
        if law is None or not self.is_thin:
            rows, log_p = self.rows(cloud, poses)
            weigh_by_rows(log_w, rows, log_p, scan.readings, scan.weights)
            return
        read = (law[scan.readings[counts]] * scan.weights[counts, None]).astype(np.float32)
        bearings = self.sensor.bearings[counts]
        if table is None:
            grid = cloud.ground.grid
            z_max = self.sensor.z_max
            weigh_by_rays(grid.squares, grid.frame, z_max, poses, bearings, read, log_w)
            return
        table.expect(len(poses) * len(bearings))
        weigh_by_table(
            table.table, table.index, table.squares, table.headings, table.frame, table.reach,
            poses, bearings, read, log_w,
        )  # fmt: skip

    def rows(
        self, cloud: Cloud, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """At poses ``(N, 3)``: rows ``(N, B)`` of a table ``(Z, R)`` of powered log-likelihoods."""
        rays = rays_of(poses, self.sensor.bearings)
        if self._law is not None and isinstance(self.sensor, ExpectedRangeSensor):
            if isinstance(cloud.table, RangeTable):
                return cloud.table.levels(poses, self.sensor.bearings), self._law
            expected = self.sensor.expected(cloud.ground.grid, rays)
            return levels_of(expected, self.sensor.z_max), self._law
        p = self.sensor.bin_probabilities(cloud.ground.grid, rays, self.reading_bins)
        rows = np.arange(p.shape[0] * p.shape[1], dtype=np.int32).reshape(p.shape[:2])
        return rows, self._powered(p.reshape(-1, p.shape[-1]))

    def inject(self, cloud: Cloud, share: float, scan: Counted) -> None:
        """Resample, and put poses drawn anew in the place of a share of the particles."""
        resample(self.config, cloud, always=True)
        n = int(share * len(cloud.poses))
        if self.config.injection == "scan":
            candidates = spread_poses(cloud.ground.terrain, max(20 * n, 1000), cloud.rng)
            log_p = np.zeros(len(candidates))
            self.weigh(cloud, candidates, scan, log_p)
            if log_p.max() == -inf:  # Too few to find a pose that explains the scan.
                return
            drawn = candidates[drawn_by(log_p, n, cloud.rng)]
        else:
            drawn = spread_poses(cloud.ground.terrain, n, cloud.rng)
        cloud.poses[cloud.rng.choice(len(cloud.poses), n, replace=False)] = drawn
        cloud.masses = None
