"""What a grid filter remembers of the place: repetition and contact, both by hand."""

from math import inf, pi

import numpy as np
import pytest

from activeloc.beliefs.place import PlaceMemory

AHEAD = np.zeros(1)


def counted(memory, n, bearing=0.0):
    """Weights of ``n`` readings in one direction."""
    weights = []
    for _ in range(n):
        weights.append(float(memory.weigh(np.array([bearing]))[0]))
        memory.read(np.array([bearing]))
    return weights


def test_readings_count_one_a_third_a_sixth():
    np.testing.assert_allclose(
        counted(PlaceMemory(12, 0.25, 1.0), 5), [1, 1 / 3, 1 / 6, 1 / 10, 1 / 15], rtol=1e-12
    )


@pytest.mark.parametrize("r", [0.1, 0.5, 1.0, 3.0, 20.0])
def test_weights_are_differences_of_w_n(r):
    n = np.arange(41)
    total = (1 + r) * n / (n + r)
    weights = counted(PlaceMemory(12, 0.25, r), 40)
    np.testing.assert_allclose(weights, np.diff(total), atol=1e-14)
    assert sum(weights) < 1 + r
    np.testing.assert_allclose(weights[0], 1.0)


def test_a_thousand_readings_count_less_than_two():
    assert 1.99 < sum(counted(PlaceMemory(12, 0.25, 1.0), 1000)) < 2.0


def test_infinite_ratio_counts_all_and_zero_only_the_first():
    assert counted(PlaceMemory(12, 0.25, inf), 4) == [1.0] * 4
    assert counted(PlaceMemory(12, 0.25, 0.0), 4) == [1.0, 0.0, 0.0, 0.0]


def test_beams_in_one_sector_are_successive_readings_of_it():
    memory = PlaceMemory(4, 0.25, 1.0)
    bearings = np.array([0.0, 0.1, pi / 2, -0.1])
    np.testing.assert_allclose(memory.weigh(bearings), [1, 1 / 3, 1, 1 / 6])
    np.testing.assert_allclose(memory.weigh(bearings), [1, 1 / 3, 1, 1 / 6])
    memory.read(bearings)
    np.testing.assert_array_equal(memory.readings, [3, 1, 0, 0])
    np.testing.assert_allclose(memory.weigh(AHEAD), 1 / 10)


def test_sectors_follow_the_odometry():
    memory = PlaceMemory(12, 0.25, 1.0)
    memory.read(AHEAD)
    memory.move(np.array([pi / 6, 0.0, 0.0]))
    assert memory.weigh(AHEAD)[0] == 1.0
    assert memory.weigh(np.array([-pi / 6]))[0] == pytest.approx(1 / 3)
    memory.move(np.array([-pi / 3, 0.0, pi / 6]))
    assert memory.weigh(AHEAD)[0] == pytest.approx(1 / 3)
    for _ in range(12):  # Once around.
        memory.move(np.array([pi / 12, 0.1, pi / 12]) * [1, 0, 1])
    assert memory.weigh(AHEAD)[0] == pytest.approx(1 / 3)


def test_the_circle_has_no_seam():
    memory = PlaceMemory(12, 0.25, 1.0)
    memory.read(np.array([pi]))
    assert memory.weigh(np.array([-pi]))[0] == pytest.approx(1 / 3)
    np.testing.assert_array_equal(
        memory.sector(np.array([0.0, 2 * pi, -2 * pi, pi / 6, -pi / 6])), [0, 0, 0, 1, 11]
    )


@pytest.mark.parametrize("step", [0.1, -0.1])
def test_a_place_ends_after_a_quarter_metre(step):
    memory = PlaceMemory(12, 0.25, 1.0)
    memory.read(AHEAD)
    assert memory.refuse()
    for _ in range(2):
        memory.move(np.array([0.0, step, 0.0]))
        assert memory.weigh(AHEAD)[0] == pytest.approx(1 / 3)
        assert memory.is_refused
    memory.move(np.array([0.0, step, 0.0]))
    assert memory.weigh(AHEAD)[0] == 1.0
    assert not memory.is_refused
    assert memory.travelled == 0.0


def test_a_refusal_is_news_once_per_direction():
    memory = PlaceMemory(12, 0.25, 1.0)
    assert not memory.is_refused
    assert memory.refuse()
    assert memory.is_refused
    assert not memory.refuse()
    memory.move(np.array([pi / 6, 0.02, 0.0]))
    assert not memory.is_refused
    assert memory.refuse()
    assert not memory.refuse()
    memory.move(np.array([-pi / 6, 0.0, 0.0]))
    assert not memory.refuse()


def test_a_copy_is_independent():
    memory = PlaceMemory(12, 0.25, 1.0)
    memory.read(AHEAD)
    twin = memory.copy()
    twin.read(AHEAD)
    twin.refuse()
    twin.move(np.array([1.0, 0.1, 0.0]))
    assert memory.readings.sum() == 1
    assert not memory.is_refused
    assert (memory.heading, memory.travelled) == (0.0, 0.0)
    assert twin.readings.sum() == 2


def test_a_beam_without_a_reading_neither_counts_nor_is_remembered():
    """Three beams in one sector, of which the first read nothing; one in another."""
    place, bearings = PlaceMemory(12, 0.25, 1.0), np.array([0.0, 0.02, -0.02, np.pi])
    valid = np.array([False, True, True, True])
    weights = place.weigh(bearings, valid)
    np.testing.assert_array_equal(weights[1:], place.weigh(bearings[1:]))
    assert weights[0] == 0.0
    place.read(bearings, valid)
    assert place.readings.tolist() == [2, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0]
