"""Which particles survive, and with what weight: the comb, the allocation, like rooms."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from activeloc.beliefs.particle_bins import allocate, merge, shares, sum_bins, wheel_of
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.redrawing import resample
from activeloc.beliefs.resampling import stratified, systematic
from activeloc.beliefs.sample_size import effective_states, kld_count
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel

# --- the comb ------------------------------------------------------------------------------------

ALMOST_ONE = np.nextafter(1.0, 0.0)
COMBS = pytest.mark.parametrize("scheme", [systematic, stratified])


def searched(weights, pointers):
    """Each pointer looked up by itself; never a particle of no weight."""
    wheel = np.cumsum(np.asarray(weights, dtype=np.float64))
    index = np.searchsorted(wheel, pointers * wheel[-1], side="right")
    return np.minimum(index, np.flatnonzero(np.diff(wheel, prepend=0.0))[-1])


def agrees(scheme, weights, n, uniforms):
    teeth = uniforms[:1] if scheme is systematic else uniforms[:n]
    before = np.array(weights)
    got = scheme(weights, n, uniforms)
    np.testing.assert_array_equal(got, searched(weights, (teeth + np.arange(n)) / n))
    np.testing.assert_array_equal(weights, before)


@COMBS
@settings(deadline=None)  # The first call may compile.
@given(
    weights=arrays(np.float64, st.integers(1, 60), elements=st.floats(0.0, 1.0)),
    n=st.integers(1, 90),
    seed=st.integers(0, 2**32),
)
def test_the_comb_picks_what_a_search_would(scheme, weights, n, seed):
    assume(weights.sum() > 1e-300)
    for uniforms in (np.random.default_rng(seed).random(n), np.zeros(n), np.full(n, ALMOST_ONE)):
        agrees(scheme, weights, n, uniforms)


@COMBS
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("total", [0.999, 1.0, 1.001])
def test_the_comb_of_many_weights_that_do_not_quite_sum_to_one(scheme, dtype, total):
    rng = np.random.default_rng(0)
    weights = (rng.dirichlet(np.full(5_000, 0.3)) * total).astype(dtype)
    for n in (1, 777, 5_000, 20_000):
        for uniforms in (rng.random(n), np.zeros(n), np.full(n, ALMOST_ONE)):
            agrees(scheme, weights, n, uniforms)


@COMBS
@pytest.mark.parametrize("hot", [0, 7, 19])
@pytest.mark.parametrize("size", [5e-324, 1e-310, 1.0, 1e300])
def test_the_comb_of_one_weight_and_zeros(scheme, hot, size):
    weights = np.zeros(20)
    weights[hot] = size
    for uniforms in (np.zeros(33), np.full(33, 0.4), np.full(33, ALMOST_ONE)):
        agrees(scheme, weights, 33, uniforms)
        np.testing.assert_array_equal(scheme(weights, 33, uniforms), hot)


@COMBS
@pytest.mark.parametrize("scale", [5e-324, 1e-320, 1.0])
def test_the_comb_does_not_reach_into_a_tail_of_zeros(scheme, scale):
    weights = np.concatenate([[0.0, 0.0], np.arange(9.0) * scale, [0.0] * 6])
    for uniforms in (np.zeros(50), np.full(50, ALMOST_ONE), np.random.default_rng(0).random(50)):
        agrees(scheme, weights, 50, uniforms)
        assert scheme(weights, 50, uniforms).max() <= 10
        assert scheme(weights, 50, uniforms).min() >= 3


# --- allocation ----------------------------------------------------------------------------------

SENSOR = BeamModel(1, 0.0, 3.0)
MOTION = MotionModel(radius=0.0)
STILL = {"roughening_xy": 0.0, "roughening_theta": 0.0, "repetition": inf, "recovery": "none"}
SCHEMES = ["systematic", "stratified", "multinomial", "residual"]


def field():
    """4 m x 2.5 m without a wall: 8 x 5 places of the common bins."""
    return OccupancyGrid(np.zeros((25, 40), dtype=np.uint8), 0.1, (-1.0, 0.5))


def weighted(poses, weights, n, seed=0, **kwargs):
    """A belief of weighted particles that next resamples to ``n``."""
    config = ParticleConfig(**{"n_min": n, "n_max": n} | STILL | kwargs)
    belief = ParticleBelief(1, config, SENSOR, MOTION)
    belief.reset(0, field(), np.random.default_rng(seed), poses)
    cloud = belief._cloud(0)
    with np.errstate(divide="ignore"):
        cloud.log_w = np.log(weights)
    cloud.weights = cloud.masses = None
    return belief


def resampled(belief):
    resample(belief.config, belief._cloud(0), always=True)
    return belief.particles(0)


def random_cloud(n=600, seed=1):
    """Particles over the field with weights over four orders of magnitude, bin by bin."""
    rng = np.random.default_rng(seed)
    x0, x1, y0, y1 = field().extent
    poses = rng.uniform([x0, y0, -pi], [x1, y1, pi], (n, 3))
    poses[:, :2] = np.where(rng.random((n, 1)) < 0.7, poses[:, :2] * 0.4 + [0.5, 0.7], poses[:, :2])
    weights = np.exp(rng.normal(0.0, 2.0, n))
    return poses, weights / weights.sum()


@pytest.mark.parametrize("resampling", SCHEMES)
@pytest.mark.parametrize("allocation", [0.3, 0.5, 0.7, 1.0])
def test_resampling_leaves_the_belief_as_it_was_on_average(resampling, allocation):
    """Expected mass of each bin: within five standard errors of 300 repeats."""
    poses, weights = random_cloud()
    belief = weighted(poses, weights, 2_000, allocation=allocation, resampling=resampling)
    bins, runs = belief.bins(0), []
    before = np.bincount(bins.index(poses), weights, len(bins))
    for _ in range(300):
        again = belief.copy()
        again._cloud(0).rng = belief._cloud(0).rng
        got, w = resampled(again)
        assert w.sum() == pytest.approx(1.0, abs=1e-12)
        runs.append(np.bincount(bins.index(got), w, len(bins)))
    held = before > 0.0
    assert (np.array(runs)[:, ~held] == 0.0).all()
    error, spread = np.mean(runs, axis=0) - before, np.std(runs, axis=0)
    # A bin of few particles is drawn at random; none varies less than by one of them in the runs.
    least = before ** (1.0 - allocation) * (before**allocation).sum() / 2_000
    bound = 5.0 * (spread / np.sqrt(300) + least / 300)
    assert (np.abs(error[held]) <= bound[held]).all()


@pytest.mark.parametrize("allocation", [0.2, 0.5, 0.7, 1.0])
def test_bins_hold_particles_in_proportion_to_a_power_of_their_mass(allocation):
    poses, weights = random_cloud()
    belief, n = weighted(poses, weights, 20_000, allocation=allocation), 20_000
    bins = belief.bins(0)
    mass = np.bincount(bins.index(poses), weights, len(bins))
    got, w = resampled(belief)
    wanted = np.where(mass > 0.0, mass**allocation, 0.0)
    counts = np.bincount(bins.index(got), minlength=len(bins))
    # Systematic: each particle's offspring are within one of their share, and a bin holds several.
    held = np.bincount(bins.index(poses), minlength=len(bins))
    assert (np.abs(counts - n * wanted / wanted.sum()) <= held + 1e-9).all()
    # Within a bin all weigh the same; between bins as mass to the power 1 - a.
    each = mass[bins.index(got)] ** (1.0 - allocation)
    np.testing.assert_allclose(w, each / each.sum(), rtol=1e-12)
    if allocation == 1.0:
        np.testing.assert_allclose(w, 1.0 / n)


def test_within_a_bin_the_heavier_particle_has_more_offspring():
    """One bin, two places, 3 : 1; another bin, one place."""
    poses = np.repeat([[0.1, 0.6, 0.1], [0.2, 0.7, 0.2], [2.6, 2.6, -1.0]], 1, axis=0)
    belief = weighted(poses, np.array([0.6, 0.2, 0.2]), 3_000, allocation=0.5)
    got, w = resampled(belief)
    x, counts = np.unique(got[:, 0], return_counts=True)
    np.testing.assert_array_equal(x, [0.1, 0.2, 2.6])
    # sqrt(.8) : sqrt(.2) is 2 : 1 of 3,000.
    np.testing.assert_allclose(counts, [1_500, 500, 1_000], atol=1)
    np.testing.assert_allclose([w[got[:, 0] == p].sum() for p in x], [0.6, 0.2, 0.2], atol=1e-3)


def test_a_weight_of_zero_has_no_offspring():
    poses, weights = random_cloud()
    weights[::2] = 0.0
    got, w = resampled(weighted(poses, weights / weights.sum(), 3_000, allocation=0.4))
    assert not np.isin(got[:, 0], poses[::2, 0]).any()
    assert (w > 0.0).all()


def test_the_wheel_is_the_cumulative_product_and_its_squares():
    rng = np.random.default_rng(2)
    weights, index, factor = rng.random(100), rng.integers(0, 7, 100).astype("i4"), rng.random(7)
    out = np.empty(100)
    squares = wheel_of(weights, index, factor, out)
    np.testing.assert_allclose(out, np.cumsum(weights * factor[index]), rtol=1e-12)
    assert squares == pytest.approx(((weights * factor[index]) ** 2).sum())


@pytest.mark.parametrize("allocation", [0.5, 1.0])
def test_it_resamples_where_the_effective_sample_size_of_the_wheel_is_low(allocation):
    """The weights that count are those after allocation."""
    poses, weights = random_cloud()
    bins = weighted(poses, weights, 600).bins(0)
    index = bins.index(poses)
    wheel = weights * np.bincount(index, weights, len(bins))[index] ** (allocation - 1.0)
    ratio = wheel.sum() ** 2 / (wheel**2).sum() / 600
    for ess_ratio, resamples in ((0.99 * ratio, False), (1.01 * ratio, True)):
        belief = weighted(poses, weights, 600, allocation=allocation, ess_ratio=ess_ratio)
        resample(belief.config, belief._cloud(0))
        got, w = belief.particles(0)
        assert (not np.array_equal(got, poses)) == resamples
        if not resamples:
            np.testing.assert_allclose(w, weights, rtol=1e-12)


# --- how many ------------------------------------------------------------------------------------


@pytest.mark.parametrize("allocation", [0.5, 1.0])
def test_as_many_particles_as_effective_states(allocation):
    poses, weights = random_cloud()
    belief = weighted(
        poses, weights, 1, n_max=100_000, per_state=30.0, allocation=allocation
    )  # fmt: skip
    bins = belief.bins(0)
    states = effective_states(np.bincount(bins.index(poses), weights, len(bins)), allocation)
    assert len(resampled(belief)[0]) == int(30.0 * states)
    for low, high in ((5_000, 6_000), (10, 20)):
        belief = weighted(poses, weights, low, n_max=high, per_state=30.0, allocation=allocation)
        assert len(resampled(belief)[0]) == np.clip(int(30.0 * states), low, high)


def test_kld_sizes_by_the_bins_that_the_sample_falls_into():
    poses, weights = random_cloud()
    kwargs = {"sizing": "kld", "kld_size": 0.25, "kld_angle": pi / 4, "n_max": 100_000}
    belief = weighted(poses, weights, 1, kld_error=0.02, kld_confidence=0.95, **kwargs)
    bins = belief._cloud(0).ground.kld_bins
    got, w = resampled(belief)
    occupied = len(np.unique(bins.index(got)))
    assert len(got) == kld_count(occupied, 0.02, 0.95)
    assert w.sum() == pytest.approx(1.0)
    assert bins.size == 0.25
    assert bins.n_headings == 8
    for low, high in ((30_000, 40_000), (50, 60)):
        belief = weighted(poses, weights, low, **kwargs | {"n_max": high})
        assert low <= len(resampled(belief)[0]) <= high
    assert len(resampled(weighted(poses, weights, 50, **kwargs | {"n_max": 60}))[0]) == 60


# --- like rooms ----------------------------------------------------------------------------------


def survivals(allocation, runs=60, rounds=40):
    """In how many runs a room of .02 is still there after repeated resampling."""
    alive = 0
    rooms = np.repeat([[0.1, 0.6, 0.1], [2.6, 2.6, -1.0]], [98, 2], axis=0)
    for seed in range(runs):
        belief = weighted(
            rooms, np.full(100, 0.01), 100, seed, allocation=allocation, resampling="multinomial"
        )
        for _ in range(rounds):
            resampled(belief)
        alive += bool((belief.particles(0)[0][:, 0] > 1.0).any())
    return alive


def test_an_unlikely_room_survives_longer_the_lower_the_allocation():
    """100 particles, 2 in a room that is like the other: drawn anew 40 times without evidence."""
    even, kept = survivals(1.0), survivals(0.5)
    print(f"alive in {even} of 60 runs with a = 1, in {kept} with a = 0.5")
    assert kept > even + 20


def test_the_mass_of_an_unlikely_room_is_better_known_the_lower_the_allocation():
    rooms = np.array([[0.1, 0.6, 0.1], [2.6, 2.6, -1.0]])
    spread = {}
    for allocation in (0.5, 1.0):
        masses = []
        for seed in range(200):
            belief = weighted(
                rooms, np.array([0.98, 0.02]), 200, seed, allocation=allocation,
                resampling="multinomial",
            )  # fmt: skip
            got, w = resampled(belief)
            masses.append(w[got[:, 0] > 1.0].sum())
        spread[allocation] = np.std(masses)
        assert np.mean(masses) == pytest.approx(0.02, abs=5 * np.std(masses) / np.sqrt(200))
    assert spread[0.5] < 0.6 * spread[1.0]


@pytest.mark.parametrize("allocation", [0.0, -0.1, 1.01, float("nan"), True, "even"])
def test_an_allocation_of_nonsense_is_refused(allocation):
    with pytest.raises(ConfigError, match=r"belief\.allocation must be a number in"):
        ParticleConfig(allocation=allocation)


def test_the_bins_that_are_held_are_the_slow_sum_and_leave_no_trace():
    poses, weights = random_cloud()
    weights[:200] = 0.0
    ground = weighted(poses, weights, 600)._cloud(0).ground
    slots, n = np.zeros(len(ground.bins), dtype=np.int32), len(poses)
    index, held, masses = np.full(n, -1, "i4"), np.full(n, -1, "i4"), np.full(n, np.nan)
    count = sum_bins(poses, weights, ground.corner, ground.shape, slots, index, held, masses)
    bins = ground.bins.index(poses)
    assert (slots == 0).all()
    np.testing.assert_array_equal(np.sort(held[:count]), np.unique(bins))
    np.testing.assert_array_equal(held[index], bins)
    expected = np.bincount(bins, weights, len(ground.bins))
    np.testing.assert_allclose(masses[:count], expected[held[:count]], rtol=1e-12)


def test_bins_that_are_named_twice_are_merged():
    held, masses = np.array([5, 2, 5, 0, 2], dtype="i4"), np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    slots = np.zeros(7, dtype=np.int32)
    assert merge(held, masses, slots) == 3
    np.testing.assert_array_equal(held[:3], [5, 2, 0])
    np.testing.assert_array_equal(masses[:3], [5.0, 18.0, 8.0])
    assert (slots == 0).all()


def test_the_masses_of_a_cloud_are_those_of_all_its_parts():
    poses, weights = random_cloud()
    belief = weighted(poses, weights / weights.sum(), 200)
    cloud = belief._cloud(0)
    cloud.n_kept = 250
    expected = np.bincount(cloud.ground.bins.index(poses), weights / weights.sum())
    resample(belief.config, cloud, always=True)
    held, masses = cloud.binned()
    assert len(np.unique(held)) == len(held)
    np.testing.assert_allclose(masses, expected[held], rtol=1e-9)
    assert masses.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("log_total", [0.0, -7.5])
def test_those_that_are_kept_stay_when_only_the_others_are_drawn_anew(log_total):
    poses, weights = random_cloud()
    weights[:500] = 1.0
    weights[500:] = np.linspace(0.0, 1.0, 100) ** 30  # Few of them count.
    weights /= weights.sum()
    belief = weighted(poses, weights, 60, n_max=1_000, n_elsewhere=60, allocation=1.0)
    cloud = belief._cloud(0)
    cloud.n_kept, cloud.log_w = 500, cloud.log_w + log_total
    twin = belief.copy()
    resample(belief.config, cloud)
    got, w = belief.particles(0)
    np.testing.assert_array_equal(got[:500], poses[:500])
    np.testing.assert_allclose(w[:500], weights[:500], rtol=1e-12)
    mean = weights[500:] @ poses[500:, :2] / weights[500:].sum()
    np.testing.assert_allclose(got[500:, :2].mean(axis=0), mean, atol=0.05)
    assert cloud.n_kept == 500
    assert len(got) == 560
    assert w[500:].sum() == pytest.approx(weights[500:].sum(), rel=1e-9)
    np.testing.assert_allclose(cloud.log_w - cloud.log_total, np.log(w), rtol=0.0, atol=1e-9)
    assert cloud.log_total == pytest.approx(log_total)
    np.testing.assert_array_equal(twin.particles(0)[0], poses)
    np.testing.assert_allclose(twin.particles(0)[1], weights, rtol=1e-12)


def test_what_is_allocated_is_the_slow_sum_whatever_lies_where_nothing_is():
    rng, power = np.random.default_rng(3), 0.6
    index, weights = rng.integers(0, 9, 600).astype("i4"), rng.random(600)
    weights[(index == 3) | (index == 7)] = 0.0
    masses = np.bincount(index, weights, 9)
    wheel, factor = np.full(600, np.nan), np.full(9, np.nan)
    mass, squares, states = allocate(weights, index, masses, power, factor, wheel)
    assert mass == pytest.approx(weights.sum())
    each = np.where(weights > 0.0, weights * np.maximum(masses[index], 1e-300) ** (power - 1), 0.0)
    np.testing.assert_allclose(wheel, each.cumsum(), rtol=1e-12)
    assert squares == pytest.approx((each**2).sum())
    assert states == pytest.approx(effective_states(masses / masses.sum(), power))
    assert (factor[masses == 0.0] == 0.0).all()
    assert allocate(0.0 * weights, index, np.zeros(9), power, factor, wheel) == (0.0, 0.0, 0.0)


def test_survivors_share_the_mass_in_inverse_proportion_to_their_bins_factors():
    chosen, index = np.array([0, 0, 2, 3]), np.array([1, 0, 1, 0], dtype=np.int32)
    out = np.empty(4)
    shares(chosen, index, np.array([4.0, 2.0]), 0.7, out)
    np.testing.assert_allclose(out, 0.7 * np.array([2.0, 2.0, 2.0, 1.0]) / 7.0)
