import subprocess

import numpy as np
import pytest

from activeloc.envs.rendering import draw, frames_of, write_mp4
from activeloc.envs.rendering.marks import PAPER
from activeloc.errors import ConfigError

RED, BLUE = (np.full((64, 96, 3), colour, np.uint8) for colour in ((220, 20, 20), (20, 20, 220)))


def test_one_agent_fills_the_frame(recording_of):
    recording = recording_of(steps=3)
    frames = list(frames_of([recording], 300))
    assert len(frames) == 4
    for moment, frame in enumerate(frames):
        np.testing.assert_array_equal(frame, draw(recording.scene(moment), 300))


@pytest.mark.parametrize(("n", "rows", "cols"), [(2, 1, 2), (3, 2, 2), (5, 2, 3)])
def test_several_are_beside_each_other_and_named(recording_of, n, rows, cols):
    recordings = [recording_of(f"agent {i}", steps=1 + (i == 1), seed=i) for i in range(n)]
    frames = list(frames_of(recordings, 300))
    alone = [draw(one.scene(1, with_agent=True), 300) for one in recordings]
    height, width, _ = alone[0].shape
    assert len(frames) == 3
    assert frames[1].shape == (rows * height + 8 * (rows - 1), cols * width + 8 * (cols - 1), 3)
    for i, part in enumerate(alone):
        top, left = (i // cols) * (height + 8), (i % cols) * (width + 8)
        np.testing.assert_array_equal(frames[1][top : top + height, left : left + width], part)
    if n < rows * cols:
        assert (frames[1][-height:, -width:] == PAPER).all()
    # The others have ended by the third frame; the second agent moves on.
    changed = (frames[2] != frames[1]).any(axis=(0, 2))
    assert not changed[:width].any()
    assert changed[width + 8 : 2 * width + 8].any()


def test_different_maps_and_no_recordings_are_refused(recording_of):
    from dataclasses import replace

    from activeloc.grid import OccupancyGrid

    one = recording_of()
    other = replace(one, grid=OccupancyGrid(np.zeros((3, 4), np.uint8), name="yard"))
    with pytest.raises(ConfigError, match="one map; got hall and yard"):
        next(frames_of([one, other]))
    with pytest.raises(ConfigError, match="at least one recording"):
        next(frames_of([]))


def test_an_mp4_shows_its_frames_and_holds_the_last(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    write_mp4([RED] * 3 + [BLUE], tmp_path / "film.mp4", fps=4.0)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
    assert ffmpeg.count_frames_and_secs(tmp_path / "film.mp4") == (3 + 1 + 8, 3.0)
    decode = [
        "-v",
        "error",
        "-i",
        tmp_path / "film.mp4",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    raw = subprocess.run([ffmpeg.get_ffmpeg_exe(), *decode], capture_output=True, check=True).stdout
    frames = np.frombuffer(raw, np.uint8).reshape(12, 64, 96, 3)
    for i, frame in enumerate(frames):
        expected = RED if i < 3 else BLUE
        assert np.abs(frame.astype(int) - expected).max() < 25


@pytest.mark.parametrize(
    ("frames", "settings", "message"),
    [
        ([], {}, "at least one frame"),
        ([RED[:63]], {}, "even sides, got 96 x 63"),
        ([RED], {"fps": 0}, "fps must be"),
        ([RED], {"fps": 61}, "fps must be"),
    ],
)
def test_what_makes_no_mp4(tmp_path, frames, settings, message):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    with pytest.raises(ConfigError, match=message):
        write_mp4(frames, tmp_path / "film.mp4", **settings)
    assert not list(tmp_path.iterdir())


def test_without_the_encoder_it_is_said_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr("activeloc.envs.rendering.film.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"activeloc\[video\]"):
        write_mp4([RED], tmp_path / "film.mp4")
