"""The depth sensor: counting cells, and errors by a confusion matrix."""

import numpy as np
import pytest
from scipy.stats import chisquare

from activeloc.errors import ConfigError, ScanError
from activeloc.sensors import DepthSensor
from activeloc.sensors.depth import depths


def test_depths_of_a_map_by_hand():
    #  Row 0 is the lowest: a corridor of three, a free cell above its right end.
    free = np.array([[1, 1, 1, 0], [0, 0, 1, 0]], dtype=bool)
    east, north, west, south = depths(free)
    np.testing.assert_array_equal(east, [[3, 2, 1, 0], [0, 0, 1, 0]])
    np.testing.assert_array_equal(north, [[1, 1, 2, 0], [0, 0, 1, 0]])
    np.testing.assert_array_equal(west, [[1, 2, 3, 0], [0, 0, 1, 0]])
    np.testing.assert_array_equal(south, [[1, 1, 1, 0], [0, 0, 2, 0]])


@pytest.mark.parametrize("seed", range(5))
def test_depths_agree_with_walking(seed):
    rng = np.random.default_rng(seed)
    free = rng.random((7, 12)) < 0.7
    padded = np.pad(free, 1)
    got = depths(free)
    steps = {0: (0, 1), 1: (1, 0), 2: (0, -1), 3: (-1, 0)}
    for direction, (dr, dc) in steps.items():
        for row, col in np.ndindex(free.shape):
            n = 0
            while padded[row + 1 + n * dr, col + 1 + n * dc]:
                n += 1
            assert got[direction, row, col] == n


def test_exact_sensor_reads_the_depth():
    sensor = DepthSensor.exact(5)
    for depth in range(1, 6):
        for uniform in (0.0, 0.5, np.nextafter(1.0, 0.0)):
            assert sensor.sample(depth, uniform) == depth
        likelihood = sensor.likelihood(depth, np.arange(1, 6))
        np.testing.assert_array_equal(likelihood, np.eye(5)[depth - 1])


def test_off_by_one_keeps_the_ends_inside():
    sensor = DepthSensor.off_by_one(4, 0.1)
    expected = [[0.9, 0.1, 0, 0], [0.1, 0.8, 0.1, 0], [0, 0.1, 0.8, 0.1], [0, 0, 0.1, 0.9]]
    np.testing.assert_allclose(sensor.confusion, expected)


@pytest.mark.parametrize("depth", [1, 3, 6])
def test_readings_follow_the_matrix(depth):
    matrix = np.random.default_rng(0).dirichlet(np.ones(6), 6)
    sensor, n = DepthSensor(matrix), 20_000
    uniforms = np.random.default_rng(depth).random(n)
    z = np.array([sensor.sample(depth, u) for u in uniforms])
    counts = np.bincount(z, minlength=7)[1:]
    assert chisquare(counts, n * matrix[depth - 1]).pvalue > 1e-6


def test_likelihood_reads_a_column_and_the_sensor_draws_from_a_row():
    matrix = np.array([[0.2, 0.8], [0.5, 0.5]])
    sensor = DepthSensor(matrix)
    np.testing.assert_allclose(
        sensor.likelihood(2, np.array([[1, 2], [2, 1]])), [[0.8, 0.5], [0.5, 0.8]]
    )
    assert [sensor.sample(1, u) for u in (0.0, 0.19, 0.21, 0.99)] == [1, 1, 2, 2]


def test_the_matrix_is_a_copy_that_cannot_be_changed():
    matrix = np.eye(3)
    sensor = DepthSensor(matrix)
    matrix[0] = 0.0
    np.testing.assert_array_equal(sensor.confusion, np.eye(3))
    with pytest.raises(ValueError, match="read-only"):
        sensor.confusion[0, 0] = 0.5


@pytest.mark.parametrize(
    ("confusion", "message"),
    [
        (np.ones((2, 3)) / 3, r"must be \(D, D\), got shape \(2, 3\)"),
        (np.ones(4), r"got shape \(4,\)"),
        (np.empty((0, 0)), r"got shape \(0, 0\)"),
        ([[0.5, 0.5], [0.5, 0.6]], r"row 1 must sum to 1, got 1\.1"),
        ([[1.5, -0.5], [0.5, 0.5]], "below 0"),
        ([[np.nan, 1.0], [0.5, 0.5]], "must hold probabilities"),
    ],
)
def test_refuses_what_is_no_confusion_matrix(confusion, message):
    with pytest.raises(ConfigError, match=message):
        DepthSensor(confusion)


@pytest.mark.parametrize("z", [0, -1, 6])
def test_refuses_readings_out_of_range(z):
    with pytest.raises(ScanError, match=rf"must be in 1 \.\.\. 5, got {z}"):
        DepthSensor.exact(5).likelihood(z, np.array([1]))
