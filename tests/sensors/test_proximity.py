"""The proximity model against its own formula, and its readings against the filter."""

from itertools import pairwise
from math import erf, pi, sqrt

import numpy as np
import pytest
from scipy.stats import chisquare

from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.sensors import (
    BeamModel,
    ExpectedRangeSensor,
    LikelihoodField,
    ProximityModel,
    ReadingBins,
    Sonar,
)
from activeloc.sensors.readings import widened

Z_MAX = 3.0
EXPECTED = [0.0, 0.04, 1.0, 1.73, Z_MAX - 0.02, Z_MAX, 99.0]
PARTS = {
    "known": {"p_known": 0.9, "p_unknown": 0.0},
    "known for sure": {"p_known": 1.0, "p_unknown": 0.0},
    "unknown": {"p_known": 0.0, "p_unknown": 0.05},
    "unknown at once": {"p_known": 0.0, "p_unknown": 1.0},
    "neither": {"p_known": 0.0, "p_unknown": 0.0},
    "both": {"p_known": 0.8, "p_unknown": 0.03},
    "both to the brim": {"p_known": 0.7, "p_unknown": 0.3},
}


def model(part="both", **kwargs):
    return ProximityModel(**{"z_max": Z_MAX, "step": 0.1, **PARTS[part], **kwargs})


def gaussian(sensor, z_expected):
    """P_m(d_i | l): the Gaussian's area over each step of range, as shares of that in range."""
    if z_expected >= sensor.z_max:
        return [0.0] * (len(sensor.steps) - 1)
    scaled = [(z - z_expected) / (sensor.sigma_hit * sqrt(2)) for z in sensor.steps.edges]
    parts = [0.5 * (erf(b) - erf(a)) for a, b in pairwise(scaled)]
    return [part / sum(parts) for part in parts]


def lecture(sensor, z_expected):
    """P(d_i | l) as the lecture writes it, sum by sum, and what is left over at the end."""
    c_d, c_r, p_m = sensor.p_known, sensor.p_unknown, gaussian(sensor, z_expected)
    p_u, p = [], []
    for i in range(len(p_m)):
        known = (1 - sum(p_u[:i])) * c_d * p_m[i]
        p.append(1 - (1 - known) * (1 - (1 - sum(p[:i])) * c_r))
        p_u.append(c_r * (1 - sum(p_u[:i])))
    return np.array([*p, 1 - sum(p)])


@pytest.mark.parametrize("z_expected", EXPECTED)
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("sigma_hit", [0.02, 0.1, 2.0])
def test_steps_follow_the_lecture_and_sum_to_one(part, z_expected, sigma_hit):
    sensor = model(part, sigma_hit=sigma_hit)
    p = sensor.step_probabilities(np.array(z_expected))
    assert p.shape == (len(sensor.steps),)
    assert (p >= 0.0).all()
    assert p.sum() == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(p, lecture(sensor, z_expected), atol=1e-9)


@pytest.mark.parametrize("sensor", [ProximityModel.laser(), ProximityModel.sonar(), Sonar()])
@pytest.mark.parametrize("width", [0.05, 0.1, 0.07, 0.4, 1.5])
def test_masses_are_distributions_in_any_bins(sensor, width):
    z_expected = np.linspace(0.0, sensor.z_max, 31).reshape(1, 31)
    bins = ReadingBins(sensor.z_max, width)
    masses = sensor.masses(z_expected, bins)
    assert masses.shape == (1, 31, len(bins))
    assert (masses >= 0.0).all()
    np.testing.assert_allclose(masses.sum(axis=-1), 1.0, atol=1e-9)


def test_masses_are_the_density_summed_over_the_bins():
    """Steps of 0.1 m in bins of 0.25 m: the third step is half in the first bin."""
    sensor = model()
    p, masses = sensor.step_probabilities(1.7), sensor.masses(1.7, ReadingBins(Z_MAX, 0.25))
    assert masses[0] == pytest.approx(p[0] + p[1] + 0.5 * p[2], abs=1e-12)
    assert masses[1] == pytest.approx(0.5 * p[2] + p[3] + p[4], abs=1e-12)
    assert masses[-1] == pytest.approx(p[-1], abs=1e-12)


def test_unknown_obstacles_alone_are_geometric():
    p = model("unknown").step_probabilities(1.0)
    i = np.arange(len(p) - 1)
    np.testing.assert_allclose(p[:-1], 0.05 * 0.95**i, atol=1e-12)
    assert p[-1] == pytest.approx(0.95 ** len(i), abs=1e-12)


def test_a_known_obstacle_alone_is_seen_or_missed():
    p = model("known", sigma_hit=1e-6).step_probabilities(1.05)
    assert p[10] == pytest.approx(0.9, abs=1e-12)
    assert p[-1] == pytest.approx(0.1, abs=1e-12)


def test_nothing_in_range_reads_the_maximum():
    for part in ("known", "known for sure", "neither"):
        assert model(part).step_probabilities(Z_MAX)[-1] == 1.0


@pytest.mark.parametrize("sensor", [ProximityModel.laser(), ProximityModel.sonar()])
def test_the_table_of_parameters_is_no_more_than_parameters(sensor):
    assert type(sensor) is ProximityModel
    assert hash(sensor) == hash(widened(sensor, 1.0))
    assert widened(sensor, 2.0).sigma_hit == 2.0 * sensor.sigma_hit


def test_a_laser_is_sharper_and_misses_less_than_a_sonar():
    laser, sonar = ProximityModel.laser(), ProximityModel.sonar()
    assert laser == ProximityModel()
    assert laser.sigma_hit < sonar.sigma_hit
    assert laser.p_known > sonar.p_known
    assert laser.p_unknown < sonar.p_unknown


@pytest.mark.parametrize("part", ["known", "unknown", "both", "both to the brim"])
@pytest.mark.parametrize("z_expected", EXPECTED)
@pytest.mark.parametrize("width", [0.1, 0.07])
def test_readings_follow_the_filters_law(part, z_expected, width):
    """Chi-square over the filter's bins, which are not the sensor's own steps."""
    sensor, bins, n = model(part), ReadingBins(Z_MAX, width), 100_000
    uniforms = np.random.default_rng(7).random((n, 2))
    z = sensor.sample(np.array([z_expected]), uniforms)
    assert ((z >= 0.0) & (z <= Z_MAX)).all()
    counts = np.bincount(bins.index(z), minlength=len(bins))
    expected = n * sensor.masses(np.array(z_expected), bins)
    rare = expected < 10.0
    assert counts[rare].sum() <= expected[rare].sum() + 5 * sqrt(expected[rare].sum()) + 5
    counts, expected = counts[~rare], expected[~rare]
    if len(counts) > 1:
        assert chisquare(counts, expected * counts.sum() / expected.sum()).pvalue > 1e-6


def test_readings_are_drawn_around_the_exact_range():
    cells = np.zeros((40, 60), dtype=np.uint8)
    cells[:, 50:] = 1
    grid = OccupancyGrid(cells, 0.1, (-1.0, 2.0))
    sensor = model("known for sure", sigma_hit=0.01, step=0.01)
    rays = np.tile([1.5, 4.0, 0.0], (2000, 1))
    z = sensor.read(grid, rays, np.random.default_rng(0).random((2000, 2)))
    assert z.mean() == pytest.approx(2.5, abs=5 * 0.01 / sqrt(2000))
    bins = ReadingBins(Z_MAX, 0.1)
    np.testing.assert_allclose(
        sensor.bin_probabilities(grid, rays[:1], bins)[0], sensor.masses(np.array(2.5), bins)
    )


def test_sensors_of_the_expected_range_say_that_they_are():
    for sensor in (BeamModel(), ProximityModel(), Sonar()):
        assert isinstance(sensor, ExpectedRangeSensor)
    assert not isinstance(LikelihoodField(), ExpectedRangeSensor)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"beams": 0}, r"ProximityModel\.beams must be an integer in \[1, 4096\]; got 0"),
        ({"field_of_view": 7.0}, r"ProximityModel\.field_of_view must be"),
        ({"z_max": np.inf}, r"ProximityModel\.z_max must be .* got inf"),
        ({"sigma_hit": 0.0}, r"ProximityModel\.sigma_hit must be"),
        ({"p_known": -0.1}, r"ProximityModel\.p_known must be .* got -0\.1"),
        ({"p_unknown": np.nan}, r"ProximityModel\.p_unknown must be .* got nan"),
        ({"p_known": 0.9, "p_unknown": 0.2}, r"p_known \+ p_unknown must be at most 1, got 1\.1"),
        ({"step": 0.0}, r"ProximityModel\.step must be a number in \(0, 1\.5\]; got 0"),
        ({"step": 2.0}, r"ProximityModel\.step must be"),
        ({"step": 1e-5}, r"gives 150000 steps up to z_max 1\.5 m; at most 4096"),
    ],
)
def test_refuses_what_is_no_sensor(settings, message):
    with pytest.raises(ConfigError, match=message):
        ProximityModel(**settings)


def test_more_than_one_cause_for_sure_would_be_no_probability():
    """Why p_known + p_unknown is at most one: the formula itself leaves less than nothing over."""
    sensor = model("both to the brim", sigma_hit=1e-3)
    object.__setattr__(sensor, "p_known", 1.0)
    assert lecture(sensor, 2.95)[-1] < 0.0


def test_bearings_spread_over_the_field_of_view():
    np.testing.assert_allclose(
        ProximityModel(beams=3, field_of_view=pi).bearings, [-pi / 2, 0, pi / 2]
    )
