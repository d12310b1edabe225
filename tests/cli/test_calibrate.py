"""``activeloc calibrate``: its options, its files, what it refuses."""

import json

import numpy as np
import pytest
from PIL import Image

from activeloc.cli import main
from activeloc.cli.calibrate import SMALL, make_experiment

HUT = """\
##########
#..#.....#
#.....#..#
##########
"""
FAST = "--map hut.txt --set motion.radius=0 --set belief.cell_size=0.5 --steps 2 --replicates 100"
FEW = f"{FAST} --tracks 0"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "hut.txt").write_text(HUT)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "summary.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(belief="histogram", model="exact", world=None, *settings):
    return make_experiment(belief, model, world, SMALL, 8, 0, None, settings)


def test_it_prints_tables_and_writes_files(place, capsys):
    assert main(f"calibrate {FAST} --tracks 100 --out out/deep".split()) == 0
    out = capsys.readouterr().out
    for words in ("likelihood", "of the belief", "wrong declarations", "NEES of 100", "smallest p"):
        assert words in out
    assert max(len(line) for line in out.splitlines()) <= 100
    folder = place / "out" / "deep"
    assert sorted(p.name for p in folder.iterdir()) == [
        "ranks.png",
        "reliability.png",
        "summary.json",
    ]
    summary = json.loads((folder / "summary.json").read_text())
    assert sum(summary["ranks"]["x"]["counts"]) == summary["replicates"] == 100
    assert len(summary["nees"]) == 3
    assert summary["configuration"]["belief"]["repetition"] == "inf"
    assert summary["least_p"] == min(
        min(one["chi2_p"], one["ks_p"]) for one in summary["ranks"].values()
    )
    for name in ("ranks.png", "reliability.png"):
        with Image.open(folder / name) as image:
            assert np.asarray(image).std() > 0


def test_a_planted_defect_is_named_and_found(capsys):
    assert main(f"calibrate {FEW} --defect cubed --steps 6 --out out".split()) == 0
    out = capsys.readouterr().out
    assert "with cubed planted" in out
    assert "ranks are NOT uniform" in out


@pytest.mark.slow
def test_earlier_results_are_replaced_when_asked(place):
    command = f"calibrate {FEW} --out old"
    assert main(command.split()) == 2
    assert (place / "old" / "summary.json").read_text() == "{}"
    assert main(f"{command} --overwrite".split()) == 0
    assert json.loads((place / "old" / "summary.json").read_text())["tracks"] == 0


def test_the_exact_model_switches_every_rule_off():
    for belief in ("histogram", "particles"):
        given = made(belief)
        settings = given.belief
        assert (settings.sigma_factor, settings.likelihood_power) == (1.0, 1.0)
        assert (settings.contact_floor, settings.odometry_floor) == (1.0, 1.0)
        assert (settings.leak, settings.novelty, settings.slip) == (0.0, 0.0, 0.0)
        assert np.isinf(settings.repetition)
        assert given.control == "command"
        assert given.world == ("discrete" if belief == "histogram" else "continuous")
    assert made("particles").belief.roughening_xy == 0.0


def test_the_default_model_is_the_filter_as_shipped():
    from activeloc.beliefs.settings import HistogramConfig
    from activeloc.motion import MotionModel
    from activeloc.sensors import BeamModel

    given = made("histogram", "default", "continuous")
    assert given.belief == HistogramConfig()
    assert (given.sensor, given.motion) == (BeamModel(), MotionModel())
    assert given.control == "odometry"
    assert given.world == "continuous"


def test_settings_are_laid_over_the_models():
    given = made(
        "histogram", "exact", None, "belief.headings=36", "sensor.beams=5", "actions.turn=0.5"
    )
    assert given.belief.headings == 36
    assert np.isinf(given.belief.repetition)
    assert (given.sensor.beams, given.sensor.sigma_hit) == (5, 0.3)
    assert given.commands[0] == (0.5, 0.0, 0.0)
    given = made("histogram", "exact", None, "filter_sensor.sigma_hit=0.2", "sensor.beams=5")
    assert (given.sensor.sigma_hit, given.filter_sensor.sigma_hit) == (0.3, 0.2)
    assert given.sensor.beams == given.filter_sensor.beams == 5


REFUSED = {
    "no-out": (FEW, "--out"),
    "model": (f"{FEW} --model best --out out", "model must be one of exact, default"),
    "belief": (f"{FEW} --belief particle --out out", "did you mean 'particles'"),
    "world": (f"{FEW} --world flat --out out", "world must be one of"),
    "particles-discrete": ("--belief particles --world discrete --out out", "histogram filter's"),
    "maps": (f"{FEW} --map office:0-3 --out out", "names several maps"),
    "replicates": (f"{FAST} --replicates 10 --out out", "replicates must be an integer in [100,"),
    "tracks": (f"{FAST} --tracks 5 --out out", "tracks must be an integer in [100,"),
    "steps": (f"{FEW} --steps 0 --out out", "steps must be an integer in [1,"),
    "jobs": (f"{FEW} --jobs 0 --out out", "jobs must be an integer in [1, 256]"),
    "seed": (f"{FEW} --seed -1 --out out", "seed must be an integer in [0,"),
    "defect": (f"{FEW} --defect flippd --out out", "did you mean 'flipped'"),
    "defect-of-the-other": (f"{FEW} --defect kept-weights --out out", "the particle filter's"),
    "setting": (f"{FEW} --set task.hold=3 --out out", "unknown name 'task'"),
    "field": (f"{FEW} --set belief.cellsize=1 --out out", "did you mean 'cell_size'"),
    "continuous-actions": (f"{FEW} --set actions.kind=continuous --out out", "must be discrete"),
    "file": (f"{FEW} --out hut.txt", "is a file"),
    "under-a-file": (f"{FEW} --out hut.txt/out", "is no folder"),
    "there-already": (f"{FEW} --out old", "holds summary.json already"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(case, place, capsys):
    options, message = REFUSED[case]
    before = sorted(place.rglob("*"))
    assert main(["calibrate", *options.split()]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert sorted(place.rglob("*")) == before
