"""Noticing a kidnapped robot: Bayes' rule by hand, and two filters that find it again."""

from fractions import Fraction
from itertools import product
from math import exp, inf, log, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.recovery import RunningMeans, background_after
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, MotionNoise, Terrain
from activeloc.raycast import cast_scan
from activeloc.sensors import BeamModel

# --- the background's weight ---------------------------------------------------------------------

SHARES = st.fractions(0, 1, max_denominator=1000)
EVIDENCE = st.fractions(Fraction(1, 10**6), 1, max_denominator=10**6)


@given(SHARES, SHARES, EVIDENCE, EVIDENCE)
def test_the_background_is_weighed_by_bayes_rule(w, leak, uniform, local):
    bar = w + leak * (1 - w)
    exact = bar * uniform / (bar * uniform + (1 - bar) * local)
    got = background_after(float(w), float(leak), log(uniform), log(local))
    assert got == pytest.approx(float(exact), rel=1e-9, abs=1e-15)


def test_without_a_leak_nothing_grows_from_nothing():
    for log_uniform, log_local in [(-1.0, -50.0), (-50.0, -1.0), (-inf, -3.0), (-3.0, -inf)]:
        assert background_after(0.0, 0.0, log_uniform, log_local) == 0.0


def test_what_cannot_explain_the_scan_is_out():
    assert background_after(0.2, 0.01, -5.0, -inf) == 1.0
    assert background_after(0.2, 0.01, -inf, -5.0) == 0.0


def test_where_neither_explains_the_scan_only_the_step_counts():
    assert background_after(0.2, 0.5, -inf, -inf) == pytest.approx(0.6)
    assert background_after(0.2, 0.0, -inf, -inf) == 0.2


LOGS = [-inf, -1e300, -1e5, -1000.0, -700.0, 0.0]


@pytest.mark.parametrize("leak", [0.0, 1e-200, 1e-5, 1.0])
def test_extreme_evidence_gives_a_probability(leak):
    for w, log_uniform, log_local in product([0, 5e-324, 1e-9, 0.5, 1 - 1e-16, 1], LOGS, LOGS):
        got = background_after(float(w), leak, log_uniform, log_local)
        assert 0.0 <= got <= 1.0
        if 1e-9 <= w < 0.9 and leak < 1.0 and inf > abs(log_uniform - log_local) > 250.0:
            assert got == pytest.approx(float(log_uniform > log_local), abs=1e-99)


# --- running means -------------------------------------------------------------------------------


def test_running_means_by_hand():
    means = RunningMeans(0.001, 0.1)
    assert means.add(1.0) == 0.0
    assert (means.slow, means.fast) == (1.0, 1.0)
    assert means.add(0.5) == pytest.approx(1.0 - 0.95 / 0.9995, abs=1e-12)
    assert (means.slow, means.fast) == pytest.approx((0.9995, 0.95), abs=1e-15)
    means = RunningMeans(0.001, 0.1)
    assert means.add(0.5) == 0.0
    assert means.add(0.0) == pytest.approx(1.0 - 0.45 / 0.4995, abs=1e-12)
    assert means.add(9.0) == 0.0  # Better than ever: nothing to look for.
    assert means.fast > means.slow


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_the_share_to_draw_anew_is_a_share(likelihoods):
    means = RunningMeans(0.05, 0.4)
    slow = fast = None
    for likelihood in likelihoods:
        share = means.add(likelihood)
        if not slow:
            slow = fast = likelihood
        else:
            slow, fast = slow + 0.05 * (likelihood - slow), fast + 0.4 * (likelihood - fast)
        assert 0.0 <= share <= 1.0
        assert means.slow == pytest.approx(slow, rel=1e-12)
        assert means.fast == pytest.approx(fast, rel=1e-12)
        expected = max(0.0, 1.0 - fast / slow) if slow else 0.0
        assert share == pytest.approx(expected, abs=1e-12)


def test_equal_rates_never_draw_anew():
    means = RunningMeans(0.2, 0.2)
    assert [means.add(p) for p in (0.9, 0.1, 0.5, 0.0)] == [0.0] * 4


# --- a robot that is carried off -----------------------------------------------------------------

MOTION = MotionModel(odometry=MotionNoise(0.05, 0.05, 0.05), radius=0.1)
SENSOR = BeamModel(12, 2 * pi, z_max=3.0, sigma_hit=0.1)
DRIVE = np.array([0.35, 0.3, 0.0])
HERE, THERE = np.array([1.6, 1.2, 0.3]), np.array([6.2, 2.6, -2.0])


def flat():
    """8.2 m x 4.4 m of rooms that look alike nowhere."""
    cells = np.zeros((44, 82), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[:30, 30] = 1
    cells[24, 30:44] = 1
    cells[12:, 50] = 1
    cells[34:38, 10:16] = 1
    cells[6:9, 60:72] = 1
    cells[30:44, 74:] = 1
    return OccupancyGrid(cells, 0.1, (-0.2, -0.3))


def walk(steps, seed, kidnapped_at=None):
    """True poses, odometry readings and scans of a robot that drives in circles."""
    rng, terrain, pose = np.random.default_rng(seed), Terrain(flat(), MOTION.radius), HERE
    for step in range(steps):
        if step == kidnapped_at:
            pose = THERE
        reached, carried_out = MOTION.execute(terrain, pose[None], DRIVE, np.zeros((1, 3)))
        pose = reached[0]
        u = MOTION.read_odometry(carried_out, rng.standard_normal((1, 3)))[0]
        z = SENSOR.sample(
            cast_scan(flat(), pose, SENSOR.bearings, SENSOR.z_max), rng.random((12, 2))
        )
        yield pose, u, z


def tracker(seed, **kwargs):
    config = ParticleConfig(**{"n_min": 1_000, "n_max": 20_000, "n_start": 20_000} | kwargs)
    belief = ParticleBelief(1, config, SENSOR, MOTION)
    belief.reset_near(0, flat(), np.random.default_rng(seed), HERE, (0.1, 0.05))
    return belief


def followed(belief, steps, seed, kidnapped_at=None):
    """Mass near the truth and weight of the background after each step."""
    near, background = [], []
    for pose, u, z in walk(steps, seed, kidnapped_at):
        belief.predict(0, u)
        belief.correct(0, z)
        near.append(belief.mass_near(0, pose))
        background.append(belief.background(0))
    return np.array(near), np.array(background)


RECOVERIES = [
    {"recovery": "background", "leak": 1e-3},
    {"recovery": "augmented", "injection": "scan", "alpha_slow": 0.05, "alpha_fast": 0.5},
    {"recovery": "augmented", "injection": "free", "alpha_slow": 0.05, "alpha_fast": 0.5},
]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kwargs", RECOVERIES, ids=["background", "scan", "free"])
def test_a_kidnapped_robot_is_found_again(kwargs, seed):
    belief = tracker(seed, **kwargs)
    near, _ = followed(belief, 26, seed, kidnapped_at=6)
    assert near[:6].min() > 0.8
    assert near[-1] > 0.8
    assert belief.noticed(0) == (1 if kwargs["recovery"] == "background" else 0)


@pytest.mark.parametrize("seed", range(3))
def test_without_recovery_it_is_not(seed):
    belief = tracker(seed, recovery="none")
    near, background = followed(belief, 26, seed, kidnapped_at=6)
    assert near[:6].min() > 0.8
    assert near[6:].max() < 0.1
    assert belief.noticed(0) == 0
    assert (background == 0.0).all()


def test_the_background_grows_until_it_is_drawn_and_begins_again_at_zero():
    belief = tracker(4, leak=1e-3, widen=0.9)
    heard = []
    for step, (pose, u, z) in enumerate(walk(16, 4, kidnapped_at=5)):
        belief.predict(0, u)
        before = belief.noticed(0)
        belief.correct(0, z)
        heard.append(belief.noticed(0) - before)
        if heard[-1]:
            assert belief.background(0) == 0.0
            assert belief.mass_near(0, pose) > 0.05
            assert belief.n_particles(0) <= 20_000
            assert step >= 5
        elif step < 5:
            assert belief.background(0) < 0.01
    assert sum(heard) == 1
    never = tracker(4, leak=1e-3, widen=1.0)
    near, background = followed(never, 12, 4, kidnapped_at=5)
    assert background[:5].max() < 0.01
    assert background[7] > 0.99
    assert never.noticed(0) == 0
    assert near[5:].max() < 0.1


def test_a_robot_that_nobody_carries_off_is_not_looked_for():
    """50 runs of 12 steps."""
    runs = []
    for seed in range(50):
        belief = tracker(100 + seed, n_min=500)
        near, _ = followed(belief, 12, 100 + seed)
        runs.append((belief.noticed(0), near[-1]))
    noticed, near = np.array(runs).T
    print(f"noticed in {(noticed > 0).sum()} of 50 runs, mass near the truth {near.min():.2f}")
    assert noticed.sum() == 0
    assert near.min() > 0.8


@pytest.mark.parametrize("readings", [12, 1])
def test_the_weight_of_the_background_is_bayes_rule_for_the_scan(readings):
    """One scan, by hand: mean likelihood over the particles against that over the open ground."""
    belief = tracker(0, leak=0.01, widen=1.0, ess_ratio=1e-9, directions=0)
    scan = np.array([1.0, np.nan, 2.0, 0.5, inf, 1.0, 1.0, 3.0, 0.7, 0.2, 0.3, 2.2])
    scan[readings:] = np.nan

    def mean_likelihood(poses, weights):
        rows, law = belief.forecast(0, poses)
        index = belief.reading_bins.index(np.minimum(scan, 3.0))
        used = index >= 0
        log_p = np.take_along_axis(law[index[used]].astype(np.float64).T, rows[:, used], axis=0)
        return weights @ np.exp(log_p.sum(axis=1))

    local = mean_likelihood(*belief.particles(0))
    anywhere = mean_likelihood(belief._cloud(0).ground.probes, np.full(1_000, 1e-3))
    evidence = belief.correct(0, scan)
    assert exp(evidence) == pytest.approx(0.01 * anywhere + 0.99 * local, rel=1e-5)
    assert belief.background(0) == pytest.approx(0.01 * anywhere / exp(evidence), rel=1e-5)
    if readings == 1:  # The fewer readings, the more of the ground does a probe stand for.
        ground = belief.terrain(0).uniform_poses(np.random.default_rng(1).random((40_000, 4)))
        exact = mean_likelihood(ground, np.full(40_000, 1 / 40_000))
        assert anywhere == pytest.approx(exact, rel=0.1)


CERTAIN = {"w_hit": 1.0, "w_short": 0.0, "w_max": 0.0, "w_rand": 0.0}
PLAIN = {
    "sigma_factor": 1.0,
    "roughening_xy": 0.0,
    "roughening_theta": 0.0,
    "repetition": inf,
    "directions": 0,
}


def certain(sigma, n, **kwargs):
    """``n`` particles in one place, and a sensor to which most readings are impossible."""
    config = ParticleConfig(**{"n_min": n} | PLAIN | kwargs)
    belief = ParticleBelief(1, config, BeamModel(12, 2 * pi, 3.0, sigma, **CERTAIN), MOTION)
    belief.reset(0, flat(), np.random.default_rng(0), np.tile(HERE, (n, 1)))
    return belief


def test_a_scan_that_only_the_background_explains_widens_the_belief_at_once():
    scan = np.full(12, np.nan)
    scan[[0, 4]] = cast_scan(flat(), THERE, SENSOR.bearings, 3.0)[[0, 4]]
    for recovery in ("none", "augmented"):
        assert certain(0.003, 500, recovery=recovery).correct(0, scan) == -inf
    belief = certain(0.003, 500)
    assert -inf < belief.correct(0, scan) < log(belief.config.leak)
    assert belief.noticed(0) == 1
    assert belief.background(0) == 0.0
    poses, weights = belief.particles(0)
    assert weights.sum() == pytest.approx(1.0)
    assert not (poses == HERE).all(axis=1).any()
    assert belief.mass_near(0, THERE) > 0.0


def test_too_few_poses_to_explain_a_scan_change_nothing():
    """Of what is drawn anew nothing explains it: no NaN, and the next scan may."""
    belief = certain(0.003, 5, n_max=5, n_start=1)
    scan = np.full(12, np.nan)
    scan[0] = 0.3
    assert belief.correct(0, scan) > -inf
    assert belief.noticed(0) == 0
    assert belief.background(0) == 1.0
    np.testing.assert_array_equal(belief.particles(0)[0], np.tile(HERE, (5, 1)))
    np.testing.assert_array_equal(belief.particles(0)[1], 0.2)

    belief = certain(0.003, 5, n_max=5, recovery="augmented", alpha_fast=1.0, reading_bin=0.02)
    at_here = np.minimum(cast_scan(flat(), HERE, SENSOR.bearings, 3.0), 2.9)
    for scan in (at_here, at_here - 0.04):
        assert belief.correct(0, scan) > -inf
    assert belief._cloud(0).means.fast < 0.2 * belief._cloud(0).means.slow
    np.testing.assert_array_equal(belief.particles(0)[0], np.tile(HERE, (5, 1)))


def test_a_leak_of_one_forgets_everything():
    belief = tracker(0, leak=1.0, widen=0.99)
    (_, u, z), *_ = walk(1, 0)
    belief.predict(0, u)
    assert np.isfinite(belief.correct(0, z))
    assert belief.noticed(0) == 1


@pytest.mark.parametrize("injection", ["scan", "free"])
def test_augmented_mcl_keeps_track_where_scans_count_different_numbers_of_readings(injection):
    """A direction read again from one place counts for nothing: no reason to look around."""
    lowest = []
    for seed in range(12):
        belief = tracker(100 + seed, recovery="augmented", injection=injection)
        lowest.append(followed(belief, 20, 100 + seed)[0].min())
    print(f"least mass near the truth {np.sort(lowest).round(2)}")
    assert min(lowest) > 0.6
    assert np.median(lowest) > 0.9


def test_a_scan_that_counts_for_nothing_does_not_move_the_means():
    belief = tracker(0, recovery="augmented")
    scan = cast_scan(flat(), HERE, SENSOR.bearings, 3.0)
    belief.correct(0, scan)
    means = belief._cloud(0).means
    before = means.slow, means.fast
    poses = belief.particles(0)[0]
    belief.correct(0, scan)
    assert (means.slow, means.fast) == before
    np.testing.assert_array_equal(belief.particles(0)[0], poses)


# --- injection -----------------------------------------------------------------------------------


@pytest.mark.parametrize("injection", ["scan", "free"])
def test_injected_poses_lie_on_open_ground_and_are_as_many_as_the_means_say(injection):
    n = 120_000
    belief = tracker(
        0, n_min=n, n_max=n, recovery="augmented", injection=injection, alpha_slow=0.001,
        alpha_fast=1.0, roughening_xy=0.0, roughening_theta=0.0, allocation=1.0, repetition=inf,
    )  # fmt: skip
    belief.reset(0, flat(), np.random.default_rng(0), np.tile(HERE, (n, 1)))
    first = belief.correct(0, np.minimum(cast_scan(flat(), HERE, SENSOR.bearings, 3.0), 3.0))
    np.testing.assert_array_equal(belief.particles(0)[0], np.tile(HERE, (n, 1)))
    scan = np.full(12, np.nan)
    scan[[0, 4, 7]] = 2.6, 2.4, 2.2  # Where HERE are walls at 1.8 m.
    before, fast = exp(first / 12), exp(belief.correct(0, scan) / 3)  # Geometric means.
    slow = before + 0.001 * (fast - before)
    poses, weights = belief.particles(0)
    injected = poses[(poses != HERE).any(axis=1)]
    assert len(injected) == int((1.0 - fast / slow) * n) > 100_000
    np.testing.assert_allclose(weights, 1.0 / n)
    assert belief.terrain(0).contains(injected).all()
    assert (injected[:, 2] >= -pi).all()
    assert (injected[:, 2] < pi).all()
    assert belief.background(0) == 0.0
    # Where they are: over the open ground, or as the scan's likelihood.
    ground = belief.terrain(0).uniform_poses(np.random.default_rng(1).random((200_000, 4)))
    rows, law = belief.forecast(0, ground)
    index, rows = belief.reading_bins.index(scan)[[0, 4, 7]], rows[:, [0, 4, 7]]
    log_p = np.take_along_axis(law[index].T, rows, axis=0).sum(axis=1)
    p = np.exp(log_p) if injection == "scan" else np.ones(len(ground))
    bins = belief.bins(0)
    expected = np.bincount(bins.index(ground), p, len(bins)) / p.sum()
    share = np.bincount(bins.index(injected), minlength=len(bins)) / len(injected)
    assert 0.5 * np.abs(share - expected).sum() < 0.1
    even = np.bincount(bins.index(ground), minlength=len(bins)) / len(ground)
    if injection == "scan":
        assert 0.5 * np.abs(even - expected).sum() > 0.3


# --- what a belief with a background says --------------------------------------------------------


def with_background(w):
    belief = tracker(3)
    for _, u, z in walk(2, 3):
        belief.predict(0, u)
        belief.correct(0, z)
    cloud = belief._cloud(0)
    cloud.background, cloud.masses = w, None
    return belief


@pytest.mark.parametrize("w", [1e-3, 0.3, 0.9])
def test_entropy_and_mass_are_those_of_the_mixture(w):
    plain, mixed = with_background(0.0), with_background(w)
    bins, terrain = plain.bins(0), plain.terrain(0)
    poses, weights = plain.particles(0)
    # The open ground, bin by bin: cells lie whole in bins of five cells a side.
    cells = terrain.grid.to_metres(terrain.open_cells[:, ::-1] + 0.5)
    theta = -pi + (np.arange(12) + 0.5) * (pi / 6)
    every = np.column_stack([np.repeat(cells, 12, axis=0), np.tile(theta, len(cells))])
    uniform = np.bincount(bins.index(every), minlength=len(bins)) / len(every)
    local = np.bincount(bins.index(poses), weights, len(bins))
    mixture = (1.0 - w) * local + w * uniform
    held, open_ = mixture[mixture > 0.0], uniform[uniform > 0.0]
    one, two = plain.summarise(0), mixed.summarise(0)
    assert two.entropy == pytest.approx(-(held * np.log(held)).sum(), abs=1e-9)
    assert two.entropy > one.entropy
    assert two.uniform_entropy == pytest.approx(-(open_ * np.log(open_)).sum())
    np.testing.assert_allclose(two.estimate, one.estimate, atol=1e-12)
    offset = poses - one.estimate
    near = (np.hypot(offset[:, 0], offset[:, 1]) <= 0.5) & (
        np.abs((offset[:, 2] + pi) % (2 * pi) - pi) <= np.deg2rad(20.0)
    )
    assert one.mass == pytest.approx(weights[near].sum(), abs=1e-9)
    assert two.mass == pytest.approx((1.0 - w) * one.mass, abs=1e-12)
    assert mixed.mass_near(0, HERE) == pytest.approx((1.0 - w) * plain.mass_near(0, HERE))


@pytest.mark.parametrize("w", [0.0, 0.3, 0.9])
def test_samples_are_drawn_from_elsewhere_in_proportion(w):
    belief, n = with_background(w), 20_000
    drawn = belief.sample(0, n, np.random.default_rng(0))
    held = {tuple(pose) for pose in belief.particles(0)[0]}
    elsewhere = np.array([tuple(pose) not in held for pose in drawn])
    assert elsewhere.sum() == pytest.approx(w * n, abs=1)
    assert belief.terrain(0).contains(drawn).all()
    if w:
        strange = drawn[elsewhere]
        ground = belief.terrain(0).uniform_poses(np.random.default_rng(1).random((50_000, 4)))
        np.testing.assert_allclose(strange.mean(axis=0), ground.mean(axis=0), atol=0.06)
        np.testing.assert_allclose(strange.std(axis=0), ground.std(axis=0), rtol=0.03)


@pytest.mark.parametrize("w", [0.3, 0.9])
def test_a_view_shows_the_background(w):
    shown, plain = with_background(w).view(0, 4, 8, 8), with_background(0.0).view(0, 4, 8, 8)
    assert shown.sum() == pytest.approx(1.0)
    background = (shown - (1.0 - w) * plain) / w
    ground = tracker(0)
    uniform = ground.terrain(0).uniform_poses(np.random.default_rng(1).random((50_000, 4)))
    ground.reset(0, flat(), np.random.default_rng(0), uniform)
    assert 0.5 * np.abs(background - ground.view(0, 4, 8, 8)).sum() < 0.1
    assert background.min() > -1e-12


def test_a_background_belongs_to_its_copy_alone():
    belief = with_background(0.3)
    twin = belief.copy()
    _, u, z = next(iter(walk(1, 9, kidnapped_at=0)))
    belief.predict(0, u)
    belief.correct(0, z)
    assert twin.background(0) == 0.3
    assert twin.noticed(0) == 0
    assert belief.background(0) != 0.3


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"recovery": "maybe"}, "belief.recovery must be one of background, augmented, none"),
        ({"injection": "free space"}, "belief.injection must be one of scan, free"),
        ({"widen": 0.0}, "belief.widen"),
        ({"leak": 1.5}, "belief.leak"),
        ({"alpha_slow": 0.2, "alpha_fast": 0.1}, "belief.alpha_slow"),
        ({"alpha_slow": 0.0}, "belief.alpha_slow"),
        ({"alpha_fast": 1.1}, "belief.alpha_fast"),
    ],
)
def test_settings_of_nonsense_are_refused(kwargs, message):
    with pytest.raises(ConfigError, match=message):
        ParticleConfig(**kwargs)
