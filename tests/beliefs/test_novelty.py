"""The distance filter: beams too short for the belief are dropped, and no others."""

from math import sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.novelty import POSES, drop_novel, p_short
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.errors import ConfigError, ScanError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain
from activeloc.sensors import BeamModel, LikelihoodField, ProximityModel

Z_MAX, SIGMA, GAMMA = 3.0, 0.1, 0.99
MOTION = MotionModel(radius=0.1)


def hall():
    """Walls at x = 0.1 and 7.9: from x the range along +x is 7.9 - x."""
    cells = np.zeros((20, 80), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    return OccupancyGrid(cells, 0.1)


def beam(kind=BeamModel, **settings):
    return kind(beams=1, field_of_view=0.0, z_max=Z_MAX, sigma_hit=SIGMA, **settings)


class Places:
    """A belief of a few poses that look along +x, each with its share."""

    def __init__(self, ranges, shares=(1.0,)):
        self.poses = np.array([[7.9 - z, 1.0, 0.0] for z in ranges])
        self.counts = np.round(np.array(shares) * POSES).astype(int)
        assert self.counts.sum() == POSES

    def sample(self, robot, n, rng):
        assert n == POSES
        return np.repeat(self.poses, self.counts // np.gcd.reduce(self.counts), axis=0)

    def terrain(self, robot):
        return Terrain(hall(), 0.1)


def kept(belief, z, sensor=None, gamma=GAMMA):
    """Whether a reading survives."""
    rng = np.random.default_rng(0)
    used = drop_novel(belief, 0, sensor or beam(), np.array([z]), gamma, rng)
    assert used.shape == (1,)
    return bool(used[0] == z)


@pytest.mark.parametrize("z_expected", [0.0, 0.05, 1.0, 2.95])
@pytest.mark.parametrize("z", [0.0, 0.04, 0.9, 1.2, 2.99])
def test_p_short_is_the_tail_of_a_hit(z, z_expected):
    density = norm(z_expected, SIGMA).pdf
    points = [z_expected] if z < z_expected < Z_MAX else None
    near = max(0.0, z_expected - 1.0)
    tail = quad(density, z, Z_MAX, points=points, epsabs=1e-13)[0]
    whole = quad(density, near, Z_MAX, points=[z_expected], epsabs=1e-13)[0]
    got = p_short(np.array(z), np.array(z_expected), SIGMA, Z_MAX)
    assert got == pytest.approx(tail / whole, abs=1e-9)


def test_p_short_where_nothing_is_in_range_and_at_the_maximum():
    z = np.array([0.0, 2.999, Z_MAX])
    np.testing.assert_array_equal(p_short(z, np.full(3, Z_MAX), SIGMA, Z_MAX), [1, 1, 0])
    np.testing.assert_array_equal(p_short(z, np.full(3, 1.0), SIGMA, Z_MAX)[2], 0)
    assert np.isnan(p_short(np.array([np.nan, np.nan]), np.array([1.0, Z_MAX]), SIGMA, Z_MAX)).all()


@pytest.mark.parametrize("gamma", [0.9, 0.99, 0.999])
def test_one_place_drops_below_the_quantile_of_a_hit(gamma):
    """P_short(z) > gamma exactly if z < z* + sigma q(1 - gamma)."""
    edge = 2.0 + SIGMA * norm.ppf(1.0 - gamma)
    belief = Places([2.0])
    assert not kept(belief, edge - 0.001, gamma=gamma)
    assert kept(belief, edge + 0.001, gamma=gamma)


def test_expected_and_long_readings_are_kept():
    for z in (1.9, 2.0, 2.1, 2.9, Z_MAX):
        assert kept(Places([2.0]), z)


def test_where_nothing_is_in_range_only_no_echo_is_kept():
    belief = Places([5.0])
    assert kept(belief, Z_MAX)
    assert not kept(belief, 2.9)


@pytest.mark.parametrize(("share", "is_kept"), [(0.5, True), (0.974, True), (0.986, False)])
def test_two_places_weigh_their_shares(share, is_kept):
    """1 m is the wall's range at one place, where P_short is 1/2, and far too short at the other.

    P_short = share + (1 - share) / 2 is above .99 exactly if share > .98.
    """
    assert kept(Places([2.5, 1.0], [share, 1.0 - share]), 1.0) is is_kept


def test_no_echo_and_no_reading_are_left_as_they_are():
    sensor = BeamModel(beams=3, field_of_view=0.0, z_max=Z_MAX, sigma_hit=SIGMA)
    scan = np.array([np.inf, np.nan, 0.3])
    used = drop_novel(Places([2.0]), 0, sensor, scan, GAMMA, np.random.default_rng(0))
    np.testing.assert_array_equal(used, [Z_MAX, np.nan, np.nan])
    np.testing.assert_array_equal(scan, [np.inf, np.nan, 0.3])


def test_a_mixture_that_explains_people_drops_them_all_the_same():
    """The probability is of hits alone."""
    sensor = beam(w_hit=0.4, w_short=0.55)
    assert not kept(Places([2.0]), 1.0, sensor)
    assert not kept(Places([2.0]), 1.0, beam(ProximityModel, p_unknown=0.05, p_known=0.5))
    assert not kept(Places([2.0]), 1.0, beam(LikelihoodField))
    assert kept(Places([2.0]), 1.95, beam(LikelihoodField))


def test_gamma_zero_draws_nothing_and_one_drops_nothing():
    rng = np.random.default_rng(5)
    before = rng.bit_generator.state
    used = drop_novel(Places([2.0]), 0, beam(), np.array([0.1]), 0.0, rng)
    assert used == [0.1]
    assert rng.bit_generator.state == before
    assert kept(Places([5.0]), 0.1, gamma=1.0)


def one_cell():
    belief = HistogramBelief(1, HistogramConfig(cell_size=0.1), beam(), MOTION)
    belief.reset(0, hall())
    poses = belief.poses(0)
    cell, heading = poses.states_of(np.array([[5.95, 0.95, 0.01]]))
    prior = np.zeros_like(belief.probabilities(0))
    prior[cell[0], heading[0]] = 1.0
    belief.reset(0, hall(), prior)
    return belief


def one_pose():
    belief = ParticleBelief(1, ParticleConfig(n_min=5, n_max=50), beam(), MOTION)
    poses = np.tile([5.95, 0.95, 0.0], (50, 1))
    belief.reset(0, hall(), np.random.default_rng(0), poses)
    return belief


@pytest.mark.parametrize("make", [one_cell, one_pose])
def test_both_filters_beliefs_can_be_asked(make):
    """The wall is 1.95 m away; the belief is not changed by the question."""
    belief = make()
    before = belief.summarise(0)
    assert [kept(belief, z) for z in (0.5, 1.5, 1.9, 2.0, 2.5, Z_MAX)] == [False] * 2 + [True] * 4
    assert belief.summarise(0).entropy == before.entropy


def test_a_belief_without_an_idea_drops_little():
    belief = HistogramBelief(1, HistogramConfig(cell_size=0.2), beam(), MOTION)
    belief.reset(0, hall())
    assert all(kept(belief, z) for z in (0.3, 0.6, 1.0, 2.0))


def test_hits_are_dropped_as_often_as_gamma_says():
    """From the true place: a hundredth of the hits."""
    n = 20_000
    sensor = BeamModel(beams=4000, field_of_view=0.0, z_max=Z_MAX, sigma_hit=SIGMA)
    scans = np.random.default_rng(3).normal(2.0, SIGMA, (n // 4000, 4000))
    rng = np.random.default_rng(0)
    used = [drop_novel(Places([2.0]), 0, sensor, scan, GAMMA, rng) for scan in scans]
    assert np.isnan(used).mean() == pytest.approx(0.01, abs=5 * sqrt(0.01 * 0.99 / n))


@pytest.mark.parametrize("gamma", [-0.1, 1.1, np.nan, "0.99", True])
def test_gammas_that_are_no_probability_are_refused(gamma):
    with pytest.raises(ConfigError, match="novelty must be a number"):
        kept(Places([2.0]), 1.0, gamma=gamma)
    for config in (HistogramConfig, ParticleConfig):
        with pytest.raises(ConfigError, match=r"belief\.novelty must be a number in \[0, 1\]"):
            config(novelty=gamma)


@pytest.mark.parametrize("scan", [[1.0, 2.0], [-0.1], [9.0]])
def test_scans_that_are_none_are_refused(scan):
    with pytest.raises(ScanError):
        drop_novel(Places([2.0]), 0, beam(), np.array(scan), GAMMA, np.random.default_rng(0))
