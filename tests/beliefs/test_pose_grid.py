"""The grid of poses: cells with open ground, their averages, and what falls into which."""

from math import pi

import numpy as np
import pytest
from scipy.stats import chi2

from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps.text import from_text
from activeloc.motion import Terrain

MAP = """\
###########
#.....#...#
#.....#.###
#.........#
###.#######
###########
"""


def building(cell_size=0.2, headings=12, radius=0.0):
    return PoseGrid(Terrain(from_text(MAP, 0.25, (-1.0, 3.0)), radius), cell_size, headings)


@pytest.mark.parametrize("cell_size", [0.1, 0.2, 0.25, 0.37, 1.0])
def test_every_open_place_is_near_a_cell_of_the_belief(cell_size):
    grid = building(cell_size)
    poses = grid.terrain.uniform_poses(np.random.default_rng(0).random((5000, 4)))
    cell, heading = grid.states_of(poses)
    assert cell.min() >= 0
    assert cell.max() < len(grid.cells)
    corner = grid.cells[cell, ::-1] * cell_size + grid.terrain.grid.origin
    off = np.maximum(corner - poses[:, :2], poses[:, :2] - corner - cell_size).max(axis=1)
    # An open sliver narrower than a sub-pose has no cell of its own; its neighbour takes it.
    assert (off <= cell_size / SUB + 1e-9).all()
    assert (off <= 1e-9).mean() > 0.95
    np.testing.assert_array_equal(heading, np.floor((poses[:, 2] + pi) / grid.bin_width))


def test_states_and_samples_are_inverse():
    grid = building()
    rng = np.random.default_rng(1)
    cell = rng.integers(len(grid.cells), size=20_000).astype(np.int32)
    heading = rng.integers(grid.headings, size=20_000).astype(np.int32)
    poses = grid.sample_in(cell, heading, rng.random((20_000, 4)))
    assert grid.terrain.contains(poses).all()
    got_cell, got_heading = grid.states_of(poses)
    np.testing.assert_array_equal(got_cell, cell)
    np.testing.assert_array_equal(got_heading, heading)


def test_samples_are_uniform_over_a_whole_cell_and_its_bin():
    grid = building()
    cell = int(np.flatnonzero(grid.is_open.all(axis=1))[0])
    n = 100_000
    poses = grid.sample_in(np.full(n, cell), np.full(n, 5), np.random.default_rng(2).random((n, 4)))
    corner = np.append(grid.cells[cell, ::-1] * 0.2 + grid.terrain.grid.origin, grid.thetas[5])
    unit = (poses - corner) / [0.2, 0.2, grid.bin_width] + [0.0, 0.0, 0.5]
    counts = np.histogramdd(unit, bins=(12, 12, 4), range=[(0, 1)] * 3)[0]
    assert counts.sum() == n
    expected = n / counts.size
    assert chi2.sf(((counts - expected) ** 2 / expected).sum(), counts.size - 1) > 1e-6


@pytest.mark.parametrize("cell_size", [0.1, 0.2, 0.25])
def test_areas_add_up_to_the_open_ground(cell_size):
    grid = building(cell_size)
    assert grid.area.sum() * cell_size**2 == pytest.approx(grid.terrain.area, rel=0.01)
    assert (grid.area > 0.0).all()
    assert (grid.area <= 1.0).all()


def test_centres_are_means_of_the_open_sub_poses():
    grid = building()
    sub_poses = grid.sub_poses()
    for c in (0, 7, len(grid.cells) - 1):
        np.testing.assert_allclose(
            grid.centres[c], sub_poses[c][grid.is_open[c]].mean(axis=0), atol=1e-12
        )
        np.testing.assert_array_equal(grid.terrain.contains(sub_poses[c]), grid.is_open[c])


def test_headings_are_bins_of_the_circle_from_minus_pi():
    grid = building(headings=72)
    assert grid.thetas[0] == pytest.approx(-pi + pi / 72)
    poses = np.column_stack([np.zeros((72, 2)), grid.thetas])
    np.testing.assert_array_equal(grid.states_of(poses)[1], np.arange(72))
    edge = np.array([[0.0, 4.0, -pi], [0.0, 4.0, pi], [0.0, 4.0, 3 * pi - 1e-9]])
    np.testing.assert_array_equal(grid.states_of(edge)[1], [0, 0, 71])


def test_index_and_cells_agree():
    grid = building()
    assert (grid.index >= 0).sum() == len(grid.cells)
    np.testing.assert_array_equal(grid.index[tuple(grid.cells.T)], np.arange(len(grid.cells)))


def test_too_many_states_are_refused_before_they_are_allocated():
    big = Terrain(OccupancyGrid(np.zeros((1000, 1000), dtype=np.uint8), 1.0), 0.0)
    with pytest.raises(ConfigError, match=r"belief.cell_size 0\.01 m with 72 headings gives"):
        PoseGrid(big, 0.01, 72)
