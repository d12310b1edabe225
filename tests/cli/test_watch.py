"""``activeloc watch``: films and pages of an episode."""

import json
import re

import pytest
from PIL import Image

from activeloc.cli import main

HUT = """\
##########
#..#..?..#
#........#
##########
"""
FAST = "--map hut.txt --set belief.cell_size=0.5 --set belief.headings=12 --steps 4"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "hut.txt").write_text(HUT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def tracks(path):
    text = path.read_text("utf-8")
    return json.loads(re.search(r'id="replay">(.*?)</script>', text, re.DOTALL)[1])["tracks"]


def test_two_agents_from_the_same_start(place, capsys):
    command = f"watch --agent spin --agent random {FAST} --seed 5 --episode 2 --out both.html"
    assert main(command.split()) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("spin on hut: ")
    assert out[1].startswith("random on hut: ")
    assert re.fullmatch(r"both\.html: 0\.\d\d MB", out[2])
    one, other = tracks(place / "both.html")
    assert (one["agent"], other["agent"]) == ("spin", "random")
    assert one["poses"][0] == other["poses"][0]
    assert one["scans"][0] == other["scans"][0]
    assert one["poses"][-1] != other["poses"][-1]


def test_it_shows_the_episode_that_run_plays(place, capsys):
    assert main(f"run --agent spin {FAST} --seed 5 --episode 2".split()) == 0
    said = capsys.readouterr().out
    assert main(f"watch --agent spin {FAST} --seed 5 --episode 2 --out a.html".split()) == 0
    assert capsys.readouterr().out.startswith(said)
    (track,) = tracks(place / "a.html")
    assert f"entropy {track['entropy'][-1]:.2f} nat, error {track['error_m'][-1]:.2f} m" in said


def test_a_gif_has_the_asked_size_and_speed(place, capsys):
    assert main(f"watch --agent spin {FAST} --out a.gif --fps 10 --size 320".split()) == 0
    with Image.open(place / "a.gif") as film:
        assert max(film.size) == 320
        assert film.info["duration"] == 100
        assert 2 <= film.n_frames <= 5


def test_mazes_have_an_agent_of_their_own(place, capsys):
    command = "watch --env Maze7-v0 --map maze(size=7):3 --steps 3 --out a.html"
    assert main(command.split()) == 0
    assert capsys.readouterr().out.startswith("greedy on maze-3: ")
    (track,) = tracks(place / "a.html")
    assert track["shades"]["shape"] == [4, 7, 7]
    assert track["slices"]["shape"] == [4, 4, 7, 7]


REFUSED = {
    "no-out": ("watch --agent spin", "--out"),
    "suffix": ("watch --agent spin --out a.avi", "must end in .gif or .mp4 or .html"),
    "nowhere": ("watch --agent spin --out nowhere/a.gif", "there is no folder nowhere"),
    "twice": ("watch --agent spin --agent spin --out a.gif", "spin is given twice"),
    "unknown": ("watch --agent spinn --out a.gif", "did you mean 'spin'"),
    "size": ("watch --agent spin --size 20 --out a.gif", "size must be an integer in [300, 4000]"),
    "fps": ("watch --agent spin --fps 0 --out a.gif", "fps must be a number in (0, 50]"),
    "episode": ("watch --agent spin --episode -1 --out a.gif", "episode must be an integer"),
    "map": ("watch --agent spin --map lost.yaml --out a.gif", "lost.yaml: cannot read"),
    "maze": ("watch --env Maze7-v0 --agent spin --out a.gif", "agent spin plays no mazes"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_in_one_line_and_nothing_written(place, capsys, name):
    command, message = REFUSED[name]
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("activeloc: ")
    assert message in err
    assert [path.name for path in place.iterdir()] == ["hut.txt"]


def test_no_encoder_is_said_before_the_episode_is_played(place, capsys, monkeypatch):
    monkeypatch.setattr("activeloc.envs.rendering.film.find_spec", lambda name: None)
    monkeypatch.setattr("activeloc.agents.evaluation.Player", lambda sweep: pytest.fail("played"))
    assert main(f"watch --agent spin {FAST} --out a.mp4".split()) == 2
    assert 'pip install "activeloc[video]"' in capsys.readouterr().err


def test_a_full_disk_is_one_line(place, capsys, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("activeloc.envs.rendering.page.write_atomically", full)
    assert main(f"watch --agent spin {FAST} --out a.html".split()) == 1
    assert capsys.readouterr().err == "activeloc: a.html: No space left on device\n"
