"""Resampling: every scheme unbiased, systematic tight, none runs off the end of the wheel."""

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import chi2

from activeloc.beliefs.resampling import SCHEMES, effective_sample_size, systematic

ALL = pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
ALMOST_ONE = np.nextafter(1.0, 0.0)
WEIGHTS = hnp.arrays(np.float64, st.integers(1, 30), elements=st.floats(0.0, 1.0))


@ALL
@pytest.mark.parametrize("n", [7, 20])
def test_every_scheme_is_unbiased(scheme, n):
    """Mean offspring of each particle is n w: within five standard errors, and by chi-square."""
    rng, runs = np.random.default_rng(0), 8_000
    weights = rng.dirichlet(np.full(11, 0.4))
    counts = np.array(
        [np.bincount(scheme(weights, n, rng.random(n)), minlength=11) for _ in range(runs)]
    )
    assert (counts.sum(axis=1) == n).all()
    error = counts.mean(axis=0) - n * weights
    # No scheme's counts vary less than those of a share rounded up or down at random.
    part = n * weights % 1.0
    variance = np.maximum(counts.var(axis=0), part * (1.0 - part))
    assert (np.abs(error) <= 5 * np.sqrt(variance / runs) + 5 / runs).all()
    # Counts sum to n, so their covariance is singular without leaving one particle out; neither
    # those that hardly ever have offspring nor those whose number never changes say anything.
    kept = np.flatnonzero(counts.var(axis=0) * runs > 20)
    kept = kept[kept != weights.argmax()]
    covariance = np.cov(counts[:, kept].T) / runs
    statistic = error[kept] @ np.linalg.pinv(covariance, hermitian=True) @ error[kept]
    assert chi2.sf(statistic, len(kept)) > 1e-6


def test_multinomial_counts_have_multinomial_variance():
    weights, n, runs = np.array([0.1, 0.2, 0.7]), 10, 20_000
    rng = np.random.default_rng(1)
    counts = np.array(
        [
            np.bincount(SCHEMES["multinomial"](weights, n, rng.random(n)), minlength=3)
            for _ in range(runs)
        ]
    )
    np.testing.assert_allclose(counts.var(axis=0), n * weights * (1 - weights), rtol=0.06)


@given(WEIGHTS, st.integers(1, 50), st.floats(0.0, ALMOST_ONE))
def test_systematic_offspring_are_within_one_of_their_share(weights, n, uniform):
    assume(weights.sum() > 0.1)
    counts = np.bincount(systematic(weights, n, np.array([uniform])), minlength=len(weights))
    share = n * weights / weights.sum()
    assert (counts >= np.floor(share - 1e-9)).all()
    assert (counts <= np.ceil(share + 1e-9)).all()


@pytest.mark.parametrize("name", ["systematic", "stratified", "residual"])
def test_whole_shares_are_kept_for_certain(name):
    scheme = SCHEMES[name]
    rng = np.random.default_rng(2)
    weights = np.array([0.5, 0.25, 0.125, 0.125])
    for _ in range(200):
        counts = np.bincount(scheme(weights, 8, rng.random(8)), minlength=4)
        np.testing.assert_array_equal(counts, [4, 2, 1, 1])


@ALL
@pytest.mark.parametrize("total", [0.999, 1.0, 1.001, 1e-3, 1e6])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_sums_off_one_do_not_matter(scheme, total, dtype):
    weights = np.random.default_rng(3).dirichlet(np.ones(1000)).astype(dtype)
    for u in (0.0, 0.5, ALMOST_ONE):
        uniforms = np.full(1000, u)
        got = scheme((weights * dtype(total)).astype(dtype), 1000, uniforms)
        assert got.shape == (1000,)
        assert got.min() >= 0
        assert got.max() < 1000
        spread = np.bincount(got, minlength=1000) - np.bincount(
            scheme(weights, 1000, uniforms), minlength=1000
        )
        assert np.abs(spread).sum() <= 20


@ALL
@pytest.mark.parametrize("hot", [0, 3, 9])
@pytest.mark.parametrize("u", [0.0, 0.37, ALMOST_ONE])
@pytest.mark.parametrize("size", [1.0, 1e-300, 5e-324, 1e300])
def test_one_hot_weights_give_one_particle(scheme, hot, u, size):
    weights = np.zeros(10)
    weights[hot] = size
    np.testing.assert_array_equal(scheme(weights, 6, np.full(6, u)), hot)


@ALL
@given(weights=WEIGHTS, n=st.integers(1, 40), seed=st.integers(0, 2**32))
def test_only_particles_with_weight_survive(scheme, weights, n, seed):
    assume(weights.sum() > 0.0)
    uniforms = np.random.default_rng(seed).random(n)
    for u in (uniforms, np.zeros(n), np.full(n, ALMOST_ONE)):
        got = scheme(weights, n, u)
        assert got.shape == (n,)
        assert (weights[got] > 0.0).all()


@ALL
def test_zeros_at_the_end_are_never_chosen(scheme):
    weights = np.append(np.full(1000, 1e-3, dtype=np.float32), np.zeros(5, dtype=np.float32))
    got = scheme(weights, 5000, np.full(5000, ALMOST_ONE))
    assert got.max() == 999


@ALL
def test_nothing_is_written_to_the_weights(scheme):
    weights, uniforms = np.array([0.2, 0.5, 0.3]), np.array([0.1, 0.9, 0.4, 0.2])
    before = weights.copy(), uniforms.copy()
    scheme(weights, 4, uniforms)
    np.testing.assert_array_equal(weights, before[0])
    np.testing.assert_array_equal(uniforms, before[1])


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([1.0], 1.0),
        ([0.25] * 4, 4.0),
        ([1.0, 0.0, 0.0], 1.0),
        ([0.5, 0.5, 0.0], 2.0),
        ([3.0, 1.0], 1.6),
        ([1e-200, 1e-200, 1e-200], 3.0),
        ([5e-324, 5e-324], 2.0),
        ([1e200, 1e200], 2.0),
    ],
)
def test_effective_sample_size_by_hand(weights, expected):
    assert effective_sample_size(np.array(weights)) == pytest.approx(expected)


@given(WEIGHTS, st.sampled_from([1.0, 1e-3, 1e-180, 1e150]))
def test_effective_sample_size_lies_between_one_and_n_whatever_the_scale(weights, scale):
    assume(weights.max() > 1e-3)
    size = effective_sample_size(weights * scale)
    assert 1.0 - 1e-9 <= size <= np.count_nonzero(weights) + 1e-9
    assert size == pytest.approx(effective_sample_size(weights))
    assert size == pytest.approx(effective_sample_size(weights[::-1]))
    assert effective_sample_size(np.tile(weights, 2)) == pytest.approx(2 * size)
