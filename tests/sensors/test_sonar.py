"""Cones: the nearest echo wins, pose by pose, wherever a sonar is used."""

from math import pi, radians

import numpy as np
import pytest

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.profiles import LEVELS
from activeloc.beliefs.reading_table import ANGLES, PER_BIN, build_reading_table
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain
from activeloc.raycast import cast_scan
from activeloc.sensors import ProximityModel, ReadingBins, Sonar
from activeloc.sensors.readings import rays_of


def building():
    cells = np.zeros((50, 66), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[30:33, :40] = 1
    cells[33:45, 50:53] = 1
    cells[np.arange(8) + 10, np.arange(8) + 30] = 1
    cells[8:12, 20] = 2
    return OccupancyGrid(cells, 0.05, (-0.7, 1.9))


def posts():
    """A hall with one post, off the axis of a robot at (1, 1) that looks along x."""
    cells = np.zeros((40, 80), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[22, 30] = 1
    return OccupancyGrid(cells, 0.05)


POST = np.array([1.0, 1.0, 0.0])
TO_POST = float(np.hypot(0.5, 0.125))
SONAR = Sonar(beams=1, field_of_view=0.0, opening=radians(30), cone_rays=31)


def test_the_nearest_ray_of_the_cone_wins():
    grid, rng = building(), np.random.default_rng(0)
    x0, x1, y0, y1 = grid.extent
    rays = rng.uniform([x0, y0, -pi], [x1, y1, pi], (4, 50, 3))
    sensor = Sonar(opening=radians(20), cone_rays=3)
    one_by_one = [
        cast_scan(grid, rays, np.array([turn]), sensor.z_max)[..., 0]
        for turn in radians(20) * np.array([-0.5, 0.0, 0.5])
    ]
    np.testing.assert_array_equal(sensor.expected(grid, rays), np.min(one_by_one, axis=0))
    assert (np.ptp(one_by_one, axis=0) > 0.05).mean() > 0.1


def test_a_cone_hears_a_post_beside_its_axis():
    assert ProximityModel().expected(posts(), POST) == pytest.approx(1.5)
    assert SONAR.expected(posts(), POST) == pytest.approx(TO_POST, abs=0.03)
    narrow = Sonar(opening=radians(10), cone_rays=11)
    assert narrow.expected(posts(), POST) == pytest.approx(1.5)


def test_a_cone_of_nothing_is_a_beam():
    sensor = Sonar(opening=0.0, cone_rays=1)
    rays = np.random.default_rng(1).uniform([0.5, 2.5, -pi], [2.0, 4.0, pi], (40, 3))
    thin = ProximityModel.sonar()
    np.testing.assert_array_equal(
        sensor.expected(building(), rays), thin.expected(building(), rays)
    )
    np.testing.assert_array_equal(sensor.masses(0.7, ReadingBins(1.5, 0.1)),
                                  thin.masses(0.7, ReadingBins(1.5, 0.1)))  # fmt: skip


def test_rows_of_a_grid_average_the_nearest_of_each_pose():
    """Not the nearest of the averages: half of a cell may hear the post."""
    poses = PoseGrid(Terrain(building(), 0.2), 0.2, 24)
    sensor = Sonar(opening=radians(30), cone_rays=5)
    table = build_reading_table(poses, sensor, 0.1)
    bins, rng = table.bins, np.random.default_rng(0)
    half, across = bins.edges[1] / PER_BIN, (np.arange(ANGLES) + 0.5) / ANGLES - 0.5
    mixed = 0
    for _ in range(200):
        c, d = int(rng.integers(len(poses.cells))), int(rng.integers(table.row.shape[1]))
        angles = poses.thetas[0] + (d / table.per_heading + across) * poses.bin_width
        subs = poses.sub_poses()[c][poses.is_open[c]]
        rays = np.array([[x, y, angle] for x, y in subs for angle in angles])
        single = cast_scan(poses.terrain.grid, rays, sensor.cone, sensor.z_max)
        z = single.min(axis=-1)
        mixed += z.mean() < single.mean(axis=0).min() - 0.02
        classes = np.floor(z / half + 1e-9)
        middle = np.where(z >= sensor.z_max, sensor.z_max, (classes + 0.5) * half)
        told = np.exp(table.log_p[:, table.row[c, d]].astype(np.float64))
        error = 0.5 * np.abs(told - sensor.masses(middle, bins).mean(axis=0)).sum()
        assert error <= 0.5 * (len(np.unique(middle)) - 1) / LEVELS + 1e-6
    assert mixed > 20


def told_by(belief, pose):
    """P(reading in bin) that a belief forecasts for its one beam, its power undone."""
    rows, log_p = belief.forecast(0, pose[None])
    p = np.exp(log_p[:, rows[0, 0]].astype(np.float64) / belief.config.likelihood_power)
    return p / p.sum()


def test_both_filters_expect_the_post():
    """A thin beam would expect nothing in range."""
    motion = MotionModel(radius=0.1)
    grid_belief = HistogramBelief(1, HistogramConfig(likelihood_power=1.0), SONAR, motion)
    grid_belief.reset(0, posts())
    cloud = ParticleBelief(1, ParticleConfig(n_min=10, n_max=50), SONAR, motion)
    cloud.reset(0, posts(), np.random.default_rng(0))
    for belief, tolerance in ((grid_belief, 0.25), (cloud, 0.1)):
        p = told_by(belief, POST)
        wide = belief.sensor
        exact = wide.bin_probabilities(posts(), POST, ReadingBins(1.5, 0.1))
        thin = ProximityModel.sonar().masses(1.5, ReadingBins(1.5, 0.1))
        assert 0.5 * np.abs(p - exact).sum() < tolerance
        assert 0.5 * np.abs(p - thin).sum() > 0.5


def test_a_sonar_reads_the_cone():
    sure = Sonar(beams=1, field_of_view=0.0, opening=radians(30), cone_rays=31,
                 sigma_hit=1e-6, p_known=1.0, p_unknown=0.0)  # fmt: skip
    rays = rays_of(np.tile(POST, (500, 1)), sure.bearings)
    z = sure.read(posts(), rays, np.random.default_rng(0).random((500, 1, 2)))
    assert ((z > TO_POST - 0.08) & (z < TO_POST + 0.08)).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"opening": -0.1}, r"Sonar\.opening must be a number in \[0, 3\.14"),
        ({"opening": np.nan}, r"Sonar\.opening must be .* got nan"),
        ({"cone_rays": 0}, r"Sonar\.cone_rays must be an integer in \[1, 64\]; got 0"),
        ({"cone_rays": 2.0}, r"Sonar\.cone_rays must be an integer"),
        ({"cone_rays": 1}, "one cone_ray cannot spread over an opening"),
        ({"p_known": 2.0}, r"Sonar\.p_known must be"),
    ],
)
def test_refuses_what_is_no_sonar(settings, message):
    with pytest.raises(ConfigError, match=message):
        Sonar(**settings)
