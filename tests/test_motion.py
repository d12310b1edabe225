"""Motion against its formula, against walls in known places, and against its own density.

Every statistical bound is five standard errors at a fixed seed. The terrain of most tests is a
point robot's (radius 0), where the place of every wall is known exactly.
"""

from math import cos, erf, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from activeloc.free_squares import free_squares
from activeloc.grid import OccupancyGrid
from activeloc.maps.text import from_text
from activeloc.motion import (
    MARGIN,
    MotionModel,
    MotionNoise,
    Terrain,
    free_way,
    move,
    slipped,
    wrap,
)
from activeloc.raycast import cast_ray

STILL = MotionNoise()
N = 200_000


def hall(height=200, width=300):
    """An empty map far larger than any motion of the tests."""
    return Terrain(OccupancyGrid(np.zeros((height, width), dtype=np.uint8), 1.0), 0.0)


def drawn(terrain, pose, u, noise, n=N, seed=0):
    """``n`` successors of one pose."""
    normals = np.random.default_rng(seed).standard_normal((n, 3))
    return MotionModel(odometry=noise).sample(terrain, np.tile(pose, (n, 1)), u, normals)[0]


# --- without noise -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("u", "expected"),
    [
        ((0.0, 3.0, 0.0), (53.0, 50.0, 0.0)),
        ((pi / 2, 3.0, -pi / 2), (50.0, 53.0, 0.0)),
        ((0.0, -3.0, 0.0), (47.0, 50.0, 0.0)),
        ((pi / 2, -3.0, 0.3), (50.0, 47.0, pi / 2 + 0.3)),
        ((radians(30), 2.0, radians(15)), (50 + sqrt(3), 51.0, radians(45))),
        ((3.0, 0.0, 3.0), (50.0, 50.0, 6.0 - 2 * pi)),
        ((0.0, 0.0, 0.0), (50.0, 50.0, 0.0)),
    ],
)
def test_without_noise_it_is_exact(u, expected):
    model = MotionModel(STILL, STILL, radius=0.0)
    pose, normals = np.array([[50.0, 50.0, 0.0]]), np.full((1, 3), 7.0)
    reached, read = model.execute(hall(), pose, np.array([u]), np.full((1, 2, 3), 7.0))
    np.testing.assert_allclose(reached, [expected], atol=1e-12)
    np.testing.assert_allclose(read, [u], atol=1e-12)
    successor, shortfall = model.sample(hall(), pose, np.array(u), normals)
    np.testing.assert_array_equal(successor, reached)
    np.testing.assert_allclose(shortfall, 0.0, atol=1e-12)


def test_poses_and_motions_are_not_written_to():
    poses, u, normals = np.array([[50.0, 50.0, 0.5]]), np.array([0.1, 2.0, 0.1]), np.ones((1, 3))
    before = poses.copy(), u.copy(), normals.copy()
    MotionModel(radius=0.0).sample(hall(), poses, u, normals)
    for array, copy in zip((poses, u, normals), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_resolution_and_origin_do_not_change_a_motion():
    fine = Terrain(OccupancyGrid(np.zeros((120, 240), dtype=np.uint8), 0.05, (-3.0, 8.0)), 0.0)
    reached, _ = move(fine, np.array([[-1.0, 9.0, 1.0]]), np.array([0.5, 2.0, 0.25]))
    np.testing.assert_allclose(reached, [[-1 + 2 * cos(1.5), 9 + 2 * sin(1.5), 1.75]], atol=1e-12)


# --- headings ------------------------------------------------------------------------------------


@given(st.floats(-1e3, 1e3))
def test_wrapped_angles_are_the_same_angle_in_half_open_circle(angle):
    wrapped = float(wrap(np.array(angle)))
    assert -pi <= wrapped < pi
    assert cos(wrapped) == pytest.approx(cos(angle), abs=1e-9)
    assert sin(wrapped) == pytest.approx(sin(angle), abs=1e-9)


@pytest.mark.parametrize("angle", [np.nextafter(-pi, -4.0), -pi, pi, 3 * pi, np.nextafter(pi, 4.0)])
def test_pi_itself_wraps_into_the_half_open_circle(angle):
    assert -pi <= wrap(np.array(angle)) < -pi + 1e-9


def test_headings_wrap_across_pi():
    for heading, turn in ((radians(170), radians(20)), (radians(-170), radians(-20))):
        reached, _ = move(hall(), np.array([[50.0, 50.0, heading]]), np.array([turn, 1.0, 0.0]))
        assert reached[0, 2] == pytest.approx(wrap(np.array(heading + turn)), abs=1e-12)
        assert -pi <= reached[0, 2] < pi
        spread = drawn(hall(), [50.0, 50.0, heading], [turn, 0.0, 0.0], MotionNoise(0.2), 10_000)
        assert (spread[:, 2] >= -pi).all()
        assert (spread[:, 2] < pi).all()


# --- noise: each coefficient changes the moments that it should, and no other -------------------

U = (0.4, 3.0, -0.7)
PARTS = {  # Standard deviation of rot1, trans and rot2 per unit of each coefficient, by hand.
    "rotation_from_rotation": (0.4, 0.0, 0.7),
    "rotation_from_translation": (3.0, 0.0, 3.0),
    "translation_from_translation": (0.0, 3.0, 0.0),
    "translation_from_rotation": (0.0, sqrt(0.4**2 + 0.7**2), 0.0),
}


def parts_of(start, end):
    """The rotation, translation and rotation between two poses that lie apart."""
    way = end[:, :2] - start[:2]
    rot1 = wrap(np.arctan2(way[:, 1], way[:, 0]) - start[2])
    return np.stack([rot1, np.hypot(*way.T), wrap(end[:, 2] - start[2] - rot1)])


def assert_moments(values, mean, sigma):
    if sigma == 0.0:
        np.testing.assert_allclose(values, mean, atol=1e-9)
        return
    assert values.mean() == pytest.approx(mean, abs=5 * sigma / sqrt(len(values)))
    assert values.std() == pytest.approx(sigma, abs=5 * sigma / sqrt(2 * len(values)))


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_coefficient_changes_its_own_variance(name, sign):
    noise = MotionNoise(**{name: 0.05})
    u = np.array(U) * (1.0, sign, 1.0)
    start = np.array([50.0, 50.0, 2.0])
    end = drawn(hall(), start, u, noise)
    if sign < 0:  # Seen from behind, a drive backwards is a drive ahead.
        start, end = start + np.array([0.0, 0.0, pi]), end + np.array([0.0, 0.0, pi])
    got = parts_of(start, end)
    for values, mean, unit in zip(got, U, PARTS[name], strict=True):
        assert_moments(values, mean, 0.05 * unit)


@pytest.mark.parametrize("name", PARTS)
def test_odometry_reads_with_the_same_variances(name):
    model = MotionModel(odometry=MotionNoise(**{name: 0.05}))
    poses, normals = np.tile([50.0, 50.0, 0.0], (N, 1)), np.zeros((N, 2, 3))
    normals[:, 1] = np.random.default_rng(1).standard_normal((N, 3))
    _, read = model.execute(hall(), poses, np.tile(U, (N, 1)), normals)
    for values, mean, unit in zip(read.T, U, PARTS[name], strict=True):
        assert_moments(values, mean, 0.05 * unit)


def test_doubling_a_motion_doubles_its_sigma():
    noise = MotionNoise(0.1, 0.02, 0.05, 0.03)
    np.testing.assert_allclose(noise.sigma(2 * np.array(U)), 2 * noise.sigma(np.array(U)))


def test_contributions_add_in_variance():
    total = MotionNoise(0.1, 0.02, 0.05, 0.03).sigma(np.array(U)) ** 2
    alone = sum(
        MotionNoise(**{name: value}).sigma(np.array(U)) ** 2
        for name, value in zip(PARTS, (0.1, 0.02, 0.05, 0.03), strict=True)
    )
    np.testing.assert_allclose(total, alone, rtol=1e-12)


def test_execution_uses_the_actuation_and_sampling_the_odometry():
    model = MotionModel(MotionNoise(0.5), MotionNoise(0.1), radius=0.0)
    poses, normals = np.array([[50.0, 50.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    u = np.array([1.0, 0.0, 0.0])
    given = np.stack([normals, normals], axis=1)
    assert model.execute(hall(), poses, u[None], given)[0][0, 2] == pytest.approx(1.5)
    assert model.sample(hall(), poses, u, normals)[0][0, 2] == pytest.approx(1.1)


def test_samples_follow_the_density():
    """Chi-square of x' against p(x' | u, x) written out in polar form, table 5.5 of the book."""
    noise, u = MotionNoise(0.3, 0.02, 0.15, 0.0), np.array([0.5, 2.0, 0.3])
    start = np.array([50.0, 50.0, -2.5])
    rot1, trans, rot2 = parts_of(start, drawn(hall(), start, u, noise, seed=3))
    sigma = noise.sigma(u)
    edges = [m + s * np.array([-9, -1.5, -0.5, 0, 0.8, 9]) for m, s in zip(u, sigma, strict=True)]
    counts = np.histogramdd(np.stack([rot1, trans, rot2], axis=1), edges)[0]
    cells = [np.diff(norm.cdf(e, m, s)) for e, m, s in zip(edges, u, sigma, strict=True)]
    expected = N * np.einsum("i,j,k->ijk", *cells)
    statistic = ((counts - expected) ** 2 / expected).sum()
    assert chi2.sf(statistic, counts.size - 1) > 1e-6


# --- contact -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [(0, (7.0, 4.5)), (90, (4.5, 6.0)), (180, (2.0, 4.5)), (-90, (4.5, 3.0))],
)
@pytest.mark.parametrize("length", [5.0, -5.0, 1e4])
def test_stops_at_walls_in_all_four_directions(degrees, expected, length):
    cells = np.ones((10, 12), dtype=np.uint8)
    cells[3:6, 2:7] = 0  # Open ground: x in [2, 7], y in [3, 6].
    terrain = Terrain(OccupancyGrid(cells, 1.0), 0.0)
    heading = radians(degrees) + (pi if length < 0 else 0.0)
    reached, carried_out = move(
        terrain, np.array([[4.5, 4.5, heading]]), np.array([0.0, length, 0.2])
    )
    np.testing.assert_allclose(reached[0, :2], expected, atol=2 * MARGIN)
    assert abs(carried_out[0, 1]) == pytest.approx(np.hypot(*(np.array(expected) - 4.5)), abs=1e-5)
    assert np.sign(carried_out[0, 1]) == np.sign(length)
    assert terrain.contains(reached).all()
    assert reached[0, 2] == pytest.approx(wrap(np.array(heading + 0.2)), abs=1e-12)


def test_stops_at_a_wall_met_obliquely():
    cells = np.ones((10, 12), dtype=np.uint8)
    cells[3:6, 2:7] = 0
    terrain = Terrain(OccupancyGrid(cells, 1.0), 0.0)
    reached, carried_out = move(
        terrain, np.array([[4.5, 4.5, radians(60)]]), np.array([0.0, 9.0, 0.0])
    )
    travelled = 1.5 / sin(radians(60))
    assert carried_out[0, 1] == pytest.approx(travelled, abs=2 * MARGIN)
    np.testing.assert_allclose(reached[0, :2], [4.5 + 0.5 * travelled, 6.0], atol=3 * MARGIN)


@pytest.mark.parametrize("degrees", [0, 90, 180, -90, 37])
def test_the_disc_touches_where_the_robot_stops(degrees):
    """Within the half cell by which the configuration space is rounded."""
    resolution, radius = 0.05, 0.3
    cells = np.zeros((60, 80), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    grid = OccupancyGrid(cells, resolution)
    reached, _ = move(
        Terrain(grid, radius), np.array([[1.9, 1.3, radians(degrees)]]), np.array([0.0, 50.0, 0.0])
    )
    x, y = reached[0, :2]
    gap = min(x - 0.05, 3.95 - x, y - 0.05, 2.95 - y)
    assert gap == pytest.approx(radius, abs=resolution)


@pytest.mark.parametrize("length", [0.3, 1.0, 7.3, 1e3, 1e6])
def test_walls_one_cell_thin_are_never_jumped(length):
    cells = np.zeros((21, 40), dtype=np.uint8)
    cells[:, 20] = 1
    cells[np.arange(20), np.arange(20)] = 1  # A diagonal wall whose squares meet in corners.
    cells[np.arange(20), np.arange(20) + 20] = 1
    grid = OccupancyGrid(cells, 0.1)
    terrain = Terrain(grid, 0.0)
    rng = np.random.default_rng(0)
    poses = terrain.uniform_poses(rng.random((20_000, 4)))
    for _ in range(4):
        turn = rng.uniform(-pi, pi, len(poses))
        poses, _ = move(terrain, poses, np.stack([turn, np.full_like(turn, length), turn], axis=1))
        assert terrain.contains(poses).all()


def test_robots_at_contact_can_turn_and_leave():
    terrain = hall(10, 16)
    cells = np.array([[3.0, 5.0, 0.1], [3.0, 5.0, 0.9], [3.0, 5.0, -2.0], [8.0, 2.0, 3.0]])
    stuck, _ = move(terrain, cells, np.array([0.0, 100.0, 0.0]))
    again, refused = move(terrain, stuck, np.array([0.0, 5.0, 0.0]))
    np.testing.assert_allclose(refused[:, 1], 0.0, atol=1e-5)
    np.testing.assert_allclose(again[:, :2], stuck[:, :2], atol=1e-5)
    back, carried_out = move(terrain, stuck, np.array([pi, 1.5, 0.0]))
    np.testing.assert_allclose(carried_out[:, 1], 1.5, atol=1e-9)
    way = np.stack([np.cos(cells[:, 2]), np.sin(cells[:, 2])], axis=1)
    np.testing.assert_allclose(back[:, :2], stuck[:, :2] - 1.5 * way, atol=1e-9)


def test_shortfall_is_what_the_obstacle_took():
    terrain = hall(10, 16)
    poses = np.array([[3.0, 5.0, 0.0], [3.0, 5.0, pi / 2]])
    model = MotionModel(STILL, STILL, radius=0.0)
    _, shortfall = model.sample(terrain, poses, np.array([0.0, 7.0, 0.0]), np.zeros((2, 3)))
    np.testing.assert_allclose(shortfall, [0.0, 2.0], atol=1e-5)
    _, shortfall = model.sample(terrain, poses, np.array([0.0, -7.0, 0.0]), np.zeros((2, 3)))
    np.testing.assert_allclose(shortfall, [4.0, 2.0], atol=1e-5)


@pytest.mark.parametrize(
    ("command", "read", "touched"),
    [
        (0.5, 0.36, False),
        (0.5, 0.34, True),
        (-0.5, -0.36, False),
        (-0.5, -0.34, True),
        (0.5, 0.0, True),
        (0.0, 0.0, False),
        (0.5, 0.7, False),
    ],
)
def test_touched_when_less_than_the_ratio_was_travelled(command, read, touched):
    model = MotionModel(contact_ratio=0.7)
    turn = 0.3
    assert model.touched(np.array([turn, command, 0.0]), np.array([turn, read, 0.0])) == touched


# --- terrain -------------------------------------------------------------------------------------

CORNER = """\
###########
#.....#...#
#.....#.###
#.........#
###.#######
###########
"""


def test_contains_says_open_cells_of_an_asymmetric_map():
    grid = from_text(CORNER, 0.5, (-1.0, 3.0))
    terrain = Terrain(grid, 0.0)
    rng = np.random.default_rng(0)
    xy = rng.uniform([-2.0, 2.0], [6.0, 8.0], (5000, 2))
    lines = CORNER.split()[::-1]
    expected = []
    for x, y in xy:
        row, col = int(np.floor((y - 3.0) / 0.5)), int(np.floor((x + 1.0) / 0.5))
        inside = 0 <= row < len(lines) and 0 <= col < len(lines[0])
        expected.append(inside and lines[row][col] == ".")
    np.testing.assert_array_equal(terrain.contains(np.column_stack([xy, xy[:, 0]])), expected)
    assert not terrain.contains(np.array([[np.nan, 4.0, 0.0], [np.inf, 4.0, 0.0]])).any()


def test_only_the_largest_part_is_open():
    grid = from_text("#######\n#..#..#\n#..#.##\n#######\n", 1.0)
    terrain = Terrain(grid, 0.0)
    np.testing.assert_array_equal(
        terrain.contains(np.array([[1.5, 1.5, 0.0], [4.5, 1.5, 0.0]])), [True, False]
    )
    assert terrain.area == pytest.approx(4.0)


def test_uniform_poses_are_uniform_over_ground_and_headings():
    terrain = Terrain(from_text(CORNER, 0.5, (-1.0, 3.0)), 0.0)
    poses = terrain.uniform_poses(np.random.default_rng(0).random((N, 4)))
    assert terrain.contains(poses).all()
    assert (poses[:, 2] >= -pi).all()
    assert (poses[:, 2] < pi).all()
    # Quarters of cells by eighths of the circle.
    fine = np.floor((poses[:, :2] - [-1.0, 3.0]) / 0.25).astype(int)
    octant = np.floor((poses[:, 2] + pi) / (pi / 4)).astype(int)
    counts = np.zeros((2 * 6, 2 * 11, 8))
    np.add.at(counts, (fine[:, 1], fine[:, 0], octant), 1)
    is_open = np.array([[cell == "." for cell in line] for line in CORNER.split()[::-1]])
    is_open = is_open.repeat(2, axis=0).repeat(2, axis=1)
    assert counts[~is_open].sum() == 0
    observed = counts[is_open]
    expected = N / observed.size
    assert chi2.sf(((observed - expected) ** 2 / expected).sum(), observed.size - 1) > 1e-6


def test_gauss_of_a_long_drive_is_cut_where_the_wall_is():
    """P(stopped) of a drive whose noise straddles a wall, from the normal distribution."""
    terrain = hall(10, 16)
    model = MotionModel(odometry=MotionNoise(0.0, 0.0, 0.1, 0.0), radius=0.0)
    poses = np.tile([6.0, 5.0, 0.0], (N, 1))
    normals = np.random.default_rng(5).standard_normal((N, 3))
    reached, shortfall = model.sample(terrain, poses, np.array([0.0, 9.5, 0.0]), normals)
    p = 0.5 * (1.0 - erf(0.5 / 0.95 / sqrt(2)))
    tolerance = 5 * sqrt(p * (1 - p) / N)
    assert (shortfall > 1e-5).mean() == pytest.approx(p, abs=tolerance)
    assert (np.abs(reached[:, 0] - 16.0) < 1e-5).mean() == pytest.approx(p, abs=tolerance)


# --- ways ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_where_there_is_room_the_way_is_free(seed):
    """Not casting a ray changes nothing, for ways a little longer or shorter than the room."""
    rng = np.random.default_rng(seed)
    squares = free_squares(rng.random((40, 60)) < 0.01)
    skipped = 0
    for _ in range(4_000):
        col, row, heading = rng.uniform(-2, 62), rng.uniform(-2, 42), rng.uniform(-pi, pi)
        if rng.random() < 0.4:
            col, row = np.round(col), np.round(row)
        if rng.random() < 0.3:
            heading = rng.integers(-2, 3) * pi / 2
        dx, dy = np.cos(heading), np.sin(heading)
        quadrant = (dx <= 0.0) + 2 * (dy <= 0.0)
        inside = 0 <= col < 60 and 0 <= row < 40
        side = float(squares[quadrant, int(row) + 1, int(col) + 1]) if inside else 0.0
        wanted = max(0.0, side + rng.uniform(-2.0, 1.5))
        reach = cast_ray(squares, col, row, dx, dy, wanted + 2.0 * MARGIN) - MARGIN
        assert free_way(squares, col, row, dx, dy, wanted) == max(0.0, min(wanted, reach))
        skipped += side - 1.0 > wanted + 2.0 * MARGIN
    assert skipped > 400


def test_the_edge_of_a_wall_is_not_taken_for_room():
    """On the line between a wall and open ground, along it: the closed square stops the robot."""
    blocked = np.zeros((12, 12), dtype=bool)
    blocked[:, 5] = True
    squares = free_squares(blocked)
    for heading in (pi / 2, -pi / 2):
        d = np.cos(heading), np.sin(heading)
        assert free_way(squares, 6.0, 6.5, *d, 2.0) == 0.0
        assert free_way(squares, 6.0 + 1e-6, 6.5, *d, 2.0) == 2.0


def test_a_wrong_reading_stands_for_ways_around_it():
    u, quarter = np.array([0.3, -0.4, 0.7]), pi / 4
    np.testing.assert_allclose(slipped(u, 0.0, 0.0), [0.3 - quarter, 0.0])
    np.testing.assert_allclose(slipped(u, 0.5, 0.5), [0.3, -0.4])
    np.testing.assert_allclose(slipped(u, 0.75, 0.25), [0.3 + quarter / 2, -0.2])
    np.testing.assert_allclose(slipped(np.array([0.0, 0.1, 0.0]), 0.5, 1.0), [0.0, 0.5])
    assert slipped(np.array([0.0, 0.0, 0.0]), 0.5, 1.0)[1] == 0.0


def test_one_call_carries_a_command_out_and_reads_the_odometry():
    """To the bit what the two calls make, walls in the way or not."""
    rng, terrain = np.random.default_rng(4), hall(12, 17)
    model = MotionModel(MotionNoise(0.1, 0.2, 0.3, 0.05), MotionNoise(0.2, 0.1, 0.1, 0.02))
    poses = rng.uniform([0.0, 0.0, -pi], [17.0, 12.0, pi], (300, 3))
    commands, normals = rng.uniform(-3.0, 3.0, (300, 3)), rng.standard_normal((300, 2, 3))
    wanted = commands + normals[:, 0] * model.actuation.sigma(commands)
    reached, done = move(terrain, poses, wanted)
    assert (np.abs(done[:, 1]) < 0.5 * np.abs(commands[:, 1])).sum() > 20
    both = model.execute(terrain, poses, commands, normals)
    np.testing.assert_array_equal(both[0], reached)
    read = done + normals[:, 1] * model.odometry.sigma(done)
    np.testing.assert_array_equal(both[1], read)
