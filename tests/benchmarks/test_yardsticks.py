"""The yardsticks do the work that they are held to have done."""

import numpy as np
import pytest

from activeloc.benchmarks.worlds import bearings, free_poses, large_map, local_poses, open_ground
from activeloc.benchmarks.yardsticks.crossings import count_wrong, range_of
from activeloc.benchmarks.yardsticks.traversal import Traversal
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_scan


def scattered(seed, shape=(9, 14)):
    rng = np.random.default_rng(seed)
    return OccupancyGrid((rng.random(shape) < 0.2).astype(np.uint8), 0.5, (-2.0, 1.0))


def march(blocked, x, y, theta, reach, step=1e-3):
    """Slow and obvious: walk until something is in the way."""
    for z in np.arange(0.0, reach, step):
        col, row = int(np.floor(x + z * np.cos(theta))), int(np.floor(y + z * np.sin(theta)))
        inside = 0 <= row < blocked.shape[0] and 0 <= col < blocked.shape[1]
        if not inside or blocked[row, col]:
            return z
    return reach


@pytest.mark.parametrize("seed", range(4))
def test_crossings_agree_with_marching(seed):
    blocked, rng = scattered(seed).blocked, np.random.default_rng(seed)
    for row, col in np.argwhere(~blocked)[:20]:
        x, y = col + rng.random(), row + rng.random()
        theta = rng.uniform(-np.pi, np.pi)
        least, greatest = range_of(blocked, x, y, theta, 12.0)
        assert greatest == pytest.approx(march(blocked, x, y, theta, 12.0), abs=2e-3)
        assert least == pytest.approx(greatest)


def test_at_a_corner_a_range_is_an_interval():
    blocked = np.zeros((4, 6), dtype=bool)
    blocked[2, 1] = True  # The diagonal from the first cell's middle passes its corner at (2, 2).
    least, greatest = range_of(blocked, 0.5, 0.5, np.pi / 4, 10.0)
    assert least == pytest.approx(1.5 * np.sqrt(2.0))
    assert greatest == pytest.approx(3.5 * np.sqrt(2.0))


def test_wrong_rays_are_counted():
    grid = scattered(5)
    poses, angles = free_poses(grid, 30), bearings(8)
    in_cells = np.column_stack([grid.to_cells(poses[:, :2]), poses[:, 2]])
    ranges = cast_scan(grid, poses, angles, 4.0) / grid.resolution
    assert count_wrong(grid.blocked, in_cells, angles, 8.0, ranges) == 0
    ranges[3, 2] += 1e-3
    ranges[7, 0] = 8.5
    assert count_wrong(grid.blocked, in_cells, angles, 8.0, ranges) == 2


@pytest.mark.parametrize("seed", range(3))
def test_cell_by_cell_is_right_but_for_rounding(seed):
    grid = scattered(seed)
    poses, angles = free_poses(grid, 200), bearings(16)
    plain = Traversal(grid)
    ranges = plain.cast(plain.prepared(poses), angles.astype(np.float32), 8.0)
    exact = cast_scan(grid, poses, angles, 4.0) / grid.resolution
    off = np.abs(ranges - exact)
    assert np.quantile(off, 0.99) < 1e-3
    assert ranges.max() <= 8.0


def test_the_large_map_is_large_and_poses_are_free():
    grid = large_map(None)
    assert grid.shape == (1200, 1200)
    assert 0.1 < grid.free.mean() < 0.9
    for poses in (free_poses(grid, 50), local_poses(grid, 50)):
        col, row = np.floor(grid.to_cells(poses[:, :2])).astype(int).T
        assert len(poses) == 50
        assert grid.free[row, col].all()
    assert np.ptp(local_poses(grid, 50)[:, :2], axis=0).max() < 3.0


def test_the_map_that_is_given_is_taken(tmp_path):
    from PIL import Image

    pixels = np.full((20, 30), 254, dtype=np.uint8)
    pixels[0] = 0
    Image.fromarray(pixels).save(tmp_path / "basement_hallways.png")
    assert large_map(tmp_path).shape == (20, 30)


def test_open_ground_is_open():
    grid = open_ground(6, 0.2)
    assert grid.free[1:-1, 1:-1].all()
    assert grid.count()["occupied"] == 4 * 25


def test_amcl_localizes_on_what_it_is_given():
    pytest.importorskip("amcl")
    from activeloc.benchmarks.yardsticks import nav2

    grid = large_map(None)
    pose, angles = local_poses(grid, 1)[0], bearings(30)
    scan = cast_scan(grid, pose, angles, 25.0)
    update = nav2.update_of(grid, pose, angles, scan, 500)
    for _ in range(4):
        estimate = update()
    assert np.hypot(*(np.array(estimate[:2]) - pose[:2])) < 0.5
