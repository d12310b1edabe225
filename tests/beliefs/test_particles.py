"""The particle filter against importance sampling without resampling, and its rules by hand."""

from math import inf, log, pi, sqrt

import numpy as np
import pytest

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.errors import ConfigError, ScanError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, MotionNoise, move
from activeloc.sensors import BeamModel, LikelihoodField

MOTION = MotionModel(odometry=MotionNoise(0.13, 0.05, 0.1), radius=0.1)
SENSOR = BeamModel(3, pi / 3, sigma_hit=0.3, w_hit=0.8, w_short=0.05, w_max=0.05, w_rand=0.1)
OFF = {
    "per_state": 0.0,
    "sigma_factor": 1.0,
    "likelihood_power": 1.0,
    "roughening_xy": 0.0,
    "roughening_theta": 0.0,
    "repetition": inf,
    "contact_floor": 1.0,
    "odometry_floor": 1.0,
    "leak": 0.0,
    "slip": 0.0,
    "directions": 0,
    "allocation": 1.0,
}
STEPS = [  # What the odometry read and what the beams read.
    ((0.5, 0.3, 0.0), (0.4, 0.9, 1.5)),
    ((-0.9, 0.4, 0.2), (0.7, 0.5, 0.6)),
    ((0.0, -0.2, 0.0), (0.9, 0.7, 1.2)),
]


def hall():
    """Asymmetric, 2 m x 2.8 m."""
    cells = np.zeros((40, 56), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[10:14, 30:34] = 1
    cells[30:, 8] = 1
    return OccupancyGrid(cells, 0.05, (0.4, -1.0))


def cloud(n, seed=0, sensor=SENSOR, **kwargs):
    config = ParticleConfig(**{"n_min": n, "n_max": n, "n_start": n} | OFF | kwargs)
    belief = ParticleBelief(1, config, sensor, MOTION)
    belief.reset(0, hall(), np.random.default_rng(seed))
    return belief


def posterior(belief):
    """Masses after all steps, on 24 bins, and the log-evidence."""
    evidence = 0.0
    for u, scan in STEPS:
        belief.predict(0, np.array(u))
        evidence += belief.correct(0, np.array(scan))
    return belief.view(0, 4, 2, 3), evidence


def set_weights(belief, log_w):
    inside = belief._cloud(0)
    inside.log_w[:], inside.weights, inside.masses = log_w, None, None


def importance(n, seed):
    """Paths drawn from the prior, each weighed by its scans: no resampling, no tables."""
    rng, terrain = np.random.default_rng(seed), cloud(1).terrain(0)
    poses, log_w = terrain.uniform_poses(rng.random((n, 4))), np.zeros(n)
    bins = cloud(1).reading_bins
    for u, scan in STEPS:
        poses = MOTION.sample(terrain, poses, np.array(u), rng.standard_normal((n, 3)))[0]
        index = bins.index(np.array(scan))
        for bearing, z in zip(SENSOR.bearings, index, strict=True):
            rays = poses + np.array([0.0, 0.0, bearing])
            expected = SENSOR.expected(terrain.grid, rays)
            high = SENSOR.cdf(bins.edges[z + 1], expected) if z + 1 < len(bins) else 1.0
            log_w += np.log(high - SENSOR.cdf(bins.edges[z], expected))
    shown = cloud(n)
    shown.reset(0, hall(), rng, poses)
    set_weights(shown, log_w)
    return shown.view(0, 4, 2, 3), float(np.logaddexp.reduce(log_w) - log(n))


@pytest.fixture(scope="module")
def reference():
    parts = [importance(150_000, seed) for seed in range(3)]
    return np.mean([p for p, _ in parts], axis=0), float(np.mean([e for _, e in parts]))


def total_variation(p, q):
    return 0.5 * np.abs(p - q).sum()


@pytest.mark.parametrize("resampling", ["systematic", "stratified", "multinomial", "residual"])
def test_many_particles_agree_with_importance_sampling(resampling, reference):
    masses, evidence = posterior(cloud(100_000, ess_ratio=1.0, resampling=resampling))
    assert total_variation(masses, reference[0]) < 0.02
    # The log-evidence of one run of 100,000 particles strays by 0.012 (standard deviation).
    assert evidence == pytest.approx(reference[1], abs=0.04)


@pytest.mark.parametrize("ess_ratio", [1.0])
def test_error_falls_like_one_over_the_root_of_n(ess_ratio):
    truth = np.mean(
        [posterior(cloud(150_000, s, ess_ratio=ess_ratio))[0] for s in (90, 91)], axis=0
    )
    sizes = np.array([250, 1000, 4000, 16_000])
    errors = []
    for n, repeats in zip(sizes, (48, 24, 12, 8), strict=True):
        runs = [posterior(cloud(int(n), 100 + r, ess_ratio=ess_ratio))[0] for r in range(repeats)]
        errors.append(np.mean([total_variation(run, truth) for run in runs]))
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    print(f"total variation {np.round(errors, 4)}, slope {slope:.3f}")
    assert slope == pytest.approx(-0.5, abs=0.1)
    assert errors[-1] < 0.06


@pytest.mark.slow
def test_error_at_full_sample_sizes():
    truth = np.mean([posterior(cloud(400_000, s, ess_ratio=1.0))[0] for s in range(5)], axis=0)
    sizes = 250 * 2 ** np.arange(7)
    errors = [
        np.mean([total_variation(posterior(cloud(int(n), 100 + r, ess_ratio=1.0))[0], truth)
                 for r in range(100)])
        for n in sizes
    ]  # fmt: skip
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    print(f"total variation {np.round(errors, 4)}, slope {slope:.3f}")
    assert slope == pytest.approx(-0.5, abs=0.05)


def test_agrees_with_a_fine_grid():
    """Two filters, one world: the grid's own cells cost it a few hundredths."""
    config = HistogramConfig(
        cell_size=0.1, headings=72, reading_bin=0.1, sigma_factor=1.0, likelihood_power=1.0,
        repetition=inf, contact_floor=1.0, odometry_floor=1.0, least=0.0, precision="float64",
    )  # fmt: skip
    grid = HistogramBelief(1, config, SENSOR, MOTION)
    grid.reset(0, hall())
    masses, evidence = posterior(cloud(200_000))
    on_grid, grid_evidence = posterior(grid)
    assert total_variation(masses, on_grid) < 0.04
    assert evidence == pytest.approx(grid_evidence, abs=0.05)


# --- updates -------------------------------------------------------------------------------------


def test_no_reading_leaves_the_belief_as_it_was_to_the_bit():
    belief = cloud(1000)
    belief.correct(0, np.array([0.5, 1.0, 0.7]))
    before = belief.particles(0)
    assert belief.correct(0, np.full(3, np.nan)) == 0.0
    for array, copy in zip(belief.particles(0), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_a_scan_that_tells_nothing_leaves_the_belief_as_it_was_to_the_bit():
    belief = cloud(1000, repetition=0.0, leak=0.0)
    belief.correct(0, np.array([0.5, 1.0, 0.7]))
    before = belief.particles(0)
    assert belief.correct(0, np.array([0.1, 0.1, 0.1])) == 0.0
    for array, copy in zip(belief.particles(0), before, strict=True):
        np.testing.assert_array_equal(array, copy)
    belief.place(0).clear()
    assert belief.correct(0, np.array([0.5, 1.0, 0.7])) != 0.0


def test_impossible_evidence_keeps_the_prediction():
    sure = BeamModel(3, pi / 3, sigma_hit=0.01, w_hit=1.0, w_short=0.0, w_max=0.0, w_rand=0.0)
    belief = cloud(100, sensor=sure)
    belief.reset(0, hall(), np.random.default_rng(0), np.tile([1.2, -0.2, 0.0], (100, 1)))
    before = belief.particles(0)
    assert belief.correct(0, np.array([0.01, 0.01, 0.01])) == -inf
    for array, copy in zip(belief.particles(0), before, strict=True):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("sensor", [SENSOR, LikelihoodField(3, pi / 3, sigma_hit=0.3)])
def test_splitting_the_beams_in_two_updates_changes_nothing(sensor):
    scan, whole = np.array([0.5, 1.5, 0.7]), cloud(2000, sensor=sensor, ess_ratio=1e-6)
    parts = whole.copy()
    evidence = whole.correct(0, scan)
    split = [parts.correct(0, np.where(mask, scan, np.nan)) for mask in ([0, 1, 0], [1, 0, 1])]
    assert evidence == pytest.approx(sum(split), abs=1e-9)
    np.testing.assert_allclose(whole.particles(0)[1], parts.particles(0)[1], rtol=1e-9)


def test_the_order_of_the_particles_does_not_matter():
    belief = cloud(500, ess_ratio=1e-6)
    poses, _ = belief.particles(0)
    order = np.random.default_rng(1).permutation(500)
    twin = belief.copy()
    twin.reset(0, hall(), np.random.default_rng(0), poses[order])
    scan = np.array([0.5, 1.5, 0.7])
    assert belief.correct(0, scan) == pytest.approx(twin.correct(0, scan), abs=1e-12)
    np.testing.assert_allclose(belief.particles(0)[1][order], twin.particles(0)[1], rtol=1e-12)
    np.testing.assert_allclose(belief.view(0, 4, 2, 3), twin.view(0, 4, 2, 3), atol=1e-12)


def test_doubling_the_particles_changes_no_estimate():
    belief = cloud(500, ess_ratio=1e-6)
    twin = belief.copy()
    twin.reset(0, hall(), np.random.default_rng(0), np.repeat(belief.particles(0)[0], 2, axis=0))
    for b in (belief, twin):
        b.correct(0, np.array([0.5, 1.5, 0.7]))
    one, two = belief.summarise(0), twin.summarise(0)
    np.testing.assert_allclose(one.estimate, two.estimate, atol=1e-9)
    assert one.entropy == pytest.approx(two.entropy, abs=1e-9)
    assert one.mass == pytest.approx(two.mass, abs=1e-9)


@pytest.mark.parametrize(("radius", "angle"), [(0.5, 0.35), (2.0, pi), (0.1, 3.0)])
def test_the_mass_near_a_pose_is_that_of_the_particles_there(radius, angle):
    belief, pose = cloud(2_000, ess_ratio=1e-6), np.array([1.1, 0.4, 3.0])
    belief.correct(0, np.array([0.5, 1.5, 0.7]))
    poses, w = belief.particles(0)
    turn = np.abs((poses[:, 2] - pose[2] + pi) % (2 * pi) - pi)
    there = (np.hypot(*(poses - pose)[:, :2].T) <= radius) & (turn <= angle)
    assert 0 < there.sum() < len(poses)
    assert belief.mass_near(0, pose, radius, angle) == pytest.approx(w[there].sum(), abs=1e-12)


def test_weights_are_equal_after_resampling_and_counted_by_the_entropy():
    belief = cloud(5000, ess_ratio=1.0, n_min=300, n_max=5000, per_state=5.0)
    belief.correct(0, np.array([0.5, 1.5, 0.7]))
    poses, weights = belief.particles(0)
    assert 300 <= len(poses) <= 5000
    np.testing.assert_allclose(weights, 1 / len(poses))
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)


def test_roughening_has_the_spread_it_says_and_stays_on_open_ground():
    belief = cloud(50_000, ess_ratio=1.0, roughening_xy=0.05, roughening_theta=0.1)
    start = np.array([1.0, 0.1, pi - 0.01])
    rng = np.random.default_rng(0)
    poses = np.where(rng.random((50_000, 1)) < 0.5, start, [2.6, -0.5, 1.0])
    belief.reset(0, hall(), rng, poses)
    belief.correct(0, np.array([0.5, 0.5, 0.5]))
    got = belief.particles(0)[0]
    got = got[np.hypot(*(got[:, :2] - start[:2]).T) < 0.5] - start
    got[:, 2] = (got[:, 2] + pi) % (2 * pi) - pi
    np.testing.assert_allclose(got.std(axis=0), [0.05, 0.05, 0.1], rtol=0.05)
    crowd = cloud(20_000, ess_ratio=1.0, roughening_xy=0.3)
    crowd.correct(0, np.array([0.5, 1.5, 0.7]))
    poses = crowd.particles(0)[0]
    assert crowd.terrain(0).contains(poses).all()
    assert (poses[:, 2] >= -pi).all()
    assert (poses[:, 2] < pi).all()


def test_likelihood_is_widened_and_tempered_as_configured():
    plain, wide = cloud(1000, ess_ratio=1e-6), cloud(1000, ess_ratio=1e-6, sigma_factor=2.0)
    assert wide.sensor.sigma_hit == 0.6
    tempered = cloud(1000, ess_ratio=1e-6, likelihood_power=0.5)
    scan = np.array([0.5, 1.5, 0.7])
    for belief in (plain, tempered):
        belief.correct(0, scan)
    expected = np.sqrt(plain.particles(0)[1])
    np.testing.assert_allclose(tempered.particles(0)[1], expected / expected.sum(), rtol=1e-5)


def test_particles_that_a_wall_stopped_weigh_the_floor():
    belief = cloud(20_000, odometry_floor=0.05)
    still = ParticleBelief(
        1, belief.config, SENSOR, MotionModel(odometry=MotionNoise(), radius=0.1)
    )
    still.reset(0, hall(), np.random.default_rng(0))
    start, _ = still.particles(0)
    still.predict(0, np.array([0.0, 0.6, 0.0]))
    done = move(still.terrain(0), start, np.array([0.0, 0.6, 0.0]))[1][:, 1]
    weights = still.particles(0)[1]
    ratio = weights[done < 0.5].max() / weights[done > 0.55].min()
    assert ratio == pytest.approx(0.05)
    assert np.ptp(weights[done < 0.5]) == 0.0


def test_a_refused_motion_is_evidence_of_a_wall_ahead_once():
    belief = cloud(20_000, contact_floor=0.02, contact_reach=0.2)
    poses, _ = belief.particles(0)
    ahead = move(belief.terrain(0), poses, np.array([0.0, 0.2, 0.0]))[1][:, 1]
    belief.predict(0, np.zeros(3), touched=True)
    weights = belief.particles(0)[1]
    near = ahead < 0.2
    assert weights[~near].max() / weights[near].min() == pytest.approx(0.02)
    belief.predict(0, np.zeros(3), touched=True)
    np.testing.assert_array_equal(belief.particles(0)[1], weights)


# --- the object ----------------------------------------------------------------------------------


def test_a_copy_is_independent_and_continues_alike():
    belief = cloud(2000, roughening_xy=0.02, repetition=1.0, contact_floor=0.02, leak=0.01)
    posterior(belief)
    twin = belief.copy()
    before = belief.particles(0)
    ends = []
    for b in (twin, belief):
        if b is belief:
            for array, copy in zip(belief.particles(0), before, strict=True):
                np.testing.assert_array_equal(array, copy)
        b.predict(0, np.array([0.3, 0.3, 0.0]), touched=True)
        b.correct(0, np.array([0.3, 0.9, np.nan]))
        ends.append(b.particles(0))
    for mine, yours in zip(*ends, strict=True):
        np.testing.assert_array_equal(mine, yours)


def test_a_start_near_a_pose_has_its_moments():
    belief = cloud(50_000)
    pose = np.array([1.2, 0.1, pi - 0.05])
    belief.reset_near(0, hall(), np.random.default_rng(0), pose, (0.1, 0.2))
    poses, _ = belief.particles(0)
    offset = poses - pose
    offset[:, 2] = (offset[:, 2] + pi) % (2 * pi) - pi
    np.testing.assert_allclose(offset.mean(axis=0), 0.0, atol=5 * 0.2 / sqrt(50_000))
    np.testing.assert_allclose(offset.std(axis=0), [0.1, 0.1, 0.2], rtol=0.03)
    assert belief.terrain(0).contains(poses).all()


def test_malformed_scans_change_nothing():
    belief = cloud(100)
    before = belief.particles(0)
    for scan in (np.zeros(2), np.array([0.5, -1.0, 0.5]), np.array([0.5, 0.5, 9.0])):
        with pytest.raises(ScanError):
            belief.correct(0, scan)
    for array, copy in zip(belief.particles(0), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_headings_given_in_any_turn_are_the_same_headings():
    belief, twin = cloud(400, directions=64), cloud(400, directions=64)
    poses, _ = belief.particles(0)
    turned = poses + np.outer(np.arange(400) % 7 - 3, [0.0, 0.0, 2 * pi])
    before = turned.copy()
    twin.reset(0, hall(), np.random.default_rng(0), turned)
    np.testing.assert_array_equal(turned, before)
    np.testing.assert_allclose(twin.particles(0)[0], poses, atol=1e-14)
    belief.reset(0, hall(), np.random.default_rng(0), poses)
    np.testing.assert_array_equal(belief.particles(0)[0], poses)
    scan = np.array([0.5, 1.5, 0.7])
    assert twin.correct(0, scan) == pytest.approx(belief.correct(0, scan), abs=1e-9)
    assert twin.summarise(0).entropy == pytest.approx(belief.summarise(0).entropy, abs=1e-9)


@pytest.mark.parametrize(
    "poses",
    [
        np.zeros((0, 3)),
        np.zeros((5, 2)),
        np.zeros(3),
        np.array([[1.0, 0.0, np.nan]]),
        np.array([[np.inf, 0.0, 0.0]]),
    ],
)
def test_poses_that_are_none_are_refused(poses):
    with pytest.raises(ConfigError, match=r"poses must be \(N, 3\) finite numbers"):
        cloud(10).reset(0, hall(), np.random.default_rng(0), poses)


def test_a_robot_without_a_belief_is_refused():
    with pytest.raises(ConfigError, match="robot 0 has no belief yet"):
        ParticleBelief(1, ParticleConfig(), SENSOR, MOTION).summarise(0)
