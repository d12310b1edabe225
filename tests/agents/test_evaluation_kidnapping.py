"""What is reported of a kidnapped robot, against arithmetic by hand."""

import csv
import json
from dataclasses import replace
from math import isnan

import pytest
from scipy.stats import beta

from activeloc.agents.evaluation import Player, Record, Sweep, evaluate
from activeloc.agents.evaluation.records import FILE_NAME, read_records
from activeloc.agents.evaluation.statistics import KIDNAP_SCORES, columns_of, estimates
from activeloc.cli.settings import make_sweep
from activeloc.cli.tables import kidnap_table
from activeloc.errors import ConfigError
from activeloc.maps import MapSource, from_text

HUT = from_text(
    """
##########
#...#....#
#........#
###.##...#
##########
""",
    name="hut",
)
COARSE = {"kind": "histogram", "cell_size": 0.5, "headings": 12}
RECORD = Record(agent="spin", map="hut", seed=3, episode=0, steps=5, success=False, wrong=False,
                entropy_auc=0.5, final_entropy=1.0, error_m=2.0, error_rad=0.1, total_reward=0.0,
                played=5, entropy=(1.0, 0.5), start=(1.0, 2.0, 3.0), mass_at_truth=0.5,
                n_particles=None, act_ms=1.0, step_ms=1.0)  # fmt: skip
KIDNAPPED = "activeloc/KidnappedRobot-v0"
NAMES = ["kidnapped", "notice_steps", "recover_steps", "false_alarm"]


def carried(episode, notice, recover, alarm=False):
    return replace(RECORD, episode=episode, kidnapped=True, notice_steps=notice,
                   recover_steps=recover, false_alarm=alarm)  # fmt: skip


def left_alone(episode, alarm=False):
    return replace(RECORD, episode=episode, false_alarm=alarm)


def values(records):
    scores = estimates(columns_of(records), KIDNAP_SCORES)
    return {name: estimate.value for name, estimate in scores.items()}


def test_scores_by_hand():
    records = [carried(0, 0, 20), carried(1, 3, -1), carried(2, -1, -1), carried(3, 6, 31, True),
               left_alone(4), left_alone(5, True)]  # fmt: skip
    assert values(records) == pytest.approx(
        {
            "noticed": 3 / 4,
            "recovered": 2 / 4,
            "notice_steps": (0 + 3 + 6) / 3,
            "recover_steps": (20 + 31) / 2,
            "false_alarm": 2 / 6,
        }
    )


def test_where_nobody_is_carried_off_there_are_only_false_alarms():
    scores = values([left_alone(i, i == 2) for i in range(8)])
    assert scores.pop("false_alarm") == 1 / 8
    assert all(isnan(value) for value in scores.values())


@pytest.mark.parametrize("n", [5, 200])
def test_none_in_n_is_not_never(n):
    """The exact interval, over the episodes that the share is of."""
    records = [carried(i, 1, 9) for i in range(n)] + [left_alone(n + i) for i in range(n)]
    scores = estimates(columns_of(records), KIDNAP_SCORES)
    for name, among in (("recovered", n), ("noticed", n)):
        assert scores[name].low == pytest.approx(beta.ppf(0.025, among, 1))
        assert scores[name].high == 1.0
    assert scores["false_alarm"].high == pytest.approx(beta.ppf(0.975, 1, 2 * n))
    assert (scores["recover_steps"].low, scores["recover_steps"].high) == (9.0, 9.0)


def test_a_time_s_interval_is_over_the_episodes_that_have_it():
    records = [carried(i, 1, 10 * (i % 2) + 10 if i < 60 else -1) for i in range(120)]
    estimate = estimates(columns_of(records), KIDNAP_SCORES)["recover_steps"]
    half = 1.96 * 5.0 / 60**0.5
    assert estimate.value == 15.0
    assert estimate.high - estimate.low == pytest.approx(2 * half, rel=0.15)


def sweep(kidnap, **changes):
    task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_first": 2, "kidnap_last": 3}
    task |= changes.pop("task", {})
    given = {"env": KIDNAPPED, "agents": {"spin": {}}, "episodes": 3, "seed": 1, "limit": 25}
    return Sweep(settings={"belief": COARSE, "task": task}, map=MapSource.parse(HUT),
                 **{**given, **changes})  # fmt: skip


@pytest.mark.parametrize("kidnap", ["range", "never"])
def test_records_say_what_the_episode_s_end_did(kidnap):
    player = Player(sweep(kidnap))
    last = {}
    played = player.play("spin", 1, watch=lambda env, step, info: last.update(info))
    assert {name: getattr(played, name) for name in NAMES} == {name: last[name] for name in NAMES}
    assert played.kidnapped == (kidnap == "range")


def test_files_of_a_kidnapped_robot_say_more(tmp_path):
    """And the CSV, the summary and the table say the same."""
    report = evaluate(sweep("range"), tmp_path)
    with (tmp_path / "episodes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]][-4:] == NAMES
    records = read_records(tmp_path / FILE_NAME).records
    for row, kept in zip(rows, records, strict=True):
        assert [int(row[name]) for name in NAMES] == [int(getattr(kept, name)) for name in NAMES]
    said = json.loads((tmp_path / "summary.json").read_text())["kidnapping"]["spin"]
    assert said.keys() == KIDNAP_SCORES.keys()
    assert said["noticed"]["value"] == report.kidnap_scores["spin"]["noticed"].value
    assert len(kidnap_table(report).columns) == 1 + len(KIDNAP_SCORES)


def test_another_task_s_files_do_not(tmp_path):
    env = "activeloc/GlobalLocalization-v0"
    report = evaluate(sweep("range", env=env, task={"kind": "global"}), tmp_path)
    assert "kidnapped" not in (tmp_path / "episodes.csv").read_text()
    assert "kidnapping" not in json.loads((tmp_path / "summary.json").read_text())
    assert report.kidnap_scores == {}


def test_a_robot_that_is_left_alone_plays_to_the_limit():
    played = Player(sweep("never")).play("spin", 0)
    assert (played.played, played.steps) == (25, 25)
    assert played.recover_steps == played.notice_steps == -1


def test_episodes_of_an_older_version_are_refused_by_the_setting_they_lack(tmp_path):
    """Their lines can be read; their configuration says that they are not ours."""
    evaluate(sweep("range"), tmp_path)
    path = tmp_path / FILE_NAME
    old = []
    for line in path.read_text().splitlines():
        entry = json.loads(line)
        for name in (*NAMES, "gains"):
            entry.pop(name, None)
        if "configuration" in entry:
            del entry["configuration"]["settings"]["task"]["kidnap"]
        old.append(json.dumps(entry) + "\n")
    path.write_text("".join(old))
    kept = read_records(path).records[0]
    assert kept == replace(kept, kidnapped=False, notice_steps=-1, gains=())
    with pytest.raises(ConfigError, match=r"task\.kidnap was None and is now 'range'"):
        evaluate(sweep("range"), tmp_path)


@pytest.mark.parametrize("kidnap", ["never", "range", "rate"])
def test_when_it_happens_is_said_on_the_command_line(kidnap):
    settings = [f"task.kidnap={kidnap}", "task.kidnap_distance=2", "motion.blunder=0.05"]
    config = make_sweep("KidnappedRobot-v0", "maze", "histogram", ["spin"], settings, 0, 9).config()
    assert (config.task.kind, config.task.kidnap) == ("kidnapped", kidnap)
    assert (config.task.kidnap_distance, config.motion.blunder) == (2, 0.05)


def test_the_record_of_another_task_has_nothing_of_it():
    assert [getattr(RECORD, name) for name in NAMES] == [False, -1, -1, False]
