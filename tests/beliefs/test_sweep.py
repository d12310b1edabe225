"""Ranges swept over a whole map against rays, one by one."""

from math import pi

import numpy as np
import pytest

from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.beliefs.sweep import Sweep
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.raycast import cast_ray

AXES = [0.0, pi / 2, -pi / 2, pi, -pi, pi / 4, 3 * pi / 4, -pi / 4, -3 * pi / 4, np.arctan(0.5)]


def clutter(resolution, shape=(26, 38), seed=0):
    """Scattered squares, some of which meet in a corner; the rim is partly open."""
    cells = (np.random.default_rng(seed).random(shape) < 0.12).astype(np.uint8)
    cells[0], cells[:, -1] = 1, 1
    cells[8, 8] = cells[9, 9] = cells[20, 30] = cells[21, 29] = 1
    cells[8, 9] = cells[9, 8] = cells[20, 29] = cells[21, 30] = 0
    return OccupancyGrid(cells, resolution, (-0.3, 1.1))


def rays(poses, squares, angles, reach):
    """``(S, C)``; nearest range in any of the directions from every sub-pose [map cell]."""
    places = poses.terrain.grid.to_cells(poses.sub_poses())
    z = np.full(places.shape[:2], reach)
    for angle in angles:
        dx, dy = float(np.cos(angle)), float(np.sin(angle))
        for c, s in np.ndindex(*z.shape):
            x, y = places[c, s]
            z[c, s] = min(z[c, s], cast_ray(squares, x, y, dx, dy, reach))
    return z.T


def swept(sweep, poses, angles):
    layout = GridLayout(poses)
    out = np.full((SUB * SUB, layout.size), 99, dtype=sweep.dtype)
    sweep.along(np.asarray(angles), out)
    return out[:, layout.place]


# Cells that hold 4, 1, 2, 3 and 8 map cells a side, and some that hold no whole number of them.
@pytest.mark.parametrize("per_cell", [4, 1, 2, 3, 8, 2.5])
@pytest.mark.parametrize("of_terrain", [False, True])
def test_classes_are_those_of_the_rays(per_cell, of_terrain):
    grid = clutter(0.05)
    poses = PoseGrid(Terrain(grid, 0.04), 0.05 * per_cell, 12)
    world = poses.terrain if of_terrain else grid
    # Limits between the ranges that a beam along an axis can have.
    limits = np.append(np.sort(np.random.default_rng(1).uniform(0.0, 17.0, 19)), 17.3)
    sweep = Sweep(poses, world, limits)
    assert sweep.fits == (per_cell != 2.5)
    for angle in [*AXES, *np.random.default_rng(2).uniform(-pi, pi, 4)]:
        z = rays(poses, world.squares, [angle], 17.3)
        np.testing.assert_array_equal(
            swept(sweep, poses, [angle]), np.searchsorted(limits, z, "right")
        )


@pytest.mark.parametrize("per_cell", [4, 2.5])
def test_a_cone_meets_the_nearest(per_cell):
    grid = clutter(0.05)
    poses = PoseGrid(Terrain(grid, 0.04), 0.05 * per_cell, 12)
    limits = np.linspace(0.37, 12.1, 20)
    sweep = Sweep(poses, grid, limits)
    for middle in (0.0, 0.7, -2.2):
        cone = middle + np.array([-0.2, 0.0, 0.2])
        expected = np.searchsorted(limits, rays(poses, grid.squares, cone, 12.1), "right")
        np.testing.assert_array_equal(swept(sweep, poses, cone), expected)


def test_many_classes_take_two_bytes():
    grid = clutter(0.05)
    poses = PoseGrid(Terrain(grid, 0.04), 0.2, 12)
    limits = np.linspace(0.03, 30.0, 700)
    sweep = Sweep(poses, grid, limits)
    assert sweep.dtype == np.uint16
    for angle in (0.3, -1.9):
        expected = np.searchsorted(limits, rays(poses, grid.squares, [angle], 30.0), "right")
        np.testing.assert_array_equal(swept(sweep, poses, [angle]), expected)
    assert swept(sweep, poses, [0.3]).max() > 255


def test_two_maps_alike_are_swept_alike_wherever_they_lie():
    one, other = clutter(0.05), clutter(0.05)
    other = OccupancyGrid(other.cells, 0.05, (117.3, -66.61))
    limits = np.arange(1, 21) * 1.0
    classes = []
    for grid in (one, other):
        poses = PoseGrid(Terrain(grid, 0.04), 0.2, 12)
        sweep = Sweep(poses, grid, limits)
        classes.append(np.stack([swept(sweep, poses, [a]) for a in np.linspace(-pi, pi, 25)]))
    np.testing.assert_array_equal(*classes)
