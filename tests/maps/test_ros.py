"""map_server maps: what each pixel means, and that what is written is read back."""

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from activeloc.errors import MapError
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps import load_image, load_map, load_ros, save_map, save_ros

F, X, U = Cell.FREE, Cell.OCCUPIED, Cell.UNKNOWN
DATA = Path(__file__).parents[3] / "shared" / "data" / "maps"


def write(folder, pixels, **fields):
    """Write an image and a YAML file that names it; the YAML file's path."""
    pixels.save(folder / "plan.png")
    header = {
        "image": "plan.png",
        "resolution": 0.05,
        "origin": [0.0, 0.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(header | fields))
    return path


def grey(rows):
    return Image.fromarray(np.array(rows, dtype=np.uint8))


def test_the_image_is_flipped_once(tmp_path):
    path = write(tmp_path, grey([[0, 254, 254], [254, 205, 0]]), origin=[-1.5, 2, 0.0])
    grid = load_ros(path)
    np.testing.assert_array_equal(grid.cells, [[F, U, X], [X, F, F]])
    assert (grid.name, grid.resolution, grid.origin) == ("plan", 0.05, (-1.5, 2.0))
    assert grid.count() == {"free": 3, "occupied": 2, "unknown": 1}


# Worked by hand: darkness 1 - grey/255 is .349 for 166, .353 for 165, .196 for 205, .2 for 204,
# .651 for 89, .647 for 90.
GREYS = [0, 51, 89, 90, 165, 166, 204, 205, 206, 254, 255]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        pytest.param({}, [X, X, X, U, U, U, U, U, F, F, F], id="trinary"),
        pytest.param({"mode": "scale"}, [X, X, X, U, U, U, U, U, F, F, F], id="scale"),
        pytest.param({"free_thresh": 0.25}, [X, X, X, U, U, U, F, F, F, F, F], id="depot"),
        pytest.param({"free_thresh": 0.2}, [X, X, X, U, U, U, F, F, F, F, F], id="equal-is-free"),
        pytest.param({"free_thresh": 0.1}, [X, X, X, U, U, U, U, U, U, F, F], id="warehouse"),
        pytest.param(
            {"occupied_thresh": 0.8, "free_thresh": 0.35},
            [X, X, U, U, U, F, F, F, F, F, F],
            id="equal-is-occupied",
        ),
        pytest.param(
            {"negate": 1, "occupied_thresh": 0.8, "free_thresh": 0.2},
            [F, F, U, U, U, U, X, X, X, X, X],
            id="negate",
        ),
        pytest.param({"negate": True}, [F, U, U, U, U, X, X, X, X, X, X], id="negate-true"),
        pytest.param({"negate": "0"}, [X, X, X, U, U, U, U, U, F, F, F], id="negate-quoted"),
        pytest.param({"mode": "raw"}, [F, U, X, X, U, U, U, U, U, U, U], id="raw"),
        pytest.param(
            {"mode": "raw", "negate": 1}, [F, U, X, X, U, U, U, U, U, U, U], id="raw-not-negated"
        ),
        pytest.param(
            {"mode": "raw", "occupied_thresh": 0.9, "free_thresh": 0.51},
            [F, F, U, X, U, U, U, U, U, U, U],
            id="raw-thresholds",
        ),
    ],
)
def test_what_a_grey_level_means(tmp_path, fields, expected):
    np.testing.assert_array_equal(
        load_ros(write(tmp_path, grey([GREYS]), **fields)).cells[0], expected
    )


def test_raw_ends_at_100_percent(tmp_path):
    path = write(tmp_path, grey([[0, 100, 101]]), mode="raw")
    np.testing.assert_array_equal(load_ros(path).cells, [[F, X, U]])


def palette():
    image = Image.fromarray(np.array([[0, 1, 2]], dtype=np.uint8)).convert("P")
    image.putpalette([255, 255, 255, 0, 0, 0, 205, 205, 205])
    image.frombytes(bytes([0, 1, 2]))
    return image


def palette_with_transparency():
    image = palette()
    image.info["transparency"] = bytes([255, 0])
    return image


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        # The mean of (255, 255, 102) is 204: unknown; its luma would be 238: free.
        pytest.param(
            Image.fromarray(np.array([[[255, 255, 102], [255, 255, 255], [9, 0, 0]]], np.uint8)),
            [U, F, X],
            id="rgb-is-the-mean",
        ),
        pytest.param(
            Image.fromarray(
                np.array([[[0, 0, 0, 0], [255, 255, 255, 254], [255, 255, 255, 255]]], np.uint8)
            ),
            [U, U, F],
            id="rgba-transparent-is-unknown",
        ),
        pytest.param(
            Image.fromarray(np.array([[[0, 0], [255, 255], [0, 255]]], np.uint8)),
            [U, F, X],
            id="grey-alpha",
        ),
        pytest.param(palette(), [F, X, U], id="palette"),
        pytest.param(palette_with_transparency(), [F, U, U], id="palette-transparent"),
        pytest.param(
            Image.fromarray(np.array([[65535, 0, 205 * 257]], np.uint16)), [F, X, U], id="16-bit"
        ),
        pytest.param(
            Image.fromarray(np.array([[255, 0, 255]], np.uint8)).convert("1"), [F, X, F], id="1-bit"
        ),
    ],
)
def test_kinds_of_pixels(tmp_path, image, expected):
    np.testing.assert_array_equal(load_ros(write(tmp_path, image)).cells[0], expected)


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"P5\n3 1\n255\n\xff\x00\xcd", id="binary"),
        pytest.param(b"P2\n# drawn by hand\n3 1\n255\n255 0\n205\n", id="ascii-with-comment"),
        pytest.param(b"P5 3 1 65535 \xff\xff\x00\x00\xcd\xcd", id="16-bit"),
        pytest.param(b"P5 3 1 100 \x64\x00\x50", id="maxval-100"),
    ],
)
def test_kinds_of_pgm(tmp_path, content):
    (tmp_path / "plan.pgm").write_bytes(content)
    np.testing.assert_array_equal(load_image(tmp_path / "plan.pgm").cells, [[F, X, U]])


def test_bmp(tmp_path):
    grey([[255, 0, 205], [0, 0, 0]]).save(tmp_path / "plan.bmp")
    grid = load_map(tmp_path / "plan.bmp", resolution=0.1)
    np.testing.assert_array_equal(grid.cells, [[X, X, X], [F, X, U]])
    assert grid.resolution == 0.1


def test_exif_rotation_is_ignored(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    grey([[255, 0, 205], [0, 0, 0]]).save(tmp_path / "plan.png", exif=exif)
    assert load_image(tmp_path / "plan.png").shape == (2, 3)


def test_numbers_may_be_written_as_yaml_11_does_not_know(tmp_path):
    path = write(tmp_path, grey([[255, 0]]))
    path.write_text(path.read_text().replace("resolution: 0.05", "resolution: 5e-2"))
    assert load_ros(path).resolution == 0.05


def test_byte_order_mark_and_missing_final_newline(tmp_path):
    path = write(tmp_path, grey([[255, 0]]))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().rstrip())
    assert load_ros(path).shape == (1, 2)


def test_unknown_keys_are_named_in_a_warning(tmp_path):
    path = write(tmp_path, grey([[255, 0]]), colour="red", author="me")
    with pytest.warns(UserWarning, match="unknown keys ignored: 'author', 'colour'"):
        load_ros(path)


def test_sha256_of_the_image_is_checked(tmp_path):
    path = write(tmp_path, grey([[255, 0]]))
    digest = sha256((tmp_path / "plan.png").read_bytes()).hexdigest()
    assert load_ros(write(tmp_path, grey([[255, 0]]), sha256=digest.upper())).shape == (1, 2)
    grey([[0, 255]]).save(tmp_path / "plan.png")
    with pytest.raises(MapError, match=f"SHA-256 is [0-9a-f]{{64}}, but .* says {digest}"):
        load_ros(path)


def test_image_outside_the_folder_only_if_allowed(tmp_path):
    (tmp_path / "maps").mkdir()
    grey([[255, 0]]).save(tmp_path / "outside.png")
    for name in ("../outside.png", str(tmp_path / "outside.png")):
        path = write(tmp_path / "maps", grey([[0, 255]]), image=name)
        with pytest.raises(MapError, match="outside the map's folder"):
            load_ros(path)
        grid = load_ros(path, allow_external_image=True)
        np.testing.assert_array_equal(grid.cells, [[F, X]])


def test_link_out_of_the_folder_is_seen_through(tmp_path):
    (tmp_path / "maps").mkdir()
    grey([[255, 0]]).save(tmp_path / "outside.png")
    path = write(tmp_path / "maps", grey([[0, 255]]), image="link.png")
    (tmp_path / "maps" / "link.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(MapError, match="outside the map's folder"):
        load_map(path)
    assert load_map(path, allow_external_image=True).shape == (1, 2)


def test_image_in_a_folder_below(tmp_path):
    path = write(tmp_path, grey([[255, 0]]), image="images/plan.png")
    (tmp_path / "images").mkdir()
    (tmp_path / "plan.png").rename(tmp_path / "images" / "plan.png")
    assert load_ros(path).shape == (1, 2)


GRIDS = st.builds(
    OccupancyGrid,
    hnp.arrays(
        np.uint8, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.integers(0, 2)
    ).filter(lambda cells: (cells == Cell.FREE).any()),
    st.floats(1e-4, 1e3),
    st.tuples(st.floats(-1e8, 1e8), st.floats(-1e8, 1e8)),
)


@settings(max_examples=60)
@given(GRIDS)
def test_any_map_survives_saving(tmp_path_factory, grid):
    path = tmp_path_factory.mktemp("maps") / "any map, really: ü.yaml"
    save_ros(grid, path)
    assert load_ros(path) == grid


def test_saved_files_are_what_other_tools_expect(tmp_path):
    grid = OccupancyGrid(np.array([[F, U, X], [X, F, F]]), 0.05, (-3.0, 1.25))
    save_map(grid, tmp_path / "hall.yml")
    pgm = (tmp_path / "hall.pgm").read_bytes()
    assert pgm == b"P5\n3 2\n255\n" + bytes([0, 254, 254, 254, 205, 0])
    assert yaml.safe_load((tmp_path / "hall.yml").read_text()) == {
        "image": "hall.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [-3.0, 1.25, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        "sha256": sha256(pgm).hexdigest(),
    }
    assert sorted(file.name for file in tmp_path.iterdir()) == ["hall.pgm", "hall.yml"]


def test_text_is_saved_by_suffix(tmp_path):
    grid = OccupancyGrid(np.array([[F, U, X], [X, F, F]]), 0.25)
    save_map(grid, tmp_path / "hall.txt")
    assert load_map(tmp_path / "hall.txt", resolution=0.25) == grid
    assert load_map(tmp_path / "hall.txt").resolution == 1.0


def test_failed_save_leaves_the_old_map(tmp_path, monkeypatch):
    old, new = (OccupancyGrid(np.array([cells])) for cells in ([F, X], [X, F]))
    save_ros(old, tmp_path / "hall.yaml")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(MapError, match="No space left"):
        save_ros(new, tmp_path / "hall.yaml")
    assert load_ros(tmp_path / "hall.yaml") == old
    assert len(list(tmp_path.iterdir())) == 2


def test_a_new_image_with_old_words_is_noticed(tmp_path):
    old, new = (OccupancyGrid(np.array([cells])) for cells in ([F, X], [X, F]))
    save_ros(old, tmp_path / "hall.yaml")
    words = (tmp_path / "hall.yaml").read_bytes()
    save_ros(new, tmp_path / "hall.yaml")
    (tmp_path / "hall.yaml").write_bytes(words)
    with pytest.raises(MapError, match="SHA-256"):
        load_ros(tmp_path / "hall.yaml")


# Shape, and free, occupied and unknown cells, counted from the images with Pillow and a histogram.
REAL = {
    "depot.yaml": ((307, 604), 179481, 5947, 0),
    "intel.yaml": ((593, 594), 201808, 13910, 136524),
    "skirk.yaml": ((602, 431), 66583, 192879, 0),
    "tb3_sandbox.yaml": ((384, 384), 7903, 870, 138683),
    "warehouse.yaml": ((1674, 1006), 1422292, 30951, 230801),
    "basement_hallways.png": ((1200, 1200), 233220, 11182, 1195598),
}


@pytest.mark.skipif(not DATA.is_dir(), reason="the real maps are not in ../shared/data/maps")
@pytest.mark.parametrize("name", REAL)
def test_real_maps(name):
    grid = load_map(DATA / name)
    assert (grid.shape, *grid.count().values()) == REAL[name]


@pytest.mark.skipif(not DATA.is_dir(), reason="the real maps are not in ../shared/data/maps")
def test_depots_unknown_grey_is_free_only_under_its_own_threshold(tmp_path):
    words = (DATA / "depot.yaml").read_text()
    (tmp_path / "depot.pgm").write_bytes((DATA / "depot.pgm").read_bytes())
    path = tmp_path / "depot.yaml"
    path.write_text(words)
    assert load_ros(path).count()["unknown"] == 0
    path.write_text(words.replace("free_thresh: 0.25", "free_thresh: 0.196"))
    n_grey_205 = int((np.asarray(Image.open(DATA / "depot.pgm")) == 205).sum())
    assert load_ros(path).count()["unknown"] == n_grey_205 > 1000


@pytest.mark.skipif(not DATA.is_dir(), reason="the real maps are not in ../shared/data/maps")
def test_real_map_survives_saving(tmp_path):
    grid = load_map(DATA / "skirk.yaml")
    save_map(grid, tmp_path / "skirk.yaml")
    assert load_map(tmp_path / "skirk.yaml") == grid
