"""Noticing a kidnapped robot: Bayes' rule by hand, and two filters that find it again."""

from math import exp, inf, log, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activeloc.beliefs.carried_off import look_back, search
from activeloc.beliefs.particle_past import MOST_MOTIONS, REMEMBERED
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.recovery import RunningMeans
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, MotionNoise, Terrain, move, wrap
from activeloc.raycast import cast_scan
from activeloc.sensors import BeamModel

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
        reached, carried_out = move(terrain, pose[None], DRIVE)
        pose = reached[0]
        u = (carried_out + rng.standard_normal((1, 3)) * MOTION.odometry.sigma(carried_out))[0]
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
        background.append(belief.elsewhere(0))
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


def test_the_chance_grows_until_the_robot_is_looked_for_and_found():
    belief = tracker(4, leak=1e-3, widen=0.1)
    heard, searching = [], []
    for step, (pose, u, z) in enumerate(walk(20, 4, kidnapped_at=5)):
        belief.predict(0, u)
        before = belief.noticed(0)
        belief.correct(0, z)
        heard.append(belief.noticed(0) - before)
        searching.append(belief._cloud(0).searching)
        if heard[-1]:
            assert belief.mass_near(0, pose) > 0.05
            assert step >= 5
        elif step < 5:
            assert belief.elsewhere(0) < 0.01
        if searching[-1]:
            assert 0.025 <= belief.elsewhere(0) < 0.5
    assert sum(heard) == 1
    assert not searching[-1]
    assert belief.elsewhere(0) < 0.01
    assert belief.mass_near(0, pose) > 0.8


@pytest.mark.parametrize(("w", "goes_on"), [(0.004, False), (0.006, True), (0.4, True)])
def test_a_search_goes_on_until_it_has_found_or_has_given_up(w, goes_on):
    """Given up, those who came fall back to a few; found, the cloud is one again."""
    belief = tracker(0, widen=0.02, n_elsewhere=100)
    cloud = belief._cloud(0)
    found = belief.terrain(0).uniform_poses(np.random.default_rng(0).random((3_000, 4)))
    log_w = np.concatenate([np.full(1_000, log((1 - w) / 1_000)), np.full(3_000, log(w / 3_000))])
    cloud.join(found, log_w)
    cloud.searching = True
    search(belief.model, cloud)
    assert cloud.searching == goes_on
    assert cloud.elsewhere == pytest.approx(w)
    assert belief.n_particles(0) - cloud.n_kept == (3_000 if goes_on else 100)
    assert belief.noticed(0) == 0


def test_a_search_that_holds_half_of_the_belief_has_found():
    belief = tracker(0, widen=0.02)
    cloud = belief._cloud(0)
    cloud.join(np.tile(THERE, (1_000, 1)), np.log(np.full(2_000, 1 / 2_000)))
    cloud.searching = True
    search(belief.model, cloud)
    assert not cloud.searching
    assert belief.elsewhere(0) == 0.0
    assert belief.mass_near(0, THERE) == pytest.approx(0.5, abs=0.03)


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


def test_a_scan_that_only_a_robot_carried_off_reads_is_noticed_at_once():
    scan = np.full(12, np.nan)
    scan[[0, 4]] = cast_scan(flat(), THERE, SENSOR.bearings, 3.0)[[0, 4]]
    for recovery in ("none", "augmented"):
        assert certain(0.003, 500, recovery=recovery).correct(0, scan) == -inf
    belief = certain(0.003, 500, n_elsewhere=1)  # Too few: as many as at the start are tried.
    assert -inf < belief.correct(0, scan) < log(belief.config.leak)
    assert belief.noticed(0) == 1
    assert belief.elsewhere(0) == 0.0
    poses, weights = belief.particles(0)
    assert weights.sum() == pytest.approx(1.0)
    assert not (poses == HERE).all(axis=1).any()
    assert belief.mass_near(0, THERE) > 0.0


@pytest.mark.parametrize("recovery", ["background", "augmented"])
def test_a_scan_that_nothing_explains_changes_nothing(recovery):
    kwargs = {"n_max": 5, "n_start": 1, "n_elsewhere": 1, "recovery": recovery}
    belief = certain(0.003, 5, alpha_fast=1.0, reading_bin=0.02, **kwargs)
    at_here = np.minimum(cast_scan(flat(), HERE, SENSOR.bearings, 3.0), 2.9)
    assert belief.correct(0, at_here) > -inf
    assert belief.correct(0, np.full(12, 0.3)) == -inf
    np.testing.assert_array_equal(belief.particles(0)[0], np.tile(HERE, (5, 1)))
    np.testing.assert_array_equal(belief.particles(0)[1], 0.2)
    assert belief.noticed(0) == 0
    if recovery == "augmented":  # Of what it draws by the scan nothing explains it either.
        assert belief.correct(0, at_here - 0.04) > -inf
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
    assert belief.elsewhere(0) == 0.0
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


# --- Bayes' rule for a robot that may be carried off ---------------------------------------------

EXACT = MotionModel(odometry=MotionNoise(), actuation=MotionNoise(), radius=0.1)
LEAK = 0.02
STILL = {
    "slip": 0.0,
    "odometry_floor": 1.0,
    "leak": LEAK,
    "likelihood_power": 0.1,
    "ess_ratio": 1e-9,
    "n_start": 100_000,
    "n_elsewhere": 100_000,
    "directions": 128,
}


def drives(steps, kidnapped_at):
    """Odometry readings and scans, without noise of motion; the robot is carried off once."""
    terrain, pose = Terrain(flat(), 0.1), HERE
    rng = np.random.default_rng(8)
    for step in range(steps):
        pose = THERE if step == kidnapped_at else pose
        pose = move(terrain, pose[None], DRIVE)[0][0]
        ranges = cast_scan(flat(), pose, SENSOR.bearings, SENSOR.z_max)
        yield DRIVE, SENSOR.sample(ranges, rng.random((12, 2)))


def likelihood(belief, scan, poses):
    """``(N,)``; the filter's, by its own table of the sensor, pose by pose."""
    rows, law = belief.forecast(0, poses)
    readings = belief.reading_bins.index(scan)
    log_p = sum(law[readings[b], rows[:, b]].astype(np.float64) for b in range(len(scan)))
    return np.exp(log_p)


def exact_chances(belief, steps, n=400_000):
    """Probability of having been carried off after each step, and where: poses, weights.

    Slow and obvious: every step leaks to poses drawn over the ground; nobody is ever dropped.
    """
    terrain = belief.terrain(0)
    rng, here, kept = np.random.default_rng(5), HERE[None], 1.0
    poses, w, chances = np.empty((0, 3)), np.empty(0), []
    for u, z in steps:
        here, poses = move(terrain, here, u)[0], move(terrain, poses, u)[0]
        new = terrain.uniform_poses(rng.random((n, 4)))
        leaked = LEAK * (kept + w.sum())
        w = np.append((1.0 - LEAK) * w, np.full(n, leaked / n))
        poses = np.concatenate([poses, new])
        w, kept = w * likelihood(belief, z, poses), (1.0 - LEAK) * kept
        kept *= float(likelihood(belief, z, here)[0])
        w, kept = w / (w.sum() + kept), kept / (w.sum() + kept)
        chances.append(w.sum())
    return np.array(chances), poses, w


def still(seed, **kwargs):
    """A filter without noise, all of whose particles are HERE."""
    config = ParticleConfig(**{"n_min": 50} | PLAIN | STILL | kwargs)
    belief = ParticleBelief(1, config, SENSOR, EXACT)
    belief.reset(0, flat(), np.random.default_rng(seed), np.tile(HERE, (50, 1)))
    return belief


def logit(p):
    return np.log(p) - np.log1p(-p)


@pytest.mark.parametrize("kidnapped_at", [1, 99])
def test_newcomers_weigh_what_bayes_rule_says(kidnapped_at):
    steps = list(drives(4, kidnapped_at))
    exact, _, _ = exact_chances(still(0), steps)
    got = []
    for seed in range(3):
        belief, row = still(seed, widen=1.0), []
        for u, z in steps:
            belief.predict(0, u)
            evidence = belief.correct(0, z)
            row.append(belief.elsewhere(0))
        got.append(row)
        assert np.isfinite(evidence)
    off = logit(np.mean(got, axis=0)) - logit(exact)
    print(f"chance {exact.round(4)}, off by {off.round(2)}")
    # What is drawn by a scan is thinned: the first step has no noise but the probes'.
    np.testing.assert_allclose(off, 0.0, atol=0.2)
    assert abs(off[0]) < 0.1


def test_looking_back_finds_what_bayes_rule_says():
    steps = list(drives(5, 2))
    exact, where, weights = exact_chances(still(0), steps)
    got, mass = [], []
    for seed in range(16):
        belief = still(seed, widen=1.0, ess_ratio=0.5, n_min=20_000)
        for u, z in steps:
            belief.predict(0, u)
            belief.correct(0, z)
        cloud = belief._cloud(0)
        assert len(cloud.past.steps) == 5
        assert cloud.place.readings.any()
        look_back(belief.model, cloud)
        assert not cloud.place.readings.any()  # It may stand in another place.
        poses, w = belief.particles(0)
        here = (np.abs(poses - belief_pose(belief, steps)) < 1e-4).all(axis=1)
        got.append(w[~here].sum())
        mass.append(w[~here] @ (poses[~here, 0] > 4.5))
    print(f"chance {exact[-1]:.4f}, found {np.mean(got):.4f} +- {np.std(got):.4f}")
    assert exact[-1] > 0.05
    assert logit(np.mean(got)) == pytest.approx(logit(exact[-1]), abs=0.25)
    assert np.mean(mass) == pytest.approx(weights @ (where[:, 0] > 4.5), abs=0.05)


def belief_pose(belief, steps):
    """Where a robot is that started HERE and was not carried off."""
    pose = HERE[None]
    for u, _ in steps:
        pose = move(belief.terrain(0), pose, u)[0]
    return np.append(pose[0, :2], wrap(pose[0, 2]))


def test_the_evidence_is_the_mixture_s():
    (u, z), *_ = drives(1, 99)
    belief = still(3, n_elsewhere=40_000)
    belief.predict(0, u)
    ground = belief.terrain(0).uniform_poses(np.random.default_rng(1).random((60_000, 4)))
    here = move(belief.terrain(0), HERE[None], u)[0]
    anywhere = likelihood(belief, z, ground).mean()
    mixture = LEAK * anywhere + (1.0 - LEAK) * likelihood(belief, z, here)[0]
    assert exp(belief.correct(0, z)) == pytest.approx(mixture, rel=1e-3)
    assert belief.elsewhere(0) == pytest.approx(LEAK * anywhere / mixture, rel=0.1)


def test_a_scan_that_counts_for_nothing_is_no_evidence():
    belief = still(0, widen=1.0, repetition=0.0)
    (u, z), *_ = drives(1, 99)
    belief.predict(0, u)
    belief.correct(0, z)
    poses, weights = belief.particles(0)
    assert belief.correct(0, z) == 0.0
    np.testing.assert_array_equal(belief.particles(0)[0], poses)
    np.testing.assert_allclose(belief.particles(0)[1], weights, rtol=1e-12)


def test_the_past_remembers_so_many_scans_that_count():
    belief = still(0, widen=1.0, repetition=0.0)
    turn = np.array([0.0, 0.0, 2.0 * pi])
    for step, (u, z) in enumerate(drives(REMEMBERED + 4, 99)):
        belief.predict(0, u)
        belief.correct(0, z)
        belief.predict(0, turn)
        belief.correct(0, z)  # Read again from the same place: it does not count.
        past = belief._cloud(0).past
        assert len(past.steps) == min(step + 1, REMEMBERED)
        assert len(past.motions) == 1
        assert len(past.steps[-1].motions) == (1 if step == 0 else 2)
    assert all(step.scan.weights.any() for step in past.steps)


def test_a_robot_that_turns_on_the_spot_for_ever_forgets_its_past():
    belief = still(0, widen=1.0, repetition=0.0)
    (u, z), *_ = drives(1, 99)
    belief.predict(0, u)
    belief.correct(0, z)
    past = belief._cloud(0).past
    for turns in range(1, MOST_MOTIONS + 1):
        belief.predict(0, np.array([0.0, 0.0, 2.0 * pi]))
        assert (len(past.steps), len(past.motions)) == (1, turns)
    belief.predict(0, np.array([0.0, 0.0, 2.0 * pi]))
    assert (past.steps, past.motions) == ([], [])
    belief.predict(0, u)
    belief.correct(0, z)
    assert len(past.steps) == len(past.steps[0].motions) == 1


def test_a_past_belongs_to_its_copy_alone():
    belief = still(0, widen=1.0)
    steps = list(drives(3, 99))
    for u, z in steps:
        belief.predict(0, u)
        belief.correct(0, z)
    twin = belief.copy()
    w = belief.elsewhere(0)
    belief.predict(0, steps[0][0])
    belief.correct(0, steps[0][1])
    assert len(twin._cloud(0).past.steps) == 3
    assert twin._cloud(0).past.motions == []
    assert twin.elsewhere(0) == w != belief.elsewhere(0)


def test_newcomers_lie_on_open_ground_behind_those_that_are_kept():
    belief = still(1, widen=1.0, n_elsewhere=2_000)
    (u, z), *_ = drives(1, 99)
    belief.predict(0, u)
    belief.correct(0, z)
    poses, w = belief.particles(0)
    assert len(poses) == 50 + 2_000 // 20
    assert np.ptp(poses[:50], axis=0).max() == 0.0
    assert belief.terrain(0).contains(poses[50:]).all()
    assert w[50:].sum() == belief.elsewhere(0) > 0.0
    np.testing.assert_allclose(w[50:], w[50], rtol=1e-9)


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
