"""The egocentric view of metric maps, against looking at whole maps from every hypothesis."""

import time

import numpy as np
import pytest

from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.metric_view import HYPOTHESES, MetricView, lookup_of
from activeloc.beliefs.metric_view_kernels import draw_window
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import MapSource, from_text
from activeloc.motion import MotionModel, Terrain
from activeloc.plots import plot_surroundings
from activeloc.raycast import cast_ray
from activeloc.sensors import BeamModel

SENSOR, MOTION = BeamModel(beams=3, field_of_view=np.pi / 3), MotionModel()
# 12 m x 6 m from (-1, 2), neither square nor symmetric.
GRID = from_text(
    """
########################
#......................#
#.......##.............#
#..#....##......###....#
#..#............#......#
#...............#......#
#.....######....#......#
#.....#.........########
#.....#................#
#..............##......#
#......................#
########################
""",
    resolution=0.5,
    origin=(-1.0, 2.0),
    name="yard",
)


def on(grid, poses, weights=None, sensor=SENSOR, motion=MOTION):
    """A histogram belief that holds these poses."""
    belief = HistogramBelief(1, HistogramConfig(cell_size=0.25), sensor, motion)
    belief.reset(0, grid)
    cell, heading = belief.poses(0).states_of(np.asarray(poses, dtype=float))
    prior = np.zeros_like(belief.probabilities(0))
    np.add.at(prior, (cell, heading), 1.0 / len(poses) if weights is None else weights)
    belief.reset(0, grid, prior)
    return belief


def open_share(terrain, x, y):
    """Open sixteenths of the 0.2 m cell around a place."""
    origin = np.array(terrain.grid.origin)
    corner = np.floor((np.array([x, y]) - origin) / 0.2)
    side = (np.arange(4) + 0.5) / 4
    places = (corner + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)) * 0.2 + origin
    return terrain.contains(places), places


def range_class(terrain, x, y, direction, z_max):
    """Class of the range from the middle of the cell's open ground, or from next to it."""
    is_open, places = open_share(terrain, x, y)
    start = places[is_open].mean(axis=0)
    if not terrain.contains(start):
        apart = ((places - start) ** 2).sum(axis=1)
        start = places[np.where(is_open, apart, np.inf).argmin()]
    start = terrain.grid.to_cells(start)
    angle, reach = np.deg2rad(10 * direction), z_max / terrain.grid.resolution
    z = cast_ray(terrain.grid.squares, *start, np.cos(angle), np.sin(angle), reach)
    return 7 if z >= reach else int(z / reach * 7 + 1e-9)


def entropy(p):
    p = np.array([*p]) / sum(p)
    return -(p * np.log(p)).sum()


def slow_window(belief, terrain, radius, z_max):
    """What the module promises of the window, place by place."""
    poses, counts = belief.thinned(0, HYPOTHESES)
    side = 2 * radius + 1
    view = np.zeros((5, side, side))
    for row, col in np.ndindex(side, side):
        forward, right = 0.5 * (row - radius), 0.5 * (col - radius)
        seen = [{} for _ in range(4)]
        for (x, y, theta), n in zip(poses, counts, strict=True):
            px = x + forward * np.cos(theta) + right * np.sin(theta)
            py = y + forward * np.sin(theta) - right * np.cos(theta)
            share = open_share(terrain, px, py)[0].mean()
            view[0, row, col] += share * n / HYPOTHESES
            for q in range(4 if share > 0 else 0):
                direction = (round(np.rad2deg(theta) / 10) + 9 * q) % 36
                z = range_class(terrain, px, py, direction, z_max)
                seen[q][z] = seen[q].get(z, 0) + n
        for q in range(4):
            view[1 + q, row, col] = entropy(seen[q].values()) / np.log(8) if seen[q] else 0.0
    return view


def slow_ways(belief, terrain, bearings, z_max):
    """And of the ways."""
    poses, counts = belief.thinned(0, HYPOTHESES)
    bins = belief.bins(0).index(poses)
    p_bin = [counts[bins == one].sum() / HYPOTHESES for one in np.unique(bins)]
    ways = np.zeros((2, 12, 9))
    for b, k in np.ndindex(12, 9):
        codes, joint = {}, {}
        for (x, y, theta), n, own in zip(poses, counts, bins, strict=True):
            heading = theta + np.pi / 6 * b
            step = 0.25 * np.array([np.cos(heading), np.sin(heading)])
            places = [np.array([x, y]) + i * step for i in range(2 * k + 1)]
            if any(open_share(terrain, *p)[0].sum() < 4 for p in places[1:]):
                code = "stopped"
            else:
                directions = [round(np.rad2deg(heading) / 10) + round(a / 10) for a in bearings]
                code = tuple(range_class(terrain, *places[-1], d % 36, z_max) for d in directions)
                ways[0, b, k] += n / HYPOTHESES
            codes[code] = codes.get(code, 0) + n
            joint[own, code] = joint.get((own, code), 0) + n
        information = entropy(codes.values()) + entropy(p_bin) - entropy(joint.values())
        ways[1, b, k] = information / np.log(128)
    return ways


POSES = [(0.3, 3.1, 0.4), (5.2, 6.9, -2.0), (8.1, 3.2, 1.3), (3.3, 7.2, 2.9), (9.7, 6.4, -0.6)]


# Two poses of one common bin, that a scan tells apart and the bins do not.
ALIKE = [*POSES, (5.2, 6.6, -2.0), (8.4, 3.2, 1.3)]


@pytest.mark.parametrize("poses", [POSES[:1], POSES[1:2], POSES[:3], POSES, ALIKE])
def test_is_every_hypothesis_surroundings_turned_and_averaged(poses):
    belief, terrain = on(GRID, poses), Terrain(GRID, MOTION.radius)
    drawn = MetricView(belief, SENSOR, 4).draw(0)
    window = slow_window(belief, terrain, 4, SENSOR.z_max)
    np.testing.assert_allclose(drawn["view"], window, atol=1e-5)
    ways = slow_ways(belief, terrain, np.rad2deg(SENSOR.bearings), SENSOR.z_max)
    np.testing.assert_allclose(drawn["ways"], ways, atol=1e-5)
    assert window[1:].max() > 0.2 or len(poses) == 1


def test_a_small_robot_on_open_ground_sees_as_far_as_the_map_s_edge():
    """No wall around the map; and beams that are not the same to the left and to the right."""
    sensor, motion = BeamModel(beams=4, field_of_view=np.deg2rad(120)), MotionModel(radius=0.05)
    lawn = from_text("........\n..#.....\n.....#..\n.#......\n......#.", 0.5)
    poses = [(0.3, 1.2, 0.4), (3.6, 0.4, -2.0), (1.7, 2.2, 1.3), (2.6, 1.1, 2.9)]
    belief, terrain = on(lawn, poses, sensor=sensor, motion=motion), Terrain(lawn, 0.05)
    drawn = MetricView(belief, sensor, 4).draw(0)
    window = slow_window(belief, terrain, 4, sensor.z_max)
    np.testing.assert_allclose(drawn["view"], window, atol=1e-5)
    ways = slow_ways(belief, terrain, [-60, 20, 60], sensor.z_max)
    np.testing.assert_allclose(drawn["ways"], ways, atol=1e-5)


def test_one_pose_sees_the_map_turned_and_expects_no_news():
    """Looking along +y from the middle of a pixel: the window is the map, without a turn."""
    belief = on(GRID, [(3.0, 5.0, np.pi / 2)])
    poses, counts = belief.thinned(0, HYPOTHESES)
    assert counts.tolist() == [HYPOTHESES]
    drawn = MetricView(belief, SENSOR, 3).draw(0)
    terrain = Terrain(GRID, MOTION.radius)
    for row, col in np.ndindex(7, 7):
        # The heading is that of a bin, 2.5 degrees off.
        ahead, aside = 0.5 * (row - 3), 0.5 * (col - 3)
        cos, sin = np.cos(poses[0, 2]), np.sin(poses[0, 2])
        place = poses[0, :2] + (ahead * cos + aside * sin, ahead * sin - aside * cos)
        share = open_share(terrain, *place)[0].mean()
        assert drawn["view"][0, row, col] == pytest.approx(share, abs=1e-6)
    assert not drawn["view"][1:].any()
    assert drawn["view"][0].min() == 0.0
    assert set(np.unique(drawn["ways"][0])) == {0.0, 1.0}
    assert not drawn["ways"][1].any()


def test_left_is_left_and_ahead_is_up():
    """A passage that goes on to the left only: no wall for two metres, one beside the robot."""
    passage = from_text(
        "#############\n#...........#\n#.##########.\n#############", resolution=1.0
    )
    belief = on(passage, [(10.6, 2.5, np.pi)])
    drawn = MetricView(belief, SENSOR, 4).draw(0)
    np.testing.assert_array_equal(drawn["view"][0, 4:, 4], 1.0)
    assert drawn["view"][0, 4, 0] == 0.0
    np.testing.assert_array_equal(drawn["ways"][0, 0], 1.0)  # Straight ahead.
    assert drawn["ways"][0, 3, 2:].max() == 0.0  # To the left, a wall.
    corner = on(passage, [(1.5, 2.5, np.pi)])
    seen = MetricView(corner, SENSOR, 4).draw(0)
    assert seen["ways"][0, 3, 2] == 1.0  # A bay there.
    assert seen["ways"][0, 9, 2] == 0.0
    assert seen["view"][0, 4, 2] == 1.0
    assert seen["view"][0, 4, 6] == 0.0


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_it_does_not_depend_on_where_north_is(quarters):
    """Map and belief turned together: the same view."""
    centre = np.array([GRID.shape[1], GRID.shape[0]]) * 0.25  # From the corner [m].
    turned = OccupancyGrid(np.rot90(GRID.cells, -quarters), GRID.resolution, (-1.0, 2.0))
    middle = np.array([turned.shape[1], turned.shape[0]]) * 0.25
    poses, moved = [], []
    for x, y, theta in POSES:
        # The middle of a cell and of a heading bin stays one.
        x, y = np.floor(np.array([x, y]) / 0.25) * 0.25 + 0.125
        theta = np.deg2rad(np.floor(np.rad2deg(theta) / 5) * 5 + 2.5)
        poses.append((x, y, theta))
        angle = np.pi / 2 * quarters
        dx, dy = np.array([x + 1.0, y - 2.0]) - centre
        cos, sin = round(np.cos(angle)), round(np.sin(angle))
        place = middle + np.array([cos * dx - sin * dy, sin * dx + cos * dy])
        heading = (theta + angle + np.pi) % (2 * np.pi) - np.pi
        moved.append((*(place + np.array([-1.0, 2.0])), heading))
    one = MetricView(on(GRID, poses), SENSOR, 6).draw(0)
    other = MetricView(on(turned, moved), SENSOR, 6).draw(0)
    assert one["view"].std() > 0.1
    # Rays are cast from a sub-pose beside the middle of a cell, which a turn may change, and places
    # on the edge of a cell fall to either side.
    for key in ("view", "ways"):
        apart = np.abs(one[key] - other[key])
        assert apart.mean() < 0.02, key
        assert np.quantile(apart, 0.9) < 0.07, key


def beliefs_after(steps, seed=1):
    """Both filters after the same readings."""
    grid = MapSource.parse("office:101").number(0)
    rng = np.random.default_rng(seed)
    histogram = HistogramBelief(1, HistogramConfig(), SENSOR, MOTION)
    particles = ParticleBelief(1, ParticleConfig(), SENSOR, MOTION)
    histogram.reset(0, grid)
    particles.reset(0, grid, rng)
    for u, scan in steps:
        for belief in (histogram, particles):
            if u is not None:
                belief.predict(0, np.array(u), False)
            belief.correct(0, np.array(scan))
    return histogram, particles


def test_both_beliefs_give_one_view_within_sampling_error():
    turn = (np.pi / 6, 0.0, 0.0)
    steps = [(None, (0.8, 1.2, np.inf)), (turn, (1.2, np.inf, np.inf)), (turn, (1.4, 1.3, 0.9))]
    views = [MetricView(belief, SENSOR, 8).draw(0) for belief in beliefs_after(steps)]
    for key in ("view", "ways"):
        one, other = views[0][key][0], views[1][key][0]
        # Two draws of 128 differ by sqrt(2 p (1 - p) / 128) at most, .0625 for p = 1/2, so by .05
        # on average.
        assert np.abs(one - other).mean() < 0.06, key
        assert np.abs(one - other).max() < 0.25, key
        news = np.abs(views[0][key][1:] - views[1][key][1:])
        assert news.mean() < 0.08, key
    assert views[0]["view"][0].std() > 0.08  # It is .1: the view is not one grey.
    np.testing.assert_array_equal(views[0]["place"], views[1]["place"])


def test_drawing_changes_no_belief():
    """The filter's noise after a view is that without one."""
    grid = MapSource.parse("rooms(width=6,height=5,resolution=0.1):1").number(0)
    ends = []
    for looks in (False, True):
        belief = ParticleBelief(1, ParticleConfig(n_min=500, n_start=2000), SENSOR, MOTION)
        belief.reset(0, grid, np.random.default_rng(5))
        view = MetricView(belief, SENSOR, 8)
        for _ in range(4):
            if looks:
                view.draw(0)
            belief.predict(0, np.array([0.5, 0.3, 0.0]), False)
            belief.correct(0, np.array([1.0, 1.2, np.inf]))
        ends.append(belief.particles(0)[0])
    np.testing.assert_array_equal(*ends)


def test_what_has_been_read_and_refused_turns_with_the_robot():
    belief = on(GRID, POSES)
    belief.correct(0, np.array([1.0, np.inf, 0.7]))
    place = MetricView(belief, SENSOR, 2).draw(0)["place"]
    read = np.zeros(12)
    read[[11, 0, 1]] = 0.5
    np.testing.assert_array_equal(place, [*read, *np.zeros(12)])
    belief.predict(0, np.array([np.pi / 3, 0.0, 0.0]), False)
    belief.predict(0, np.array([0.0, 0.0, 0.0]), True)  # Refused ahead,
    belief.predict(0, np.array([np.pi / 6, 0.0, 0.0]), False)  # now on the right.
    place = MetricView(belief, SENSOR, 2).draw(0)["place"]
    np.testing.assert_array_equal(place[:12], np.roll(read, -3))
    assert np.flatnonzero(place[12:]).tolist() == [11]


@pytest.mark.parametrize(("beams", "width"), [(1, 0.0), (2, 0.6), (9, 3.0), (8, 2 * np.pi)])
def test_any_number_of_beams_and_any_range(beams, width):
    sensor = BeamModel(beams=beams, field_of_view=width, z_max=4.0)
    drawn = MetricView(on(GRID, POSES, sensor=sensor), sensor, 3).draw(0)
    for part in drawn.values():
        assert part.dtype == np.float32
        assert np.isfinite(part).all()
        assert 0.0 <= part.min() <= part.max() <= 1.0
    assert drawn["ways"][1].max() > 0.1


def test_a_map_is_looked_up_once():
    first = lookup_of(GRID, MOTION.radius, 1.5)
    MetricView(on(GRID, POSES), SENSOR, 3).draw(0)
    assert lookup_of(GRID, MOTION.radius, 1.5) is first


@pytest.mark.slow
def test_a_view_takes_less_than_a_millisecond():
    belief = on(MapSource.parse("office:101").number(0), POSES)
    view = MetricView(belief, SENSOR, 8)
    view.draw(0)
    rng = np.random.default_rng(0)
    poses = belief.sample(0, 128, rng)
    table = lookup_of(belief.terrain(0).grid, MOTION.radius, SENSOR.z_max)
    out, counts = np.empty((5, 17, 17), np.float32), np.ones(128, np.int64)
    records = table.records
    took = []
    for _ in range(50):
        start = time.thread_time()
        draw_window(poses, counts, table.frame, records, 31, 2.5, out)
        took.append(time.thread_time() - start)
    assert min(took) < 1e-3


def test_it_can_be_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from PIL import Image

    drawn = MetricView(on(GRID, POSES), SENSOR, 4).draw(0)
    given = [GRID.free, GRID.extent, np.array(POSES), drawn["view"], drawn["ways"]]
    plot_surroundings(*given, tmp_path / "view.png")
    with Image.open(tmp_path / "view.png") as image:
        assert len(image.convert("RGB").getcolors(1_000_000)) > 20
    for i, wrong in ((0, np.zeros(3)), (2, np.zeros((2, 2))), (3, np.zeros((4, 9)))):
        with pytest.raises(ConfigError, match="free must be"):
            plot_surroundings(*given[:i], wrong, *given[i + 1 :], tmp_path / "no.png")
    assert not (tmp_path / "no.png").exists()
