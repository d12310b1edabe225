"""The report of a sweep as a page, and the replays that it leads to."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from activeloc.agents import evaluation
from activeloc.agents.evaluation import Record, Report, Sweep, write_gallery
from activeloc.agents.evaluation.chart import chart
from activeloc.agents.evaluation.gallery import choices, replay_name
from activeloc.agents.evaluation.page import report_page
from activeloc.cli import main
from activeloc.errors import ConfigError
from activeloc.maps import MapSource

COMMAND = (
    "evaluate --map rooms(width=4,height=3,smallest=1.5):0-1 --agents spin,random --episodes 4 "
    "--seed 3 --steps 12 --set belief.cell_size=0.5 --set belief.headings=12 "
    "--set task.confidence=0.6"
)


def record(agent="spin", episode=0, area=0.5, steps=9):
    return Record(
        agent=agent, map="hut", seed=0, episode=episode, steps=steps, success=True, wrong=False,
        entropy_auc=area, final_entropy=1.0, error_m=0.1, error_rad=0.1, total_reward=0.0,
        played=9, entropy=(1.0,) * 10, start=(0.0, 0.0, 0.0), mass_at_truth=0.5, n_particles=None,
        act_ms=0.1, step_ms=0.1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder with the report of a small sweep."""
    folder = tmp_path_factory.mktemp("results")
    assert main([*COMMAND.split(), "--out", str(folder), "--report"]) == 0
    return folder


@pytest.fixture(scope="module")
def page(results):
    return (results / "report.html").read_text("utf-8")


def test_best_median_and_worst_are_chosen_by_area():
    areas = [0.5, 0.2, 0.9, 0.4, 0.1, 0.7]
    chosen = choices([record(episode=i, area=area) for i, area in enumerate(areas)])
    assert [(c.rank, c.record.episode) for c in chosen] == [
        ("best", 4),
        ("median", 3),
        ("worst", 2),
    ]


def test_of_equals_the_quicker_then_the_earlier_is_better():
    records = [record(episode=i, steps=steps) for i, steps in enumerate((9, 5, 9, 5, 7))]
    assert [c.record.episode for c in choices(records)] == [1, 4, 2]


@pytest.mark.parametrize(("n", "ranks"), [(1, ["best"]), (2, ["best", "worst"])])
def test_few_episodes_are_shown_once(n, ranks):
    assert [c.rank for c in choices([record(episode=i) for i in range(n)])] == ranks


def test_the_tables_hold_the_summary(results, page):
    scores = json.loads((results / "summary.json").read_text())["scores"]
    for agent in ("spin", "random"):
        row = re.search(f'<tr><th scope="row">{agent}</th>(.*?)</tr>', page)[1]
        cells = re.findall(r"<td>([^<]*)<small>(.*?) \.\. (.*?)</small></td>", row)
        for cell, name in ((0, "right"), (-3, "steps"), (-2, "entropy_auc"), (-1, "error_m")):
            digits = 0 if name == "steps" else 2
            expected = [
                f"{scores[agent][name][key]:.{digits}f}" for key in ("value", "low", "high")
            ]
            assert list(cells[cell]) == expected


def test_the_curves_are_those_of_the_table(results, page):
    rows = [line.split(",") for line in (results / "curves.csv").read_text().splitlines()[1:]]
    lines = re.findall(r'<polyline points="(.*?)"', page)
    assert len(lines) == 4
    for agent, line in zip(("spin", "random"), lines, strict=False):
        points = np.array([point.split(",") for point in line.split()], float)
        means = [float(row[2]) for row in rows if row[0] == agent]
        np.testing.assert_allclose((246 - points[:, 1]) / 236, means, atol=1e-3)
        np.testing.assert_allclose(points[:, 0], np.linspace(56, 462, 13), atol=0.06)


def test_a_band_goes_there_and_back():
    flat = np.array([[0.2, 0.4, 0.6]])
    points = re.search(r'<polygon points="(.*?)"', chart({"spin": flat}, "share"))[1]
    xy = np.array([point.split(",") for point in points.split()], float)
    np.testing.assert_array_equal(xy[:3], xy[:2:-1])
    np.testing.assert_allclose((246 - xy[:3, 1]) / 236, flat[0], atol=1e-3)


def test_pictures_lead_to_the_replays_of_those_episodes(results, page):
    entries = [json.loads(line) for line in (results / ".episodes.jsonl").read_text().splitlines()]
    kept = {(e["agent"], e["episode"]): e for e in entries if "agent" in e}
    links = re.findall(r'<a href="replays/((\w+)-(\d+)\.html)">', page)
    assert len(links) == 6
    for name, agent, episode in links:
        text = (results / "replays" / name).read_text("utf-8")
        (track,) = json.loads(re.search(r'id="replay">(.*?)</script>', text, re.DOTALL)[1])[
            "tracks"
        ]
        record = kept[agent, int(episode)]
        np.testing.assert_allclose(track["fraction"], record["entropy"], atol=1e-4)
        np.testing.assert_allclose(track["poses"][0], record["start"], atol=1e-3)
    assert {path.name for path in (results / "replays").iterdir()} == {name for name, *_ in links}


def test_the_page_needs_nothing_else(page):
    assert "default-src 'none'" in page
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!data:|replays/)', page)


def test_names_are_words_and_no_markup(results):
    sweep = replace(_sweep(), seed=5)
    evil = replace(record(agent="spin"), map="<b>&")
    text = report_page(Report(sweep, [evil], "cmd --agents '<script>'"), []).decode()
    assert "&#x27;&lt;script&gt;&#x27;" in text
    assert "<script" not in text


def test_replays_of_other_agents_have_other_names():
    names = {replay_name(record(agent=agent)) for agent in ("onnx:a.b", "onnx:a-b", "onnx-a-b")}
    assert len(names) == 3
    assert all(re.fullmatch(r"[\w-]+\.html", name) for name in names)
    assert replay_name(record(episode=7)) == "spin-7.html"


def _sweep():
    settings = {"belief": {"kind": "histogram", "cell_size": 0.5, "headings": 12}}
    source = MapSource.parse("rooms(width=4,height=3,smallest=1.5):0")
    name = "activeloc/GlobalLocalization-v0"
    return Sweep(name, source, {"spin": {}}, settings, episodes=1, limit=3)


def test_an_episode_that_comes_out_otherwise_is_remarked_upon(tmp_path):
    report = evaluation.evaluate(_sweep(), tmp_path)
    write_gallery(report, tmp_path)
    assert not [remark for remark in report.remarks if "otherwise" in remark]
    changed = replace(report.records[0], entropy=(0.5,))
    other = Report(report.sweep, [changed])
    write_gallery(other, tmp_path)
    assert "episode 0 of spin came out otherwise" in other.remarks[0]


def test_a_folder_that_is_being_written_is_left_alone(tmp_path):
    import os
    import socket

    report = Report(_sweep(), [record()])
    (tmp_path / ".lock").write_text(f"{os.getpid()} {socket.gethostname()}\n")
    with pytest.raises(ConfigError, match="is in use"):
        write_gallery(report, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_a_new_run_throws_the_old_pages_away(tmp_path, capsys):
    folder = tmp_path / "out"
    (folder / "replays").mkdir(parents=True)
    for name in ("report.html", "replays/spin-3.html", "replays/notes.txt"):
        (folder / name).write_text("old")
    command = [*COMMAND.replace("--episodes 4", "--episodes 1").split(), "--out", str(folder)]
    assert main(command) == 2
    assert "report.html" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0
    assert not (folder / "report.html").exists()
    assert [path.name for path in (folder / "replays").iterdir()] == ["notes.txt"]


def test_in_a_browser_a_picture_leads_to_its_replay(chromium, axe_script, results):
    page, complaints = chromium.new_page(viewport={"width": 360, "height": 640}), []
    page.on("console", lambda said: said.type != "error" or complaints.append(said.text))
    page.goto((results / "report.html").as_uri())
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 360
    page.locator("summary").first.click()
    page.evaluate(axe_script)
    found = page.evaluate("axe.run()")
    assert len(found["passes"]) > 30
    assert [(rule["id"], rule["nodes"][0]["html"]) for rule in found["violations"]] == []
    link = page.get_by_role("link").first
    episode = re.search(r"episode (\d+)", link.text_content())[1]
    link.click()
    page.locator("html[data-ready]").wait_for()
    assert f"episode {episode}, best" in page.locator("header p").text_content()
    assert complaints == []
    page.close()
