"""The bins of entropy: by hand, and grid against particles on one belief."""

from math import log, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain
from activeloc.sensors import BeamModel


def building():
    """Asymmetric, 4 m x 6.5 m, with origin off zero and sides that 0.5 does not divide."""
    cells = np.zeros((83, 131), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[30:34, :60] = 1
    cells[34:60, 80:86] = 1
    cells[60:, 30:33] = 1
    return OccupancyGrid(cells, 0.05, (-0.7, 1.9))


def test_entropy_by_hand():
    assert entropy(np.full(7, 1 / 7)) == pytest.approx(log(7), abs=1e-12)
    assert entropy(np.array([0.0, 1.0, 0.0])) == 0.0
    assert entropy(np.array([[0.5, 0.0], [0.0, 0.5]])) == pytest.approx(log(2), abs=1e-12)
    assert entropy(np.array([0.75, 0.25])) == pytest.approx(log(4) - 0.75 * log(3), abs=1e-12)
    assert entropy(np.full(10_000, 1e-4, dtype=np.float32)) == pytest.approx(log(1e4), abs=1e-6)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=50).filter(lambda p: sum(p) > 0))
def test_entropy_lies_between_zero_and_the_uniform(p):
    p = np.array(p) / sum(p)
    assert -1e-12 <= entropy(p) <= log(len(p)) + 1e-9


def test_index_and_centres_are_inverse():
    bins = CommonBins(building())
    assert bins.shape == (9, 14)
    every = np.arange(len(bins))
    np.testing.assert_array_equal(bins.index(np.array([bins.centre(k) for k in every])), every)


def test_bins_by_hand():
    bins = CommonBins(building())
    poses = np.array(
        [
            [-0.7, 1.9, -pi],
            [-0.21, 1.91, -pi + 0.1],
            [-0.19, 1.91, pi - 0.1],
            [-0.69, 2.41, pi],
            [-5.0, -5.0, 0.01],
        ]
    )
    np.testing.assert_array_equal(bins.index(poses), [0, 0, 12 + 11, 14 * 12, 6])


def coarse(grid):
    """The common bins under a grid's states."""
    bins = CommonBins(building())
    return bins, CoarseBins.over(grid, bins.origin, bins.size, bins.shape, bins.n_headings)


@pytest.mark.parametrize("cell_size", [0.05, 0.1, 0.2, 0.25, 0.3, 0.7])
@pytest.mark.parametrize("headings", [4, 12, 20, 72])
def test_shares_sum_to_one_and_equal_areas(cell_size, headings):
    grid = PoseGrid(Terrain(building(), 0.2), cell_size, headings)
    bins, shares = coarse(grid)
    rows = np.zeros((shares.shape[0], grid.shape[0]))
    for y, first in enumerate(shares.row_first):
        there = rows[y, first : first + shares.row_shares.shape[1]]
        there += shares.row_shares[y, : len(there)]
    np.testing.assert_allclose(shares.col_shares.sum(axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(rows.sum(axis=0), 1.0, atol=1e-6)
    np.testing.assert_allclose(shares.headings.sum(axis=0), 1.0, atol=1e-6)
    told = np.zeros_like(shares.headings)
    coarse_heading = np.repeat(np.arange(len(told)), np.diff(shares.heading_start))
    told[coarse_heading, shares.heading_bin] = shares.heading_share
    np.testing.assert_array_equal(told, shares.headings)
    assert shares.even == (headings // 12 if headings % 12 == 0 else 0)
    # The oracle throws points at a few cells and sees where they fall.
    rng, tolerance = np.random.default_rng(0), 5 * 0.5 / np.sqrt(20_000)
    for row, col in grid.cells[rng.choice(len(grid.cells), 5, replace=False)]:
        corner = np.array([col, row]) * cell_size + bins.origin
        poses = np.zeros((20_000, 3))
        poses[:, :2] = corner + rng.random((20_000, 2)) * cell_size
        thrown = np.bincount(bins.index(poses) // 12, minlength=len(bins) // 12) / 20_000
        cols = np.bincount(shares.col_bins[col], shares.col_shares[col], minlength=bins.shape[1])
        np.testing.assert_allclose(np.outer(rows[:, row], cols).ravel(), thrown, atol=tolerance)
    for k in range(headings):
        theta = grid.thetas[k] + (rng.random(20_000) - 0.5) * grid.bin_width
        poses = np.column_stack([np.zeros((20_000, 2)), theta])
        thrown = np.bincount(bins.index(poses) % 12, minlength=12) / 20_000
        np.testing.assert_allclose(shares.headings[:, k], thrown, atol=tolerance)


def test_heading_bins_by_hand():
    shares = coarse(PoseGrid(Terrain(building(), 0.2), 0.5, 72))[1].headings
    np.testing.assert_allclose(shares, np.repeat(np.eye(12), 6, axis=1), atol=1e-6)
    # 18 degrees in 30: the second is cut 12 : 6.
    shares = coarse(PoseGrid(Terrain(building(), 0.2), 0.5, 20))[1].headings.T
    told = [{int(b): round(float(row[b]), 6) for b in np.flatnonzero(row > 1e-6)} for row in shares]
    assert told[:3] == [{0: 1.0}, {0: 0.666667, 1: 0.333333}, {1: 1.0}]
    assert told[19] == {11: 1.0}


def beliefs(sigma):
    """A grid and 200,000 particles with one belief: uniform, or Gaussians around two poses."""
    grid, motion, sensor = building(), MotionModel(), BeamModel()
    histogram = HistogramBelief(1, HistogramConfig(), sensor, motion)
    particles = ParticleBelief(1, ParticleConfig(n_max=200_000), sensor, motion)
    rng = np.random.default_rng(0)
    histogram.reset(0, grid)
    particles.reset(0, grid, rng)
    if sigma is not None:
        poses, terrain = histogram.poses(0), histogram.terrain(0)
        fine = terrain.uniform_poses(rng.random((800_000, 4)))
        weight = np.zeros(len(fine))
        for pose in ((0.6, 2.6, 1.0), (4.9, 3.3, -3.1)):
            offset = fine - pose
            offset[:, 2] = (offset[:, 2] + pi) % (2 * pi) - pi
            weight += np.exp(-0.5 * ((offset / [sigma, sigma, sigma]) ** 2).sum(axis=1))
        weight /= weight.sum()
        cell, heading = poses.states_of(fine)
        flat = np.bincount(
            cell.astype(np.int64) * 72 + heading, weight, minlength=len(poses.cells) * 72
        )
        histogram.reset(0, grid, flat.reshape(-1, 72))
        chosen = rng.choice(len(fine), 200_000, p=weight)
        particles.reset(0, grid, rng, fine[chosen])
    return histogram.summarise(0), particles.summarise(0)


@pytest.mark.parametrize("sigma", [None, 1.0, 0.3])
def test_grid_and_particles_agree_on_the_entropy_of_one_belief(sigma):
    grid, cloud = beliefs(sigma)
    assert grid.entropy == pytest.approx(cloud.entropy, abs=0.07)
    assert grid.uniform_entropy == pytest.approx(cloud.uniform_entropy, abs=0.07)
    if sigma is None:
        assert grid.entropy == pytest.approx(grid.uniform_entropy, abs=1e-4)
    else:
        assert grid.entropy < grid.uniform_entropy - 0.3
