"""The likelihood field looked up against the field itself, and weights by it."""

from math import inf, pi

import numpy as np
import pytest

from activeloc.beliefs.field_weighing import TILES, FieldWeigher, by_place
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.sensors import LikelihoodField, ReadingBins
from activeloc.sensors.field_table import BIAS, STEP, FieldTable
from activeloc.sensors.readings import rays_of

OFFICE = MapSource.parse("office(rooms=3,corridors=1)").number(1)


def clutter(seed, height=23, width=31):
    """A random map that is not square, with unknown cells, off the origin."""
    cells = np.random.default_rng(seed).choice(3, (height, width), p=[0.93, 0.05, 0.02])
    return OccupancyGrid(cells.astype(np.uint8), 0.1, (-0.35, 2.2))


def anywhere(grid, n, seed):
    """Poses over the map, its obstacles and a cell beyond."""
    x0, x1, y0, y1 = grid.extent
    low, high = [x0 - 0.1, y0 - 0.1, -pi], [x1 + 0.1, y1 + 0.1, np.nextafter(pi, 0.0)]
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


def on_open_ground(grid, n, seed):
    rng = np.random.default_rng(seed)
    cells = np.argwhere(grid.free)[:, ::-1]
    xy = grid.to_metres(cells[rng.integers(len(cells), size=n)] + rng.random((n, 2)))
    return np.column_stack([xy, rng.uniform(-pi, pi, n)])


def exact(sensor, grid, poses, readings):
    """``(N, B)``; log-probability of each reading's bin by the field itself."""
    bins = ReadingBins(sensor.z_max, sensor.reading_bin)
    p = sensor.bin_probabilities(grid, rays_of(poses, sensor.bearings), bins)
    index = np.broadcast_to(readings[None, :, None], (*p.shape[:2], 1))
    with np.errstate(divide="ignore"):
        return np.log(np.take_along_axis(p, index, axis=2)[..., 0])


def looked_up(sensor, grid, poses, readings, beam):
    """``(N,)``; what a scan of one beam adds."""
    weights, log_w = np.zeros(len(readings)), np.zeros(len(poses))
    weights[beam] = 1.0
    FieldWeigher(FieldTable(grid, sensor), 1.0).weigh(poses, readings, weights, log_w)
    return log_w


def at_the_table(table, poses):
    """The same poses in the middle of their blocks, so that every beam looks along a direction."""
    side, n = table.side, table.total.shape[1]
    cells = np.floor((poses[:, :2] - table.frame[:2]) * table.frame[2] / side)
    moved = poses.copy()
    moved[:, :2] = (cells + 0.5) * side / table.frame[2] + table.frame[:2]
    moved[:, 2] = np.floor(poses[:, 2] / (2.0 * pi / n)) * (2.0 * pi / n)
    moved[moved[:, 2] < -pi, 2] += 2.0 * pi
    return moved


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("z_max", [1.5, 4.0])
def test_where_the_table_was_summed_it_is_the_field_but_for_its_steps(seed, z_max):
    grid = clutter(seed)
    sensor = LikelihoodField(beams=1, z_max=z_max, sigma_hit=0.31, reading_bin=0.1)
    table, n_bins = FieldTable(grid, sensor), len(ReadingBins(z_max, 0.1))
    poses = at_the_table(table, anywhere(grid, 400, seed))
    # Not on the edge of a cell, where rounding decides in which one a reading ends.
    poses += [0.0013, 0.0017, 1e-4]
    for reading in range(n_bins):
        readings = np.array([reading], dtype=np.int32)
        error = (
            looked_up(sensor, grid, poses, readings, 0) - exact(sensor, grid, poses, readings)[:, 0]
        )
        assert np.quantile(np.abs(error), 0.9) < 1.1 * STEP
        assert np.median(np.abs(error)) < 0.5 * STEP


@pytest.mark.parametrize(
    ("sensor", "typical", "deviation"),
    [
        (LikelihoodField(beams=5, sigma_hit=0.2, reading_bin=0.1), 0.015, 0.2),
        (LikelihoodField(beams=5, z_max=12.0, sigma_hit=0.4, reading_bin=0.1), 0.02, 0.06),
    ],
)
def test_anywhere_the_error_of_a_logarithm_is_small(sensor, typical, deviation):
    """What the module says of itself, on open ground of an office."""
    poses, rng = on_open_ground(OFFICE, 1_500, 0), np.random.default_rng(1)
    bins = ReadingBins(sensor.z_max, sensor.reading_bin)
    z = sensor.read(OFFICE, rays_of(poses[:1], sensor.bearings), rng.random((1, 5, 2)))[0]
    readings = bins.index(z)
    expected = exact(sensor, OFFICE, poses, readings)
    for beam in range(5):
        error = looked_up(sensor, OFFICE, poses, readings, beam) - expected[:, beam]
        assert np.median(np.abs(error)) < typical
        assert error.std() < deviation < 0.15 * expected[:, beam].std()
        assert abs(error.mean()) < 0.01


def test_the_probabilities_of_all_readings_sum_to_one():
    sensor = LikelihoodField(beams=1, sigma_hit=0.2, reading_bin=0.1)
    poses, total = on_open_ground(OFFICE, 800, 2), np.zeros(800)
    for reading in range(len(ReadingBins(sensor.z_max, 0.1))):
        total += np.exp(looked_up(sensor, OFFICE, poses, np.array([reading], dtype=np.int32), 0))
    assert np.median(np.abs(total - 1.0)) < 0.05
    assert np.quantile(np.abs(total - 1.0), 0.9) < 0.3
    assert total.mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_a_scan_is_the_weighted_sum_over_its_beams(seed):
    grid, rng = clutter(seed), np.random.default_rng(seed)
    sensor = LikelihoodField(beams=7, field_of_view=2.0 * pi, sigma_hit=0.2, reading_bin=0.1)
    poses, before = anywhere(grid, 500, seed), rng.normal(size=500)
    readings = np.array([3, 15, -1, 0, 14, 15, 8], dtype=np.int32)
    weights = np.array([1.0, 0.5, 1.0, 0.0, 0.25, 1.0, 1.0])
    log_w, expected = before.copy(), before.copy()
    weigher = FieldWeigher(FieldTable(grid, sensor), 0.6)
    weigher.weigh(poses, readings, weights, log_w)
    for beam in (0, 1, 4, 5, 6):
        expected += 0.6 * weights[beam] * looked_up(sensor, grid, poses, readings, beam)
    np.testing.assert_allclose(log_w, expected, atol=1e-4)
    again = before.copy()
    weigher.weigh(poses, readings, weights, again)
    np.testing.assert_array_equal(again, log_w)


def test_what_a_pose_weighs_does_not_depend_on_the_others():
    """To the bit: alone, in a cloud, in another order, from a table that is warm or cold."""
    grid, sensor = clutter(3), LikelihoodField(5, 2.0, 1.2, sigma_hit=0.1)
    table = FieldTable(grid, sensor)
    readings, weights = np.array([3, -1, 7, len(table.reach), 0], np.int32), np.ones(5)
    poses, order = anywhere(grid, 300, 4), np.random.default_rng(5).permutation(300)
    together, shuffled, alone = np.zeros(300), np.zeros(300), np.zeros(300)
    weigher = FieldWeigher(table, 0.7)
    weigher.weigh(poses, readings, weights, together)
    weigher.weigh(poses[order], readings, weights, shuffled)
    for i in range(300):
        one = slice(i, i + 1)
        FieldWeigher(table, 0.7).weigh(poses[one], readings, weights, alone[one])
    np.testing.assert_array_equal(shuffled, together[order])
    np.testing.assert_array_equal(alone, together)
    assert len(np.unique(together)) > 100


@pytest.mark.parametrize("seed", range(5))
def test_every_pose_is_visited_once_neighbours_after_each_other(seed):
    rng = np.random.default_rng(seed)
    index = np.arange(40 * 30, dtype=np.int32).reshape(40, 30)
    poses = rng.uniform(-1.0, [31.0, 41.0, 1.0], (500, 3))
    rows, order = by_place(index, np.array([0.0, 0.0, 1.0]), poses)
    assert sorted(order) == list(range(500))
    x, y = np.floor(poses[:, :2]).astype(int).T
    inside = (x >= 0) & (x < 30) & (y >= 0) & (y < 40)
    np.testing.assert_array_equal(rows, np.where(inside, y * 30 + x, -1))
    drawer = np.where(inside, y % TILES * TILES + x % TILES, 0)[order]
    assert (np.diff(drawer) >= 0).all()


def test_nothing_near_the_ray_is_a_missed_echo():
    grid = OccupancyGrid(np.zeros((200, 300), dtype=np.uint8), 0.1)
    sensor = LikelihoodField(beams=1, sigma_hit=0.1, reading_bin=0.1)
    poses = np.array([[15.0, 10.0, 1.0]])
    for reading, p in ((15, 0.95), (0, 0.05 / 15), (7, 0.05 / 15)):
        got = looked_up(sensor, grid, poses, np.array([reading], dtype=np.int32), 0)
        assert got[0] == pytest.approx(np.log(p), rel=1e-6)


def test_only_what_is_asked_for_is_summed():
    sensor = LikelihoodField(beams=1, sigma_hit=0.2)
    table, log_w = FieldTable(clutter(0), sensor), np.zeros(4)
    weigher = FieldWeigher(table, 1.0)
    pose = np.array([*table.frame[:2] + 1.05, 0.3])
    weigher.weigh(np.tile(pose, (4, 1)), np.array([3], dtype=np.int32), np.ones(1), log_w)
    assert np.count_nonzero(table.total) == 1
    assert abs(int(table.total[table.total > 0][0]) - BIAS) < 2_000


def test_a_filter_by_the_table_believes_what_one_by_the_field_does():
    """The same particles, one scan: the posteriors agree, and no scan changes nothing."""
    sensor = LikelihoodField(beams=5, sigma_hit=0.1)
    given = {
        "n_start": 4_000,
        "n_min": 4_000,
        "n_max": 4_000,
        "recovery": "none",
        "ess_ratio": 1e-9,
        "repetition": inf,
    }
    poses, weights = on_open_ground(OFFICE, 4_000, 5), []
    scan = None
    for directions in (0, 128):
        config = ParticleConfig(directions=directions, **given)
        belief = ParticleBelief(1, config, sensor, MotionModel())
        belief.reset(0, OFFICE, np.random.default_rng(0), poses)
        if scan is None:
            uniforms = np.random.default_rng(2).random((5, 2))
            scan = sensor.read(OFFICE, rays_of(poses[7], sensor.bearings), uniforms)
        assert belief.correct(0, np.full(5, np.nan)) == 0.0
        belief.correct(0, scan)
        weights.append(belief.particles(0)[1])
    assert 0.5 * np.abs(weights[0] - weights[1]).sum() < 0.1
