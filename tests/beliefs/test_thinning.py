"""Hypotheses that stand for weights: as many as their share says, and the same every time."""

import numpy as np
import pytest

from activeloc.beliefs.thinning import thin_weights


def thinned(weights, n):
    index, count = np.empty(n, np.int64), np.empty(n, np.int64)
    m = thin_weights(np.asarray(weights), index, count)
    return index[:m], count[:m]


@pytest.mark.parametrize("n", [1, 7, 128, 1000])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_each_weight_gets_its_share_to_within_one(n, dtype):
    rng = np.random.default_rng(n)
    weights = (rng.exponential(size=300) ** 3).astype(dtype)
    weights[rng.random(300) < 0.3] = 0.0
    index, count = thinned(weights, n)
    assert count.sum() == n
    assert (count > 0).all()
    assert (np.diff(index) > 0).all()
    assert (weights[index] > 0).all()
    given = np.zeros(300)
    given[index] = count
    assert np.abs(given - n * weights / weights.sum(dtype=np.float64)).max() < 1.0


def test_one_weight_gets_all():
    assert [part.tolist() for part in thinned([0.0, 0.0, 3.0, 0.0], 5)] == [[2], [5]]


def test_equal_weights_are_met_at_equal_distances():
    index, count = thinned(np.ones(1000), 10)
    assert index.tolist() == [*range(50, 1000, 100)]
    assert (count == 1).all()


def test_a_sum_that_is_rounded_leaves_none_out():
    """A million float32 weights, one of them larger than all others together."""
    weights = np.full(1_000_000, 1e-9, np.float32)
    weights[-1] = 1.0
    index, count = thinned(weights, 255)
    assert count.sum() == 255
    assert index[-1] == 999_999
