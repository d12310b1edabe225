"""The likelihood field: rows that are distributions, readings that follow them, a value by hand."""

from math import exp, pi

import numpy as np
import pytest
from scipy.stats import chisquare

from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps.text import from_text
from activeloc.sensors import LikelihoodField, ReadingBins

ROOM = """\
##########
#........#
#...##...#
#........#
#......###
##########
"""


def rays_in(grid, n, seed=0):
    x0, x1, y0, y1 = grid.extent
    return np.random.default_rng(seed).uniform([x0, y0, -pi], [x1, y1, pi], (n, 3))


@pytest.mark.parametrize("width", [0.05, 0.13, 0.4])
@pytest.mark.parametrize("z_max", [0.4, 1.5, 30.0])
def test_rows_sum_to_one(z_max, width):
    grid = from_text(ROOM, 0.25, (1.0, -2.0))
    bins = ReadingBins(z_max, width)
    sensor = LikelihoodField(z_max=z_max)
    p = sensor.bin_probabilities(grid, rays_in(grid, 300).reshape(30, 10, 3), bins)
    assert p.shape == (30, 10, len(bins))
    assert (p >= 0.0).all()
    np.testing.assert_allclose(p.sum(axis=-1), 1.0, atol=1e-12)


def test_a_value_by_hand():
    """A wall three cells ahead of the ray, four bins of one cell: d = 3, 2, 1 and 0 cells."""
    cells = np.ones((9, 11), dtype=np.uint8)
    cells[1:-1, 1:-1] = 0
    cells[4, 7] = 1
    grid = OccupancyGrid(cells, 1.0)
    sensor = LikelihoodField(
        z_max=4.0, sigma_hit=1.0, w_hit=0.7, w_max=0.1, w_rand=0.2, reading_bin=1.0
    )
    p = sensor.bin_probabilities(grid, np.array([[4.0, 4.5, 0.0]]), ReadingBins(4.0, 1.0))[0]
    # Bin centres .5, 1.5, 2.5 and 3.5 ahead lie in columns 4, 5, 6 and 7.
    near = np.array([exp(-9 / 2), exp(-4 / 2), exp(-1 / 2), 1.0])
    np.testing.assert_allclose(p[:4], 0.7 * near / near.sum() + 0.2 / 4, rtol=1e-12)
    assert p[4] == pytest.approx(0.1)


def test_nothing_near_the_ray_is_a_missed_echo():
    grid = OccupancyGrid(np.zeros((200, 300), dtype=np.uint8), 0.1)
    sensor = LikelihoodField()
    p = sensor.bin_probabilities(grid, np.array([[15.0, 10.0, 1.0]]), ReadingBins(1.5, 0.1))[0]
    assert p[-1] == pytest.approx(0.95)
    np.testing.assert_allclose(p[:-1], 0.05 / 15)


def test_the_outside_of_the_map_is_an_obstacle():
    grid = OccupancyGrid(np.zeros((20, 30), dtype=np.uint8), 0.1)
    near = LikelihoodField().near(grid)
    assert near[10, 0] == pytest.approx(exp(-0.5))
    assert near[0, 12] == near[-1, 12] == near[10, -1] == pytest.approx(exp(-0.5))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("width", [0.05, 0.1, 0.07, 0.5])
def test_readings_follow_the_probabilities_in_any_bins(seed, width):
    """A filter with bins of its own must assume the density that the simulator draws from."""
    grid, n = from_text(ROOM, 0.25, (1.0, -2.0)), 100_000
    sensor = LikelihoodField(w_hit=0.8, w_max=0.05, w_rand=0.15)
    bins = ReadingBins(sensor.z_max, width)
    ray = rays_in(grid, 1, seed)
    uniforms = np.random.default_rng(seed).random((n, 2))
    z = sensor.read(grid, np.repeat(ray, n, axis=0), uniforms)
    assert ((z >= 0.0) & (z <= sensor.z_max)).all()
    counts = np.bincount(bins.index(z), minlength=len(bins))
    assert chisquare(counts, n * sensor.bin_probabilities(grid, ray, bins)[0]).pvalue > 1e-6


def test_refuses_weights_that_are_no_mixture():
    with pytest.raises(ConfigError, match=r"w_hit \+ w_max \+ w_rand must be 1, got 1\.2"):
        LikelihoodField(w_rand=0.25)
