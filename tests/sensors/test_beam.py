"""The beam model against quadrature of its own density, and its sampler against the filter."""

from itertools import pairwise
from math import exp, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chisquare, kstest, norm, truncnorm

from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sensors import BeamModel, ReadingBins

Z_MAX = 5.0
EXPECTED = [0.0, 0.05, 3.0, Z_MAX - 0.1, Z_MAX]
MIXTURES = {
    "hit": (1.0, 0.0, 0.0, 0.0),
    "short": (0.0, 1.0, 0.0, 0.0),
    "max": (0.0, 0.0, 1.0, 0.0),
    "random": (0.0, 0.0, 0.0, 1.0),
    "mixed": (0.7, 0.15, 0.05, 0.1),
}


def model(mixture="mixed", **kwargs):
    w_hit, w_short, w_max, w_rand = MIXTURES[mixture]
    return BeamModel(
        z_max=Z_MAX, w_hit=w_hit, w_short=w_short, w_max=w_max, w_rand=w_rand, **kwargs
    )


def density(sensor, z, z_expected):
    return float(np.exp(sensor.log_likelihood(np.array(z), np.array(z_expected))))


def integral(sensor, z_expected, low=0.0, high=Z_MAX):
    """Quadrature of the density on [low, high), broken where it is not smooth."""
    sigma = sensor.sigma_hit
    points = [z_expected + s * sigma for s in (-8, -3, -1, 0, 1, 3, 8)]
    inside = [low, *sorted(z for z in points if low < z < high), high]
    # The last point itself is a point mass.
    return sum(
        quad(
            lambda z: density(sensor, min(z, np.nextafter(Z_MAX, 0.0)), z_expected),
            a,
            b,
            epsabs=1e-12,
            epsrel=1e-12,
        )[0]
        for a, b in pairwise(inside)
    )


@pytest.mark.parametrize("z_expected", EXPECTED)
@pytest.mark.parametrize("mixture", MIXTURES)
@pytest.mark.parametrize("sigma_hit", [0.1, 2.0])
def test_is_a_probability(mixture, z_expected, sigma_hit):
    sensor = model(mixture, sigma_hit=sigma_hit)
    assert integral(sensor, z_expected) + density(sensor, Z_MAX, z_expected) == pytest.approx(
        1.0, abs=1e-9
    )


@pytest.mark.parametrize("z_expected", EXPECTED)
@pytest.mark.parametrize("mixture", MIXTURES)
def test_masses_are_integrals_of_the_density(mixture, z_expected):
    sensor, bins = model(mixture), ReadingBins(Z_MAX, 0.3)
    masses = sensor.masses(np.array(z_expected), bins)
    assert masses.shape == (len(bins),)
    assert masses.sum() == pytest.approx(1.0, abs=1e-12)
    below = [integral(sensor, z_expected, a, b) for a, b in pairwise(bins.edges)]
    np.testing.assert_allclose(masses[:-1], below, atol=1e-9)
    assert masses[-1] == pytest.approx(density(sensor, Z_MAX, z_expected), abs=1e-12)


@pytest.mark.parametrize("z_expected", EXPECTED)
def test_likelihood_is_the_slope_of_the_distribution(z_expected):
    sensor = model()
    z = np.linspace(0.0, Z_MAX, 37)[1:-1] + 1e-3
    h = 1e-6
    slope = (sensor.cdf(z + h, z_expected) - sensor.cdf(z - h, z_expected)) / (2 * h)
    np.testing.assert_allclose(
        np.exp(sensor.log_likelihood(z, np.array(z_expected))), slope, rtol=1e-5
    )
    assert sensor.cdf(0.0, z_expected) == 0.0
    at_max = np.exp(sensor.log_likelihood(np.array(Z_MAX), np.array(z_expected)))
    assert sensor.cdf(Z_MAX, z_expected) + at_max == pytest.approx(1.0, abs=1e-12)


def test_a_value_by_hand():
    """z* = 3, z = 2.9: far from both ends, so the hit's normaliser is one."""
    sensor = model()
    hit = exp(-0.5) / (0.1 * sqrt(2 * pi))
    short = exp(-2.9) / (1 - exp(-3.0))
    expected = 0.7 * hit + 0.15 * short + 0.1 / 5.0
    assert density(sensor, 2.9, 3.0) == pytest.approx(expected, rel=1e-12)
    late = 0.7 * norm.pdf(3.1, 3.0, 0.1) + 0.1 / 5.0
    assert density(sensor, 3.1, 3.0) == pytest.approx(late, rel=1e-12)


def test_nothing_in_range_reads_the_maximum():
    assert density(model(), Z_MAX, Z_MAX) == pytest.approx(0.75, abs=1e-12)
    assert density(model(), Z_MAX, 99.0) == pytest.approx(0.75, abs=1e-12)
    assert density(model(), Z_MAX, Z_MAX - 1e-9) == pytest.approx(0.05, abs=1e-12)


@pytest.mark.parametrize("mixture", MIXTURES)
@pytest.mark.parametrize("z_expected", EXPECTED)
def test_samples_follow_the_filters_distribution(mixture, z_expected):
    """Chi-square over the filter's bins with the point mass as one of them."""
    sensor, bins, n = model(mixture), ReadingBins(Z_MAX, 0.1), 100_000
    uniforms = np.random.default_rng(7).random((n, 2))
    z = sensor.sample(np.full(n, z_expected), uniforms)
    assert ((z >= 0.0) & (z <= Z_MAX)).all()
    counts = np.bincount(bins.index(z), minlength=len(bins))
    expected = n * sensor.masses(np.array(z_expected), bins)
    rare = expected < 10.0
    assert counts[rare].sum() <= expected[rare].sum() + 5 * sqrt(expected[rare].sum()) + 5
    counts, expected = counts[~rare], expected[~rare]
    if len(counts) > 1:
        assert chisquare(counts, expected * counts.sum() / expected.sum()).pvalue > 1e-6


@pytest.mark.parametrize("z_expected", EXPECTED)
def test_samples_below_the_maximum_follow_the_cdf(z_expected):
    sensor, n = model(), 100_000
    z = sensor.sample(np.full(n, z_expected), np.random.default_rng(8).random((n, 2)))
    below, whole = z[z < Z_MAX], float(sensor.cdf(Z_MAX, z_expected))
    assert len(below) / n == pytest.approx(whole, abs=5 * sqrt(whole * (1 - whole) / n))
    assert kstest(below, lambda x: sensor.cdf(x, z_expected) / whole).pvalue > 1e-6


def test_narrow_sigma_stays_finite():
    sensor = model(sigma_hit=1e-6)
    z = np.linspace(0.0, Z_MAX, 101)
    for z_expected in EXPECTED:
        assert np.isfinite(sensor.log_likelihood(z, np.array(z_expected))).all()
        masses = sensor.masses(np.array(z_expected), ReadingBins(Z_MAX, 0.1))
        assert (masses >= 0.0).all()
        assert masses.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("z_max", [1.0, 1.5, 1.9, 3.3, 3.8, 6.6, 7.1])
@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.02, 0.03])
def test_beams_without_an_echo_expect_exactly_the_maximum(z_max, resolution):
    """A rounding under ``z_max`` would turn every missed echo into a hit."""
    sensor = BeamModel(beams=1, z_max=z_max)
    side = int(3 * z_max / resolution)
    hall = OccupancyGrid(np.zeros((side, side), dtype=np.uint8), resolution)
    middle = 0.5 * side * resolution
    rays = np.array([[middle, middle, theta] for theta in (0.0, 0.3, 2.0, -pi / 2)])
    np.testing.assert_array_equal(sensor.expected(hall, rays), z_max)


def test_readings_are_drawn_around_the_exact_range():
    cells = np.zeros((40, 60), dtype=np.uint8)
    cells[:, 50:] = 1
    grid = OccupancyGrid(cells, 0.1, (-1.0, 2.0))
    sensor = model("hit", sigma_hit=0.01)
    rays = np.tile([1.5, 4.0, 0.0], (20_000, 1))
    z = sensor.read(grid, rays, np.random.default_rng(0).random((20_000, 2)))
    assert z.mean() == pytest.approx(2.5, abs=5 * 0.01 / sqrt(20_000))
    assert z.std() == pytest.approx(0.01, rel=5 / sqrt(2 * 20_000))
    bins = ReadingBins(Z_MAX, 0.1)
    np.testing.assert_allclose(
        sensor.bin_probabilities(grid, rays[:1], bins)[0], sensor.masses(np.array(2.5), bins)
    )


def test_refuses_weights_that_are_no_mixture():
    with pytest.raises(
        ConfigError, match=r"w_hit \+ w_short \+ w_max \+ w_rand must be 1, got 1\.1"
    ):
        BeamModel(w_hit=1.0)


@pytest.mark.parametrize("mixture", MIXTURES)
@pytest.mark.parametrize("sigma_hit", [0.1, 2.0])
def test_a_reading_is_where_its_part_of_the_mixture_says(mixture, sigma_hit):
    """Against inversion with scipy's distributions, beam by beam."""
    sensor, rng = model(mixture, sigma_hit=sigma_hit), np.random.default_rng(2)
    expected = np.concatenate([np.repeat([0.0, Z_MAX, 9.0], 40), rng.uniform(0.0, Z_MAX, 200)])
    uniforms = rng.random((len(expected), 2))
    last = np.nextafter(Z_MAX, 0.0)
    for z, z_expected, (part, u) in zip(
        sensor.sample(expected, uniforms), np.minimum(expected, Z_MAX), uniforms, strict=True
    ):
        nothing, w_short = z_expected == Z_MAX, sensor.w_short * (z_expected > 0.0)
        w_hit = 0.0 if nothing else sensor.w_hit + sensor.w_short - w_short
        w_max = sensor.w_max + sensor.w_hit * nothing
        if part < w_hit:
            hit = truncnorm(-z_expected / sigma_hit, (Z_MAX - z_expected) / sigma_hit)
            assert z == pytest.approx(min(z_expected + sigma_hit * hit.ppf(u), last), abs=1e-9)
        elif part < w_hit + w_short:
            whole = 1.0 - exp(-sensor.lambda_short * z_expected)
            assert 1.0 - exp(-sensor.lambda_short * z) == pytest.approx(u * whole, abs=1e-12)
        else:
            assert z == (Z_MAX if part < w_hit + w_short + w_max else u * Z_MAX)
