from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from activeloc.envs import rendering
from activeloc.envs.rendering import Scene, draw, layout, write_gif
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid

# 20 m x 12 m with its lower left corner at (-3, 2): neither square nor at the origin.
ORIGIN, RESOLUTION, ROWS, COLS = (-3.0, 2.0), 0.5, 24, 40
HEADINGS = {"right": 0.0, "up": np.pi / 2, "left": np.pi, "down": -np.pi / 2}
TRUTH, BEAM = np.array([0, 98, 178]), np.array([0, 114, 190])


def free_map(rows=ROWS, cols=COLS, *marks, value=1):
    cells = np.zeros((rows, cols), np.uint8)
    for row, col in marks:
        cells[row, col] = value
    return OccupancyGrid(cells, RESOLUTION, ORIGIN)


def scene(grid=None, belief=None, **parts):
    grid = grid or free_map()
    belief = np.zeros((1, *grid.shape)) if belief is None else belief
    parts = {"belief_resolution": RESOLUTION, "belief_origin": ORIGIN} | parts
    return Scene(grid, belief, **parts)


def pixel(xy, size=600):
    """Row and column of a point of the free map; the map is 600 x 360 px, 30 px a metre."""
    scale = 30.0 * size / 600
    return int((14.0 - xy[1]) * scale), int((xy[0] + 3.0) * scale)


def changed(a, b, least=12):
    """``(N, 2)``: rows and columns of the map's pixels that differ between two frames."""
    differs = np.abs(a[:360].astype(int) - b[:360]).max(axis=-1) >= least
    return np.argwhere(differs)


def near(frame, colour, within=40):
    return np.argwhere(np.abs(frame[:360].astype(int) - colour).max(axis=-1) <= within)


def one_cell(row, col, n_headings=1, heading=0):
    belief = np.zeros((n_headings, ROWS, COLS))
    belief[heading, row, col] = 1.0
    return belief


# --- where things are


@pytest.mark.parametrize("size", [600, 300])
def test_a_wall_is_drawn_where_it_stands(size):
    frame = draw(scene(free_map(ROWS, COLS, (3, 31))), size)
    row, col = pixel((-3.0 + 31.5 * 0.5, 2.0 + 3.5 * 0.5), size)
    rim = round(6 * size / 600)  # a thick wall is dark at its rim and grey inside
    assert frame[row, col].max() < 180
    for up, right in ((rim, 0), (-rim, 0), (0, rim), (0, -rim)):
        assert frame[row + up, col + right].max() < 80
        assert frame[row + 2 * up, col + 2 * right].min() > 250
    mirrored = [(3, 8), (20, 31), (20, 8)]
    for r, c in mirrored:
        row, col = pixel((-3.0 + (c + 0.5) * 0.5, 2.0 + (r + 0.5) * 0.5), size)
        assert frame[row, col].min() == 255


def test_free_unknown_and_occupied_differ():
    cells = np.zeros((ROWS, COLS), np.uint8)
    cells[:, 10:20], cells[:, 20:22] = 2, 1
    frame = draw(scene(OccupancyGrid(cells, RESOLUTION, ORIGIN)))
    free, unknown, wall = frame[180, 50], frame[180, 225], frame[180, 328]
    assert free.min() == 255
    assert 180 < unknown.min() <= unknown.max() < 220
    assert wall.max() < 70


def test_a_wall_thinner_than_a_pixel_stays_dark():
    cells = np.zeros((1000, 1700), np.uint8)
    cells[:, 850] = 1
    frame = draw(Scene(OccupancyGrid(cells), np.zeros((1, 10, 17)), 5.0))
    assert frame[150].sum(axis=-1).min() < 3 * 130


def test_belief_colours_its_own_cell_and_no_mirrored_one():
    frame = draw(scene(belief=one_cell(4, 33)))
    where = changed(frame, draw(scene()))
    expected = pixel((-3.0 + 33.5 * 0.5, 2.0 + 4.5 * 0.5))
    np.testing.assert_allclose(where.mean(axis=0), expected, atol=1.0)
    assert np.abs(where - expected).max() <= 16  # a cell is 15 px; nothing beyond its neighbours
    red, green, blue = frame[expected].astype(int)
    assert red > green + 60
    assert red > blue + 60


def test_belief_has_a_frame_of_its_own():
    belief = np.zeros((1, 7, 11))
    belief[0, 1, 8] = 1.0  # 2 m cells from (-4, 1): x 12 to 14, y 3 to 5
    frame = draw(scene(belief=belief, belief_resolution=2.0, belief_origin=(-4.0, 1.0)))
    where = changed(frame, draw(scene()))
    np.testing.assert_allclose(where.min(axis=0), pixel((12.0, 5.0)), atol=1)
    np.testing.assert_allclose(where.max(axis=0), pixel((14.0, 3.0)), atol=1)


@pytest.mark.parametrize("cell", [(301, 1501), (303, 1504), (299, 1502), (302, 1500)])
def test_belief_finer_than_a_pixel_is_not_lost(cell):
    belief = np.zeros((1, 1200, 2000))  # 1 cm cells, three a pixel
    belief[0, *cell] = 1.0
    frame = draw(scene(belief=belief, belief_resolution=0.01))
    where = changed(frame, draw(scene()), least=60)
    assert len(where) > 0
    expected = pixel((-3.0 + 0.01 * cell[1], 2.0 + 0.01 * cell[0]))
    np.testing.assert_allclose(where.mean(axis=0), expected, atol=1.5)


@pytest.mark.parametrize("size", [600, 300])
def test_the_true_robot_is_drawn_where_it_stands(size):
    frame = draw(scene(pose=np.array([9.0, 4.0, 0.3])), size)
    robot = near(frame[: 360 * size // 600], TRUTH)
    assert len(robot) > 20
    np.testing.assert_allclose(robot.mean(axis=0), pixel((9.0, 4.0), size), atol=2.0)


@pytest.mark.parametrize("heading", HEADINGS.values(), ids=HEADINGS)
def test_the_robots_tick_points_ahead(heading):
    frame = draw(scene(pose=np.array([9.0, 4.0, heading]), radius=0.5)).astype(int)
    row, col = pixel((9.0, 4.0))
    step = round(10 * -np.sin(heading)), round(10 * np.cos(heading))
    assert frame[row + step[0], col + step[1]].min() > 150
    assert np.abs(frame[row - step[0], col - step[1]] - TRUTH).max() < 30


def test_a_robot_of_known_radius_has_its_size():
    small, large = (draw(scene(pose=np.array([9.0, 4.0, 0.0]), radius=r)) for r in (0.5, 1.0))
    area = [len(near(frame, TRUTH)) for frame in (small, large)]
    assert area[1] == pytest.approx(np.pi * 30.0**2, rel=0.2)
    assert area[1] == pytest.approx(4 * area[0], rel=0.15)


@pytest.mark.parametrize("heading", HEADINGS.values(), ids=HEADINGS)
def test_the_estimate_is_a_ring_with_its_longest_spoke_ahead(heading):
    frame = draw(scene(estimate=np.array([1.0, 10.0, heading])))
    dark = np.argwhere(frame[:360].max(axis=-1) < 100)
    offset = dark - np.array(pixel((1.0, 10.0)))
    ahead = offset @ (-np.sin(heading), np.cos(heading))
    assert ahead.max() == pytest.approx(25, abs=3)
    assert -ahead.min() == pytest.approx(18, abs=3)
    assert np.hypot(*offset.T).min() > 8  # hollow: what it marks stays visible


def test_the_robot_is_visible_inside_its_estimate():
    pose = np.array([1.0, 10.0, 0.0])
    alone, both = (draw(scene(pose=pose, estimate=e)) for e in (None, pose))
    assert len(near(both, TRUTH)) > 0.9 * len(near(alone, TRUTH))


@pytest.mark.parametrize("heading", HEADINGS.values(), ids=HEADINGS)
def test_wedges_point_where_the_belief_heads(heading):
    t = int(np.floor((heading + np.pi) / (np.pi / 4))) % 8  # of 8 bins, the one above ``heading``
    centre = -np.pi + (t + 0.5) * np.pi / 4
    known = draw(scene(belief=one_cell(12, 20, 8, t)))
    where = changed(known, draw(scene(belief=one_cell(12, 20))))
    offset = where - np.array(pixel((-3.0 + 20.5 * 0.5, 2.0 + 12.5 * 0.5)))
    along = offset @ (-np.sin(centre), np.cos(centre))
    across = offset @ (np.cos(centre), np.sin(centre))
    assert along.max() > -along.min() + 2
    assert np.abs(across.mean()) < 1.0


def test_both_headings_of_a_divided_belief_are_shown():
    one, other = one_cell(12, 20, 4, 0), one_cell(12, 20, 4, 2)
    plain = draw(scene(belief=one_cell(12, 20)))
    single, both = (len(changed(draw(scene(belief=b)), plain)) for b in (one, (one + other) / 2))
    assert both > 1.3 * single


def test_no_heading_stands_out_of_a_uniform_belief():
    uniform = np.full((12, ROWS, COLS), 1.0 / (12 * ROWS * COLS))
    np.testing.assert_array_equal(
        draw(scene(belief=uniform)), draw(scene(belief=uniform.sum(axis=0, keepdims=True)))
    )


def test_particles_are_dots_where_they_are():
    particles = np.array([[9.0, 4.0, 0.0], [np.inf, 0.0, 0.0], [500.0, -500.0, 0.0]])
    frame = draw(scene(particles=particles))
    where = changed(frame, draw(scene()))
    assert 1 <= len(where) <= 16
    np.testing.assert_allclose(where.mean(axis=0), pixel((9.0, 4.0)), atol=1.5)


# --- the scan


@pytest.mark.parametrize("bearing", HEADINGS.values(), ids=HEADINGS)
def test_a_beam_ends_where_it_read(bearing):
    pose = np.array([7.0, 8.0, 0.5])
    parts = {"pose": pose, "bearings": np.array([bearing])}
    frame = draw(scene(scan=np.array([3.0]), **parts))
    end = pose[:2] + 3.0 * np.array([np.cos(0.5 + bearing), np.sin(0.5 + bearing)])
    assert np.abs(frame[pixel(end)].astype(int) - BEAM).max() < 60
    where = changed(frame, draw(scene(pose=pose)), least=30)
    length = np.hypot(*(where - np.array(pixel(pose))).T)
    assert length.max() == pytest.approx(3.0 * 30.0, abs=4)


def test_a_beam_of_maximum_range_is_drawn_to_there_and_fainter():
    parts = {"pose": np.array([7.0, 8.0, 0.0]), "bearings": np.zeros(1), "z_max": 4.0}
    hit, missed = (draw(scene(scan=np.array([z]), **parts)) for z in (3.999, np.inf))
    row, col = pixel((9.0, 8.0))
    middle = slice(row - 1, row + 2)
    assert hit[middle, col].min() < missed[middle, col].min() < 240
    columns = changed(missed, draw(scene(**parts | {"bearings": None})))[:, 1]
    assert columns.max() == pytest.approx(pixel((11.0, 8.0))[1], abs=1)


def test_beams_without_a_reading_are_not_drawn():
    parts = {"pose": np.array([7.0, 8.0, 0.0])}
    some = scene(scan=np.array([np.nan, 2.0]), bearings=np.array([1.0, -1.0]), **parts)
    one = scene(scan=np.array([2.0]), bearings=np.array([-1.0]), **parts)
    none = scene(scan=np.full(2, np.nan), bearings=np.array([1.0, -1.0]), **parts)
    np.testing.assert_array_equal(draw(some), draw(one))
    np.testing.assert_array_equal(draw(none), draw(scene(**parts)))


def test_without_a_true_pose_the_scan_starts_at_the_estimate():
    scan = {"scan": np.array([3.0]), "bearings": np.zeros(1)}
    frame = draw(scene(estimate=np.array([1.0, 10.0, 0.0]), **scan))
    assert np.abs(frame[pixel((4.0, 10.0))].astype(int) - BEAM).max() < 60
    np.testing.assert_array_equal(draw(scene(**scan)), draw(scene()))


# --- colours and panel


def test_more_probable_is_darker_and_the_uniform_is_visible():
    uniform = 1.0 / (ROWS * COLS)
    levels = [0.0, uniform, 5 * uniform, 30 * uniform, 0.3, 1.0]
    belief = np.zeros((1, ROWS, COLS))
    belief[0, 12, 3:39:7] = levels
    frame = draw(scene(belief=belief)).astype(float) @ (0.2126, 0.7152, 0.0722)
    shades = [frame[pixel((-3.0 + (c + 0.5) * 0.5, 8.25))] for c in range(3, 39, 7)]
    assert shades[0] == pytest.approx(255)
    assert np.diff(shades).max() < -8


def test_a_shade_means_the_same_beside_any_other():
    belief = one_cell(12, 5) * 0.01
    beside = belief + one_cell(12, 30) * 0.9
    np.testing.assert_array_equal(
        draw(scene(belief=belief))[:360, :200], draw(scene(belief=beside))[:360, :200]
    )


def test_the_gauge_and_the_curve_show_the_entropy():
    ink = []
    for entropy in (0.0, 0.25, 0.5, 1.0):
        panel = draw(scene(entropy=entropy))[361:, 436:452]
        ink.append(int((panel.max(axis=-1) < 60).sum()))
    assert ink[0] < 12
    np.testing.assert_allclose(np.diff(ink) / (ink[3] - ink[0]), [0.25, 0.25, 0.5], atol=0.05)


def test_the_curve_follows_its_history():
    plain = draw(scene(entropy=0.0))
    rise, fall = (
        np.abs(draw(scene(entropy=0.0, history=h)).astype(int) - plain).max(axis=-1) > 30
        for h in ([0.1] * 15 + [0.9] * 15, [0.9] * 15 + [0.1] * 15)
    )
    assert rise[:360].sum() == 0
    area = [(half.sum(axis=0)[200:315], half.sum(axis=0)[325:430]) for half in (rise, fall)]
    assert area[0][0].sum() < 0.5 * area[0][1].sum()
    assert area[1][0].sum() > 2.0 * area[1][1].sum()


@pytest.mark.parametrize("caption", ["a corridor " * 40, "corridor" * 40, "a " + "m" * 90])
def test_words_change_the_panel_only(caption):
    plain, told = draw(scene()), draw(scene(step=123, caption=caption))
    np.testing.assert_array_equal(plain[:360], told[:360])
    assert (plain[360:] != told[360:]).any()
    assert (plain[:, 200:] == told[:, 200:]).all()  # long words are cut, not run over the curve


@pytest.mark.parametrize("entropy", [np.nan, -0.1, 1.7])
def test_odd_entropies_are_drawn_within_bounds(entropy):
    frame = draw(scene(entropy=entropy, history=[np.nan, 2.0, -1.0]))
    np.testing.assert_array_equal(frame[:360], draw(scene())[:360])


# --- the frame


@pytest.mark.parametrize("size", [300, 600, 900])
@pytest.mark.parametrize("shape", [(24, 40), (40, 24), (30, 30), (8, 200), (200, 8), (7, 7)])
def test_the_longer_side_is_as_asked_and_both_are_even(shape, size):
    grid = OccupancyGrid(np.zeros(shape, np.uint8))
    frame = draw(Scene(grid, np.zeros((1, *shape)), 0.05), size)
    assert frame.dtype == np.uint8
    assert max(frame.shape[:2]) == size
    assert frame.shape[0] % 2 == frame.shape[1] % 2 == 0
    width, height = layout(grid, size).map_size
    assert width / height == pytest.approx(shape[1] / shape[0], rel=0.06)


@pytest.mark.parametrize("grid", [free_map(), free_map(COLS, ROWS)], ids=["wide", "tall"])
def test_frames_of_a_map_have_one_shape(grid):
    pose = np.array([1.0, 6.0, 1.0])
    full = scene(
        grid,
        np.full((4, *grid.shape), 0.1),
        pose=pose,
        estimate=pose,
        scan=np.array([1.0, np.inf, np.nan]),
        bearings=np.arange(3.0),
        history=[1.0] * 500,
        step=10**9,
        caption="words " * 100,
        particles=np.zeros((5, 3)),
    )
    assert draw(full).shape == draw(scene(grid)).shape


def test_metres_become_pixels():
    place = layout(free_map(), 600)
    assert place.map_size == (600, 360)
    corners = np.array([[-3.0, 2.0], [17.0, 14.0], [7.0, 5.0]])
    np.testing.assert_allclose(place.to_pixels(corners), [[0, 360], [600, 0], [300, 270]])
    assert place.panel == (0, 360, 600, place.height)


def test_what_leaves_the_map_does_not_enter_the_panel():
    pose = np.array([9.0, 2.0, -1.0])
    parts = {"scan": np.array([5.0]), "bearings": np.zeros(1), "radius": 2.0}
    frame = draw(scene(pose=pose, estimate=pose, **parts))
    np.testing.assert_array_equal(frame[364:], draw(scene())[364:])


def test_one_scene_gives_the_same_bytes_and_is_left_as_it_was():
    rng = np.random.default_rng(0)
    arrays = {
        "belief": rng.dirichlet(np.ones(6 * ROWS * COLS)).reshape(6, ROWS, COLS),
        "pose": np.array([9.0, 4.0, 0.3]),
        "estimate": np.array([1.0, 10.0, 0.3]),
        "scan": np.array([1.0, np.nan, np.inf]),
        "bearings": np.array([-1.0, 0.0, 1.0]),
        "particles": rng.uniform(2.0, 9.0, (100, 3)),
    }
    before = {name: array.copy() for name, array in arrays.items()}
    for array in arrays.values():
        array.flags.writeable = False
    one = scene(**arrays, history=(1.0, 0.5))
    first = draw(one)
    np.testing.assert_array_equal(first, draw(one))
    np.testing.assert_array_equal(first, draw(replace(one)))
    for name, array in before.items():
        np.testing.assert_array_equal(arrays[name], array)
    first[:] = 0  # the caller's own: no later frame shares it
    assert draw(one).max() == 255


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"belief": np.zeros((ROWS, COLS))}, r"belief must be \(T, R, C\).*\(24, 40\)"),
        ({"belief": np.zeros((0, ROWS, COLS))}, "not empty"),
        ({"belief_resolution": 0.0}, "belief_resolution must be > 0 m, got 0.0"),
        ({"belief_resolution": np.nan}, "belief_resolution"),
        ({"pose": np.zeros(2)}, r"pose must be \(3,\), got shape \(2,\)"),
        ({"estimate": np.zeros((1, 3))}, "estimate must be"),
        ({"scan": np.zeros(2)}, "both or neither"),
        ({"scan": np.zeros(2), "bearings": np.zeros(3)}, r"\(2,\), \(3,\)"),
        ({"particles": np.zeros((4, 2))}, r"particles must be \(N, 3\)"),
    ],
)
def test_a_scene_refuses_what_it_cannot_show(parts, message):
    with pytest.raises(ConfigError, match=message):
        scene(**parts)


@pytest.mark.parametrize("size", [299, 4001])
def test_a_size_out_of_range_is_refused(size):
    with pytest.raises(ConfigError, match="size must be 300 to 4000 px"):
        draw(scene(), size)


# --- films


def film(n=5):
    poses = [np.array([1.0 + 2 * i, 4.0, 0.0]) for i in range(n)]
    return [draw(scene(belief=one_cell(20, 5), pose=pose), 300) for pose in poses]


def test_a_gif_reads_back(tmp_path):
    frames, path = film(), tmp_path / "film.gif"
    write_gif(frames, path, fps=8)
    with Image.open(path) as gif:
        assert gif.n_frames == 5
        assert gif.info["loop"] == 0
        durations = []
        for i, frame in enumerate(frames):
            gif.seek(i)
            durations.append(gif.info["duration"])
            shown = np.asarray(gif.convert("RGB")).astype(int)
            assert np.abs(shown - frame).mean() < 0.5
            assert np.abs(shown - frame).max() < 40
            np.testing.assert_array_equal(shown[60, 200], frame[60, 200])  # the floor's white
    assert durations == [120, 120, 120, 120, 2000]  # 12.5 hundredths of a second, rounded to even
    assert [file.name for file in tmp_path.iterdir()] == ["film.gif"]


def test_colours_do_not_flicker(tmp_path):
    frames = film()
    write_gif(frames, tmp_path / "film.gif")
    still = np.all([frame == frames[0] for frame in frames], axis=(0, 3))
    with Image.open(tmp_path / "film.gif") as gif:
        shown = []
        for i in range(gif.n_frames):
            gif.seek(i)
            shown.append(np.asarray(gif.convert("RGB"))[still])
    for later in shown[1:]:
        np.testing.assert_array_equal(later, shown[0])


def test_common_colours_are_kept_although_others_are_close(tmp_path):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        common = rng.integers(0, 256, 3)
        frame = np.empty((60, 80, 3), np.uint8)
        frame[:] = common
        frame[:, :50] = np.clip(common + rng.integers(-9, 10, (60, 50, 3)), 0, 255)
        frame[:20, :30] = rng.integers(0, 256, (20, 30, 3))
        write_gif([frame], tmp_path / "film.gif")
        with Image.open(tmp_path / "film.gif") as gif:
            shown = np.asarray(gif.convert("RGB"))
        assert (shown[:, 55:] == common).all()


def test_equal_frames_become_one_long_one(tmp_path):
    frames = film(2)
    write_gif([frames[0]] * 3 + frames[1:], tmp_path / "film.gif", fps=5)
    with Image.open(tmp_path / "film.gif") as gif:
        assert gif.n_frames == 2
        assert gif.info["duration"] == 600


def test_a_single_frame_is_a_film(tmp_path):
    write_gif(film(1), tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as gif:
        assert getattr(gif, "n_frames", 1) == 1


def test_a_film_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "film.gif"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError("disk")

    monkeypatch.setattr("activeloc.files.os.replace", fail)
    with pytest.raises(OSError, match="disk"):
        write_gif(film(2), path)
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["film.gif"]


@pytest.mark.parametrize(
    ("frames", "fps", "message"),
    [
        ([], 5, "at least one frame"),
        ([np.zeros((4, 4, 3), np.uint8), np.zeros((4, 6, 3), np.uint8)], 5, "one size"),
        ([np.zeros((4, 4), np.uint8)], 5, "one size"),
        ([np.zeros((4, 4, 3), np.uint8)], 0, "fps"),
        ([np.zeros((4, 4, 3), np.uint8)], 51, "fps"),
    ],
)
def test_a_film_refuses_what_it_cannot_hold(frames, fps, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        write_gif(frames, tmp_path / "film.gif", fps)
    assert not list(tmp_path.iterdir())


def test_what_is_offered_exists():
    assert all(hasattr(rendering, name) for name in rendering.__all__)
