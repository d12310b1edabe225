"""Calibration: its scores against closed forms, its worlds against known posteriors, its teeth."""

import os
from dataclasses import replace
from itertools import pairwise
from math import inf, pi

import numpy as np
import pytest
from scipy import stats

from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.calibration import DEFECTS, Experiment, calibrate, runner
from activeloc.calibration.experiment import Bench
from activeloc.calibration.posterior import Posterior, likelihoods, posterior_of, rank, seen
from activeloc.calibration.scores import (
    LEVELS,
    Share,
    coverage,
    declarations,
    nees,
    uniformity,
)
from activeloc.errors import ConfigError
from activeloc.maps.text import from_text
from activeloc.motion import MotionModel, MotionNoise
from activeloc.sensors import BeamModel, LikelihoodField

HUT = """\
##########
#....#...#
#........#
#....#...#
#.....##.#
##########
"""
PLAIN = {
    "sigma_factor": 1.0,
    "likelihood_power": 1.0,
    "repetition": inf,
    "contact_floor": 1.0,
    "odometry_floor": 1.0,
    "leak": 0.0,
    "slip": 0.0,
}
HISTOGRAM = HistogramConfig(headings=12, least=0.0, precision="float64", **PLAIN)
PARTICLES = ParticleConfig(
    n_min=1000,
    n_max=1000,
    n_start=1000,
    roughening_xy=0.0,
    roughening_theta=0.0,
    recovery="none",
    directions=0,
    **PLAIN,
)
SENSOR = BeamModel(beams=2, field_of_view=pi / 3, sigma_hit=0.3, w_hit=0.82, w_rand=0.1)
MOTION = MotionModel(odometry=MotionNoise(0.2, 0.0, 0.05), radius=0.0)
COMMANDS = ((pi / 6, 0.0, 0.0), (-pi / 6, 0.0, 0.0), (0.0, 0.4, 0.0))


def experiment(belief=HISTOGRAM, **kwargs):
    """A weak sensor in a hut of 2 m x 1.2 m."""
    given = {
        "grid": from_text(HUT, 0.2),
        "sensor": SENSOR,
        "motion": MOTION,
        "filter_sensor": kwargs.get("sensor", SENSOR),
        "filter_motion": MOTION,
        "commands": COMMANDS,
        "world": "discrete" if isinstance(belief, HistogramConfig) else "continuous",
        "steps": 3,
    }
    return Experiment(belief=belief, **given | kwargs)


def posterior(poses, weights, truth, within=0.0):
    return Posterior(
        np.array(poses, dtype=float),
        np.array(weights, dtype=float),
        np.array(weights, dtype=float),
        within * np.eye(3),
        np.array(truth, dtype=float),
        0.0,
    )


# --- ranks ---------------------------------------------------------------------------------------


def test_a_rank_is_the_weight_below_and_a_share_of_the_equals():
    values, weights = np.array([3.0, 1.0, 2.0, 2.0]), np.array([0.4, 0.1, 0.2, 0.3])
    assert rank(values, weights, 2.0, 0.5) == pytest.approx(0.1 + 0.25)
    assert rank(values, weights, 2.5, 0.9) == pytest.approx(0.6)
    assert rank(values, weights, 0.0, 0.9) == 0.0
    assert rank(values, weights, 9.0, 0.1) == 1.0


def test_ranks_of_draws_from_the_posterior_are_uniform_in_every_quantity():
    rng = np.random.default_rng(0)
    poses = rng.integers(0, 3, (40, 3)).astype(float)
    weights = rng.dirichlet(np.full(40, 0.3))
    ranks, look = np.empty((1500, 5)), rng.integers(0, 5, 40).astype(float)
    for i in range(len(ranks)):
        j = rng.choice(40, p=weights)
        drawn = replace(posterior(poses, weights, poses[j]), p_truth=float(weights[j]))
        ranks[i] = drawn.ranks((look, look[j]), 2 * pi * rng.random(), rng.random(5))
    for column in ranks.T:
        assert uniformity(column).p > 1e-4


def test_the_zero_of_the_circle_is_where_headings_are_counted_from():
    given = posterior([[0, 0, -1.0], [0, 0, 1.0]], [0.25, 0.75], [0, 0, 1.0])
    look, shares = (np.zeros(2), 0.0), np.zeros(5)
    assert given.ranks(look, 0.0, shares)[2] == 0.0  # 1 rad comes first, 2 pi - 1 after it.
    assert given.ranks(look, pi, shares)[2] == 0.25


def test_uniformity_is_the_textbooks_two_tests():
    rng = np.random.default_rng(0)
    ranks = rng.random(1000)
    got = uniformity(ranks)
    counts = [((ranks >= i / 20) & (ranks < (i + 1) / 20)).sum() for i in range(20)]
    np.testing.assert_array_equal(got.counts, counts)
    chi2 = sum((n - 50) ** 2 / 50 for n in counts)
    assert got.chi2_p == pytest.approx(stats.chi2.sf(chi2, 19))
    assert got.ks_p == pytest.approx(stats.ks_1samp(ranks, stats.uniform.cdf).pvalue)
    assert got.p > 1e-3
    assert uniformity(ranks**1.5).p < 1e-6
    assert uniformity(np.append(ranks, [0.0, 1.0])).counts.sum() == 1002


# --- NEES ----------------------------------------------------------------------------------------


def test_nees_is_the_mahalanobis_distance():
    rng = np.random.default_rng(0)
    spread = np.array([[0.3, 0, 0], [0.1, 0.2, 0], [0.05, -0.02, 0.1]])
    poses = rng.normal(size=(500, 3)) @ spread.T + [1.0, -2.0, 3.1]
    poses[:, 2] = (poses[:, 2] + pi) % (2 * pi) - pi
    truth = np.array([1.2, -2.1, -3.1])
    got, variance = posterior(poses, np.full(500, 1 / 500), truth).nees(truth)
    unwrapped = poses.copy()
    unwrapped[poses[:, 2] < 0, 2] += 2 * pi
    error = truth + np.array([0, 0, 2 * pi]) - unwrapped.mean(axis=0)
    covariance = np.cov(unwrapped.T, bias=True)
    assert got == pytest.approx(error @ np.linalg.inv(covariance) @ error, rel=1e-3)
    assert variance == pytest.approx(6.0, abs=1.5)


def test_nees_averages_to_three_over_any_belief():
    rng = np.random.default_rng(1)
    poses = rng.uniform(-pi, pi, (60, 3))
    weights = rng.dirichlet(np.full(60, 0.2))
    values = [posterior(poses, weights, pose).nees(pose)[0] for pose in poses]
    assert weights @ values == pytest.approx(3.0, abs=1e-4)


def test_a_cloud_on_one_pose_has_a_finite_error():
    given = posterior([[1, 1, 0]] * 3, [0.2, 0.3, 0.5], [1, 1.1, 0])
    assert 1e3 < given.nees(given.truth)[0] < inf


def test_the_interval_of_the_nees_is_the_chi_squares():
    got = nees(np.full(1000, 3.2), np.full(1000, 6.0))
    assert (got.low, got.high) == pytest.approx((2.752, 3.261), abs=1e-3)
    assert got.reach == pytest.approx(3.2905 * np.sqrt(6.0 / 1000), abs=1e-4)
    assert got.holds
    assert not nees(np.full(1000, 3.4), np.full(1000, 6.0)).holds
    assert nees(np.full(1000, 3.4), np.full(1000, 60.0)).holds  # The beliefs have tails.
    assert not nees(np.full(1000, 2.5), np.full(1000, 6.0)).holds


# --- shares --------------------------------------------------------------------------------------


def test_coverage_counts_the_truths_in_the_sets_of_highest_probability():
    ranks = np.array([0.995, 0.7, 0.5, 0.3, 0.04, 0.001])
    assert [share.k for share in coverage(ranks)] == [3, 4, 4 + 0, 5]
    assert [share.promised for share in coverage(ranks)] == list(LEVELS)


def test_declarations_are_judged_when_first_made():
    mass = np.array([[0.2, 0.7, 0.9], [0.6, 0.3, 0.95], [0.1, 0.2, 0.3]])
    right = np.array([[True, False, True], [True, False, False], [True] * 3])
    half, much, most = declarations(mass, right, (0.5, 0.9, 0.99))
    assert (half.n, half.k) == (2, 1)
    assert half.promised == pytest.approx(1 - (0.7 + 0.6) / 2)
    assert (much.n, much.k) == (2, 1)
    assert (most.n, most.interval) == (0, (0.0, 1.0))
    assert np.isnan(most.value)


def test_a_shares_interval_is_exact():
    low, high = Share(0.5, 30, 0).interval
    assert low == 0.0
    assert high == pytest.approx(1 - 0.025 ** (1 / 30))


# --- beliefs and their truth ---------------------------------------------------------------------


def test_to_a_grid_the_truth_is_its_state():
    bench = Bench(experiment())
    bench.run("global", 0)
    belief, pose = bench.belief, bench.simulator.poses[0]
    got, grid, bel = posterior_of(belief, pose), belief.poses(0), belief.probabilities(0)
    cell, heading = grid.states_of(pose[None])
    np.testing.assert_array_equal(got.truth, seen(belief, pose))
    np.testing.assert_array_equal(got.truth, [*grid.centres[cell[0]], grid.thetas[heading[0]]])
    assert got.p_truth == pytest.approx(bel[cell[0], heading[0]])
    assert (got.poses == got.truth).all(axis=1).sum() == 1
    assert got.weights.sum() == pytest.approx(1.0)


def test_the_covariance_within_states_is_that_of_poses_drawn_in_them():
    bench = Bench(experiment(HistogramConfig(**{**PLAIN, "cell_size": 0.3, "headings": 12})))
    bench.run("global", 0)
    belief, rng = bench.belief, np.random.default_rng(0)
    grid, bel = belief.poses(0), belief.probabilities(0).astype(float)
    state = rng.choice(bel.size, 200_000, p=bel.ravel() / bel.sum())
    cell, heading = (part.astype(np.int32) for part in np.divmod(state, grid.headings))
    drawn = grid.sample_in(cell, heading, rng.random((len(state), 4)))
    centres = np.column_stack([grid.centres[cell], grid.thetas[heading]])
    expected = (drawn - centres).T @ (drawn - centres) / len(state)
    got = posterior_of(belief, bench.simulator.poses[0]).within
    np.testing.assert_allclose(got, expected, atol=1e-4)


def test_a_clouds_truth_has_the_mass_of_its_bin():
    bench = Bench(experiment(PARTICLES))
    bench.run("global", 0)
    got = posterior_of(bench.belief, bench.simulator.poses[0])
    x0, _, y0, _ = bench.experiment.grid.extent
    turn = (got.poses[:, 2] + pi) // (pi / 3)
    there = np.column_stack([np.floor(got.poses[:, :2] - [x0, y0]), turn])
    truth = [*np.floor(got.truth[:2] - [x0, y0]), (got.truth[2] + pi) // (pi / 3)]
    assert got.p_truth == pytest.approx(got.weights[(there == truth).all(axis=1)].sum())
    for i in (0, 500, 999):
        mass = got.weights[(there == there[i]).all(axis=1)].sum()
        assert got.p[i] == pytest.approx(mass)


@pytest.mark.parametrize("belief", [HISTOGRAM, PARTICLES])
def test_likelihoods_are_those_that_the_filter_weighs_by(belief):
    """One scan takes a belief from its prior to prior times likelihood."""
    bench = Bench(experiment(belief))
    bench._reset(bench.belief, np.random.default_rng(0), None)
    before = posterior_of(bench.belief, np.zeros(3))
    scan = np.array([0.5, np.nan])
    p = likelihoods(bench.belief, before.poses, scan)
    assert p.shape == (len(before.poses), 2)
    assert (p[:, 1] == 1.0).all()
    bench.belief.correct(0, scan)
    after = posterior_of(bench.belief, np.zeros(3))
    if len(after.poses) == len(before.poses) and (after.poses == before.poses).all():
        expected = before.weights * p[:, 0]
        np.testing.assert_allclose(after.weights, expected / expected.sum(), rtol=1e-3)
    else:
        assert after.weights @ likelihoods(bench.belief, after.poses, scan)[:, 0] == pytest.approx(
            (before.weights @ p[:, 0] ** 2) / (before.weights @ p[:, 0]), rel=0.05
        )


# --- replicates ----------------------------------------------------------------------------------


@pytest.mark.parametrize("belief", [HISTOGRAM, PARTICLES])
def test_a_replicate_follows_from_seed_start_and_number(belief):
    first = Bench(experiment(belief)).run("tracking", 7)
    bench = Bench(experiment(belief))
    bench.run("global", 3)
    for one, other in zip(bench.run("tracking", 7), first, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (bench.run("tracking", 8).ranks != first.ranks).all()
    assert (bench.run("global", 7).ranks != first.ranks).all()
    assert np.isnan(bench.run("global", 7).nees).all()
    assert np.isfinite(first.nees).all()


@pytest.mark.slow
def test_processes_do_not_change_the_results():
    few = replace(experiment(), steps=1)
    done = []
    alone = calibrate(few, 100, 100).summary()
    split = calibrate(few, 100, 100, 2, lambda start, n: done.append((start, n))).summary()
    assert {**alone, "timing": 0} == {**split, "timing": 0}
    assert sorted(done) == [("global", 25)] * 4 + [("tracking", 25)] * 4


def test_a_dead_process_is_an_error(monkeypatch):
    monkeypatch.setattr(runner, "_set_up", os._exit)
    with pytest.raises(ChildProcessError, match="a worker process died"):
        calibrate(replace(experiment(), steps=1), 100, 0, 2)


@pytest.mark.parametrize("start", ["global", "tracking"])
@pytest.mark.parametrize("belief", [HISTOGRAM, PARTICLES])
def test_the_truth_is_drawn_from_the_prior(belief, start):
    bench = Bench(experiment(belief))
    truths, nears = [], []
    for i in range(400):
        truth, near = bench._start(start, np.random.default_rng(i))
        truths.append(truth)
        nears.append(truth if near is None else near)
        assert bench._terrain.contains(truth)
    truths, nears = np.array(truths), np.array(nears)
    if start == "tracking":
        turn = (truths[:, 2] - nears[:, 2] + pi) % (2 * pi) - pi
        # On a grid, the prior is wider by three tenths of a bin, and flat within bins.
        degrees = 10.0 if belief is PARTICLES else np.sqrt(10.0**2 + 9.0**2 + 30.0**2 / 12.0)
        assert turn.std() == pytest.approx(np.deg2rad(degrees), rel=0.15)
        assert 0.05 < np.abs(truths[:, :2] - nears[:, :2]).mean() < 0.3
        return
    assert stats.kstest((truths[:, 2] + pi) / (2 * pi), "uniform").pvalue > 1e-4
    expected = np.zeros(bench.experiment.grid.shape)
    expected[bench._terrain.open] = 400 / bench._terrain.open.sum()
    cells = np.floor(bench.experiment.grid.to_cells(truths[:, :2])).astype(int)
    got = np.zeros_like(expected)
    np.add.at(got, (cells[:, 1], cells[:, 0]), 1)
    chi2 = ((got - expected)[expected > 0] ** 2 / expected[expected > 0]).sum()
    assert stats.chi2.sf(chi2, (expected > 0).sum() - 1) > 1e-4


def test_as_control_the_command_moves_robot_and_filter_by_one_law(monkeypatch):
    """The robot strays by the odometry's noise and the filter is told the command."""
    bench = Bench(experiment(motion=MotionModel(actuation=MotionNoise(9.0), radius=0.0)))
    assert bench.simulator.motion.actuation == MOTION.odometry
    told = []
    predict = HistogramBelief.predict
    monkeypatch.setattr(
        HistogramBelief,
        "predict",
        lambda self, robot, u, touched=False: (
            told.append((tuple(u), touched)),
            predict(self, robot, u, touched),
        ),
    )
    for i in range(4):
        bench.run("global", i)
    assert {u for u, _ in told} == set(COMMANDS)
    assert not any(touched for _, touched in told)


def test_as_control_the_odometry_knows_walls(monkeypatch):
    bench = Bench(experiment(control="odometry"))
    assert bench.simulator.motion.actuation == MOTION.actuation
    told = []
    monkeypatch.setattr(
        HistogramBelief, "predict", lambda self, robot, u, touched: told.append((u[1], touched))
    )
    for i in range(20):
        bench.run("global", i)
    assert any(touched for _, touched in told)
    assert all(abs(travel) < 0.3 for travel, touched in told if touched)


# --- teeth ---------------------------------------------------------------------------------------


def test_an_exact_filter_passes_and_keeps_its_promises():
    report = calibrate(experiment(), 400, 120)
    assert report.uniform
    assert {name for name, one in report.ranks.items() if one.p > 1e-4} == set(report.ranks)
    for level, share in report.coverage.items():
        low, high = stats.binom.interval(0.9999, 400, level)
        assert low <= share.k <= high
    for share in report.declarations.values():
        deviation = np.sqrt(share.promised * (1 - share.promised) / max(share.n, 1))
        assert share.n == 0 or abs(share.value - share.promised) <= 4 * deviation + 1 / share.n
    assert all(one.holds for one in report.nees)
    assert report.impossible == 0


@pytest.mark.parametrize("defect", ["cubed", "half-cell", "flipped"])
def test_a_planted_defect_of_the_histogram_filter_is_found(defect):
    report = calibrate(experiment(defect=defect), 300, 0)
    assert report.least_p < 1e-6
    assert not report.uniform


def test_too_sharp_a_sensor_is_found():
    many = replace(SENSOR, beams=12)
    assert calibrate(experiment(sensor=many, defect="sigma"), 300, 0).least_p < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("defect", ["cubed", "half-cell", "kept-weights"])
def test_a_planted_defect_of_the_particle_filter_is_found(defect):
    many = replace(SENSOR, beams=6, field_of_view=3.0)
    report = calibrate(experiment(PARTICLES, sensor=many, steps=4, defect=defect), 200, 0)
    assert report.least_p < 1e-6


@pytest.mark.slow
def test_the_defective_cloud_without_its_defect_is_sound():
    """What the planted filters share (their own weights and resampling) is not what is found."""
    from activeloc.calibration.defects import _OwnWeights

    bench = Bench(experiment(PARTICLES))
    bench.belief = _OwnWeights(1, PARTICLES, SENSOR, MOTION)
    ranks = np.array([bench.run("global", i).ranks for i in range(150)])
    assert min(uniformity(column).p for column in ranks.T) > 1e-4


def test_every_defect_can_be_planted_where_it_belongs():
    for defect in DEFECTS:
        assert isinstance(Bench(experiment(PARTICLES, defect=defect)).belief, ParticleBelief)
        if defect != "kept-weights":
            Bench(experiment(defect=defect))


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"world": "flat"}, "world must be one of continuous, discrete"),
        ({"control": "wish"}, "control must be one of command, odometry"),
        ({"steps": 0}, "steps must be an integer"),
        ({"seed": -1}, "seed must be an integer"),
        ({"belief": PARTICLES, "world": "discrete"}, "the histogram filter's"),
    ],
)
def test_an_experiment_that_cannot_be_is_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        experiment(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"defect": "sigmma"}, "did you mean 'sigma'"),
        ({"defect": "kept-weights"}, "the particle filter's"),
    ],
)
def test_a_defect_that_cannot_be_is_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        Bench(experiment(**given))


def test_a_sensor_without_a_sigma_cannot_be_sharpened():
    from activeloc.calibration.defects import _sharpened

    assert _sharpened(SENSOR).sigma_hit == pytest.approx(0.24)
    assert _sharpened(LikelihoodField()).sigma_hit < LikelihoodField().sigma_hit
    with pytest.raises(ConfigError, match="has no sigma_hit"):
        _sharpened(object())


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ((99, 0, 1), "replicates must be an integer in"),
        ((100, 99, 1), "tracks must be an integer in"),
        ((100, 0, 0), "jobs must be an integer in"),
        ((100, -1, 1), "tracks must be an integer in"),
    ],
)
def test_numbers_that_cannot_be_are_refused(counts, message):
    with pytest.raises(ConfigError, match=message):
        calibrate(experiment(), *counts)


def test_more_is_promised_at_a_higher_threshold_and_fewer_runs_reach_it():
    report = calibrate(experiment(), 100, 0)
    shares = [share for share in report.declarations.values() if share.n > 0]
    assert all(one.promised >= other.promised for one, other in pairwise(shares))
    assert all(one.n >= other.n for one, other in pairwise(shares))
    assert report.nees == []
    assert report.tracks == 0
