"""How many particles: against the chi-square quantile, the definition of entropy, and a count."""

from math import ceil, exp, log, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri
from scipy.stats import chi2

from activeloc.beliefs.sample_size import (
    draw_until,
    effective_states,
    kld_count,
    wilson_hilferty,
)
from activeloc.errors import ConfigError

SIZES = [2, 3, 4, 5, 6, 7, 8, 10, 15, 20, 50, 100, 1000, 20_000]
Z_99 = 2.3263478740408408  # A table's quantile of the normal distribution at .99.


def drawn(weights, bins, pointers, error=0.05, confidence=0.99, n_min=1):
    """Indices that KLD sampling draws."""
    bins = np.asarray(bins, dtype=np.int64)
    out = np.full(len(pointers), -1, dtype=np.intp)
    seen = np.zeros(int(bins.max()) + 1, dtype=np.bool_)
    z, wheel = float(ndtri(confidence)), np.cumsum(weights)
    n = draw_until(wheel, bins, np.asarray(pointers), z, error, n_min, seen, out)
    assert (out[n:] == -1).all()
    return out[:n]


# --- the bound -----------------------------------------------------------------------------------


@pytest.mark.parametrize("confidence", [0.5, 0.8, 0.9, 0.95, 0.99])
@pytest.mark.parametrize("k", SIZES)
def test_count_follows_the_chi_square_quantile(k, confidence):
    error = 1e-5  # So small that rounding the count up does not matter.
    exact = chi2.ppf(confidence, k - 1) / (2.0 * error)
    tolerance = 0.003 if k >= 7 else 0.035  # Of Wilson and Hilferty's cube.
    assert kld_count(k, error, confidence) == pytest.approx(exact, rel=tolerance)


def test_count_by_hand():
    """Fox (2003), equation (7), for 10 bins, an error of .05 and a confidence of .99."""
    cube = (1.0 - 2.0 / 81.0 + sqrt(2.0 / 81.0) * Z_99) ** 3
    assert kld_count(10, 0.05, 0.99) == ceil(9.0 / 0.1 * cube) == 217


def test_confidence_is_a_probability_and_not_a_quantile():
    assert wilson_hilferty(30, Z_99, 0.02) == pytest.approx(kld_count(30, 0.02, 0.99), abs=1.0)
    assert kld_count(30, 1e-4, 0.5) == pytest.approx(chi2.median(29) / 2e-4, rel=0.003)
    with pytest.raises(ConfigError, match=r"KLD confidence must be a number in .0, 1\]; got 2.33"):
        kld_count(30, 0.02, 2.33)


def test_one_bin_counts_as_two():
    assert kld_count(1, 0.05, 0.99) == kld_count(2, 0.05, 0.99) == 66


@pytest.mark.parametrize("confidence", [0.01, 0.2, 0.5, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("error", [1e-3, 0.05, 1.0])
def test_count_never_falls_as_bins_are_added(confidence, error):
    counts = [kld_count(k, error, confidence) for k in range(1, 400)]
    assert (np.diff(counts) >= 0).all()
    assert counts[0] >= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 0.05, 0.99), "KLD bins must be an integer"),
        ((2.5, 0.05, 0.99), "KLD bins must be an integer"),
        ((True, 0.05, 0.99), "KLD bins must be an integer"),
        ((5, 0.0, 0.99), "KLD error must be a number"),
        ((5, -0.1, 0.99), "KLD error must be a number"),
        ((5, float("nan"), 0.99), "KLD error must be a number"),
        ((5, 11.0, 0.99), "KLD error must be a number"),
        ((5, 0.05, 0.0), "KLD confidence must be a number"),
        ((5, 0.05, 1.0), "KLD confidence must be a number"),
        ((5, 0.05, -0.5), "KLD confidence must be a number"),
        ((5, 0.05, float("nan")), "KLD confidence must be a number"),
    ],
)
def test_a_count_of_nonsense_is_refused(arguments, message):
    with pytest.raises(ConfigError, match=message):
        kld_count(*arguments)


# --- drawing -------------------------------------------------------------------------------------


def share_kept(p, error, confidence, runs, n_min=1):
    """Share of the runs in which KL(p_hat || p) <= error."""
    rng, kept = np.random.default_rng(0), 0
    bins = np.repeat(np.arange(len(p)), 7)  # Seven particles of equal weight in each bin.
    for _ in range(runs):
        index = drawn(np.repeat(p / 7.0, 7), bins, rng.random(5_000), error, confidence, n_min)
        p_hat = np.bincount(bins[index], minlength=len(p)) / len(index)
        some = p_hat > 0.0
        kept += float((p_hat[some] * np.log(p_hat[some] / p[some])).sum()) <= error
    print(f"{kept / runs:.3f} of the runs")
    return kept / runs


@pytest.mark.parametrize("confidence", [0.9, 0.99])
@pytest.mark.parametrize("masses", [[0.5, 0.3, 0.2], np.full(12, 1 / 12), np.full(40, 1 / 40)])
def test_divergence_stays_under_the_error_as_often_as_promised(masses, confidence):
    """P(KL(p_hat || p) <= error) >= confidence, less five standard errors of 2,000 runs."""
    bound = confidence - 5.0 * sqrt(confidence * (1.0 - confidence) / 2_000)
    assert share_kept(np.array(masses), 0.05, confidence, 2_000) >= bound


def test_a_thin_tail_breaks_the_promise_and_the_fewest_particles_keep_it():
    """Bins that have not been drawn are not counted: the limit of the method."""
    p = np.append(0.95, np.full(20, 0.05 / 20))
    assert share_kept(p, 0.05, 0.99, 300) < 0.6
    assert share_kept(p, 0.05, 0.99, 300, n_min=kld_count(21, 0.05, 0.99)) >= 0.96


def slowly(weights, bins, pointers, error, confidence, n_min):
    """The loop of table 8.4, with sets and Python's own sums."""
    total, index = sum(weights), []
    while len(index) < len(pointers):
        occupied = {bins[i] for i in index}
        if index and len(index) >= max(n_min, kld_count(len(occupied), error, confidence)):
            break
        at, i = pointers[len(index)] * total, 0
        while at >= sum(weights[: i + 1]):
            i += 1
        index.append(i)
    return index


@settings(deadline=None)  # The first call may compile.
@given(
    st.lists(st.tuples(st.integers(1, 9), st.integers(0, 12)), min_size=1, max_size=40),
    st.integers(1, 60),
    st.integers(1, 150),
    st.integers(0, 1000),
)
def test_draws_as_the_book_does_and_counts_each_bin_once(particles, n_min, n_max, seed):
    weights, bins = (np.array(part) for part in zip(*particles, strict=True))
    # Multiples of 1/64 and whole weights: both sides of the comparison are exact.
    pointers = np.random.default_rng(seed).integers(0, 64, n_max) / 64.0
    got = drawn(weights.astype(np.float64), bins, pointers, 0.2, 0.9, n_min)
    expected = slowly(weights.tolist(), bins.tolist(), pointers.tolist(), 0.2, 0.9, n_min)
    assert got.tolist() == expected
    assert min(n_min, n_max) <= len(got) <= n_max


def test_fewest_and_most_are_respected():
    rng = np.random.default_rng(1)
    assert len(drawn(np.ones(50), np.zeros(50, dtype=int), rng.random(500), n_min=123)) == 123
    assert len(drawn(np.ones(50), np.zeros(50, dtype=int), rng.random(500))) == 66
    assert len(drawn(np.ones(50), np.arange(50), rng.random(77), n_min=5)) == 77
    assert len(drawn(np.ones(50), np.arange(50), rng.random(77), n_min=200)) == 77


def test_a_wider_belief_is_given_more_particles():
    rng, n = np.random.default_rng(2), 400
    counts = [
        len(drawn(np.ones(n), np.arange(n) % k, rng.random(50_000), n_min=10)) for k in (1, 5, 400)
    ]
    assert counts == [kld_count(k, 0.05, 0.99) for k in (1, 5, 400)]


def test_draws_are_in_proportion_to_the_weights():
    weights, rng = np.array([0.1, 0.0, 0.6, 0.3]), np.random.default_rng(3)
    counts = np.bincount(drawn(weights, np.arange(4), rng.random(40_000), n_min=40_000))
    assert counts[1] == 0
    expected = 40_000 * weights[[0, 2, 3]]
    statistic = ((counts[[0, 2, 3]] - expected) ** 2 / expected).sum()
    assert chi2.sf(statistic, 2) > 1e-6


@pytest.mark.parametrize("total", [5e-324, 1e-3, 1.0, 1e300])
def test_the_wheel_is_not_left_at_its_end(total):
    weights = np.array([0.0, total, 0.0, 0.0])
    pointers = np.array([0.0, 0.5, np.nextafter(1.0, 0.0)])
    np.testing.assert_array_equal(drawn(weights, np.zeros(4, dtype=int), pointers, n_min=3), 1)


# --- effective states ----------------------------------------------------------------------------

ORDERS = [0.05, 0.3, 0.5, 0.7, 0.9, 0.999, 1.0]


@pytest.mark.parametrize("n", [1, 2, 7, 1000])
@pytest.mark.parametrize("order", ORDERS)
def test_a_uniform_belief_over_n_states_counts_n(n, order):
    p = np.concatenate([np.full(n, 1.0 / n), np.zeros(3)])
    assert effective_states(p, order) == pytest.approx(n, rel=1e-9)


def test_effective_states_by_hand():
    p = np.array([0.5, 0.25, 0.25, 0.0])
    assert effective_states(p) == pytest.approx(exp(1.5 * log(2.0)), rel=1e-12)
    assert effective_states(p, 0.5) == pytest.approx((sqrt(0.5) + 1.0) ** 2, rel=1e-12)
    near = 0.5 * 0.5**-0.1 + 0.5 * 0.25**-0.1  # sum p^.9, as p p^-.1
    assert effective_states(p, 0.9) == pytest.approx(near**10, rel=1e-12)


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=30))
def test_the_lower_the_order_the_more_states_count(masses):
    p = np.array(masses) / np.sum(masses)
    counts = np.array([effective_states(p, order) for order in ORDERS])
    assert (counts[1:] <= counts[:-1] * (1.0 + 1e-9)).all()
    assert counts[-1] >= 1.0 - 1e-9
    assert counts[0] <= len(p) * (1.0 + 1e-9)


def test_shannon_is_the_limit_of_renyi():
    p = np.random.default_rng(0).dirichlet(np.ones(20))
    assert effective_states(p, 1.0 - 1e-7) == pytest.approx(effective_states(p, 1.0), rel=1e-5)
    assert effective_states(p, 0.9) > effective_states(p, 1.0) * 1.01
