"""What each subcommand does when all is well."""

import re

import numpy as np
import pytest
from PIL import Image

from activeloc.cli import main
from activeloc.cli.settings import parse_settings
from activeloc.maps import load_map

HUT = """\
##########
#..#..?..#
#........#
##########
"""
FAST = "--set belief.cell_size=0.5 --set belief.headings=12 --steps 6"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "hut.txt").write_text(HUT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(capsys, command):
    """What a command that succeeds prints."""
    assert main(command.split()) == 0
    return capsys.readouterr().out


def test_values_are_yaml_and_numbers_are_numbers():
    given = parse_settings(
        ["a.b=1", "a.c=1.5", "a.d=1e-3", "a.e=inf", "f=discrete", "g=true", "h=[1, 2e0]", "i=null"]
    )
    assert given == {
        "a": {"b": 1, "c": 1.5, "d": 1e-3, "e": float("inf")},
        "f": "discrete",
        "g": True,
        "h": [1, 2.0],
        "i": None,
    }
    assert type(given["a"]["b"]) is int


def test_settings_reach_environment_and_agents():
    from activeloc.cli.settings import make_sweep

    settings = ["sensor.z_max=2", "task.hold=5", "belief.repetition=inf", "agent.greedy.samples=9"]
    sweep = make_sweep("KidnappedRobot-v0", "hut.txt", "particles", ["greedy"], settings, 0, 7)
    config = sweep.config()
    assert (config.sensor.z_max, config.task.hold, config.task.kind) == (2, 5, "kidnapped")
    assert type(config.belief).__name__ == "ParticleConfig"
    assert config.belief.repetition == float("inf")
    assert (sweep.agents["greedy"], sweep.limit) == ({"samples": 9}, 7)
    settings = ["actions=discrete+stay", "filter_sensor.z_max=1"]
    sweep = make_sweep("GlobalLocalization-v0", "hut.txt", "histogram", ["spin"], settings, 0, 7)
    assert sweep.config().actions.stay
    assert sweep.config().filter_sensor.z_max == 1


def test_envs_lists_every_id(capsys):
    from activeloc.envs import ENVIRONMENTS

    out = said(capsys, "envs")
    assert all(name in out for name in ENVIRONMENTS)
    assert "Discrete(3)" in out
    assert "belief 8x32x32" in out


def test_evaluate_prints_a_table_and_writes_the_files(place, capsys):
    command = f"evaluate --map hut.txt {FAST} --agents spin,random --episodes 2 --out out/deep"
    out = said(capsys, command)
    assert "less spin's, on the same episodes" in out
    assert "out/deep: curves.csv, entropy.png, episodes.csv, summary.json" in out
    assert max(len(line) for line in out.splitlines()) <= 100
    assert said(capsys, command) == out


def test_run_plays_the_episode_that_evaluate_plays(place, capsys):
    said(capsys, f"evaluate --map hut.txt {FAST} --agents spin --seed 4 --episodes 2 --out out")
    row = (place / "out" / "episodes.csv").read_text().splitlines()[2].split(",")
    out = said(capsys, f"run --map hut.txt {FAST} --agent spin --seed 4 --episode 1")
    assert f"error {float(row[9]):.2f} m" in out
    assert f"entropy {float(row[8]):.2f} nat" in out


def test_run_writes_a_film_of_every_step(place, capsys):
    out = said(capsys, f"run --map hut.txt {FAST} --agent spin --out spin.gif")
    assert out.startswith("spin on hut: ")
    assert re.fullmatch(r"spin\.gif: \d\.\d\d MB", out.splitlines()[1])
    with Image.open(place / "spin.gif") as film:
        assert 2 <= film.n_frames <= 7


def test_map_info_counts(capsys):
    out = said(capsys, "map info hut.txt")
    assert "10.00 x 4.00 m" in out
    assert "10 x 4 of 1 m" in out
    assert "14 free (35.0%), 25 occupied (62.5%), 1 unknown (2.5%)" in out
    assert "14.0 m2 for a robot of radius 0.2 m, the largest of 1 connected parts" in out


def test_map_info_of_several(capsys):
    out = said(capsys, "map info maze:2-4")
    assert [line for line in out.splitlines() if line.startswith("maze")] == [
        "maze-2",
        "maze-3",
        "maze-4",
    ]
    assert "of endless maps" in said(capsys, "map info maze:*")


def test_map_show_draws_top_first(capsys, place, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    (place / "tall.txt").write_text("####\n#..#\n#.?#\n#..#\n####\n####\n")
    assert said(capsys, "map show tall.txt") == "####\n# ?#\n####\n"
    said(capsys, "map show hut.txt --out hut.png")
    with Image.open(place / "hut.png") as picture:
        pixels = np.asarray(picture)
    assert pixels.shape == (320, 800)
    assert (pixels[40, 0], pixels[120, 120], pixels[120, 520]) == (0, 255, 160)


def test_map_make_writes_what_it_reads(capsys, place):
    said(capsys, "map make rooms:3 --out home.yaml")
    from activeloc.maps import MapSource

    assert load_map(place / "home.yaml").digest == MapSource.parse("rooms:3").number(0).digest
    said(capsys, "map make rooms:4 --out home.yaml --overwrite")
    assert load_map(place / "home.yaml").digest == MapSource.parse("rooms:4").number(0).digest


@pytest.mark.parametrize(
    "command", ["", "envs", "evaluate", "play", "run", "watch", "map", "map info", "map make"]
)
def test_help_for_all(capsys, command):
    out = said(capsys, f"{command} --help")
    assert "Usage: activeloc" in out
    if command in ("evaluate", "play", "run", "watch"):
        assert f"  activeloc {command} --" in out
