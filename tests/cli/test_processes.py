"""The command as a process: start-up time, signals, pipes."""

import os
import resource
import signal
import subprocess
import sys
import time

import pytest

from activeloc.cli import main

COMMAND = [sys.executable, "-m", "activeloc.cli"]
HUT = "##########\n#..#.....#\n#........#\n##########\n"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "hut.txt").write_text(HUT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_help_comes_at_once():
    times = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([*COMMAND, "--help"], capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        # Processor time: what others do on the machine is not the command's fault.
        times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        assert "evaluate" in done.stdout
    assert min(times) < 0.5


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from activeloc.cli import main; main(['--help']);"
        "heavy = {'numba', 'scipy', 'torch', 'matplotlib', 'PIL', 'yaml', 'rich'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "arguments",
    [[], ["evalaute"], ["map", "info", "lost.yaml"], ["evaluate", "--out", "o", "--agents", "x"]],
)
def test_refusals_leave_one_line(place, arguments):
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("activeloc: ")
    assert done.stderr.count("\n") == 1
    assert [path.name for path in place.iterdir()] == ["hut.txt"]


@pytest.mark.parametrize(
    ("number", "jobs", "code", "word"),
    [(signal.SIGINT, 1, 130, "interrupted"), (signal.SIGTERM, 2, 143, "terminated")],
)
def test_stopped_runs_say_how_to_go_on(place, number, jobs, code, word):
    arguments = (
        "evaluate --map hut.txt --agents spin --episodes 100000 --out out --steps 30 --jobs "
        f"{jobs} --set belief.cell_size=0.5 --set belief.headings=12 --set task.confidence=1"
    )
    process = subprocess.Popen([*COMMAND, *arguments.split()], stderr=subprocess.PIPE, text=True)
    kept = place / "out" / ".episodes.jsonl"
    end = time.monotonic() + 60.0
    while time.monotonic() < end and not (kept.exists() and kept.read_bytes().count(b"\n") > 3):
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert process.returncode == code, err
    n_kept = kept.read_bytes().count(b"\n") - 1
    assert err == (
        f"activeloc: {word}; {n_kept} of 100000 episodes are kept in out; "
        "the same command goes on\n"
    )
    assert [path.name for path in (place / "out").iterdir()] == [".episodes.jsonl"]
    assert main(arguments.replace("100000", "2").split()) == 0


@pytest.mark.parametrize(
    ("more", "way"),
    [("", "the same command"), ("--overwrite", "the same command without --overwrite")],
)
def test_what_is_kept_is_what_the_file_holds(monkeypatch, capsys, more, way):
    """The interrupt comes when an episode is in the file and not yet on the bar."""
    last = 2

    def stop(progress, record):
        if record.episode == last:
            raise KeyboardInterrupt

    monkeypatch.setattr("activeloc.cli.evaluate._Progress.add", stop)
    arguments = "evaluate --map hut.txt --agents spin --out out --steps 2 --set belief.headings=12"
    kept = "activeloc: interrupted; {} episodes are kept in out; {} goes on\n"
    assert main([*arguments.split(), "--episodes", "9", *more.split()]) == 130
    assert capsys.readouterr().err == kept.format("3 of 9", way)
    last = 0  # Those that are not asked for are kept, and do not count.
    assert main([*arguments.split(), "--episodes", "1"]) == 130
    assert capsys.readouterr().err == kept.format("1 of 1", "the same command")


def test_nobody_reads(place):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, "map", "info", "hut.txt"], stdout=write, stderr=subprocess.PIPE, text=True
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("locale", ["C", "POSIX"])
def test_other_locales(place, locale):
    (place / "höme.txt").write_text(HUT)
    environment = {**os.environ, "LC_ALL": locale, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [*COMMAND, "map", "info", "höme.txt"], capture_output=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert b"8.00 x 4.00" not in done.stdout
    assert b"10.00 x 4.00 m" in done.stdout
