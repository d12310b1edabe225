"""Where particles stand, against plain sums."""

from math import pi

import numpy as np
import pytest

from activeloc.beliefs.common_bins import entropy
from activeloc.beliefs.particle_summary import localise, peak
from activeloc.motion import wrap


def test_the_peak_and_the_entropy_of_probabilities():
    p = np.random.default_rng(0).dirichlet(np.full(60, 0.2))
    p[::3] = 0.0
    held = np.random.default_rng(1).permutation(60).astype(np.int32)
    best, nats = peak(held, p[held])
    assert best == p.argmax()
    assert nats == pytest.approx(entropy(p))
    assert peak(held[:1], np.zeros(1)) == (held[0], 0.0)


def test_of_equal_peaks_it_is_the_first_bin():
    held = np.array([9, 4, 7, 2], dtype=np.int32)
    assert peak(held, np.array([0.4, 0.4, 0.1, 0.1]))[0] == 4
    assert peak(held, np.array([0.2, 0.3, 0.2, 0.3]))[0] == 2


@pytest.mark.parametrize("rounds", [0, 1, 3])
@pytest.mark.parametrize(("angle", "spread"), [(0.35, 0.3), (3.0, 1.0), (3.0, 9.0)])
def test_a_pose_moves_to_the_mean_of_the_mass_around_it(rounds, angle, spread):
    rng = np.random.default_rng(1)
    poses = rng.normal([1.0, 2.0, pi], [0.4, 0.4, spread], (4_000, 3))
    poses[:, 2] = wrap(poses[:, 2])
    weights = rng.dirichlet(np.ones(4_000))
    pose = np.array([1.3, 1.8, -3.0])
    expected = pose.copy()

    def window():
        offset = poses - expected
        offset[:, 2] = wrap(offset[:, 2])
        near = (np.hypot(*offset[:, :2].T) <= 0.5) & (np.abs(offset[:, 2]) <= angle)
        return offset[near], weights[near]

    for _ in range(rounds):
        offset, w = window()
        expected = expected + (w[:, None] * offset).sum(axis=0) / w.sum()
        expected[2] = wrap(expected[2])
    mass = localise(poses, weights, pose, 0.5, angle, rounds)
    np.testing.assert_allclose(pose, expected, atol=1e-12)
    assert mass == pytest.approx(window()[1].sum())


def test_where_there_is_nothing_a_pose_stays():
    pose = np.array([5.0, 5.0, 0.0])
    assert localise(np.zeros((3, 3)), np.full(3, 1 / 3), pose, 0.5, 0.3, 3) == 0.0
    np.testing.assert_array_equal(pose, [5.0, 5.0, 0.0])
