"""The map relative to a lost robot, against counting poses one by one."""

import numpy as np
import pytest

from activeloc.agents.expected_occupancy import ExpectedOccupancy
from activeloc.maps import from_text
from activeloc.motion import Terrain

L_SHAPE = from_text("##########\n#....#####\n#....#...#\n#........#\n##########", resolution=0.5)
RADIUS, PITCH = 6, 0.3


def looked_up(terrain, poses, x, y):
    """Share of the poses for which the robot could not be at x ahead and y to the left."""
    closed = 0
    for px, py, theta in poses:
        cos, sin = np.cos(theta), np.sin(theta)
        closed += not terrain.contains(
            np.array([px + x * cos - y * sin, py + x * sin + y * cos, 0])
        )
    return closed / len(poses)


@pytest.mark.parametrize("n", [1, 40])
def test_it_is_the_share_of_poses_with_an_obstacle_there(n):
    terrain, rng = Terrain(L_SHAPE, 0.2), np.random.default_rng(3)
    poses = terrain.uniform_poses(rng.random((n, 4)))
    window = ExpectedOccupancy.of(terrain, poses, RADIUS, PITCH)
    offsets = PITCH * np.arange(-RADIUS, RADIUS + 1)
    expected = [[looked_up(terrain, poses, x, y) for x in offsets] for y in offsets]
    np.testing.assert_allclose(window.p, expected, atol=1e-12)
    assert 0.2 < window.p.mean() < 1.0


@pytest.mark.parametrize(("turns", "free"), [*enumerate([(0, 1), (-1, 0), (0, -1), (1, 0)])])
def test_a_corridor_to_the_east_is_where_the_heading_says(turns, free):
    """Row grows to the left, column ahead."""
    corridor = from_text("######\n#....#\n######", resolution=1.0)
    pose = np.array([[1.5, 1.5, turns * np.pi / 2]])
    window = ExpectedOccupancy.of(Terrain(corridor, 0.2), pose, 1, 1.0)
    around = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    assert [place for place in around if window.p[1 + place[0], 1 + place[1]] == 0.0] == [free]


def test_obstacles_that_were_seen_are_certain():
    terrain = Terrain(L_SHAPE, 0.2)
    window = ExpectedOccupancy.of(terrain, np.array([[1.5, 1.25, 0.0]]), RADIUS, PITCH)
    seen = window.with_obstacles(np.array([[0.65, 0.3], [-0.3, -0.6]]), 0.25)
    offsets = PITCH * np.arange(-RADIUS, RADIUS + 1)
    for row, y in enumerate(offsets):
        for col, x in enumerate(offsets):
            is_near = min(np.hypot(x - 0.65, y - 0.3), np.hypot(x + 0.3, y + 0.6)) < 0.25
            assert seen.p[row, col] == (1.0 if is_near else window.p[row, col])
    assert (seen.p != window.p).sum() == 3
