import numpy as np
import pytest

from activeloc.errors import MapError
from activeloc.grid import MAX_CELLS, Cell, OccupancyGrid

CELLS = np.array([[0, 1, 2, 0, 0], [0, 0, 0, 1, 0], [2, 0, 0, 0, 0]], dtype=np.uint8)


def grid_of(*rows, **options):
    """A map drawn as text, row 0 first: ``.`` is free, ``#`` occupied, ``?`` unknown."""
    return OccupancyGrid([[".#?".index(cell) for cell in row] for row in rows], **options)


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (np.zeros(4, dtype=np.uint8), r"cells must be \(H, W\), not empty; got shape \(4,\)"),
        (np.zeros((2, 2, 3), dtype=np.uint8), r"got shape \(2, 2, 3\)"),
        (np.zeros((0, 5), dtype=np.uint8), r"got shape \(0, 5\)"),
        (np.uint8(0), r"got shape \(\)"),
        ([[0, 1, 3]], r"0 \(free\), 1 \(occupied\) or 2 \(unknown\), got int64 .*\[0 1 3\]"),
        ([[0, -1]], r"got int64 with values \[-1  0\]"),
        ([[0.0, 1.0]], r"got float64 with values \[0\. 1\.\]"),
        ([[0.0, np.nan]], r"got float64 with values \[ 0\. nan\]"),
        ([["0", "1"]], r"got <U1 with values \['0' '1'\]"),
        (np.ones((3, 5), dtype=np.uint8), "no free cell among 15"),
        (np.full((2, 3), 2), "no free cell among 6"),
    ],
)
def test_refuses_cells(cells, message):
    with pytest.raises(MapError, match=message):
        OccupancyGrid(cells)


def test_refuses_a_map_too_large_to_work_with():
    huge = np.broadcast_to(np.uint8(0), (5001, 5000))
    with pytest.raises(MapError, match=f"25005000 cells; at most {MAX_CELLS} are allowed"):
        OccupancyGrid(huge)


@pytest.mark.parametrize("resolution", [0.0, -0.05, 1000.5, np.inf, np.nan])
def test_refuses_resolution(resolution):
    with pytest.raises(MapError, match=rf"resolution must be in \(0, 1000\] m, got {resolution}"):
        OccupancyGrid(CELLS, resolution=resolution)


@pytest.mark.parametrize("origin", [(0.0, np.nan), (np.inf, 0.0), (1.0, 2.0, 3.0), (1.0,), 4.0])
def test_refuses_origin(origin):
    with pytest.raises(MapError, match="origin must be two finite numbers, got") as caught:
        OccupancyGrid(CELLS, origin=origin)
    assert str(origin) in str(caught.value)


@pytest.mark.parametrize(
    "wrong", [{"cells": [[7]]}, {"cells": [[1]]}, {"resolution": 0.0}, {"origin": (0.0,)}]
)
def test_an_error_names_the_map(wrong):
    with pytest.raises(MapError, match=r"^attic: "):
        OccupancyGrid(**({"cells": CELLS, "name": "attic"} | wrong))


def test_a_map_error_is_a_value_error():
    assert issubclass(MapError, ValueError)


@pytest.mark.parametrize("resolution", [1e-3, 1000.0])
def test_accepts_resolutions_up_to_the_bounds(resolution):
    assert OccupancyGrid(CELLS, resolution=resolution).resolution == resolution


# --- what is kept --------------------------------------------------------------------------------


def test_defaults():
    grid = OccupancyGrid(CELLS)
    assert (grid.resolution, grid.origin, grid.name) == (0.05, (0.0, 0.0), "map")
    assert grid.shape == (3, 5)


@pytest.mark.parametrize("dtype", [np.uint8, np.int8, np.int64, np.uint64])
def test_keeps_cells_as_uint8_in_row_order(dtype):
    grid = OccupancyGrid(np.asfortranarray(CELLS.astype(dtype)))
    np.testing.assert_array_equal(grid.cells, CELLS)
    assert grid.cells.dtype == np.uint8
    assert grid.cells.flags.c_contiguous


def test_true_is_occupied():
    grid = OccupancyGrid(np.array([[True, False]]))
    np.testing.assert_array_equal(grid.cells, [[Cell.OCCUPIED, Cell.FREE]])


def test_cells_are_a_copy_of_the_input():
    cells = CELLS.copy()
    grid = OccupancyGrid(cells)
    cells[0, 0] = Cell.OCCUPIED
    np.testing.assert_array_equal(grid.cells, CELLS)
    assert cells.flags.writeable


def test_nothing_can_be_written():
    grid = OccupancyGrid(CELLS)
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = Cell.OCCUPIED
    with pytest.raises(AttributeError, match="cannot assign to field 'resolution'"):
        grid.resolution = 1.0


def test_free_and_blocked_part_the_map():
    grid = grid_of(".#?", "?..")
    np.testing.assert_array_equal(grid.free, [[True, False, False], [False, True, True]])
    np.testing.assert_array_equal(grid.blocked, ~grid.free)


def test_counts_each_kind():
    assert OccupancyGrid(CELLS).count() == {"free": 11, "occupied": 2, "unknown": 2}
    assert grid_of("..").count() == {"free": 2, "occupied": 0, "unknown": 0}


# --- frame ---------------------------------------------------------------------------------------


def test_extent_grows_with_columns_along_x_and_rows_along_y():
    assert OccupancyGrid(CELLS, 0.5, (-1.0, 2.0)).extent == (-1.0, 1.5, 2.0, 3.5)


def test_cell_coordinates_by_hand():
    grid = OccupancyGrid(CELLS, resolution=0.5, origin=(-1.0, 2.0))
    np.testing.assert_allclose(grid.to_cells([-1.0, 2.0]), [0.0, 0.0])
    np.testing.assert_allclose(grid.to_cells([1.5, 3.5]), [5.0, 3.0])
    np.testing.assert_allclose(grid.to_cells([[0.0, 2.25], [-1.5, 2.0]]), [[2.0, 0.5], [-1.0, 0.0]])
    np.testing.assert_allclose(grid.to_metres([4.0, 1.0]), [1.0, 2.5])


@pytest.mark.parametrize("shape", [(2,), (6, 2), (3, 4, 2), (0, 2)])
def test_to_metres_inverts_to_cells(shape):
    grid = OccupancyGrid(CELLS, resolution=0.07, origin=(-12.3, 4.5))
    xy = np.random.default_rng(0).uniform(-20.0, 20.0, shape)
    assert grid.to_cells(xy).shape == shape
    np.testing.assert_allclose(grid.to_metres(grid.to_cells(xy)), xy, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(grid.to_cells(grid.to_metres(xy)), xy, rtol=0.0, atol=1e-11)


# --- clearance -----------------------------------------------------------------------------------


def distance_to_squares(blocked, row, col):
    """From a cell's centre to the nearest blocked square, one after the other [cell]."""
    height, width = blocked.shape
    nearest = np.inf
    for r in range(-1, height + 1):
        for c in range(-1, width + 1):
            if not (0 <= r < height and 0 <= c < width) or blocked[r, c]:
                across, along = max(abs(c - col) - 0.5, 0.0), max(abs(r - row) - 0.5, 0.0)
                nearest = min(nearest, np.hypot(across, along))
    return nearest


@pytest.mark.parametrize("seed", range(6))
def test_clearance_is_the_distance_to_the_nearest_square(seed):
    """A disc passes the corner of a square exactly as near as it does the square's side."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((9, 13)) < rng.uniform(0.0, 0.25), rng.integers(1, 3, (9, 13)), 0)
    grid = OccupancyGrid(cells, resolution=0.2)
    expected = [[0.2 * distance_to_squares(cells != 0, *rc) for rc in row] for row in places(cells)]
    np.testing.assert_allclose(grid.clearance, expected, rtol=0.0, atol=1e-14)


def places(cells):
    height, width = cells.shape
    return [[(row, col) for col in range(width)] for row in range(height)]


def test_clearance_along_the_axes_and_at_a_corner():
    grid = grid_of("#......", ".......", ".......", ".......", ".......", resolution=2.0)
    np.testing.assert_allclose(grid.clearance[0], [0, 1, 1, 1, 1, 1, 1])
    assert grid.clearance[1, 1] == pytest.approx(2.0 * np.sqrt(0.5))
    assert grid.clearance[2, 3] == 5.0


def test_clearance_of_a_corridor_is_half_its_width():
    np.testing.assert_allclose(
        grid_of("#####", ".....", "#####", resolution=0.1).clearance[1], 0.05
    )


def test_unknown_cells_and_the_outside_bound_the_clearance():
    np.testing.assert_allclose(
        grid_of("...?..", resolution=1.0).clearance, [[0.5] * 3 + [0, 0.5, 0.5]]
    )


# --- passable ------------------------------------------------------------------------------------


def test_passable_is_the_largest_part():
    grid = grid_of("..#...", "..#...", "..#...", resolution=1.0)
    np.testing.assert_array_equal(grid.passable(0.0), [[0, 0, 0, 1, 1, 1]] * 3)


def test_parts_that_touch_in_a_corner_are_apart():
    grid = grid_of("..##", "..##", "##..", "##..", "##..")
    expected = np.zeros((5, 4), dtype=bool)
    expected[2:, 2:] = True
    np.testing.assert_array_equal(grid.passable(0.0), expected)


def test_unknown_cells_are_not_passable():
    np.testing.assert_array_equal(grid_of(".?..").passable(0.0), [[0, 0, 1, 1]])


def test_a_disc_keeps_its_radius_from_walls():
    grid = grid_of(".....", ".....", ".....", ".....", "#....", resolution=1.0)
    inner = np.zeros((5, 5), dtype=bool)
    inner[1:4, 1:4] = True
    np.testing.assert_array_equal(grid.passable(0.5), grid.free)
    inner[3, 1] = False  # its centre is sqrt(1/2) from the corner of the square
    np.testing.assert_array_equal(grid.passable(0.8), inner)
    np.testing.assert_array_equal(grid.passable(1.5), inner)
    inner[3, 1] = True
    np.testing.assert_array_equal(grid.passable(np.sqrt(0.5)), inner)


def test_a_disc_too_wide_for_the_door_stays_in_the_larger_room():
    grid = grid_of("...#....", "........", "...#....", resolution=1.0)
    assert grid.passable(0.5).sum() == 22
    np.testing.assert_array_equal(grid.passable(0.6), [[0] * 8, [0, 0, 0, 0, 1, 1, 1, 0], [0] * 8])


def test_a_disc_that_fits_nowhere_is_an_error():
    with pytest.raises(MapError, match=r"hut: a robot of radius 1\.6 m fits nowhere on this map"):
        grid_of("...", "...", "...", resolution=1.0, name="hut").passable(1.6)


# --- identity ------------------------------------------------------------------------------------


def test_equal_maps_have_equal_digests_whatever_their_name():
    one = OccupancyGrid(CELLS, 0.1, (1.0, 2.0), name="one")
    two = OccupancyGrid(CELLS.astype(np.int64).tolist(), 0.1, [1, 2], name="two")
    assert one == two
    assert one.digest == two.digest
    assert len({one, two}) == 1
    assert len(one.digest) == 64


def test_a_map_under_another_name_keeps_what_was_computed():
    grid = OccupancyGrid(CELLS, 0.1, (1.0, 2.0), name="one")
    clearance = grid.clearance
    twin = grid.renamed("two")
    assert (grid.name, twin.name) == ("one", "two")
    assert twin == grid
    assert twin.clearance is clearance


@pytest.mark.parametrize(
    "other",
    [
        OccupancyGrid(CELLS, 0.2, (1.0, 2.0)),
        OccupancyGrid(CELLS, 0.1, (1.0, 2.5)),
        OccupancyGrid(CELLS, 0.1, (2.0, 1.0)),
        OccupancyGrid(CELLS.reshape(5, 3), 0.1, (1.0, 2.0)),
        OccupancyGrid(CELLS[::-1], 0.1, (1.0, 2.0)),
        OccupancyGrid(CELLS != 0, 0.1, (1.0, 2.0)),
    ],
    ids=["resolution", "origin", "axes of the origin", "shape", "flipped", "unknown is occupied"],
)
def test_maps_that_differ_have_other_digests(other):
    grid = OccupancyGrid(CELLS, 0.1, (1.0, 2.0))
    assert grid != other
    assert grid.digest != other.digest


def test_a_map_is_no_array():
    assert OccupancyGrid(CELLS) != CELLS.tolist()
