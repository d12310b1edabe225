"""``activeloc localize``: a recorded run into a folder, and what it refuses."""

import csv
import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from activeloc.cli import main
from activeloc.cli.localize import select
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.logs import Recording
from activeloc.maps import load_map, save_map
from activeloc.raycast import cast_scan

HUT = """\
############
#....#.....#
#....#.....#
#..........#
#....#.....#
###..####..#
#..........#
############
"""
FAST = "--set belief.cell_size=0.5 --set belief.headings=24 --set beams=9"
N_SCANS = 24


def hut():
    rows = [[int(letter == "#") for letter in line] for line in HUT.splitlines()]
    cells = np.repeat(np.repeat(np.array(rows[::-1], dtype=np.uint8), 5, axis=0), 5, axis=1)
    return OccupancyGrid(cells, 0.2, name="hut")


def log_of(grid):
    """A way through the hut, seen by a perfect laser of 37 beams; the odometry is elsewhere."""
    corners = np.array([[1.6, 1.5], [4.0, 1.5], [4.0, 4.5], [8.5, 4.5], [8.5, 6.0]])
    legs = np.diff(corners, axis=0)
    along = np.linspace(0, len(legs) - 1e-9, N_SCANS)
    leg = along.astype(int)
    xy = corners[leg] + (along - leg)[:, None] * legs[leg]
    poses = np.column_stack([xy, np.arctan2(legs[leg, 1], legs[leg, 0])])
    scans = cast_scan(grid, poses, np.linspace(-np.pi / 2, np.pi / 2, 37), 80.0)
    lines = ["# made by a test"]
    for i, (pose, scan) in enumerate(zip(poses, scans, strict=True)):
        x, y, theta = pose
        wheels = (3 - y, x + 7, theta + np.pi / 2)
        numbers = " ".join(f"{z:.4f}" for z in (*scan, *pose, *wheels))
        lines.append(f"FLASER 37 {numbers} {1000 + 2 * i}.5 robot 0")
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """A folder with a map, a log and traps."""
    save_map(hut(), tmp_path / "hut.yaml")
    (tmp_path / "drive.log").write_text(log_of(hut()))
    (tmp_path / "bad.log").write_text("# nothing\nFLASER 3 1 2\n")
    (tmp_path / "empty.log").write_text("")
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "trajectory.csv").write_text("mine\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch):
    """No pictures: they take longer than the rest."""
    monkeypatch.setattr("activeloc.cli.replay_files._draw", lambda run, folder: None)


def rows_in(folder):
    with (folder / "trajectory.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("belief", ["histogram", "particles"])
def test_localizes_and_writes_what_it_says(place, capsys, belief):
    settings = FAST if belief == "histogram" else "--set belief.n_start=5000"
    command = f"localize drive.log --map hut.yaml --belief {belief} {settings} --out deep/out"
    assert main(command.split()) == 0
    out, err = capsys.readouterr()
    assert out.startswith("drive, 24 scans: right, median error 0.")
    assert out.endswith("deep/out: trajectory.csv, summary.json, path.png, error.png\n")
    assert err == ""
    rows = rows_in(place / "deep/out")
    assert list(rows[0]) == ["scan", "time", "x", "y", "theta", "entropy", "error_m", "error_rad"]
    assert [int(row["scan"]) for row in rows] == list(range(N_SCANS))
    assert [float(row["time"]) for row in rows] == [1000.5 + 2 * i for i in range(N_SCANS)]
    summary = json.loads((place / "deep/out/summary.json").read_text())
    last = [float(row["error_m"]) for row in rows[-6:]]
    assert summary["median_error_m"] == pytest.approx(np.median(last))
    assert summary["right"] is True
    assert summary["scans_to_localize"] is not None
    assert summary["recorded_seconds"] == 2.0 * (N_SCANS - 1)
    assert summary["times_faster_than_recorded"] == pytest.approx(46.0 / summary["seconds"])
    assert summary["settings"]["belief"]["repetition"] == "inf"
    assert summary["map"]["sha256"] == load_map(place / "hut.yaml").digest
    assert "last quarter" in summary["rule"]
    for name in ("path.png", "error.png"):
        with Image.open(place / "deep/out" / name) as picture:
            assert min(picture.size) > 600
    assert not list((place / "deep/out").glob(".*"))


def test_same_seed_same_trajectory(place, undrawn):
    command = "localize drive.log --map hut.yaml --belief particles --set belief.n_start=2000"
    for seed, folder in ((4, "a"), (4, "b"), (5, "c")):
        assert main(f"{command} --scans 6 --seed {seed} --out {folder}".split()) == 0
    a, b, c = ((place / name / "trajectory.csv").read_bytes() for name in "abc")
    assert a == b != c


def test_start_scans_and_kidnapping_choose_scans_of_the_log(place, capsys, undrawn):
    command = f"localize drive.log --map hut.yaml {FAST} --start 2 --scans 9 --kidnap 6:12 --out o"
    assert main(command.split()) == 0
    assert "kidnapped: carried " in capsys.readouterr().out
    assert [int(row["scan"]) for row in rows_in(place / "o")] == [2, 3, 4, 5, *range(12, 17)]
    summary = json.loads((place / "o" / "summary.json").read_text())
    assert summary["set_down_at_scan"] == 12
    assert summary["recorded_seconds"] == 2.0 * (3 + 4)


def test_overwrite_replaces_the_run(place, undrawn):
    command = f"localize drive.log --map hut.yaml {FAST} --scans 3 --out full"
    assert main(command.split()) == 2
    assert (place / "full" / "trajectory.csv").read_text() == "mine\n"
    assert main([*command.split(), "--overwrite"]) == 0
    assert len(rows_in(place / "full")) == 3


def test_poses_off_the_open_ground_are_said(place, capsys, undrawn):
    command = f"localize drive.log --map hut.yaml {FAST} --scans 3 --set radius=0.9 --out o"
    assert main(command.split()) == 0
    assert "of the reference poses are in or too near an obstacle" in capsys.readouterr().err


RUN = "localize drive.log --map hut.yaml --out out"
REFUSED = {
    "no log": ("localize --map hut.yaml --out out", "LOG"),
    "no map": ("localize drive.log --out out", "--map"),
    "no out": ("localize drive.log --map hut.yaml", "--out"),
    "missing log": ("localize lost.log --map hut.yaml --out out", "lost.log: cannot read"),
    "empty log": ("localize empty.log --map hut.yaml --out out", "no FLASER or ROBOTLASER1"),
    "damaged log": ("localize bad.log --map hut.yaml --out out", "bad.log:2: FLASER: 3 fields"),
    "folder as log": ("localize folder.log --map hut.yaml --out out", "a regular file"),
    "map as log": ("localize hut.yaml --map hut.yaml --out out", "hut.yaml:1: message: unknown"),
    "missing map": ("localize drive.log --map lost.yaml --out out", "lost.yaml: cannot read"),
    "several maps": ("localize drive.log --map office:0-3 --out out", "names several maps"),
    "belief": (f"{RUN} --belief histogramm", "did you mean 'histogram'"),
    "seed": (f"{RUN} --seed -1", "seed must be an integer in [0,"),
    "start negative": (f"{RUN} --start -1", "--start must be an integer in [0, 23]; got -1"),
    "start too late": (f"{RUN} --start 24", "--start must be an integer in [0, 23]; got 24"),
    "no scans": (f"{RUN} --scans 0", "--scans must be an integer in [1,"),
    "kidnap word": (f"{RUN} --kidnap here", "--kidnap 'here': expected I:J"),
    "kidnap negative": (f"{RUN} --kidnap=-1:3", "expected I:J"),
    "kidnap half": (f"{RUN} --kidnap 3:", "expected I:J"),
    "kidnap backwards": (f"{RUN} --kidnap 9:3", "expected 0 < I < J < 24"),
    "kidnap at once": (f"{RUN} --kidnap 0:3", "expected 0 < I < J < 24"),
    "kidnap past the end": (f"{RUN} --kidnap 3:24", "expected 0 < I < J < 24"),
    "kidnap before start": (f"{RUN} --start 5 --kidnap 4:9", "expected 5 < I < J < 24"),
    "kidnap after the scans": (f"{RUN} --scans 4 --kidnap 4:9", "among the scans used"),
    "set": (f"{RUN} --set beams", "expected KEY=VALUE"),
    "set unknown": (f"{RUN} --set beam=3", "did you mean 'beams'"),
    "set range": (f"{RUN} --set beams=0", "beams must be an integer in [1, 4096]"),
    "set sensor": (f"{RUN} --set sensor=laser", "unknown name 'laser'"),
    "set beams of sensor": (f"{RUN} --set sensor.beams=3", "is the recording's"),
    "set belief": (f"{RUN} --set belief=particles", "use --belief"),
    "robot too wide": (f"{RUN} --set radius=9", "fits nowhere"),
    "out is a file": ("localize drive.log --map hut.yaml --out hut.yaml", "is a file"),
    "out is taken": ("localize drive.log --map hut.yaml --out full", "--overwrite"),
}


def tree(folder):
    return {
        p.relative_to(folder): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")
    }


@pytest.mark.parametrize("name", REFUSED)
def test_refused_in_one_line_and_nothing_written(place, capsys, name):
    command, message = REFUSED[name]
    before = tree(place)
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("activeloc: ")
    assert err.count("\n") == 1
    assert message in err
    assert tree(place) == before


def test_the_whole_log_can_be_asked_for():
    n = 10
    zeros = np.zeros((n, 3))
    recording = Recording(zeros, np.array([-1.0, 0, 1]), zeros, zeros, np.arange(n) * 1.0)
    assert len(select(recording, 0, None, None)[0]) == 10
    assert len(select(recording, 9, None, None)[0]) == 1
    part, down = select(recording, 1, "3:9", None)
    assert (part.scan_numbers.tolist(), down) == ([1, 2, 9], 9)
    with pytest.raises(ConfigError):
        select(recording, 1, "3:10", None)


def test_an_interrupt_leaves_nothing_half_written(place):
    command = f"localize drive.log --map hut.yaml {FAST} --out out --overwrite"
    code = "import sys; from activeloc.cli import main; sys.exit(main(sys.argv[1:]))"
    # The hook says when the run is under way: an interrupt during the imports would prove little.
    hook = (
        "import time; import activeloc.replay as r; old = r.Replay.rows\n"
        "def rows(self, seed):\n"
        "    for row in old(self, seed):\n"
        "        open('under-way', 'w').close(); time.sleep(1); yield row\n"
        "r.Replay.rows = rows\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", hook + code, *command.split()], stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while not (place / "under-way").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err == "activeloc: interrupted\n"
    assert not (place / "out").exists()


def test_a_full_disk_leaves_whole_files_alone(place, capsys, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("activeloc.cli.replay_files.write_atomically", full)
    command = f"localize drive.log --map hut.yaml {FAST} --scans 3 --out out"
    assert main(command.split()) == 1
    assert capsys.readouterr().err.endswith("trajectory.csv: No space left on device\n")
    assert list((place / "out").iterdir()) == []
