"""The particle filter's kernels against the simulator's motion and against counting."""

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, kstest

from activeloc.beliefs import particle_motion as kernels
from activeloc.beliefs.cloud import spread_poses
from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.particle_bins import bin_weights, bins_of, roughen
from activeloc.beliefs.particle_motion import NORMALS
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain, move, slipped, wrap

BELOW_PI = np.nextafter(pi, 0.0)


def ruin(seed, height=31, width=47, resolution=0.1):
    """A random map that is not square: blocks, thin walls and gaps, off the origin."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((height, width), dtype=np.uint8)
    for _ in range(9):
        row, col = rng.integers(0, height), rng.integers(0, width)
        if rng.random() < 0.5:
            cells[row, col : col + rng.integers(2, 12)] = 1
        else:
            cells[row : row + rng.integers(2, 9), col] = 1
    return Terrain(OccupancyGrid(cells, resolution, (-1.3, 0.7)), 0.0)


def frame_of(terrain):
    return np.array([*terrain.grid.origin, 1.0 / terrain.grid.resolution])


def anywhere(terrain, n, seed):
    return terrain.uniform_poses(np.random.default_rng(seed).random((n, 4)))


def as_table(noise):
    """Given numbers as indices of a table of them."""
    return np.arange(noise.size, dtype=np.uint16).reshape(noise.shape), noise.ravel()


def driven(terrain, poses, u, sigma, noise, slack=0.05, log_floor=-3.0):
    """Poses after :func:`kernels.drive`, and what it added to the log-weights."""
    poses, log_w = poses.copy(), np.zeros(len(poses))
    kernels.drive(
        terrain.squares, frame_of(terrain), poses, np.array(u), np.array(sigma),
        *as_table(noise), log_w, slack, log_floor,
    )  # fmt: skip
    return poses, log_w


# --- driving -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "u", [(0.0, 0.5, 0.0), (0.7, -0.4, 0.3), (-9.0, 2.5, -7.0), (2.0, 0.0, 1.0)]
)
@pytest.mark.parametrize("seed", range(4))
def test_drives_as_the_simulated_robot_does(seed, u):
    """With the same noise, on maps where some have room and some are beside a wall."""
    terrain, sigma = ruin(seed), (0.1, 0.15, 0.2)
    poses = anywhere(terrain, 4_000, seed)
    noise = np.random.default_rng(seed).standard_normal((4_000, 3)).astype(np.float32)
    got, log_w = driven(terrain, poses, u, sigma, noise)
    motions = np.array(u) + noise * sigma
    expected, carried_out = move(terrain, poses, motions)
    # Where a heading just misses a corner, or just does not, two ways end far apart.
    error = np.abs(got[:, :2] - expected[:, :2]).max(axis=1)
    same = error < 1e-8
    assert same.mean() > 0.999
    np.testing.assert_allclose(wrap(got[:, 2] - expected[:, 2]), 0.0, atol=1e-6)
    assert (got[:, 2] >= -pi).all()
    assert (got[:, 2] < pi).all()
    missing = np.abs(motions[:, 1]) - np.abs(carried_out[:, 1])
    clear = same & (np.abs(missing - 0.05) > 1e-5)
    np.testing.assert_array_equal(log_w[clear], np.where(missing > 0.05, -3.0, 0.0)[clear])
    if u[1]:
        assert 0.02 < (missing > 0.05).mean() < 0.98


@pytest.mark.parametrize("seed", range(3))
def test_no_particle_jumps_a_wall(seed):
    """Long ways over a maze of thin walls: every point of the way is on open ground."""
    terrain = ruin(10 + seed)
    poses = anywhere(terrain, 2_000, seed)
    noise = np.random.default_rng(seed).standard_normal((2_000, 3)).astype(np.float32)
    got, _ = driven(terrain, poses, (0.0, 0.9, 0.0), (0.0, 0.5, 0.0), noise)
    assert terrain.contains(got).all()
    for share in np.linspace(0.0, 1.0, 60):
        assert terrain.contains(poses + share * (got - poses)).all()


@pytest.mark.parametrize("u", [(0.4, 0.3, -0.2), (0.0, -0.6, 0.0), (1.0, 0.0, 0.5)])
def test_those_that_slip_go_another_way_and_keep_their_weight(u):
    terrain, rng, u = ruin(4), np.random.default_rng(4), np.array(u)
    poses, log_w = anywhere(terrain, 2_000, 4), rng.normal(size=2_000)
    slipping, uniforms = rng.permutation(2_000)[:700], rng.random((700, 2))
    before, weighed = poses[slipping], rng.normal(size=700)
    motions = np.array([(*slipped(u, *pair), u[2]) for pair in uniforms])
    expected, old_poses, old_log_w = move(terrain, before, motions)[0], poses.copy(), log_w.copy()
    kernels.slip(
        terrain.squares, frame_of(terrain), before, weighed, slipping, u, uniforms, poses, log_w
    )
    same = np.abs(poses[slipping, :2] - expected[:, :2]).max(axis=1) < 1e-8
    assert same.mean() > 0.995
    np.testing.assert_allclose(wrap(poses[slipping, 2] - expected[:, 2]), 0.0, atol=1e-12)
    np.testing.assert_array_equal(log_w[slipping], weighed)
    others = np.setdiff1d(np.arange(2_000), slipping)
    np.testing.assert_array_equal(poses[others], old_poses[others])
    np.testing.assert_array_equal(log_w[others], old_log_w[others])


@pytest.mark.parametrize("reach", [0.05, 0.2, 0.7])
def test_a_contact_tells_against_those_with_nothing_ahead(reach):
    """Each by itself: the simulated robot sets out, and is stopped short of the reach or is not."""
    terrain = ruin(6)
    poses, log_w = anywhere(terrain, 3_000, 6), np.linspace(-5.0, 0.0, 3_000)
    ahead = np.tile([0.0, reach, 0.0], (len(poses), 1))
    went = np.abs(move(terrain, poses, ahead)[1][:, 1])
    got = log_w.copy()
    kernels.touch(terrain.squares, frame_of(terrain), poses, reach, got, -3.0)
    clear = (np.abs(reach - went) < 1e-12) | (reach - went > 1e-6)
    assert clear.mean() > 0.999
    assert 0.02 < (went < reach).mean() < 0.98
    expected = log_w + np.where(went < reach - 1e-9, 0.0, -3.0)
    np.testing.assert_allclose(got[clear], expected[clear], atol=1e-12)


@pytest.mark.parametrize("n", [1, 19, 20, 21, 1000])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.999, 1.0])
def test_every_particle_is_as_likely_to_be_among_a_share(n, share):
    starts = (np.arange(4_000) + 0.5) / 4_000
    counts = np.zeros(n)
    for start in starts:
        index = kernels.every(share, n, start)
        assert len(np.unique(index)) == len(index)
        counts[index] += 1  # Out of bounds it would raise.
    np.testing.assert_allclose(counts / len(starts), share, atol=2e-3)


def test_headings_are_looked_up_to_a_billionth():
    theta = np.concatenate([np.linspace(-pi, BELOW_PI, 50_001), [0.0, BELOW_PI, pi / 2, -pi]])
    got = np.array([kernels.unit(angle) for angle in theta])
    np.testing.assert_allclose(got[:, 0], np.cos(theta), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(got[:, 1], np.sin(theta), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("pose", [(-9.0, 1.0, 0.0), (1.0, 99.0, 2.0), (3.41, 1.0, 0.0)])
def test_off_the_map_nothing_moves(pose):
    terrain = ruin(0)
    noise = np.zeros((1, 3), dtype=np.float32)
    got, log_w = driven(terrain, np.array([pose]), (0.0, 0.5, 0.0), (0.0, 0.0, 0.0), noise)
    np.testing.assert_allclose(got, [pose], atol=1e-12)
    assert log_w[0] == -3.0


def test_turns_by_the_angle_and_its_noise():
    theta = np.array([0.0, 3.0, -3.0, -pi, BELOW_PI, 1.0])
    noise = np.array([0.0, 1.0, -2.0, 0.5, 0.0, 300.0], dtype=np.float32)
    for angle in (0.0, 0.5, -0.5, 2 * pi, -9.0, 50.0):
        poses = np.column_stack([np.arange(6.0), -np.arange(6.0), theta])
        kernels.turn(poses, angle, 0.25, *as_table(noise))
        np.testing.assert_array_equal(poses[:, 0], np.arange(6.0))
        np.testing.assert_array_equal(poses[:, 1], -np.arange(6.0))
        left = (poses[:, 2] - (theta + angle + 0.25 * noise)) / (2.0 * pi)
        np.testing.assert_allclose(left, np.round(left), atol=1e-12)
        assert (poses[:, 2] >= -pi).all()
        assert (poses[:, 2] < pi).all()


@settings(deadline=None)  # The first call may compile.
@given(st.floats(-1e3, 1e3))
@pytest.mark.parametrize("edge", [0.0, pi, -pi, BELOW_PI, np.nextafter(-pi, -4.0), 3 * pi, -3 * pi])
def test_every_heading_is_wrapped(edge, angle):
    for value in (edge, angle):
        poses = np.zeros((1, 3))
        kernels.turn(poses, value, 0.0, np.zeros(1, dtype=np.uint16), NORMALS)
        assert -pi <= poses[0, 2] < pi
        assert np.cos(poses[0, 2]) == pytest.approx(np.cos(value), abs=1e-9)
        assert np.sin(poses[0, 2]) == pytest.approx(np.sin(value), abs=1e-9)


# --- roughening ----------------------------------------------------------------------------------


def test_roughening_adds_its_noise_where_the_ground_is_open_and_keeps_the_place_where_not():
    terrain, rng = ruin(5), np.random.default_rng(5)
    poses, chosen = anywhere(terrain, 3_000, 5), rng.integers(0, 3_000, 8_000)
    noise, out = rng.standard_normal((8_000, 3)).astype(np.float32), np.empty((8_000, 3))
    before = poses.copy()
    frame = frame_of(terrain)
    roughen(terrain.open, frame, poses, chosen, *as_table(noise), 0.3, 0.5, out)
    np.testing.assert_array_equal(poses, before)
    wanted = poses[chosen] + noise * [0.3, 0.3, 0.5]
    open_ = terrain.contains(wanted)
    assert 0.3 < open_.mean() < 0.95
    np.testing.assert_allclose(out[open_, :2], wanted[open_, :2], atol=1e-7)
    np.testing.assert_array_equal(out[~open_, :2], poses[chosen][~open_, :2])
    np.testing.assert_allclose(wrap(out[:, 2] - wanted[:, 2]), 0.0, atol=1e-7)
    assert terrain.contains(out).all()
    assert (out[:, 2] >= -pi).all()
    assert (out[:, 2] < pi).all()


# --- spreading -----------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 37, 1000, 5000])
def test_each_stratum_of_equal_area_holds_one_pose(n):
    terrain = ruin(6)
    poses = spread_poses(terrain, n, np.random.default_rng(n))
    assert terrain.contains(poses).all()
    # Open area before the pose, in cells of map order: known to one cell.
    rank = np.full(terrain.grid.shape, -1)
    rank[tuple(terrain.open_cells.T)] = np.arange(len(terrain.open_cells))
    col, row = np.floor(terrain.grid.to_cells(poses[:, :2])).astype(int).T
    low = rank[row, col] * n / len(terrain.open_cells)
    assert (low < np.arange(n) + 1.0).all()
    assert (low + n / len(terrain.open_cells) > np.arange(n)).all()


def test_poses_are_uniform_over_the_open_ground_and_within_its_cells():
    terrain, n = ruin(7), 300
    poses = np.concatenate([
        spread_poses(terrain, n, np.random.default_rng(seed)) for seed in range(400)
    ])  # fmt: skip
    column_row = terrain.grid.to_cells(poses[:, :2])
    col, row = np.floor(column_row).astype(int).T
    counts = np.zeros(terrain.grid.shape)
    np.add.at(counts, (row, col), 1)
    counts = counts[tuple(terrain.open_cells.T)]
    # Strata make the counts vary less than independent draws would, never more.
    expected = len(poses) / len(counts)
    assert chi2.sf(((counts - expected) ** 2 / expected).sum(), len(counts) - 1) > 1e-6
    error = np.abs(counts - expected).max()
    assert error < 5.0 * np.sqrt(expected)
    inside = column_row - np.floor(column_row)
    for axis in range(2):
        assert kstest(inside[:, axis], "uniform").pvalue > 1e-6
    assert abs(np.corrcoef(inside.T)[0, 1]) < 5.0 / np.sqrt(len(poses))


@pytest.mark.parametrize("bins", [8, 36, 72])
def test_headings_of_one_spread_are_even_everywhere(bins):
    """Overall and in any patch of the ground: the golden section leaves no gap."""
    terrain = ruin(8)
    poses = spread_poses(terrain, 20_000, np.random.default_rng(0))
    assert (poses[:, 2] >= -pi).all()
    assert (poses[:, 2] < pi).all()
    for part in (poses, poses[4_000:5_000]):
        counts = np.histogram(part[:, 2], bins, (-pi, pi))[0]
        assert np.abs(counts - len(part) / bins).max() < 4.0
    starts = [spread_poses(terrain, 1, np.random.default_rng(seed))[0, 2] for seed in range(2_000)]
    assert kstest(starts, "uniform", (-pi, 2.0 * pi)).pvalue > 1e-6


def test_the_greatest_random_number_does_not_leave_the_open_cells():
    """Just under one more stratum, the sum is rounded up to it."""
    cells, n = np.array([[0, 0], [3, 5]]), 200_000
    out, uniforms = np.full((n, 3), np.nan), np.zeros((n, 3))
    uniforms[:, 0] = np.nextafter(1.0, 0.0)
    kernels.spread(cells, np.array([0.0, 0.0, 1.0]), uniforms, 0.5, out)
    assert set(map(tuple, np.unique(out[:, :2], axis=0))) == {(0.0, 0.0), (5.0, 3.0)}


def test_normal_numbers_are_normal():
    drawn = NORMALS[kernels.noise(np.random.default_rng(0), 100_000, 2)]
    assert drawn.shape == (100_000, 2)
    assert kstest(drawn.ravel(), "norm").pvalue > 1e-6
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5.0 / np.sqrt(100_000)
    assert NORMALS.std(dtype=np.float64) == pytest.approx(1.0, abs=1e-6)
    assert NORMALS.mean(dtype=np.float64) == pytest.approx(0.0, abs=1e-6)


# --- binning -------------------------------------------------------------------------------------


def test_weights_are_binned_as_the_common_bins_index_them():
    terrain, rng = ruin(9), np.random.default_rng(9)
    bins = CommonBins(terrain.grid)
    poses = anywhere(terrain, 5_000, 9)
    poses[:4] = [[-99.0, 1.0, -pi], [99.0, 99.0, 3.14], [0.0, -99.0, 0.0], [-1.3, 0.7, 3.0]]
    weights, out = rng.random(5_000), np.zeros(len(bins))
    corner, shape = np.array([*bins.origin, 1.0 / bins.size]), (*bins.shape, bins.n_headings)
    index, first = np.empty(4_000, dtype=np.int32), 500
    bins_of(poses, first, 4_000, corner, shape, index)
    np.testing.assert_array_equal(index, bins.index(poses)[first : first + 4_000])
    bin_weights(poses, weights, corner, shape, out)
    expected = np.bincount(bins.index(poses), weights, len(bins))
    np.testing.assert_allclose(out, expected, atol=1e-12)
