"""Leaping from square to square against walking from cell to cell: the same ranges, bit for bit."""

from math import pi

import numpy as np
import pytest
from numba import njit

from activeloc.free_squares import LONGEST, free_squares
from activeloc.raycast import EPS, cast_ray

FAR = 1e4


# --- squares -------------------------------------------------------------------------------------


def largest_square(blocked, row, col, row_step, col_step):
    """By trying them all; what is outside the map is blocked."""
    height, width = blocked.shape
    for side in range(1, LONGEST + 2):
        rows = row + row_step * np.arange(side)
        cols = col + col_step * np.arange(side)
        inside = rows.min() >= 0 and rows.max() < height and cols.min() >= 0 and cols.max() < width
        if not inside or blocked[np.ix_(rows, cols)].any():
            return side - 1
    return LONGEST


@pytest.mark.parametrize("density", [0.0, 0.05, 0.4, 1.0])
def test_squares_are_the_largest(density):
    blocked = np.random.default_rng(20).random((9, 14)) < density
    squares = free_squares(blocked)
    assert squares.shape == (4, 11, 16)
    for quadrant, steps in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)]):
        inside = squares[quadrant, 1:-1, 1:-1]
        for row, col in np.ndindex(blocked.shape):
            assert inside[row, col] == largest_square(blocked, row, col, *steps)
        assert squares[quadrant].sum() == inside.sum()


def test_a_side_never_leaves_its_byte():
    squares = free_squares(np.zeros((300, 270), dtype=bool))
    assert squares.max() == LONGEST
    assert squares[0, 1, 1] == squares[3, 300, 270] == LONGEST
    assert squares[0, 300, 270] == squares[3, 1, 1] == 1


def test_squares_of_a_map_turned_in_memory():
    blocked = np.random.default_rng(21).random((6, 9)) < 0.2
    np.testing.assert_array_equal(free_squares(blocked.T), free_squares(blocked.T.copy()))


# --- walking -------------------------------------------------------------------------------------


@njit
def stops(blocked, row, col):
    return not (0 <= row < blocked.shape[0] and 0 <= col < blocked.shape[1]) or blocked[row, col]


@njit
def first_cell(start, direction):
    line = np.floor(start + 0.5)
    if abs(start - line) <= EPS:
        return int(line) if direction >= 0.0 else int(line) - 1
    return int(np.floor(start))


@njit
def walk_along_axis(blocked, across, start, step, by_row):
    line = np.floor(across + 0.5)
    lanes = (int(np.floor(across)), int(np.floor(across)))
    if abs(across - line) <= EPS:
        lanes = (int(line) - 1, int(line))
    along = first_cell(start, step)
    while True:
        for lane in lanes:
            row, col = (along, lane) if by_row else (lane, along)
            if stops(blocked, row, col):
                return max(0.0, (along - start) if step > 0 else (start - along - 1))
        along += step


@njit
def walk(blocked, x, y, dx, dy, z_max):
    """Amanatides and Woo's traversal, cell by cell."""
    if abs(dx) < 1e-14:
        return min(z_max, walk_along_axis(blocked, x, y, 1 if dy > 0.0 else -1, True))
    if abs(dy) < 1e-14:
        return min(z_max, walk_along_axis(blocked, y, x, 1 if dx > 0.0 else -1, False))
    col, row = first_cell(x, dx), first_cell(y, dy)
    if stops(blocked, row, col):
        return 0.0
    col_step, row_step = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    per_col, per_row = 1.0 / dx, 1.0 / dy
    while True:
        next_col = (col + (dx > 0.0) - x) * per_col
        next_row = (row + (dy > 0.0) - y) * per_row
        z = min(next_col, next_row)
        if z >= z_max:
            return z_max
        if next_col < next_row - EPS:
            col += col_step
        elif next_row < next_col - EPS:
            row += row_step
        else:
            if stops(blocked, row, col + col_step) or stops(blocked, row + row_step, col):
                return z
            col += col_step
            row += row_step
        if stops(blocked, row, col):
            return z


@njit
def differences(blocked, squares, beams, z_max):
    """How many beams ``(N, 4)`` leaping and walking disagree about in any bit."""
    n = 0
    for i in range(beams.shape[0]):
        x, y, dx, dy = beams[i]
        n += cast_ray(squares, x, y, dx, dy, z_max) != walk(blocked, x, y, dx, dy, z_max)
    return n


def beams_of(rng, shape, n):
    """Starts anywhere, on lines, on corners, beside them, outside; headings of every kind."""
    height, width = shape
    start = rng.uniform([-1.0, -1.0], [width + 1.0, height + 1.0], (n, 2))
    on_line = rng.random((n, 2)) < 0.3
    start[on_line] = np.round(start[on_line])
    beside = rng.random((n, 2)) < 0.2
    start[beside] += rng.choice([-1.0, 1.0], beside.sum()) * 10.0 ** -rng.uniform(
        4, 14, beside.sum()
    )
    whole = rng.integers(-9, 10, (2, n))
    theta = np.choose(
        rng.integers(0, 5, n),
        [
            rng.uniform(-pi, pi, n),
            rng.integers(-4, 5, n) * pi / 2,
            rng.integers(-4, 5, n) * pi / 4,
            np.arctan2(*whole),
            rng.integers(-4, 5, n) * pi / 2 + 10.0 ** -rng.uniform(3, 16, n),
        ],
    )
    return np.column_stack([start, np.cos(theta), np.sin(theta)])


def maps():
    """Of many shapes and densities, with corridors, diagonal walls and wide halls."""
    rng = np.random.default_rng(22)
    for i in range(60):
        height, width = rng.integers(1, 40, 2)
        row, col = np.indices((height, width))
        if i % 6 == 0:
            yield (row + (1 if i % 4 else -1) * col) % int(rng.integers(3, 9)) == 0
        elif i % 6 == 1:
            yield (row % 7 == 0) & (col % 5 != 0)
        else:
            yield rng.random((height, width)) < rng.choice([0.0, 0.003, 0.03, 0.1, 0.3])
    yield np.zeros((40, 700), dtype=bool)
    hall = np.random.default_rng(23).random((500, 600)) < 2e-5
    yield hall


@pytest.mark.parametrize("z_max", [FAR, 30.0, 3.0])
def test_leaps_leave_no_trace_in_a_range(z_max):
    rng = np.random.default_rng(24)
    for blocked in maps():
        beams = beams_of(rng, blocked.shape, 3000)
        assert differences(blocked, free_squares(blocked), beams, z_max) == 0


def test_a_range_that_is_just_the_longest():
    """z_max a rounding beside the range itself: neither more nor less than walking says."""
    rng = np.random.default_rng(25)
    blocked = rng.random((30, 50)) < 0.02
    squares = free_squares(blocked)
    for beam in beams_of(rng, blocked.shape, 2000):
        z = walk(blocked, *beam, FAR)
        for z_max in (z, np.nextafter(z, 0.0), np.nextafter(z, FAR)):
            assert cast_ray(squares, *beam, z_max) == walk(blocked, *beam, z_max)
