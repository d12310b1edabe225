"""Files that are no map: each refused at once, in one line that says what is wrong."""

import os
import struct
import time
import zlib
from contextlib import suppress
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.maps import load_image, load_map, load_ros, save_map

GOOD = """\
image: plan.png
resolution: 0.05
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM = b"P5\n4 3\n255\n" + bytes([0, 254, 254, 205] * 3)


def png(image):
    """The bytes of a PNG file."""
    file = BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


ROWS = np.array([[0, 254, 254, 254], [254, 205, 0, 0]], dtype=np.uint8)
PNG = png(Image.fromarray(ROWS))


def refused_in_time(load, path, message):
    """Assert that a file is refused in less than two seconds and in one line."""
    start = time.perf_counter()
    with pytest.raises(MapError, match=message) as refusal:
        load(path)
    assert time.perf_counter() - start < 2.0
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 700


def without(key):
    return "".join(line + "\n" for line in GOOD.splitlines() if not line.startswith(key))


def said(key, value):
    """The good file with another value for one key, or with one key more."""
    return without(key) + f"{key}: {value}\n"


def bomb():
    """Nine lists, each of nine of the one before."""
    lines = ["a0: &a0 [lol, lol]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    return GOOD + "\n".join(lines)


YAML_CASES = {
    "empty": ("", "empty; expected the keys image, resolution"),
    "comment-only": ("# a map\n", "empty"),
    "not-utf8": (b"image: pl\xe4n.png\n", "not UTF-8 text, at byte 9"),
    "utf16": (GOOD.encode("utf-16"), "not UTF-8"),
    "nul": (GOOD + "\0", "not YAML"),
    "list": ("- image\n- plan.png\n", "must be a mapping"),
    "scalar": ("plan.png\n", "must be a mapping"),
    "two-documents": (GOOD + "---\n" + GOOD, "more than one document"),
    "unbalanced": (GOOD + "a: [1, 2\n", "not YAML"),
    "bad-escape": (said("image", r'"\U99999999.png"'), "not YAML"),
    "tab": (GOOD + "\tmode: raw\n", "not YAML"),
    "too-long": (GOOD + "# " + "x" * 70_000, "more than 65536 bytes"),
    "duplicate": (GOOD + "image: other.png\n", "'image' is given twice, again in line 7"),
    "duplicate-unknown": (GOOD + "a: 1\na: 2\n", "'a' is given twice"),
    "anchor": (said("image", "&name plan.png"), "line 6: anchors and aliases"),
    "alias-bomb": (bomb(), "line 7: anchors and aliases"),
    "merge-key": (GOOD + "<<: *a\n", "anchors and aliases"),
    "deep": (GOOD + "a: " + "[" * 20_000, "nested too deep"),
    "deep-mapping": (GOOD + "a: {b: {c: 1}}\n", "nested too deep"),
    "deep-root": ("[" * 60_000, "must be a mapping"),
    "complex-key": (GOOD + "? [a, b]\n: 1\n", "a key must be a word"),
    "python-object": (said("image", "!!python/object/apply:os.system [ls]"), "tag .* not allowed"),
    "tag": (said("resolution", "!!float 0.05"), "tag 'tag:yaml.org,2002:float' is not allowed"),
    "no-image": (without("image"), "missing image"),
    "no-resolution": (without("resolution"), "missing resolution"),
    "no-origin": (without("origin"), "missing origin"),
    "no-negate": (without("negate"), "missing negate"),
    "no-thresholds": (
        "image: a\nresolution: 1\norigin: [0, 0, 0]\nnegate: 0\n",
        "missing occupied_thresh, free_thresh",
    ),
    "resolution-zero": (said("resolution", "0"), r"resolution must be a number .*, got '0'"),
    "resolution-negative": (said("resolution", "-0.05"), "resolution .* got '-0.05'"),
    "resolution-nan": (said("resolution", ".nan"), "resolution .* got '.nan'"),
    "resolution-inf": (said("resolution", ".inf"), "resolution .* got '.inf'"),
    "resolution-overflows": (said("resolution", "1e999"), "resolution .* got '1e999'"),
    "resolution-bool": (said("resolution", "true"), "resolution .* got 'true'"),
    "resolution-null": (said("resolution", ""), "resolution .* got ''"),
    "resolution-unit": (said("resolution", "0.05m"), "resolution .* got '0.05m'"),
    "resolution-tiny": (said("resolution", "1e-9"), "resolution .* got '1e-9'"),
    "resolution-huge": (said("resolution", "1e9"), "resolution .* got '1e9'"),
    "resolution-sexagesimal": (said("resolution", "1:30"), "resolution .* got '1:30'"),
    "resolution-underscore": (said("resolution", "0_1"), "resolution .* got '0_1'"),
    "resolution-other-digits": (said("resolution", "٣"), "resolution .* got '٣'"),
    "resolution-list": (said("resolution", "[0.05]"), r"resolution .* got \['0.05'\]"),
    "resolution-mapping": (said("resolution", "{a: 1}"), "'resolution' is nested too deep"),
    "origin-two": (said("origin", "[0.0, 0.0]"), r"origin must be \[x, y, yaw\].* got \['0.0', "),
    "origin-four": (said("origin", "[0, 0, 0, 0]"), "origin must be"),
    "origin-scalar": (said("origin", "0.0"), "origin must be"),
    "origin-nan": (said("origin", "[0, .nan, 0]"), "origin must be"),
    "origin-text": (said("origin", "[0, here, 0]"), "origin must be .* 'here'"),
    "origin-bool": (said("origin", "[0, true, 0]"), "origin must be"),
    "origin-nested": (said("origin", "[[0, 0, 0]]"), "'origin' is nested too deep"),
    "origin-far": (said("origin", "[1e12, 0, 0]"), "origin must be"),
    "origin-yaw": (said("origin", "[0, 0, 3.14]"), "yaw 0 .*turn the image.* '3.14'"),
    "origin-yaw-degrees": (said("origin", "[0, 0, 90]"), "yaw 0"),
    "free-over-occupied": (said("free_thresh", "0.7"), "free_thresh must be .* below .*0.65"),
    "free-is-occupied": (said("free_thresh", "0.65"), "free_thresh must be .* below .*0.65"),
    "occupied-percent": (said("occupied_thresh", "65"), r"occupied_thresh .*\[0, 1\], got '65'"),
    "occupied-percent-sign": (said("occupied_thresh", "65%"), "occupied_thresh .* got '65%'"),
    "occupied-nan": (said("occupied_thresh", ".NaN"), "occupied_thresh"),
    "free-negative": (said("free_thresh", "-0.1"), r"free_thresh .*\[0, 1\], got '-0.1'"),
    "negate-two": (said("negate", "2"), "negate must be 0, 1, false or true, got '2'"),
    "negate-word": (said("negate", "no"), "negate must be .* got 'no'"),
    "negate-list": (said("negate", "[0]"), "negate must be"),
    "mode-unknown": (said("mode", "binary"), "mode must be one of trinary, scale, raw, got"),
    "mode-case": (said("mode", "Trinary"), "mode must be one of"),
    "sha256-short": (said("sha256", "abc"), "sha256 must be 64 hexadecimal digits, got 'abc'"),
    "sha256-other": (said("sha256", "0" * 64), "SHA-256 is"),
    "image-empty": (said("image", '""'), "image must be a file name"),
    "image-list": (said("image", "[plan.png]"), "image must be a file name"),
    "image-absent": (said("image", "nowhere.png"), "'nowhere.png' cannot be found: No such file"),
    "image-long": (said("image", "x" * 5000), "image must be .* got 'xxx"),
    "image-name-too-long-for-a-disk": (said("image", "x" * 999), "cannot be found: File name too"),
    "image-newline": (said("image", r'"plan\n.png"'), r"image must be .* got 'plan\\n.png'"),
    "image-nul": (said("image", r'"plan\0.png"'), "image must be"),
    "image-url": (said("image", "https://example.org/plan.png"), "not a URL"),
    "image-absolute": (said("image", "/dev/zero"), "outside the map's folder"),
    "image-above": (
        said("image", "../../../../../../../../etc/hostname"),
        "outside|cannot be found",
    ),
    "image-home": (said("image", "~/plan.png"), "cannot be found"),
    "image-folder": (said("image", "."), "regular file"),
    "image-itself": (said("image", "plan.yaml"), "not a PNG, PGM or BMP image"),
    "image-fifo": (said("image", "pipe"), "regular file"),
    "image-link-loop": (said("image", "loop"), "cannot be found"),
}


@pytest.mark.parametrize(("content", "message"), YAML_CASES.values(), ids=YAML_CASES)
def test_refuses_yaml(tmp_path, content, message):
    (tmp_path / "plan.png").write_bytes(PNG)
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    path = tmp_path / "plan.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refused_in_time(load_ros, path, message)


def test_the_good_yaml_is_good(tmp_path):
    (tmp_path / "plan.png").write_bytes(PNG)
    (tmp_path / "plan.yaml").write_text(GOOD)
    assert load_ros(tmp_path / "plan.yaml").shape == ROWS.shape


def test_device_is_refused_even_where_external_images_are_allowed(tmp_path):
    (tmp_path / "plan.yaml").write_text(said("image", "/dev/zero"))
    with pytest.raises(MapError, match="regular file"):
        load_ros(tmp_path / "plan.yaml", allow_external_image=True)


def png_of_size(width, height):
    """A PNG that claims a size and has hardly a pixel: the header of a bomb."""
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))]
    chunks += [(b"IDAT", zlib.compress(b"\0")), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def animation():
    file = BytesIO()
    frames = [Image.fromarray(ROWS), Image.fromarray(255 - ROWS)]
    frames[0].save(file, "PNG", save_all=True, append_images=frames[1:])
    return file.getvalue()


def saved_as(kind, mode):
    file = BytesIO()
    Image.fromarray(ROWS).convert(mode).save(file, kind)
    return file.getvalue()


IMAGE_CASES = {
    "empty": (b"", "not a PNG, PGM or BMP image"),
    "text": (b"this is no image\n", "not a PNG"),
    "jpeg": (saved_as("JPEG", "L"), "not a PNG"),
    "gif": (saved_as("GIF", "L"), "not a PNG"),
    "tiff": (saved_as("TIFF", "L"), "not a PNG"),
    "cmyk-tiff": (saved_as("TIFF", "CMYK"), "not a PNG"),
    "postscript": (saved_as("EPS", "L"), "not a PNG"),
    "float-pfm": (saved_as("PPM", "F"), "pixels are F; allowed are grey"),
    "animation": (animation(), "an animation"),
    "pgm-short": (PGM[:-1], "damaged image"),
    "pgm-no-pixels": (PGM[:11], "damaged image"),
    "pgm-header-cut": (PGM[:6], "damaged image|not a PNG"),
    "pgm-zero-size": (b"P5\n0 0\n255\n", "damaged image|not a PNG|no free cell|not empty"),
    "pgm-negative": (b"P5\n-4 3\n255\n" + PGM[11:], "damaged image|not a PNG"),
    "pgm-maxval-zero": (b"P5\n4 3\n0\n" + PGM[11:], "damaged image|not a PNG"),
    "pgm-maxval-huge": (b"P5\n4 3\n65536\n" + PGM[11:], "damaged image|not a PNG"),
    "pgm-not-a-number": (b"P5\n4 x\n255\n" + PGM[11:], "damaged image|not a PNG"),
    "pgm-ascii-over-maxval": (b"P2\n2 1\n255\n255 256\n", "damaged image"),
    "pgm-claims-too-much": (b"P5\n100000 100000\n255\n", "too many pixels|10000000000 pixels"),
    "png-signature-only": (PNG[:8], "damaged image|not a PNG"),
    "png-crc": (PNG[:40] + bytes([PNG[40] ^ 1]) + PNG[41:], "damaged image|not a PNG"),
    "png-over-limit": (png_of_size(5001, 5000), "5001 x 5000 are 25005000 pixels; at most"),
    "png-bomb-warning": (png_of_size(10_000, 10_000), "too many pixels; at most 25000000"),
    "png-bomb-error": (png_of_size(20_000, 20_000), "too many pixels"),
    "png-1-by-0": (png_of_size(1, 0), "damaged image|not a PNG"),
    "png-short-of-pixels": (png_of_size(1000, 1000), "damaged image"),
    "bmp-cut": (saved_as("BMP", "L")[:-4], "damaged image"),
    "all-occupied": (b"P5\n4 1\n255\n\0\0\0\0", "no free cell, 4 occupied, 0 unknown"),
    "all-unknown": (b"P5\n2 2\n255\n" + bytes([205] * 4), "no free cell, 0 occupied, 4 unknown"),
    "16-bit-transparent": (None, "16-bit grey with a transparent colour"),
}


def transparent_16_bit():
    file = BytesIO()
    Image.fromarray(ROWS.astype(np.uint16) * 257).save(file, "PNG", transparency=0)
    return file.getvalue()


@pytest.mark.parametrize(("content", "message"), IMAGE_CASES.values(), ids=IMAGE_CASES)
def test_refuses_image(tmp_path, content, message):
    path = tmp_path / "plan.png"
    path.write_bytes(transparent_16_bit() if content is None else content)
    refused_in_time(load_image, path, message)


@pytest.mark.parametrize("tenth", range(1, 10))
@pytest.mark.parametrize("whole", [pytest.param(PGM, id="pgm"), pytest.param(PNG, id="png")])
def test_a_file_cut_short_is_refused_or_has_all_its_pixels(tmp_path, whole, tenth):
    path = tmp_path / "plan.img.png"
    path.write_bytes(whole)
    complete = load_image(path)
    path.write_bytes(whole[: len(whole) * tenth // 10])
    with suppress(MapError):
        assert load_image(path) == complete


@pytest.mark.parametrize("seed", range(4))
def test_damage_gives_a_map_or_a_refusal_and_nothing_else(tmp_path, seed):
    rng = np.random.default_rng(seed)
    (tmp_path / "plan.png").write_bytes(PNG)
    path = tmp_path / "plan.yaml"
    for _ in range(60):
        which = path if rng.random() < 0.5 else tmp_path / "plan.png"
        path.write_text(GOOD)
        (tmp_path / "plan.png").write_bytes(PNG)
        content = bytearray(which.read_bytes())
        for _ in range(rng.integers(1, 4)):
            content[rng.integers(len(content))] = rng.integers(256)
        which.write_bytes(content)
        with suppress(MapError, UserWarning):  # A broken word may be an unknown key.
            load_ros(path)


def test_refuses_files_that_are_none(tmp_path):
    refused_in_time(load_map, tmp_path / "nowhere.yaml", "No such file")
    (tmp_path / "folder.yaml").mkdir()
    refused_in_time(load_map, tmp_path / "folder.yaml", "regular file")
    refused_in_time(load_map, tmp_path / "plan.jpg", "ends in .yaml, .yml, .txt.* got '.jpg'")
    refused_in_time(load_map, tmp_path / "plan", "ends in .* got ''")
    refused_in_time(load_map, "nul\0.yaml", "cannot read the map")
    (tmp_path / "plan.txt").write_bytes(b"\xff\xff")
    refused_in_time(load_map, tmp_path / "plan.txt", "not UTF-8")


def test_refuses_an_image_longer_than_64_mib(tmp_path):
    with (tmp_path / "plan.png").open("wb") as file:
        file.truncate(64 * 2**20 + 1)
    refused_in_time(load_image, tmp_path / "plan.png", "more than 67108864 bytes")


def test_refuses_a_resolution_for_a_file_that_says_its_own(tmp_path):
    with pytest.raises(MapError, match=r"says its own resolution; do not pass 0\.1"):
        load_map(tmp_path / "plan.yaml", resolution=0.1)


@pytest.mark.parametrize(
    ("name", "grid", "message"),
    [
        pytest.param("plan.png", {}, "written to .yaml, .yml, .txt; got '.png'", id="suffix"),
        pytest.param("nowhere/plan.yaml", {}, "cannot write the map: No such", id="folder"),
        pytest.param("~plan.yaml", {}, "not begin with ~", id="home"),
        pytest.param("pl\nan.yaml", {}, "must be printable", id="newline"),
        pytest.param("plan.yaml", {"resolution": 1e-5}, "resolution must be", id="resolution"),
        pytest.param("plan.yaml", {"origin": (1e9, 0.0)}, "origin must be", id="origin"),
    ],
)
def test_refuses_to_save(tmp_path, name, grid, message):
    with pytest.raises(MapError, match=message) as refusal:
        save_map(OccupancyGrid(np.array([[0, 1]]), **grid), tmp_path / name)
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []
