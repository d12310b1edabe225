"""Text maps: what is drawn is what is there, the first line on top."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from activeloc.errors import MapError
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps import from_text, to_text

DRAWING = "#####\n#..?#\n#.# #\n"


def test_first_line_is_the_top_row():
    grid = from_text(DRAWING, resolution=0.5, origin=(1.0, -2.0), name="hut")
    top, middle, bottom = [1, 1, 1, 1, 1], [1, 0, 0, 2, 1], [1, 0, 1, 0, 1]
    np.testing.assert_array_equal(grid.cells, [bottom, middle, top])
    assert (grid.resolution, grid.origin, grid.name) == (0.5, (1.0, -2.0), "hut")


def test_drawing_is_the_inverse_of_reading():
    assert to_text(from_text(DRAWING)) == DRAWING.replace(" ", ".")


def test_empty_lines_around_the_map_and_carriage_returns_are_ignored():
    assert from_text("\n\n" + DRAWING.replace("\n", "\r\n")[:-2]) == from_text(DRAWING)


@given(
    hnp.arrays(
        np.uint8, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.integers(0, 2)
    ).filter(lambda cells: (cells == Cell.FREE).any())
)
def test_any_map_survives_text(cells):
    grid = OccupancyGrid(cells, resolution=1.0)
    assert from_text(to_text(grid)) == grid


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("", "empty", id="nothing"),
        pytest.param("\n\n", "empty", id="empty-lines"),
        pytest.param("###\n#.\n###", "line 2: 2 characters.*line 1, 3", id="short-line"),
        pytest.param("\n##\n#..\n##", "line 3: 3 characters.*line 2, 2", id="long-line"),
        pytest.param("###\n\n#.#", "line 2: 0 characters", id="hole"),
        pytest.param("###\n#x#\n###", r"line 2: character 'x' in column 2", id="letter"),
        pytest.param("###\n#\t#\n###", r"line 2: character '\\t' in column 2", id="tab"),
        pytest.param("##\n#█", "line 2: character '█' in column 2", id="block"),
        pytest.param("##\n?#", "no free cell", id="no-free-cell"),
    ],
)
def test_refuses(text, message):
    with pytest.raises(MapError, match=message) as refusal:
        from_text(text)
    assert "\n" not in str(refusal.value)


def test_refuses_a_resolution_of_zero():
    with pytest.raises(MapError, match="resolution"):
        from_text("..", resolution=0.0)
