"""The examples, run as they are but for their sizes."""

import importlib.util
from pathlib import Path

import pytest

from activeloc.agents import AGENTS

EXAMPLES = Path(__file__).parents[1] / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))
HUT = "rooms(width=6,height=5):0"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def agents():
    """The table of agents, as it was afterwards: some examples enter one of their own."""
    before = dict(AGENTS)
    yield
    AGENTS.clear()
    AGENTS.update(before)


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_is_short_and_says_what_it_prints(name):
    text = (EXAMPLES / f"{name}.py").read_text("utf-8")
    assert text.count("\n") < 60
    header = text.split('"""')[1]
    assert f"``python examples/{name}.py" in header
    assert "Printed " in header


def test_make_and_step(capsys):
    info = example("make_and_step").main(map=HUT, steps=11)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[-4:]] == [
        "step   0", "step   5", "step  10", "after 11 steps",
    ]  # fmt: skip
    assert f"{info['error_m']:.2f}" != "nan"


def test_greedy_writes_a_map_where_none_is_given(place, capsys):
    example("greedy_on_your_map").main(steps=8)
    assert {path.name for path in place.iterdir()} == {"home.yaml", "home.pgm"}
    out = capsys.readouterr().out
    assert out.startswith("home.yaml: 8.0 x 6.0 m\n")
    assert out.count("  entropy ") == 8
    assert "; the estimate is " in out


def test_greedy_takes_a_map(place, capsys):
    own = example("greedy_on_your_map")
    own.main(own.small_home(place / "mine.yaml"), steps=2)
    assert capsys.readouterr().out.startswith(f"{place / 'mine.yaml'}: 8.0 x 6.0 m\n")


def test_ppo_learns(capsys):
    before, after = example("train_ppo").main(steps=6_000, mazes=100)
    assert after > before + 0.1
    assert "after 6144 steps: right in " in capsys.readouterr().out


def test_own_agent_plays_the_same_episodes_as_spin(place, capsys):
    report = example("evaluate_your_agent").main(place / "results", episodes=2, steps=5)
    spin, own = report.scores["spin"], report.scores["bouncer"]
    assert spin["steps"].value == own["steps"].value == 5
    starts = {(record.episode, record.start) for record in report.records}
    assert len(starts) == 2 < len(report.records)
    assert (place / "results" / "summary.json").exists()
    assert "less spin  entropy_auc " in capsys.readouterr().out


def test_a_log_is_written_and_filtered(place, capsys):
    verdict = example("filter_a_log").main(scans=60)
    assert verdict.right
    assert verdict.median_m < 0.2
    assert (place / "run.log").read_text().count("FLASER 61 ") == 60
    assert "right: True; median error 0.0" in capsys.readouterr().out


def test_own_sensor_is_what_the_filter_assumes(capsys):
    record = example("own_sensor").main(map=HUT, seed=1)
    assert record.success
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[:3]]
    for read, assumed in ((float(row[4]), float(row[-1])) for row in rows):
        assert read == pytest.approx(assumed, abs=0.02)
    assert {row[0] for row in rows} == {"2.00", "0.86", "0.07"}
