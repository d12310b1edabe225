"""The table of reading probabilities against brute force over the same rays."""

from math import pi, radians

import numpy as np
import pytest

from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.profiles import LEVELS
from activeloc.beliefs.reading_table import ANGLES, PER_BIN, build_reading_table, directions
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.sensors import BeamModel, LikelihoodField, ReadingBins
from activeloc.sensors.readings import spread_bearings


def building():
    cells = np.zeros((70, 96), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[30:33, :50] = 1
    cells[33:55, 60:64] = 1
    cells[np.arange(20) + 40, np.arange(20) + 10] = 1
    cells[10:18, 70:75] = 2
    return OccupancyGrid(cells, 0.05, (-0.7, 1.9))


def poses_of(grid, cell_size=0.2, headings=24, radius=0.2):
    return PoseGrid(Terrain(grid, radius), cell_size, headings)


def rays_of_state(poses, c, angle):
    """Every ray that a cell's average is taken over: open sub-poses by angles across a bin."""
    subs = poses.sub_poses()[c][poses.is_open[c]]
    across = ((np.arange(ANGLES) + 0.5) / ANGLES - 0.5) * poses.bin_width
    return np.array([[x, y, angle + turn] for x, y in subs for turn in across])


def total_variation(p, q):
    return 0.5 * np.abs(p - q).sum(axis=-1)


@pytest.mark.parametrize("sensor", [BeamModel(beams=7, field_of_view=pi), LikelihoodField()])
def test_rows_are_distributions(sensor):
    table = build_reading_table(poses_of(building(), 0.4, 12), sensor, 0.1)
    p = np.exp(table.log_p.astype(np.float64))
    np.testing.assert_allclose(p.sum(axis=0), 1.0, atol=2e-6)
    assert table.row.min() >= 0
    assert table.row.max() < p.shape[1]
    assert len(p) == len(table.bins)


@pytest.mark.parametrize("reading_bin", [0.1, 0.05])
@pytest.mark.parametrize("headings", [24, 18])
def test_rows_are_the_average_over_the_rays(headings, reading_bin):
    """Exact but for rounding shares to 1/LEVELS and ranges to half a bin: both are bounded."""
    poses, sensor = poses_of(building(), headings=headings), BeamModel()
    table = build_reading_table(poses, sensor, reading_bin)
    bins, rng = table.bins, np.random.default_rng(0)
    half = bins.edges[1] / PER_BIN
    worst, worst_rounded = [], []
    for _ in range(300):
        c, d = int(rng.integers(len(poses.cells))), int(rng.integers(table.row.shape[1]))
        angle = poses.thetas[0] + d * poses.bin_width / table.per_heading
        z = sensor.expected(poses.terrain.grid, rays_of_state(poses, c, angle))
        told = np.exp(table.log_p[:, table.row[c, d]].astype(np.float64))
        worst.append(total_variation(told, sensor.masses(z, bins).mean(axis=0)))
        middle = np.where(z >= sensor.z_max, sensor.z_max, (np.floor(z / half) + 0.5) * half)
        rounded = total_variation(told, sensor.masses(middle, bins).mean(axis=0))
        # The largest remainder moves less than one level for each range but one.
        worst_rounded.append(rounded - 0.5 * (len(np.unique(middle)) - 1) / LEVELS)
    assert max(worst_rounded) <= 1e-6
    # A Gaussian moved by a quarter bin overlaps itself but for .4 quarter bins per sigma.
    assert max(worst) <= 0.25 * reading_bin / sensor.sigma_hit * 0.4 + 0.05
    assert np.mean(worst) <= 0.03


def test_rows_of_any_sensor_are_the_exact_average():
    poses, sensor = poses_of(building(), 0.4, 12), LikelihoodField()
    table = build_reading_table(poses, sensor, 0.1)
    rng = np.random.default_rng(0)
    for _ in range(50):
        c, d = int(rng.integers(len(poses.cells))), int(rng.integers(table.row.shape[1]))
        angle = poses.thetas[0] + d * poses.bin_width / table.per_heading
        rays = rays_of_state(poses, c, angle)
        expected = sensor.bin_probabilities(poses.terrain.grid, rays, table.bins).mean(axis=0)
        told = np.exp(table.log_p[:, table.row[c, d]].astype(np.float64))
        np.testing.assert_allclose(told, expected, atol=1e-6)


@pytest.mark.parametrize("headings", [24, 20, 18, 4])
@pytest.mark.parametrize("origin", [(0.0, 0.0), (-13.37, 5.01)])
def test_like_rooms_have_the_very_same_rows(headings, origin):
    """Four equal rooms along a corridor; the middle two see the same within range."""
    room = np.ones((52, 40), dtype=np.uint8)
    room[24:50, 2:38] = 0
    room[4:20, :] = 0
    room[20:24, 12:22] = 0
    room[30:34, 25:31] = 1
    grid = OccupancyGrid(np.concatenate([room] * 4, axis=1), 0.05, origin)
    poses = poses_of(grid, 0.2, headings, 0.15)
    table = build_reading_table(poses, BeamModel(beams=5, field_of_view=2.0, z_max=1.5), 0.1)
    width = 40 * 0.05 / 0.2
    assert width == int(width)
    first = poses.cells[(poses.cells[:, 1] >= width) & (poses.cells[:, 1] < 2 * width)]
    second = poses.index[first[:, 0], first[:, 1] + int(width)]
    first = poses.index[first[:, 0], first[:, 1]]
    assert len(first) > 50
    np.testing.assert_array_equal(poses.is_open[first], poses.is_open[second])
    np.testing.assert_array_equal(table.row[first], table.row[second])


@pytest.mark.parametrize("beams", [(7, 180), (16, 270), (5, 120), (3, 60), (1, 0), (8, 360)])
@pytest.mark.parametrize("headings", [72, 36, 20, 12, 4])
def test_beams_look_where_they_point(beams, headings):
    bearings = spread_bearings(beams[0], radians(beams[1]))
    width = 2 * pi / headings
    per_heading, offsets = directions(bearings, width)
    assert per_heading in (1, 2, 4)
    error = np.abs(offsets * width / per_heading - bearings)
    assert error.max() <= width / 8 + 1e-12


def test_forecast_direction_of_a_beam_is_its_own():
    """The row of a beam is the average around heading plus bearing, to an eighth of a bin."""
    sensor = BeamModel(beams=5, field_of_view=radians(120))
    poses = poses_of(building(), 0.4, 20)
    table = build_reading_table(poses, sensor, 0.1)
    bins = ReadingBins(sensor.z_max, 0.1)
    rng, errors = np.random.default_rng(3), []
    for _ in range(100):
        c, k, b = rng.integers(len(poses.cells)), rng.integers(20), rng.integers(5)
        d = (k * table.per_heading + table.offsets[b]) % table.row.shape[1]
        rays = rays_of_state(poses, c, poses.thetas[k] + sensor.bearings[b])
        expected = sensor.bin_probabilities(poses.terrain.grid, rays, bins).mean(axis=0)
        errors.append(total_variation(np.exp(table.log_p[:, table.row[c, d]]), expected))
    assert np.mean(errors) < 0.06
    assert max(errors) < 0.4


def test_cut_cells_count_only_their_open_ground():
    grid = building()
    poses = poses_of(grid)
    cut = np.flatnonzero((poses.area > 0.2) & (poses.area < 0.8))
    assert len(cut) > 10
    assert all(len(rays_of_state(poses, c, 0.0)) < ANGLES * 16 for c in cut)
