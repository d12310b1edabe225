"""Mazes: spanning trees drawn with the odds that the published task draws them with."""

from collections import Counter

import numpy as np
import pytest
from scipy import ndimage

from activeloc.errors import ConfigError
from activeloc.grid import Cell
from activeloc.maps.maze import Maze, is_symmetric


def mazes(size, n, seed=0):
    rng = np.random.default_rng(seed)
    maze = Maze(size=size)
    return [maze.generate(rng) for _ in range(n)]


@pytest.mark.parametrize(("size", "n_free"), [(7, 17), (15, 97), (21, 199)])
def test_is_a_spanning_tree(size, n_free):
    for grid in mazes(size, 20):
        assert grid.shape == (size, size)
        assert grid.count() == {"free": n_free, "occupied": size**2 - n_free, "unknown": 0}
        assert grid.free[1::2, 1::2].all()
        # As many links as rooms less one, and all in one part: a tree.
        assert ndimage.label(grid.free)[1] == 1
        assert not grid.free[0::2, 0::2].any()
        assert grid.blocked[[0, -1]].all()
        assert grid.blocked[:, [0, -1]].all()


def test_no_maze_equals_its_own_rotation():
    for grid in mazes(7, 400):
        for quarters in (1, 2, 3):
            assert not np.array_equal(grid.cells, np.rot90(grid.cells, quarters))


def test_odds_of_the_four_smallest_mazes():
    """By hand, the top row first: a maze of 2 x 2 rooms lacks one of four links.

    The top link is cut with 1/3. Else the left room is shut below with 2/3; else the right one is
    with 2/3; else the bottom link has to be missing.
    """
    expected = {"top": 1 / 3, "left": 4 / 9, "right": 4 / 27, "bottom": 2 / 27}
    place = {"top": (3, 2), "left": (2, 1), "right": (2, 3), "bottom": (1, 2)}
    n = 4000
    missing = Counter(
        name for grid in mazes(5, n) for name, cell in place.items() if grid.cells[cell]
    )
    assert missing.total() == n
    for name, p in expected.items():
        assert abs(missing[name] / n - p) < 4.0 * np.sqrt(p * (1.0 - p) / n)


def test_odds_in_the_top_row_and_below_it():
    grids = mazes(21, 300)
    top = np.mean([grid.free[-2, 2:-2:2] for grid in grids])
    assert abs(top - 2 / 3) < 4.0 * np.sqrt(2 / 9 / (300 * 9))
    # A part of k rooms keeps 1 + (k - 1) / 3 ways down at least; all mazes have one for each part.
    n_parts = np.mean([1 + np.count_nonzero(grid.blocked[-2, 2:-2:2]) for grid in grids])
    n_down = np.mean([np.count_nonzero(grid.free[-3, 1::2]) for grid in grids])
    assert n_parts < n_down < 10.0


def test_odds_of_a_choice_in_the_last_row():
    """Where the outer rooms hang together and the middle one does not, two links are possible."""
    left = []
    for grid in mazes(7, 3000):
        rooms = grid.free.copy()
        rooms[1, [2, 4]] = False
        labels, _ = ndimage.label(rooms)
        if labels[1, 1] == labels[1, 5] != labels[1, 3]:
            left.append(grid.free[1, 2])
    assert len(left) > 60
    assert abs(np.mean(left) - 2 / 3) < 4.0 * np.sqrt(2 / 9 / len(left))


def test_cells_are_of_the_resolution_asked_for():
    grid = Maze(size=7, resolution=0.8).generate(np.random.default_rng(0))
    assert grid.resolution == 0.8
    assert grid.cells[0, 0] == Cell.OCCUPIED


@pytest.mark.parametrize("size", [3, 6, 0, -7, 503, 7.0, True, "7", None])
def test_refuses_sizes(size):
    with pytest.raises(ConfigError, match=r"size must be .*; got|size must be odd, got 6"):
        Maze(size=size)


def eller(n, rng):
    """The law again, with sets of rooms: cells ``(2 n + 1, 2 n + 1)``, the top row drawn first."""
    cells = np.ones((2 * n + 1, 2 * n + 1), dtype=np.uint8)
    cells[1::2, 1::2] = 0
    part = [{col} for col in range(n)]  # The rooms of the row that hang together with each.
    for row in range(n):
        y, last = 2 * (n - row) - 1, row == n - 1
        sideways, down = rng.random((2, n))
        alive = [set(one) for one in part]
        new = [{col} for col in range(n)]
        leads_down = [False] * n
        for col in range(n):
            alone = len(alive[col]) == 1
            apart = col + 1 < n and col + 1 not in alive[col]
            if apart and ((last and alone) or sideways[col] < 2 / 3):
                cells[y, 2 * col + 2] = 0
                joined = alive[col] | alive[col + 1]
                for other in joined:
                    alive[other] = joined
                alone = False
            if last or (not alone and down[col] < 2 / 3):
                for other in alive[col] - {col}:
                    alive[other] = alive[other] - {col}
                alive[col] = {col}
            else:
                cells[y - 1, 2 * col + 1] = 0
                leads_down[col] = True
        for col in range(n):
            if leads_down[col]:
                new[col] = alive[col]
        part = new
    return cells


@pytest.mark.parametrize("size", [5, 7, 15, 21])
def test_draws_what_rooms_kept_in_sets_give(size):
    ours, theirs = np.random.default_rng(size), np.random.default_rng(size)
    for _ in range(40):
        cells = Maze(size).draw(ours)
        while True:
            expected = eller((size - 1) // 2, theirs)
            turned = np.rot90(expected)
            if not (np.array_equal(expected, turned) or np.array_equal(expected, np.rot90(turned))):
                break
        np.testing.assert_array_equal(cells, expected)


def test_symmetry_is_what_turning_finds():
    for code in range(2**9):
        cells = np.array([code >> i & 1 for i in range(9)], dtype=np.uint8).reshape(3, 3)
        expected = any(np.array_equal(cells, np.rot90(cells, quarters)) for quarters in (1, 2))
        assert is_symmetric(cells) == expected
