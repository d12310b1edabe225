import base64
import json
import re
import zlib

import numpy as np
import pytest

from activeloc.envs.rendering import page_of, write_page
from activeloc.errors import ConfigError


def replay_in(page):
    """What the page's script reads."""
    text = page.decode()
    return json.loads(re.search(r'id="replay">(.*?)</script>', text, re.DOTALL)[1])


def unpacked(block, dtype=np.uint8):
    return np.frombuffer(zlib.decompress(base64.b64decode(block["packed"])), dtype)


def test_the_page_holds_the_recording(recording_of):
    recording = recording_of(carried=3)
    replay = replay_in(page_of([recording]))
    (track,) = replay["tracks"]
    np.testing.assert_allclose(track["entropy"], recording.entropy, atol=1e-4)
    np.testing.assert_allclose(track["poses"], recording.poses, atol=1e-3)
    assert track["commands"] == list(recording.commands)
    assert track["carried_at"] == 3
    assert track["scans"][0] == [1.0, None, 2.0]
    cells = unpacked(replay["map"]).reshape(replay["map"]["shape"])
    np.testing.assert_array_equal(cells, recording.grid.cells)
    assert replay["map"]["extent"] == [-3.0, 17.0, 2.0, 14.0]


@pytest.mark.parametrize("name", ["shades", "slices"])
def test_beliefs_survive_the_packing(recording_of, name):
    recording = recording_of()
    block = replay_in(page_of([recording]))["tracks"][0][name]
    levels, shades = block["levels"], getattr(recording, name)
    back = unpacked(block).reshape(block["shape"]).astype(int)
    assert shades.any()
    np.testing.assert_array_equal(back > 0, shades > 0)
    width = 256 // levels
    assert np.abs(back * width + width // 2 - shades)[shades > 0].max() <= width


def test_particles_are_places_on_the_map(recording_of):
    recording = recording_of(particles=True)
    block = replay_in(page_of([recording]))["tracks"][0]["particles"]
    pairs = unpacked(block, "<u2").reshape(-1, 2)
    assert block["counts"] == [len(cloud) for cloud in recording.particles]
    last = pairs[block["ends"][-1] - block["counts"][-1] :] / 65535
    xy = last * (20.0, 12.0) + (-3.0, 2.0)
    expected = recording.particles[-1][:, :2].clip((-3.0, 2.0), (17.0, 14.0))
    np.testing.assert_allclose(xy, expected, atol=1e-3)


def test_it_asks_nothing_of_the_world(recording_of):
    page = page_of([recording_of()]).decode()
    assert "default-src 'none'" in page
    links = set(re.findall(r"https?://[^\s\"']+", page))
    assert links == {"http://www.w3.org/2000/svg"}
    assert not re.findall(r"\b(src|href)=", page)
    assert "$" not in re.sub(r"\$\{", "", page.split("<script>")[0])


def test_names_are_words_and_no_markup(recording_of):
    evil = "</script><script>alert(1)</script>&<b>"
    page = page_of([recording_of(agent=evil, name=evil)], about=evil).decode()
    assert "alert(1)</script>" not in page
    assert page.count("<script") == 2
    assert replay_in(page.encode())["tracks"][0]["agent"] == evil


def test_fine_maps_are_made_coarser_and_keep_their_walls(recording_of):
    from dataclasses import replace

    from activeloc.grid import OccupancyGrid

    cells = np.zeros((700, 2500), np.uint8)
    cells[5, 1301], cells[6, 1300], cells[650, 7] = 1, 2, 2
    grid = OccupancyGrid(cells, 0.01, (-3.0, 2.0))
    block = replay_in(page_of([replace(recording_of(), grid=grid)]))["map"]
    coarse = unpacked(block).reshape(block["shape"])
    assert coarse.shape == (234, 834)
    assert (coarse[1, 433], coarse[2, 433], coarse[216, 2]) == (1, 2, 2)
    assert np.count_nonzero(coarse) == 3


def test_what_cannot_be_shown_together_is_refused(recording_of, tmp_path):
    from dataclasses import replace

    from activeloc.grid import OccupancyGrid

    one = recording_of()
    other = replace(one, grid=OccupancyGrid(np.zeros((3, 4), np.uint8), name="yard"))
    with pytest.raises(ConfigError, match="one map; got hall and yard"):
        page_of([one, other])
    with pytest.raises(ConfigError, match="at least one"):
        write_page([], tmp_path / "a.html")
    assert not list(tmp_path.iterdir())
