"""The range table against exact rays, and the kernel that reads it against the slow sum."""

import pickle
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from activeloc.beliefs.particle_weighing import weigh_by_rays, weigh_by_table
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import wrap
from activeloc.range_levels import LEVELS, level_ranges, levels_of
from activeloc.range_table import POINT, RangeTable, direction_of, range_table
from activeloc.raycast import cast_scan

Z_MAX = 1.3
TOP = LEVELS - 1
BELOW_PI = np.nextafter(pi, 0.0)


def clutter(seed, height=13, width=21):
    """A random map that is not square, with unknown cells, off the origin."""
    cells = np.random.default_rng(seed).choice(3, (height, width), p=[0.8, 0.15, 0.05])
    cells[0, 0] = 0
    return OccupancyGrid(cells.astype(np.uint8), 0.1, (-0.35, 2.2))


def anywhere(grid, n, seed, directions=2):
    """Poses over the map and a cell beyond, of every heading.

    An odd number of directions has an edge between two of them at pi, where either may be meant.
    """
    rng = np.random.default_rng(seed)
    x0, x1, y0, y1 = grid.extent
    margin = grid.resolution
    low, high = [x0 - margin, y0 - margin, -pi], [x1 + margin, y1 + margin, BELOW_PI]
    poses = rng.uniform(low, high, (n, 3))
    if directions % 2 == 0:
        poses[:4, 2] = [0.0, -1e-17, 1e-17, np.nextafter(-pi, 0.0)]
        poses[4:8, 2] = [-pi, BELOW_PI, pi / 2, -pi / 2]
    return poses


def exact(table, poses, bearings):
    """Level of the exact range from the cell's centre along the nearest direction."""
    grid, n = table.grid, table.table.shape[1]
    column_row = np.floor(grid.to_cells(poses[:, :2])) + 0.5
    direction = np.round((poses[:, 2, None] + bearings) / (2.0 * pi) * n)
    out = np.zeros((len(poses), len(bearings)), dtype=int)
    for i, (middle, turns) in enumerate(zip(column_row, direction, strict=True)):
        col, row = middle.astype(int) - (middle < 0.0)
        if 0 <= row < grid.shape[0] and 0 <= col < grid.shape[1] and grid.free[row, col]:
            pose = np.array([*grid.to_metres(middle), 0.0])
            z = cast_scan(grid, pose, 2.0 * pi * turns / n, table.z_max)
            out[i] = np.where(z >= table.z_max, TOP, np.minimum(z / table.z_max * TOP, TOP - 1))
    return out


BEARINGS = np.array([-0.9, 0.0, 0.3, pi, -pi, 4.0, -5.5, 2.0 * pi, 13.0, -1e-18])


@pytest.mark.parametrize("directions", [7, 64, 180])
@pytest.mark.parametrize("seed", range(4))
def test_levels_are_those_of_exact_rays_from_the_centre(seed, directions):
    grid = clutter(seed)
    table, poses = RangeTable(grid, Z_MAX, directions), anywhere(grid, 150, seed, directions)
    expected = exact(table, poses, BEARINGS)
    first = table.levels(poses, BEARINGS)
    assert len(np.unique(first)) > 20
    assert np.abs(first - expected).max() <= 1
    np.testing.assert_array_equal(table.levels(poses, BEARINGS), first)


def test_off_the_free_cells_the_level_is_zero():
    cells = np.array([[0, 1, 0], [2, 0, 0]], dtype=np.uint8)
    table = RangeTable(OccupancyGrid(cells, 0.5, (1.0, -1.0)), 5.0)
    closed = [[1.7, -0.8], [1.2, -0.3], [0.99, -0.8], [2.51, -0.8], [1.2, -1.01], [1.2, 0.01]]
    poses = np.column_stack([[*closed, [np.nan, 0.0], [np.inf, -0.8]], np.zeros(8)])
    np.testing.assert_array_equal(table.levels(poses, np.array([0.0, 3.0])), 0)
    assert table.filled == 0.0
    assert table.levels(np.array([[1.2, -0.8, 0.0]]), np.zeros(1)) > 0


def test_only_what_is_asked_for_is_cast():
    grid = clutter(1)
    table, free = RangeTable(grid, Z_MAX, 36), np.argwhere(grid.free)
    assert table.table.shape == (len(free), 36)
    pose = np.array([*grid.to_metres(free[5, ::-1] + 0.3), 0.1])
    table.levels(np.tile(pose, (4, 1)), np.array([0.0, 1.0, 2.0, 2.0 * pi]))
    assert table.filled == pytest.approx(3 / (36 * len(free)))
    every = np.column_stack([grid.to_metres(free[:, ::-1] + 0.5), np.zeros(len(free))])
    table.levels(every, np.arange(36) * (2.0 * pi / 36))
    assert table.filled == 1.0


@pytest.mark.parametrize("directions", [7, 64, 180])
@pytest.mark.parametrize(("seed", "z_max"), [(0, 0.04), (1, 0.75), (2, Z_MAX), (3, 5.0)])
def test_filled_at_once_it_is_what_it_is_ray_by_ray(seed, z_max, directions):
    grid = clutter(seed)
    one, two = RangeTable(grid, z_max, directions), RangeTable(grid, z_max, directions)
    one.expect(10**9)
    assert one.filled == 1.0
    free = np.argwhere(grid.free)
    for place in grid.to_metres(free[:, ::-1] + 0.5):
        for theta in np.arange(directions) * (2.0 * pi / directions):
            two.levels(np.array([[*place, theta]]), np.zeros(1))
    assert two.filled == 1.0
    np.testing.assert_array_equal(one.table, two.table)


def test_it_is_filled_at_once_only_where_that_is_cheaper():
    grid = clutter(1)
    table = RangeTable(grid, Z_MAX, 36)
    table.expect(1)
    assert table.filled == 0.0
    table.levels(
        np.tile([*grid.to_metres(np.argwhere(grid.free)[0, ::-1] + 0.5), 0.0], (5000, 1)),
        np.zeros(1),
    )
    assert table.filled == 1.0


def test_the_order_of_asking_does_not_matter():
    grid = clutter(2)
    poses = anywhere(grid, 300, 2)
    one, two = RangeTable(grid, Z_MAX, 90), RangeTable(grid, Z_MAX, 90)
    forwards = one.levels(poses, BEARINGS)
    order = np.random.default_rng(0).permutation(300)
    backwards = two.levels(poses[order], BEARINGS[::-1])[:, ::-1]
    np.testing.assert_array_equal(backwards, forwards[order])
    np.testing.assert_array_equal(one.table, two.table)


def test_a_range_in_the_map_is_within_half_a_cell_and_half_a_direction():
    """A wall 2 m ahead: the table's error is the distance to the cell's centre and the slant."""
    cells = np.zeros((80, 60), dtype=np.uint8)
    cells[:, 50:] = 1
    grid = OccupancyGrid(cells, 0.05)
    rng = np.random.default_rng(0)
    poses = rng.uniform([0.4, 1.8, -0.3], [0.6, 2.2, 0.3], (2000, 3))
    levels = RangeTable(grid, 4.0, 256).levels(poses, np.zeros(1))[:, 0]
    error = level_ranges(4.0)[levels] - cast_scan(grid, poses, np.zeros(1), 4.0)[:, 0]
    slant = 2.1 / np.cos(0.3) * np.tan(0.3) * pi / 256
    assert np.abs(error).max() < 0.025 / np.cos(0.3) + slant + 4.0 / 254 / 2 + 0.002
    assert abs(error.mean()) < 0.003


# --- levels --------------------------------------------------------------------------------------


@pytest.mark.parametrize("z_max", [0.7, 1.5, 81.83])
def test_a_level_stands_for_its_own_range(z_max):
    ranges = level_ranges(z_max)
    assert ranges.shape == (LEVELS,)
    np.testing.assert_array_equal(levels_of(ranges, z_max), np.arange(LEVELS))
    assert ranges[-1] == z_max


@given(st.floats(0.0, 1.0), st.floats(0.1, 100.0))
def test_the_range_of_a_level_is_off_by_half_a_step_at_most(share, z_max):
    z = np.array([share * z_max])
    level = levels_of(z, z_max)
    assert 0 <= level[0] <= TOP
    assert (level[0] == TOP) == (z[0] >= z_max)
    error = abs(level_ranges(z_max)[level[0]] - z[0])
    assert error <= 0.5 * z_max / TOP * (1.0 + 1e-9)


# --- weighing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("directions", [7, 128, 360])
@pytest.mark.parametrize("warm", [False, True])
def test_weights_by_the_table_are_the_slow_sum_over_its_levels(directions, warm):
    grid, rng = clutter(3), np.random.default_rng(3)
    table, slow = (RangeTable(grid, Z_MAX, directions) for _ in range(2))
    poses, before = anywhere(grid, 3000, 3, directions), rng.normal(size=3000)
    log_p = rng.uniform(-9.0, 0.0, (len(BEARINGS), LEVELS)).astype(np.float32)
    log_w, levels = before.copy(), slow.levels(poses, BEARINGS)
    if warm:
        table.levels(poses[::2], BEARINGS)
    weigh_by_table(
        table.table, table.index, table.squares, table.headings, table.frame, table.reach,
        poses, BEARINGS, log_p, log_w,
    )  # fmt: skip
    added = np.take_along_axis(log_p.astype(np.float64), levels.T, axis=1).sum(axis=0)
    np.testing.assert_allclose(log_w, before + added, atol=1e-5)
    cast = table.table > 0
    assert cast.mean() > 0.1
    np.testing.assert_array_equal(table.table[cast], slow.table[cast])


def test_weights_by_rays_are_the_slow_sum_over_exact_ranges():
    grid, rng = clutter(5), np.random.default_rng(5)
    x0, x1, y0, y1 = grid.extent
    poses, before = rng.uniform([x0, y0, -pi], [x1, y1, pi], (2000, 3)), rng.normal(size=2000)
    log_p = rng.uniform(-9.0, 0.0, (len(BEARINGS), LEVELS)).astype(np.float32)
    levels = levels_of(cast_scan(grid, poses, BEARINGS, Z_MAX), Z_MAX)
    log_w = before.copy()
    weigh_by_rays(grid.squares, grid.frame, Z_MAX, poses, BEARINGS, log_p, log_w)
    added = np.take_along_axis(log_p.astype(np.float64), levels.T, axis=1).sum(axis=0)
    np.testing.assert_allclose(log_w, before + added, atol=1e-5)


def test_weighing_reads_the_direction_that_a_beam_looks_in():
    """One cell, four directions: a reading of a level is worth that level's number."""
    cells = np.zeros((5, 9), dtype=np.uint8)
    table = RangeTable(OccupancyGrid(cells, 1.0), 10.0, 4)
    log_p = np.arange(LEVELS, dtype=np.float32)[None]
    theta = np.array([0.0, pi / 2, -pi, -pi / 2, BELOW_PI, 0.7, -0.7, 0.9])
    poses = np.column_stack([np.full(8, 3.2), np.full(8, 1.7), theta])
    log_w = np.zeros(8)
    weigh_by_table(
        table.table, table.index, table.squares, table.headings, table.frame, table.reach,
        poses, np.zeros(1), log_p, log_w,
    )  # fmt: skip
    east, north, west, south = levels_of(np.array([5.5, 3.5, 3.5, 1.5]), 10.0)
    np.testing.assert_allclose(log_w, [east, north, west, south, west, east, east, north], atol=1)


@settings(deadline=None)  # The first call may compile.
@given(st.floats(-pi, BELOW_PI), st.floats(-20.0, 20.0))
def test_every_heading_and_bearing_finds_a_direction(theta, bearing):
    grid = OccupancyGrid(np.zeros((7, 5), dtype=np.uint8), 0.2)
    table = RangeTable(grid, 2.0, 60)
    pose, log_w = np.array([[0.31, 0.93, theta]]), np.zeros(1)
    log_p = np.arange(LEVELS, dtype=np.float32)[None]
    weigh_by_table(
        table.table, table.index, table.squares, table.headings, table.frame, table.reach, pose,
        np.array([bearing]), log_p, log_w,
    )  # fmt: skip
    # At the edge between two directions either may be meant.
    nearby = wrap(theta + np.array([-1e-9, 0.0, 1e-9]))
    levels = [table.levels(np.array([[0.31, 0.93, t]]), np.array([bearing])).item() for t in nearby]
    assert log_w[0] in levels


# --- the object ----------------------------------------------------------------------------------


@pytest.mark.parametrize("directions", [4, 5, 180, 786, 3600])
def test_heading_and_bearing_add_up_around_the_circle(directions):
    """In words of 32 bits, by whole numbers that have no end."""
    circle, rng = directions << POINT, np.random.default_rng(directions)
    edges = [0, 1, circle // 2, circle - 1]
    drawn = rng.integers(circle, size=(200, 2)).tolist()
    for ahead, offset in [(a, b) for a in edges for b in edges] + drawn:
        found = direction_of(np.uint32(ahead), np.uint32(offset), np.uint32(circle))
        assert found == (ahead + offset) % circle >> POINT


def test_a_map_has_one_table_for_each_range_and_number_of_directions():
    one = range_table(clutter(0), 1.0, 16)
    assert (one.z_max, one.table.shape[1]) == (1.0, 16)
    assert range_table(clutter(0), 1.0, 16) is one
    assert range_table(clutter(0), 1.0, 17) is not one
    assert range_table(clutter(0), 2.0, 16) is not one
    assert range_table(clutter(1), 1.0, 16) is not one


def test_what_a_table_has_cast_is_not_pickled_with_it():
    grid = clutter(6)
    table = range_table(grid, 1.5, 24)
    before = pickle.dumps(table)
    table.levels(anywhere(grid, 50, 0), np.zeros(1))
    assert table.table.any()
    assert pickle.dumps(table) == before
    assert pickle.loads(before) is table


@pytest.mark.parametrize(
    ("z_max", "directions", "message"),
    [
        (0.0, 64, "range table z_max"),
        (-1.0, 64, "range table z_max"),
        (np.inf, 64, "range table z_max"),
        (np.nan, 64, "range table z_max"),
        (1.0, 3, "range table directions"),
        (1.0, 3601, "range table directions"),
        (1.0, 64.0, "range table directions"),
    ],
)
def test_a_table_of_nonsense_is_refused(z_max, directions, message):
    with pytest.raises(ConfigError, match=message):
        RangeTable(clutter(0), z_max, directions)
