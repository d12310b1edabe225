"""Beams against oracles that know nothing of grid traversal.

An obstacle is a closed square, so the range of a beam is inf {t > 0: start + t d in an obstacle}.
Three oracles compute that: a march in small steps, integer arithmetic on beams whose start and
slope are rational (exact, corners included), and shapely on beams of floating-point numbers.
"""

from math import ceil, pi

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from activeloc import raycast
from activeloc.free_squares import free_squares
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_scan

FAR = 1e3
TOLERANCE = 1e-9  # [cell]
NARROW = 1e-6  # [cell]; obstacles grown and shrunk give ranges this close: the answer is certain
ADVANCE = 1e-7  # [cell]; how far a beam that starts on a grid line is moved along


def cast_ray(blocked, x, y, dx, dy, z_max):
    return raycast.cast_ray(free_squares(blocked), x, y, dx, dy, z_max)


def shoot(blocked, x, y, dx, dy, z_max=FAR):
    squares, beams = free_squares(blocked), zip(x, y, dx, dy, strict=True)
    return np.array([raycast.cast_ray(squares, *beam, z_max) for beam in beams], dtype=float)


def at(blocked, x, y, degrees, z_max=FAR):
    return cast_ray(blocked, x, y, np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), z_max)


def room(*rows):
    """A map drawn as text, top row last in ``y`` order: the first string is row 0."""
    return np.array([[cell == "#" for cell in row] for row in rows])


def some_maps(n=20):
    """Maps of many shapes: random of many densities, diagonal walls, checkerboards."""
    rng = np.random.default_rng(10)
    for i in range(n):
        height, width = rng.choice(np.arange(3, 17), 2, replace=False)
        row, col = np.indices((height, width))
        if i % 5 == 0:
            blocked = (row + (1 if i % 2 else -1) * col) % int(rng.integers(4, 8)) == 0
        elif i % 5 == 1:
            blocked = ((row + col) % 2 == 0) & (rng.random((height, width)) < 0.6)
        else:
            blocked = rng.random((height, width)) < rng.uniform(0.02, 0.5)
        yield blocked


# --- marching ------------------------------------------------------------------------------------


def march(blocked, x, y, theta, z_max, step=1e-4):
    """Walk along the beam until something is in the way."""
    z = np.arange(0.0, z_max, step)
    col = np.floor(x + z * np.cos(theta)).astype(int)
    row = np.floor(y + z * np.sin(theta)).astype(int)
    stop = np.pad(blocked, 1, constant_values=True)
    height, width = blocked.shape
    hit = stop[np.clip(row, -1, height) + 1, np.clip(col, -1, width) + 1]
    return z[hit.argmax()] if hit.any() else z_max


@pytest.mark.parametrize("seed", range(8))
def test_agrees_with_marching(seed):
    rng = np.random.default_rng(seed)
    blocked = rng.random((7, 9)) < 0.2
    for _ in range(25):
        x, y, theta = rng.uniform(0, 9), rng.uniform(0, 7), rng.uniform(-pi, pi)
        z = cast_ray(blocked, x, y, np.cos(theta), np.sin(theta), 6.0)
        assert z == pytest.approx(march(blocked, x, y, theta, 6.0), abs=2e-4)


# --- by hand -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("degrees", "expected"), [(0, 2.5), (90, 1.25), (180, 0.5), (270, 0.75)])
def test_along_the_axes(degrees, expected):
    assert at(np.zeros((2, 3), dtype=bool), 0.5, 0.75, degrees) == pytest.approx(expected)


@pytest.mark.parametrize(("degrees", "expected"), [(0, 2.0), (90, 2.5), (180, 2.0), (270, 1.5)])
def test_stops_at_a_wall_on_each_side(degrees, expected):
    box = np.pad(np.zeros((4, 4), dtype=bool), ((2, 1), (3, 1)), constant_values=True)
    assert at(box, 5.0, 3.5, degrees) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("degrees", range(0, 360, 5))
def test_leaves_an_empty_map_at_its_side(degrees):
    height, width, x, y = 5, 8, 2.25, 3.5
    dx, dy = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    sides = [
        ((width - x) if dx > 0 else -x) / dx if abs(dx) > 1e-12 else np.inf,
        ((height - y) if dy > 0 else -y) / dy if abs(dy) > 1e-12 else np.inf,
    ]
    empty = np.zeros((height, width), dtype=bool)
    assert cast_ray(empty, x, y, dx, dy, FAR) == pytest.approx(min(sides), abs=1e-12)


def test_two_cells_that_touch_in_a_corner_stop_a_beam_through_it():
    wall = room(".....", ".#...", "..#..", ".....")
    assert at(wall, 3.0, 1.0, 135) == pytest.approx(np.sqrt(2))
    assert at(wall, 1.0, 3.0, -45) == pytest.approx(np.sqrt(2))


def test_the_corner_of_a_single_cell_stops_a_beam_that_grazes_it():
    single = room("....", ".#..", "....", "....", "....")
    assert at(single, 3.5, 0.5, 135) == pytest.approx(np.sqrt(4.5))
    assert at(single, 0.5, 2.5, -45) == pytest.approx(np.sqrt(0.5))


def test_a_beam_touches_a_corner_within_eps_and_passes_it_farther_off():
    single = room("....", ".#..", "....", "....", "....")
    assert at(single, 3.5 + 1e-10, 0.5, 135) == pytest.approx(np.sqrt(4.5))
    assert at(single, 3.5 + 1e-8, 0.5, 135) == pytest.approx(3.5 * np.sqrt(2))
    assert at(single, 2.0 + 1e-8, 1.5, 180) == pytest.approx(1e-8, abs=1e-9)
    assert at(single, 2.0 + 1e-8, 1.5, 90) == 3.5


def test_a_beam_along_an_edge_runs_to_the_obstacle():
    pillar = room(".....", "..#..", ".....")
    assert at(pillar, 0.5, 1.0, 0) == 1.5
    assert at(pillar, 0.5, 2.0, 0) == 1.5
    assert at(pillar, 4.5, 2.0, 180) == pytest.approx(1.5)
    assert at(pillar, 2.0, 0.25, 90) == pytest.approx(0.75)
    assert at(pillar, 3.0, 2.75, 270) == pytest.approx(0.75)


def test_a_beam_from_an_edge_leaves_into_it_or_along_it_stops():
    pillar = room(".....", "..#..", ".....")
    assert at(pillar, 3.0, 1.5, 0) == 2.0
    assert at(pillar, 3.0, 1.5, 45) == pytest.approx(1.5 * np.sqrt(2))
    assert at(pillar, 3.0, 1.5, 135) == 0.0
    assert at(pillar, 3.0, 1.5, 180) == 0.0
    assert at(pillar, 3.0, 1.5, 90) == 0.0
    assert at(pillar, 3.0, 1.5, 270) == 0.0


def test_a_beam_from_a_corner_leaves_into_or_along_the_square_stops():
    pillar = room(".....", "..#..", ".....")
    assert at(pillar, 3.0, 2.0, 45) == pytest.approx(np.sqrt(2))
    assert at(pillar, 3.0, 2.0, 0) == 2.0
    assert at(pillar, 3.0, 2.0, 135) == pytest.approx(np.sqrt(2))
    for into in (180, 225, 270):
        assert at(pillar, 3.0, 2.0, into) == 0.0


def test_a_beam_from_the_side_of_the_map_enters_it():
    empty = np.zeros((2, 3), dtype=bool)
    assert at(empty, 0.0, 0.5, 0) == 3.0
    assert at(empty, 3.0, 0.5, 180) == pytest.approx(3.0)
    assert at(empty, 0.5, 2.0, 270) == pytest.approx(2.0)
    assert at(empty, 3.0, 2.0, 225) == pytest.approx(2.0 * np.sqrt(2))
    assert at(empty, 0.0, 0.5, 90) == 0.0
    assert at(empty, 0.5, 2.0, 0) == 0.0


@pytest.mark.parametrize("xy", [(-0.5, 1.0), (3.5, 1.0), (1.0, -0.5), (1.0, 2.5), (-4e5, 9e9)])
@pytest.mark.parametrize("degrees", range(0, 360, 15))
def test_from_outside_the_range_is_zero(xy, degrees):
    assert at(np.zeros((2, 3), dtype=bool), *xy, degrees) == 0.0


@pytest.mark.parametrize("degrees", range(0, 360, 15))
def test_from_inside_an_obstacle_the_range_is_zero(degrees):
    assert at(room("...", ".#.", "..."), 1.25, 1.75, degrees) == 0.0


@pytest.mark.parametrize("degrees", range(0, 360, 15))
def test_never_reports_more_than_z_max(degrees):
    empty = np.zeros((7, 9), dtype=bool)
    true = at(empty, 4.0, 3.0, degrees)
    for z_max in (0.0, 0.5, 3.0, 4.0, true, np.nextafter(true, 0.0), 100.0, np.inf):
        assert at(empty, 4.0, 3.0, degrees, z_max) == min(true, z_max)


# --- exact: beams of rational numbers ------------------------------------------------------------


def exact_ranges(blocked, start, heading, unit=4):
    """Ranges by integer arithmetic: every box, no traversal, no rounding before the last line.

    Args:
        blocked: ``(H, W)``.
        start: ``(N, 2)`` of integers; x and y in ``1 / unit`` of a cell.
        heading: ``(N, 2)`` of integers; any vector along the beam.
        unit: Fractions of a cell.

    Times are counted in units of 1 / (unit |a| |b|), so that each is an integer (with a zero
    component replaced by 1 there: the beam never crosses the other axis' lines).
    """
    rows, cols = np.nonzero(np.pad(blocked, 1, constant_values=True))
    corner = unit * (np.stack([cols, rows], axis=-1) - 1)
    low = corner - start[:, None, :]
    high = low + unit
    enters, leaves = np.empty_like(low), np.empty_like(low)
    never = np.iinfo(np.int64).max // 4
    size = np.maximum(abs(heading), 1)
    for axis in range(2):
        sign = np.sign(heading[:, None, axis])
        other = size[:, None, 1 - axis]
        near = np.where(sign > 0, low[..., axis], -high[..., axis]) * other
        far = np.where(sign > 0, high[..., axis], -low[..., axis]) * other
        between = (low[..., axis] <= 0) & (high[..., axis] >= 0)
        enters[..., axis] = np.where(sign == 0, np.where(between, -never, never), near)
        leaves[..., axis] = np.where(sign == 0, np.where(between, never, -never), far)
    entry, exit_ = enters.max(axis=-1), leaves.min(axis=-1)
    touched = (entry <= exit_) & (exit_ > 0)
    first = np.where(touched, np.maximum(entry, 0), never).min(axis=1)
    return first / (unit * size.prod(axis=1)) * np.hypot(*heading.T)


def rational_beams(rng, shape, n, unit=4):
    """Starts on corners, edges and quarters of cells; headings with small whole components."""
    height, width = shape
    start = rng.integers(0, [unit * width + 1, unit * height + 1], (n, 2))
    start[: n // 3] -= start[: n // 3] % unit
    heading = rng.integers(-6, 7, (n, 2))
    heading[::4] = rng.choice([[1, 0], [0, 1], [-1, 0], [0, -1]], len(heading[::4]))
    heading[1::4] = rng.choice([[1, 1], [-1, 1], [1, -1], [-1, -1]], len(heading[1::4]))
    heading[(heading == 0).all(axis=1)] = 3, 5
    return start, heading


def test_exact_on_rational_beams():
    """Most of these meet corners or run along edges; none is excluded."""
    rng = np.random.default_rng(11)
    for blocked in some_maps():
        start, heading = rational_beams(rng, blocked.shape, 1000)
        for d in (
            heading / np.hypot(*heading.T)[:, None],
            np.stack([f(np.arctan2(*heading.T[::-1])) for f in (np.cos, np.sin)], axis=-1),
        ):
            z = shoot(blocked, *(start / 4).T, *d.T)
            expected = exact_ranges(blocked, start, heading)
            np.testing.assert_allclose(z, expected, rtol=0.0, atol=TOLERANCE)


# --- shapely -------------------------------------------------------------------------------------


def obstacles(blocked, grow):
    """Blocked squares and the outside as one geometry, its border moved outwards by ``grow``.

    Shrinking square by square would open slits between neighbours, so blocks of two and of four
    squares are shrunk as well: with them the union is the erosion of all that is blocked.
    """
    solid = np.pad(blocked, 1, constant_values=True)
    boxes = []
    for height, width in [(1, 1), (1, 2), (2, 1), (2, 2)]:
        full = np.lib.stride_tricks.sliding_window_view(solid, (height, width)).all(axis=(2, 3))
        row, col = np.nonzero(full)
        sides = col - 1 - grow, row - 1 - grow, col - 1 + width + grow, row - 1 + height + grow
        boxes.append(shapely.box(*sides))
    return shapely.union_all(np.concatenate(boxes))


def shapely_ranges(geometry, x, y, dx, dy, reach):
    """Distance from each start to the first point of the beam in a geometry.

    A beam is open at its start: where it leaves the obstacle that it starts on, it does not touch
    it. Beams that start on a grid line, where obstacles have their edges, are therefore followed
    from ``ADVANCE`` on. The nearest other obstacle is a whole cell away, except near corners; a
    beam that is inside something after so short a way was stopped at once.
    """
    on_line = (abs(x - np.round(x)) < 1e-6) | (abs(y - np.round(y)) < 1e-6)
    skip = np.where(on_line, ADVANCE, 0.0)
    near = shapely.points(x + skip * dx, y + skip * dy)
    ends = np.stack([x + skip * dx, y + skip * dy, x + reach * dx, y + reach * dy], axis=-1)
    beams = shapely.linestrings(ends.reshape(-1, 2, 2))
    z = shapely.distance(near, shapely.intersection(beams, geometry))
    return np.where(z > 0.0, z + skip, 0.0)


def beams(rng, shape, n):
    """Four kinds of start times four kinds of heading, and which beams are random in both."""
    height, width = shape
    x, y = rng.uniform(0.0, width, n), rng.uniform(0.0, height, n)
    where = rng.choice(4, n, p=[0.7, 0.1, 0.1, 0.1])
    x = np.where(where % 2 == 1, np.round(x), x)
    y = np.where(where >= 2, np.round(y), y)
    whole = rng.integers(1, 9, (2, n)) * rng.choice([-1, 1], (2, n))
    theta = np.choose(
        how := rng.choice(4, n, p=[0.7, 0.1, 0.1, 0.1]),
        [
            rng.uniform(-pi, pi, n),
            rng.integers(-4, 5, n) * pi / 2,
            rng.integers(-4, 5, n) * pi / 2 + pi / 4,
            np.arctan2(*whole),
        ],
    )
    return x, y, np.cos(theta), np.sin(theta), (where == 0) & (how == 0)


def compare_with_shapely(n_beams):
    """Counts and largest error over ``n_beams`` beams on 20 maps; asserts that none is wrong."""
    rng = np.random.default_rng(12)
    total = certain = random_total = random_certain = 0
    worst = 0.0
    maps = list(some_maps())
    for blocked in maps:
        *beam, is_random = beams(rng, blocked.shape, n_beams // len(maps))
        z = shoot(blocked, *beam)
        reach = ceil(np.hypot(*blocked.shape)) + 1.0
        shortest, nominal, longest = (
            shapely_ranges(obstacles(blocked, grow), *beam, reach)
            for grow in (TOLERANCE, 0.0, -TOLERANCE)
        )
        assert np.all(z >= shortest - TOLERANCE)
        assert np.all(z <= longest + TOLERANCE)
        narrow = longest - shortest < NARROW
        worst = max(worst, abs(z - nominal)[narrow].max())
        total, certain = total + len(z), certain + int(narrow.sum())
        random_total += int(is_random.sum())
        random_certain += int((narrow & is_random).sum())
    print(
        f"{certain} of {total} beams certain ({random_certain} of {random_total} random ones); "
        f"largest difference from shapely {worst:.2g} cell"
    )
    assert worst <= TOLERANCE
    assert random_certain > 0.99 * random_total
    assert certain > 0.8 * total


def test_agrees_with_shapely():
    compare_with_shapely(3_000)


@pytest.mark.slow
def test_agrees_with_shapely_on_a_hundred_thousand_beams():
    compare_with_shapely(100_000)


# --- diagonal walls ------------------------------------------------------------------------------


@pytest.mark.parametrize("flip", [False, True])
def test_no_beam_passes_where_two_cells_meet(flip):
    """From each free quadrant, at 1,000 angles, through the very point in which they touch."""
    blocked = np.zeros((20, 24), dtype=bool)
    blocked[9, 12] = blocked[10, 13] = True
    corner = np.array([13.0, 10.0])
    if flip:
        blocked, corner = blocked[:, ::-1].copy(), np.array([11.0, 10.0])
    angles = np.linspace(0.0, pi / 2, 1002)[1:-1]
    quadrants = (0.0, pi) if flip else (pi / 2, -pi / 2)
    for theta in np.concatenate([angles + q for q in quadrants]):
        d = np.array([np.cos(theta), np.sin(theta)])
        for t in (1e-3, 0.5, 1.0, np.sqrt(2), 3.7, 8.9):
            z = cast_ray(blocked, *(corner - t * d), *d, FAR)
            assert z == pytest.approx(t, abs=TOLERANCE)


def test_no_beam_passes_a_diagonal_wall():
    """Aimed at a corner of the staircase from anywhere, a beam ends there at the latest."""
    height, width = 9, 12
    row, col = np.indices((height, width))
    blocked = row == col - 1
    rng = np.random.default_rng(13)
    start = rng.uniform([0.0, 0.0], [width, height], (5000, 2))
    start[::2] = np.round(4 * start[::2]) / 4 + 0.125
    k = rng.integers(1, height, 5000)
    d = np.stack([k + 1.0, k], axis=-1) - start
    distance = np.hypot(*d.T)
    z = shoot(blocked, *start.T, *(d / distance[:, None]).T)
    assert np.all(z <= distance + TOLERANCE)
    assert np.mean(abs(z - distance) <= TOLERANCE) > 0.1


# --- symmetries ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("turn", "move"),
    [
        (lambda m: m.T[:, ::-1], lambda x, y, dx, dy, h, w: (h - y, x, -dy, dx)),
        (lambda m: m[::-1, ::-1], lambda x, y, dx, dy, h, w: (w - x, h - y, -dx, -dy)),
        (lambda m: m[:, ::-1], lambda x, y, dx, dy, h, w: (w - x, y, -dx, dy)),
        (lambda m: m[::-1], lambda x, y, dx, dy, h, w: (x, h - y, dx, -dy)),
        (lambda m: m.T, lambda x, y, dx, dy, h, w: (y, x, dy, dx)),
    ],
    ids=["quarter turn", "half turn", "mirror x", "mirror y", "transpose"],
)
def test_turned_map_and_pose_give_the_same_ranges(turn, move):
    rng = np.random.default_rng(14)
    for blocked in some_maps():
        start, heading = rational_beams(rng, blocked.shape, 50)
        rational = *(start / 4).T, *(heading / np.hypot(*heading.T)[:, None]).T
        *floating, _ = beams(rng, blocked.shape, 100)
        for beam in (rational, floating):
            moved = move(*beam, *blocked.shape)
            turned = np.ascontiguousarray(turn(blocked))
            z, z_turned = shoot(blocked, *beam), shoot(turned, *moved)
            np.testing.assert_allclose(z_turned, z, rtol=0.0, atol=TOLERANCE)


@settings(max_examples=200, deadline=None, derandomize=True, database=None)
@given(
    before=hnp.arrays(np.bool_, (6, 8)),
    more=hnp.arrays(np.bool_, (6, 8)),
    x=st.floats(0.0, 8.0) | st.integers(0, 16).map(lambda n: n / 2),
    y=st.floats(0.0, 6.0) | st.integers(0, 12).map(lambda n: n / 2),
    theta=st.floats(-pi, pi) | st.integers(-4, 4).map(lambda n: n * pi / 4),
    z_max=st.floats(0.0, 12.0),
)
def test_more_obstacles_never_lengthen_a_range(before, more, x, y, theta, z_max):
    d = np.cos(theta), np.sin(theta)
    z = cast_ray(before, x, y, *d, z_max)
    assert 0.0 <= cast_ray(before | more, x, y, *d, z_max) <= z <= z_max


# --- scans in metres -----------------------------------------------------------------------------

CELLS = (np.random.default_rng(15).random((7, 11)) < 0.2).astype(np.uint8)
BEARINGS = np.linspace(-2.0, 2.0, 9)


def random_poses(grid, n, rng):
    x_min, x_max, y_min, y_max = grid.extent
    return rng.uniform([x_min, y_min, -pi], [x_max, y_max, pi], (n, 3))


def test_a_scan_is_its_beams_in_metres():
    grid = OccupancyGrid(CELLS, resolution=0.25, origin=(-3.0, 12.5))
    poses = random_poses(grid, 60, np.random.default_rng(16)).reshape(3, 20, 3)
    scan = cast_scan(grid, poses, BEARINGS, 0.75)
    assert scan.shape == (3, 20, 9)
    assert 0.1 < np.mean(scan == 0.75) < 0.9
    for place in np.ndindex(3, 20):
        x, y, theta = poses[place]
        for bearing, z in zip(BEARINGS, scan[place], strict=True):
            d = np.cos(theta + bearing), np.sin(theta + bearing)
            in_cells = cast_ray(CELLS != 0, (x + 3.0) / 0.25, (y - 12.5) / 0.25, *d, 3.0)
            assert z == pytest.approx(0.25 * in_cells, abs=1e-12)


def test_a_scan_of_one_pose_has_one_range_a_beam():
    grid = OccupancyGrid(np.zeros((2, 4), dtype=np.uint8), resolution=0.5, origin=(1.0, 2.0))
    scan = cast_scan(grid, [1.5, 2.25, pi / 2], [-pi / 2, 0.0, pi / 2, pi], 10.0)
    np.testing.assert_allclose(scan, [1.5, 0.75, 0.5, 0.25])


def test_no_pose_gives_an_empty_scan():
    grid = OccupancyGrid(CELLS)
    assert cast_scan(grid, np.empty((0, 3)), BEARINGS, 1.0).shape == (0, 9)


def test_unknown_cells_stop_beams():
    grid = OccupancyGrid([[0, 0, 2, 0]], resolution=1.0)
    np.testing.assert_allclose(cast_scan(grid, [0.5, 0.5, 0.0], [0.0], 10.0), [1.5])


def test_a_pose_on_a_grid_line_is_on_it_despite_rounding():
    """0.15 / 0.05 is below 3; the beam still runs along the pillar's edge and stops at it."""
    pillar = room(".....", ".....", "..#..", ".....", ".....").astype(np.uint8)
    grid = OccupancyGrid(pillar, resolution=0.05)
    scan = cast_scan(
        grid, [[0.01, 0.15, 0.0], [0.15, 0.24, -pi / 2], [0.15, 0.15, 0.4]], [0.0], 9.0
    )
    np.testing.assert_allclose(scan[:, 0], [0.09, 0.09, 0.1 / np.cos(0.4)], atol=1e-12)
    from_edge = cast_scan(grid, [0.15, 0.125, 0.0], [0.0, pi / 2, pi], 9.0)
    np.testing.assert_allclose(from_edge, [0.1, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("scale", [0.01, 3.0, 1000.0])
def test_ranges_scale_with_the_resolution(scale):
    small = OccupancyGrid(CELLS, resolution=1.0, origin=(2.0, -5.0))
    large = OccupancyGrid(CELLS, resolution=scale, origin=(2.0 * scale, -5.0 * scale))
    poses = random_poses(small, 200, np.random.default_rng(17))
    np.testing.assert_allclose(
        cast_scan(large, poses * [scale, scale, 1.0], BEARINGS, 4.0 * scale),
        scale * cast_scan(small, poses, BEARINGS, 4.0),
        rtol=0.0,
        atol=TOLERANCE * scale,
    )


def test_a_scan_writes_into_none_of_its_arguments():
    grid = OccupancyGrid(CELLS, resolution=0.1)
    poses, bearings = random_poses(grid, 5, np.random.default_rng(18)), BEARINGS.copy()
    before = poses.copy()
    cast_scan(grid, poses, bearings, 1.0)
    np.testing.assert_array_equal(poses, before)
    np.testing.assert_array_equal(bearings, BEARINGS)
