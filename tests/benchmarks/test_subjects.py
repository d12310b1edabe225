"""Every subject runs with small sizes, and the command writes what it says."""

import json
import math
import sys

import pytest
from PIL import Image

from activeloc.benchmarks import SUBJECTS, Absent, Curve, Row, Settings, check_subjects, measure
from activeloc.cli import main
from activeloc.errors import ConfigError


@pytest.mark.parametrize("subject", SUBJECTS)
def test_every_subject_runs(subject):
    items = list(measure(subject, Settings(quick=True, threads=2)))
    rows = [item for item in items if isinstance(item, Row)]
    assert rows
    assert len({(row.name, row.yardstick) for row in rows}) == len(rows)
    for row in rows:
        assert row.subject == subject
        assert row.ours.low <= row.ours.median <= row.ours.high
        assert math.isfinite(row.ours.high)
    for curve in items:
        if isinstance(curve, Curve):
            assert len(curve.x) == len(curve.y) >= 2
            assert min(*curve.x, *curve.y) > 0.0


def test_the_command_writes_its_files(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "amcl", None)
    out = tmp_path / "deep" / "bench"
    assert main(["bench", "rays", "--quick", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "wrong rays [rays]" in said
    assert "amcl (not installed)" in said
    assert max(map(len, said.splitlines())) <= 140
    plain = json.loads((out / "bench.json").read_text())
    assert {row["subject"] for row in plain["rows"]} == {"rays"}
    assert plain["settings"] == {"quick": True, "threads": 2, "maps": None}
    absent = [row for row in plain["rows"] if row["yardstick"].startswith("amcl")]
    assert absent
    assert all(row["theirs"] is None and row["is_met"] is None for row in absent)
    assert "## rays" in (out / "bench.md").read_text()
    with Image.open(out / "rays.png") as picture:
        assert picture.size[0] > 800
    assert main(["bench", "rays", "--quick", "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_a_run_that_is_stopped_leaves_what_it_has_measured(tmp_path, capsys, monkeypatch):
    from activeloc import benchmarks

    def stopped(subject, settings):
        if subject == "memory":
            raise KeyboardInterrupt
        yield Row.of(subject, "a", "ns", 1.0)
        yield Absent(subject, "b", "there is none")

    monkeypatch.setattr(benchmarks, "measure", stopped)
    assert main(["bench", "rays", "memory", "--out", str(tmp_path)]) == 130
    there = capsys.readouterr()
    assert "rays, b: there is none" in there.out
    plain = json.loads((tmp_path / "bench.json").read_text())
    assert [row["name"] for row in plain["rows"]] == ["a"]
    assert plain["absent"] == [{"subject": "rays", "name": "b", "reason": "there is none"}]
    assert "Not measured: rays, b: there is none." in (tmp_path / "bench.md").read_text()


REFUSED = {
    "subject": ("bench ray", "did you mean 'rays'"),
    "threads": ("bench rays --threads 0", "threads must be an integer in [1, 256]"),
    "maps": ("bench rays --maps nowhere", "maps: nowhere is no folder"),
    "out": ("bench rays --out file.txt", "is a file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_before_anything_is_measured(name, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").touch()
    command, message = REFUSED[name]
    assert main(command.split()) == 2
    there = capsys.readouterr()
    assert message in there.err
    assert there.out == ""
    assert there.err.count("\n") == 1


def test_the_environment_names_the_folder_of_maps(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ACTIVELOC_MAPS", str(tmp_path / "lost"))
    assert main(["bench", "rays", "--quick"]) == 2
    assert "lost is no folder" in capsys.readouterr().err


def test_subjects_come_in_one_order():
    assert check_subjects([]) == SUBJECTS
    assert check_subjects(["particles", "rays", "rays"]) == ("rays", "particles")
    with pytest.raises(ConfigError, match="subject"):
        check_subjects(["ranks"])
