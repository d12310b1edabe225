"""Bins, bearings, rays and the refusal of malformed scans."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activeloc.errors import ConfigError, ScanError
from activeloc.sensors import BeamModel, ReadingBins
from activeloc.sensors.readings import check_scan, rays_of, spread_bearings

SENSOR = BeamModel(beams=3, z_max=1.5)


@given(st.floats(0.1, 100.0), st.floats(0.001, 1.0), st.floats(0.0, 1.0))
def test_every_reading_falls_between_the_edges_of_its_bin(z_max, share, at):
    bins = ReadingBins(z_max, share * z_max)
    z = at * z_max
    index = int(bins.index(np.array([z]))[0])
    if z >= z_max:
        assert index == len(bins) - 1
        return
    assert 0 <= index <= len(bins) - 2
    assert bins.edges[index] <= z + 1e-12 * z_max
    assert z <= bins.edges[index + 1] + 1e-12 * z_max


def test_bins_divide_the_range_evenly_and_the_maximum_has_its_own():
    bins = ReadingBins(1.5, 0.1)
    assert len(bins) == 16
    np.testing.assert_allclose(bins.edges, np.arange(16) * 0.1)
    scan = np.array([0.0, 0.05, 0.15, 1.4999, 1.5, np.nan, 99.0])
    np.testing.assert_array_equal(bins.index(scan), [0, 0, 1, 14, 15, -1, 15])
    assert len(ReadingBins(1.0, 0.3)) == 5


def test_too_many_bins_are_refused():
    with pytest.raises(ConfigError, match="4096"):
        ReadingBins(10.0, 0.001)


@pytest.mark.parametrize("width", [0.0, -1.0, 2.0, np.nan, np.inf])
def test_widths_out_of_range_are_refused(width):
    with pytest.raises(ConfigError, match="reading_bin"):
        ReadingBins(1.5, width)


def test_bearings_include_both_ends_but_divide_a_full_turn():
    np.testing.assert_allclose(spread_bearings(3, pi / 3), [-pi / 6, 0, pi / 6])
    np.testing.assert_allclose(spread_bearings(4, 2 * pi), [-pi, -pi / 2, 0, pi / 2])
    np.testing.assert_allclose(spread_bearings(1, pi), [0.0])


def test_rays_start_at_the_pose_and_turn_by_the_bearing():
    poses = np.array([[[1.0, 2.0, 0.5]], [[3.0, 4.0, -1.0]]])
    rays = rays_of(poses, np.array([-0.25, 0.75]))
    assert rays.shape == (2, 1, 2, 3)
    np.testing.assert_allclose(rays[1, 0], [[3.0, 4.0, -1.25], [3.0, 4.0, -0.25]])
    assert poses[1, 0, 2] == -1.0


def test_infinity_is_a_maximum_range_reading_and_nan_none():
    given_scan = np.array([np.inf, np.nan, 0.5])
    np.testing.assert_array_equal(check_scan(given_scan, SENSOR), [1.5, np.nan, 0.5])
    assert np.isinf(given_scan[0])


@pytest.mark.parametrize("bad", [-0.1, -np.inf, 1.5001, -1e-300, 1e300])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_readings_out_of_range_are_refused(bad, place):
    scan = np.full(3, 0.5)
    scan[place] = bad
    with pytest.raises(ScanError, match=rf"reading \({place},\) is .* allowed are \[0, 1\.5\]"):
        check_scan(scan, SENSOR)


@pytest.mark.parametrize("scan", [np.zeros(2), np.zeros(4), np.zeros((3, 1)), 0.5, np.zeros(0)])
def test_wrong_numbers_of_beams_are_refused(scan):
    with pytest.raises(ScanError, match="must have 3 readings, got shape"):
        check_scan(scan, SENSOR)
