"""The egocentric view, against turning and averaging whole maps."""

import numpy as np
import pytest

from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.lattice import Lattice, LatticeBelief
from activeloc.errors import ConfigError
from activeloc.maps.maze import Maze
from activeloc.plots import plot_egocentric
from activeloc.sensors.depth import depths


def turned(plane, row, col, k, radius):
    """The window of a map around a cell, heading k up.

    Heading 1 is up already. Rows grow upwards here and downwards in ``rot90``, so that its turns
    are clockwise ones.
    """
    padded = np.pad(plane, radius)
    window = padded[row : row + 2 * radius + 1, col : col + 2 * radius + 1]
    return np.rot90(window, k - 1)


def view_of(lattice, belief, robot, radius):
    """What the module promises, state by state."""
    free, side = lattice.free[robot], 2 * radius + 1
    z = depths(free)
    peak = belief.bel[robot].max()
    p_free = np.zeros((side, side))
    readings = np.zeros((4, side, side), dtype=object)
    readings[...] = [[[None] * side] * side] * 4
    for at in np.ndindex(4, side, side):
        readings[at] = set()
    n = 0
    for c, k in np.argwhere(belief.bel[robot] > 0.0):
        row, col = lattice.cells[robot, c]
        p = belief.bel[robot, c, k]
        p_free += p * turned(free, row, col, k, radius)
        if p < 0.01 * peak:
            continue
        n += 1
        for q in range(4):
            seen = turned(z[(k + q) % 4], row, col, k, radius)
            for i, j in np.argwhere(seen):
                readings[q, i, j].add(min(int(seen[i, j]), 16))
    counts = np.vectorize(len)(readings)
    told = np.log(np.maximum(counts, 1)) / np.log(max(min(n, 16), 2))
    return np.concatenate([p_free[None], told]), n


def played(size, p_off, n_robots, n_steps, radius):
    rng = np.random.default_rng(size)
    lattice, robots = Lattice(n_robots, size, p_off), np.arange(n_robots)
    belief = LatticeBelief(lattice)
    view = EgocentricView(belief, radius)
    lattice.place(robots, np.stack([Maze(size).draw(rng) == 0 for _ in robots]))
    view.place(robots)
    state = (rng.random(n_robots) * 4 * lattice.n_cells).astype(np.int32)
    reading, everyone = np.zeros(n_robots, dtype=np.int32), np.ones(n_robots, dtype=np.bool_)
    for step in range(n_steps + 1):
        actions = rng.integers(3, size=n_robots) if step else np.full(n_robots, 3)
        lattice.move_and_read(everyone, actions, rng.random((n_robots, 2)), state, reading)
        if step:
            belief.step(everyone, actions, reading)
        else:
            belief.reset(robots, reading)
    return lattice, belief, view


@pytest.mark.parametrize(
    ("size", "p_off", "radius", "n_steps"),
    [(7, 0.0, 9, 0), (7, 0.0, 3, 3), (15, 0.0, 9, 0), (15, 0.0, 9, 4), (21, 0.0, 4, 6),
     (9, 0.106, 9, 0), (9, 0.106, 5, 5)],
)  # fmt: skip
def test_is_every_candidates_surroundings_turned_and_averaged(size, p_off, radius, n_steps):
    lattice, belief, view = played(size, p_off, 4, n_steps, radius)
    drawn = view.draw()
    assert drawn.shape == (4, 5, 2 * radius + 1, 2 * radius + 1)
    assert drawn.dtype == np.float32
    for robot in range(4):
        expected, _ = view_of(lattice, belief, robot, radius)
        np.testing.assert_allclose(drawn[robot], expected, atol=5e-6)
    assert 0.0 <= drawn.min() <= drawn.max() <= 1.0


def test_a_robot_that_knows_where_it_is_sees_its_maze_and_expects_no_news():
    """One corridor with a bay on one side: no two places are alike."""
    free = np.zeros((7, 7), dtype=np.bool_)
    free[2, 1:6] = True
    free[3, 4] = True
    lattice = Lattice(1, 7)
    lattice.place(np.array([0]), free[None])
    belief = LatticeBelief(lattice)
    view = EgocentricView(belief, 3)
    view.place(np.array([0]))
    belief.reset(np.array([0]), np.array([4], dtype=np.int32))  # Both ends see five cells.
    both = view.draw()[0]
    assert both[0, 3, 3] == 1.0
    np.testing.assert_array_equal(both[0, 3:, 3], [1.0, 1.0, 1.0, 1.0])  # Ahead is up.
    # The bay is on the left of the robot that looks along +col, three cells ahead of it; on the
    # right of the other, one cell ahead of that.
    assert both[0, 6, 2] == 0.5
    assert both[0, 4, 4] == 0.5
    # At that place a reading to the left tells the two apart: 2 cells or 1.
    assert both[2, 6, 3] == 1.0
    assert both[1, 6, 3] == 0.0
    one = np.ones(1, dtype=np.bool_)
    for depth in (3, 2, 1):
        belief.step(one, np.array([2]), np.array([depth], dtype=np.int32))
    belief.step(one, np.array([0]), np.array([1], dtype=np.int32))
    assert belief.largest[0] == 1.0
    sure = view.draw()[0]
    assert not sure[1:].any()
    np.testing.assert_array_equal(sure[0] > 0.0, turned(free, 2, 4, 1, 3))


def test_the_view_does_not_depend_on_where_north_is():
    rng = np.random.default_rng(2)
    free = Maze(15).draw(rng) == 0
    views = []
    for quarter in range(4):
        lattice = Lattice(1, 15)
        lattice.place(np.array([0]), np.rot90(free, -quarter)[None])
        belief = LatticeBelief(lattice)
        view = EgocentricView(belief, 9)
        view.place(np.array([0]))
        belief.reset(np.array([0]), np.array([2], dtype=np.int32))
        views.append(view.draw()[0])
    for other in views[1:]:
        np.testing.assert_allclose(other, views[0], atol=5e-6)


def test_it_can_be_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from PIL import Image

    lattice, belief, view = played(7, 0.0, 1, 0, 4)
    candidates = belief.candidates()
    places = [lattice.pose_of(0, int(s)) for s in candidates.states[0, : candidates.n[0]]]
    given = [lattice.free[0], np.array(places).astype(int), view.draw()[0]]
    plot_egocentric(*given, tmp_path / "view.png")
    with Image.open(tmp_path / "view.png") as image:
        assert len(image.convert("RGB").getcolors(1_000_000)) > 20
    for i, wrong in enumerate((np.zeros(3), np.zeros((2, 2)), np.zeros((4, 9, 9)))):
        with pytest.raises(ConfigError, match="free must be"):
            plot_egocentric(*given[:i], wrong, *given[i + 1 :], tmp_path / "no.png")
    assert not (tmp_path / "no.png").exists()
