"""Command lines that cannot be: exit code 2, one line on standard error, nothing written."""

import os

import pytest

from activeloc.cli import main

HUT = """\
########
#..#...#
#......#
########
"""
EVALUATE = "evaluate --map hut.txt --out out"
FAST = "--set belief.cell_size=0.5 --set belief.headings=12 --steps 3 --agents spin"

COMMANDS = {
    "nothing": ("", "Missing command"),
    "unknown-subcommand": ("evalute --out out", "No such command 'evalute'"),
    "unknown-option": (f"{EVALUATE} --agnets spin", "No such option: --agnets"),
    "stray-argument": (f"{EVALUATE} spin", "unexpected extra argument"),
    "option-without-value": (f"{EVALUATE} --seed", "--seed"),
    "no-out": ("evaluate --map hut.txt", "--out"),
    "unknown-id": (f"{EVALUATE} --env GlobalLocalisation-v0", "did you mean 'activeloc/GlobalLoc"),
    "other-version": (f"{EVALUATE} --env GlobalLocalization-v9", "unknown name"),
    "empty-id": (f"{EVALUATE} --env=", "--env"),
    "unknown-agent": (f"{EVALUATE} --agents gredy", "did you mean 'greedy'"),
    "agent-twice": (f"{EVALUATE} --agents spin,spin", "spin is given twice"),
    "empty-agent": (f"{EVALUATE} --agents spin,,greedy", "an empty name"),
    "no-agents": (f"{EVALUATE} --agents=", "an empty name"),
    "unknown-map": ("evaluate --map ofice --out out", "did you mean 'office'"),
    "empty-map": ("evaluate --map= --out out", "no generator ''"),
    "missing-map": ("evaluate --map lost.yaml --out out", "lost.yaml: cannot read"),
    "map-is-a-folder": ("evaluate --map ./folder --out out", "folder: a map file ends in"),
    "map-is-a-folder-named-so": ("evaluate --map maps.yaml --out out", "must be a regular file"),
    "map-is-empty": ("evaluate --map empty.txt --out out", "the text is empty"),
    "map-too-small": (f"evaluate --map nook.txt {FAST} --out out", "fits nowhere"),
    "map-parameter": ("evaluate --map office(room=3) --out out", "did you mean 'rooms'"),
    "map-seeds": ("evaluate --map office:3-1 --out out", "must run upwards"),
    "unknown-belief": (f"{EVALUATE} --belief histogramm", "did you mean 'histogram'"),
    "no-episodes": (f"{EVALUATE} --episodes 0", "episodes must be an integer in [1,"),
    "episodes-negative": (f"{EVALUATE} --episodes -1", "episodes must be an integer in [1,"),
    "episodes-float": (f"{EVALUATE} --episodes 1e3", "--episodes"),
    "episodes-word": (f"{EVALUATE} --episodes abc", "--episodes"),
    "episodes-huge": (f"{EVALUATE} --episodes 10000000000", "episodes must be"),
    "no-jobs": (f"{EVALUATE} --jobs 0", "jobs must be an integer in [1, 256]"),
    "jobs-huge": (f"{EVALUATE} --jobs 1000000", "jobs must be an integer in [1, 256]"),
    "jobs-word": (f"{EVALUATE} --jobs many", "--jobs"),
    "seed-negative": (f"{EVALUATE} --seed -1", "seed must be an integer in [0,"),
    "seed-word": (f"{EVALUATE} --seed abc", "--seed"),
    "seed-huge": (f"{EVALUATE} --seed {2**70}", "seed must be an integer in [0,"),
    "no-steps": (f"{EVALUATE} --steps 0", "steps must be an integer in [1,"),
    "steps-negative": (f"{EVALUATE} --steps -5", "steps must be an integer in [1,"),
    "set-nothing": (f"{EVALUATE} --set=", "expected KEY=VALUE"),
    "set-no-value": (f"{EVALUATE} --set sensor.z_max", "expected KEY=VALUE"),
    "set-empty-value": (f"{EVALUATE} --set sensor.z_max=", "expected KEY=VALUE"),
    "set-no-key": (f"{EVALUATE} --set =3", "expected KEY=VALUE"),
    "set-empty-part": (f"{EVALUATE} --set sensor..z_max=3", "expected KEY=VALUE"),
    "set-not-yaml": (f"{EVALUATE} --set sensor.z_max=[1", "is not a YAML value"),
    "set-mapping": (f"{EVALUATE} --set sensor={{z_max:1}}", "a scalar or a list"),
    "set-nested-list": (f"{EVALUATE} --set sensor.z_max=[[1]]", "a scalar or a list"),
    "set-twice": (f"{EVALUATE} --set world=discrete --set world=discrete", "is given twice"),
    "set-under-value": (f"{EVALUATE} --set sensor=beam --set sensor.beams=3", "a value already"),
    "set-map": (f"{EVALUATE} --set map=office", "use --map"),
    "set-map-part": (f"{EVALUATE} --set map.spec=office", "use --map"),
    "set-belief": (f"{EVALUATE} --set belief=particles", "use --belief"),
    "set-unknown-group": (f"{EVALUATE} --set sonsor.z_max=1", "did you mean 'sensor'"),
    "set-unknown-field": (f"{EVALUATE} --set sensor.zmax=1", "did you mean 'z_max'"),
    "set-other-beliefs-field": (f"{EVALUATE} --set belief.n_min=5", "unknown name 'n_min'"),
    "set-unknown-kind": (f"{EVALUATE} --set sensor=laser", "unknown name 'laser'"),
    "set-list-as-kind": (f"{EVALUATE} --set sensor.kind=[beam]", "unknown name ['beam']"),
    "set-word-for-number": (f"{EVALUATE} --set sensor.z_max=far", "z_max must be a number"),
    "set-nan": (f"{EVALUATE} --set sensor.z_max=nan", "z_max must be a number"),
    "set-bool-for-number": (f"{EVALUATE} --set sensor.beams=true", "beams must be an int"),
    "set-out-of-range": (f"{EVALUATE} --set sensor.z_max=-1", "z_max must be a number in"),
    "set-world": (f"{EVALUATE} --set world=flat", "world must be one of continuous, discrete"),
    "discrete-particles": (f"{EVALUATE} --belief particles --set world=discrete", "histogram"),
    "set-agent": (f"{EVALUATE} --set agent=spin", "expected agent.NAME.SETTING=VALUE"),
    "set-agent-name": (f"{EVALUATE} --set agent.spin=1", "expected agent.spin.SETTING=VALUE"),
    "set-unknown-agent": (f"{EVALUATE} --set agent.gredy.samples=9", "did you mean 'greedy'"),
    "set-absent-agent": (f"{EVALUATE} --agents spin --set agent.greedy.samples=9", "known: spin"),
    "set-agent-field": (f"{EVALUATE} --set agent.greedy.sample=9", "did you mean 'samples'"),
    "set-agent-value": (f"{EVALUATE} --set agent.greedy.samples=0", "agent greedy.samples must"),
    "set-agent-type": (f"{EVALUATE} --set agent.active.distances=3", "must be a list of numbers"),
    "greedy-continuous": (
        f"{EVALUATE} {FAST} --agents greedy --set actions=continuous",
        "needs discrete actions",
    ),
    "out-is-a-file": ("evaluate --map hut.txt --out hut.txt", "is a file"),
    "out-under-a-file": (f"evaluate --map hut.txt {FAST} --out hut.txt/out", "is no folder"),
    "out-locked": (f"evaluate --map hut.txt {FAST} --out locked", "is in use by process"),
    "out-foreign-results": (f"evaluate --map hut.txt {FAST} --out foreign", "not the episodes"),
    "out-damaged": (f"evaluate --map hut.txt {FAST} --out damaged", "line 1 is damaged"),
    "run-unknown-agent": ("run --agent spni --map hut.txt", "did you mean 'spin'"),
    "run-episode": ("run --map hut.txt --episode -1", "episode must be an integer"),
    "run-suffix": ("run --map hut.txt --out film.avi", "must end in .gif"),
    "run-no-suffix": ("run --map hut.txt --out film", "must end in .gif"),
    "run-out-folder": ("run --map hut.txt --out film.gif", "is a folder"),
    "run-out-nowhere": ("run --map hut.txt --out nowhere/f.gif", "there is no folder nowhere"),
    "map-nothing": ("map", "Missing command"),
    "map-unknown": ("map draw hut.txt", "No such command 'draw'"),
    "map-info-nothing": ("map info", "SPEC"),
    "map-info-missing": ("map info lost.txt", "lost.txt: cannot read"),
    "map-show-several": ("map show office:0-3", "names several maps"),
    "map-show-suffix": ("map show hut.txt --out hut.jpg", "must end in .png"),
    "map-make-no-out": ("map make office", "--out"),
    "map-make-suffix": ("map make office --out office.png", "must end in .yaml or .yml or .txt"),
    "map-make-on-itself": ("map make hut.txt --out hut.txt", "is there already"),
    "map-make-nowhere": ("map make hut.txt --out nowhere/a.yaml", "there is no folder nowhere"),
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a map and with traps."""
    (tmp_path / "hut.txt").write_text(HUT)
    (tmp_path / "empty.txt").write_text("")
    (tmp_path / "nook.yaml").write_text("image: nook.png\n")
    (tmp_path / "nook.txt").write_text("###\n#.#\n###\n")
    for folder in ("folder", "maps.yaml", "film.gif", "locked", "foreign", "damaged"):
        (tmp_path / folder).mkdir()
    from activeloc.agents.evaluation.lock import socket

    (tmp_path / "locked" / ".lock").write_text(f"{os.getpid()} {socket.gethostname()}\n")
    (tmp_path / "foreign" / "episodes.csv").write_text("mine\n")
    (tmp_path / "damaged" / ".episodes.jsonl").write_text("what\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def tree(folder):
    return {
        path.relative_to(folder): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


@pytest.mark.parametrize("name", COMMANDS)
def test_refused_in_one_line_and_nothing_written(place, capsys, name):
    command, message = COMMANDS[name]
    if name == "map-too-small":
        command += " --set motion.radius=0.6"
    before = tree(place)
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("activeloc: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert message in err
    assert "Traceback" not in err
    assert len(err) < 700
    assert tree(place) == before


def test_a_map_may_be_called_anything(place, capsys):
    name = "my höme (1).txt"
    (place / name).write_text(HUT)
    assert main(["map", "info", name]) == 0
    assert capsys.readouterr().out.startswith("my höme (1)\n")


def test_debug_shows_where(place):
    from activeloc.errors import ConfigError

    with pytest.raises(ConfigError):
        main(["--debug", "evaluate", "--map", "hut.txt", "--out", "out", "--agents", "x"])


def test_a_full_disk_is_one_line(place, capsys, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("activeloc.agents.evaluation.report.write_atomically", full)
    command = f"evaluate --map hut.txt {FAST} --episodes 1 --out out"
    assert main(command.split()) == 1
    assert capsys.readouterr().err == "activeloc: out/episodes.csv: No space left on device\n"
    assert sorted(path.name for path in (place / "out").iterdir()) == [".episodes.jsonl"]
