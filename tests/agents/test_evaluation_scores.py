"""Scores against arithmetic by hand, intervals against closed forms."""

import dataclasses
import json
from math import isnan, sqrt

import numpy as np
import pytest

from activeloc.agents.evaluation import Record, penalised_area
from activeloc.agents.evaluation.records import RecordFile, read_records
from activeloc.agents.evaluation.report import diagnostics
from activeloc.agents.evaluation.statistics import columns_of, differences, estimates
from activeloc.errors import ConfigError

RECORD = Record(
    agent="spin",
    map="hut",
    seed=3,
    episode=0,
    steps=5,
    success=False,
    wrong=False,
    entropy_auc=0.5,
    final_entropy=1.0,
    error_m=2.0,
    error_rad=0.1,
    total_reward=0.25,
    played=5,
    entropy=(0.9, 0.8, 0.7, 0.6, 0.5, 0.4),
    start=(1.0, 2.0, 3.0),
    mass_at_truth=0.5,
    n_particles=None,
    act_ms=0.1,
    step_ms=0.2,
)


def record(**changes):
    return dataclasses.replace(RECORD, **changes)


@pytest.mark.parametrize(
    ("entropy", "wrong", "area"),
    [
        pytest.param((0.9, 0.8, 0.6, 0.1), False, (0.8 + 0.6 + 0.1) / 5, id="right-at-3"),
        pytest.param((0.9, 0.8, 0.6, 0.1), True, (0.8 + 0.6 + 0.1 + 1 + 1) / 5, id="wrong-at-3"),
        pytest.param((0.9, 0.8, 0.7, 0.6, 0.5, 0.4), False, 3.0 / 5, id="timeout"),
        pytest.param((0.9, 1.2, -0.1, 0.6, 0.5, 0.4), False, 2.5 / 5, id="cut-to-unit-interval"),
        pytest.param((0.9, 0.0), False, 0.0, id="best"),
        pytest.param((0.9, 1.0), True, 1.0, id="worst"),
    ],
)
def test_area_counts_nothing_after_right_and_all_after_wrong(entropy, wrong, area):
    assert penalised_area(entropy, wrong, 5) == pytest.approx(area, abs=1e-15)
    curve = record(entropy=entropy, wrong=wrong).curve(5)
    assert len(curve) == 6
    assert np.mean(curve[1:]) == pytest.approx(area, abs=1e-15)


def test_scores_are_the_plain_statistics():
    records = [
        record(episode=0, success=True, steps=2, error_m=0.1, entropy_auc=0.1),
        record(episode=1, wrong=True, error_m=3.0, entropy_auc=0.9),
        record(episode=2, error_m=7.0, entropy_auc=0.5),
        record(episode=3, success=True, steps=4, error_m=0.3, entropy_auc=0.3),
    ]
    scores = {name: estimate.value for name, estimate in estimates(columns_of(records)).items()}
    assert scores == pytest.approx(
        {
            "right": 0.5,
            "wrong": 0.25,
            "wrong_of_declared": 1 / 3,
            "steps": (2 + 5 + 5 + 4) / 4,
            "entropy_auc": 0.45,
            "error_m": (0.3 + 3.0) / 2,
            "error_rad": 0.1,
        }
    )


def test_a_truth_is_lost_below_a_thousandth_and_gone_at_nothing():
    records = [record(mass_at_truth=mass) for mass in (0.5, 1e-3, 9e-4, 0.0)]
    assert [r.truth_lost for r in records] == [False, False, True, True]
    found = diagnostics(records)
    assert (found["truth_lost"], found["truth_gone"], found["n_particles"]) == (0.5, 0.25, None)


def test_no_declaration_no_share_of_wrong_ones():
    estimate = estimates(columns_of([record(episode=i) for i in range(4)]))["wrong_of_declared"]
    assert isnan(estimate.value)
    assert isnan(estimate.low)


def test_interval_of_a_mean_is_the_normal_one_on_a_big_sample():
    rng = np.random.default_rng(1)
    n = 2000
    areas, right = rng.beta(2.0, 5.0, n), rng.random(n) < 0.3
    records = [
        record(episode=i, entropy_auc=float(areas[i]), success=bool(right[i])) for i in range(n)
    ]
    scores = estimates(columns_of(records))
    # The interval's ends are percentiles of 4000 draws: their own error is 5 % of a half-width.
    for name, values in (("entropy_auc", areas), ("right", right)):
        half = 1.959964 * values.std() / sqrt(n)
        assert scores[name].low == pytest.approx(values.mean() - half, abs=0.08 * half)
        assert scores[name].high == pytest.approx(values.mean() + half, abs=0.08 * half)


def test_a_paired_difference_has_the_interval_of_the_differences():
    rng = np.random.default_rng(2)
    n = 1000
    shared = rng.normal(0.5, 0.1, n)
    gap = rng.normal(0.05, 0.01, n)
    base = columns_of([record(episode=i, entropy_auc=float(shared[i])) for i in range(n)])
    better = columns_of(
        [record(episode=i, entropy_auc=float(shared[i] - gap[i])) for i in range(n)]
    )
    difference = differences(better, base)["entropy_auc"]
    half = 1.959964 * gap.std() / sqrt(n)
    assert difference.value == pytest.approx(-gap.mean())
    assert difference.low == pytest.approx(-gap.mean() - half, abs=0.1 * half)
    assert difference.high == pytest.approx(-gap.mean() + half, abs=0.1 * half)
    same = differences(base, base)["entropy_auc"]
    assert (same.value, same.low, same.high) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("n", [4, 16, 300])
def test_none_in_n_is_not_never(n):
    scores = estimates(columns_of([record(episode=i, success=True) for i in range(n)]))
    reach = 1.0 - 0.025 ** (1.0 / n)
    assert (scores["wrong"].low, scores["wrong"].value) == (0.0, 0.0)
    assert scores["wrong"].high == pytest.approx(reach)
    assert scores["right"].low == pytest.approx(1.0 - reach)
    assert (scores["right"].value, scores["right"].high) == (1.0, 1.0)


def test_the_order_of_records_changes_no_interval():
    records = [record(episode=i, error_m=float(i % 7), success=i == 3) for i in range(30)]
    assert estimates(columns_of(records)) == estimates(columns_of(records[::-1]))


def test_a_record_comes_back_to_the_bit(tmp_path):
    odd = record(entropy=(0.1 + 0.2, 1 / 3), start=(1e-300, -0.0, 3.0), n_particles=1 / 7)
    file = RecordFile(tmp_path / "r.jsonl", {"seed": 3})
    file.append(odd)
    file.close()
    assert read_records(tmp_path / "r.jsonl").records == [odd]


def test_a_torn_last_line_is_forgotten_and_written_over(tmp_path):
    path = tmp_path / "r.jsonl"
    file = RecordFile(path, {"seed": 3})
    file.append(record(episode=0))
    file.append(record(episode=1))
    file.close()
    whole = path.read_bytes()
    ends = [i + 1 for i, byte in enumerate(whole) if byte == ord("\n")]
    for cut in [*range(0, len(whole), 97), len(whole) - 1, *ends]:
        path.write_bytes(whole[:cut])
        file = RecordFile(path, {"seed": 3})
        kept = len(file.records)
        assert kept == max(0, sum(end <= cut for end in ends) - 1)
        for episode in range(kept, 2):
            file.append(record(episode=episode))
        file.close()
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "line", [b"{}", b"[]", b"null", b"\xff\xfe", b'{"agent": "spin"}', b"{", b"1e999"]
)
def test_damage_before_the_last_line_is_refused(tmp_path, line):
    path = tmp_path / "r.jsonl"
    header = json.dumps({"configuration": {"seed": 3}}).encode()
    path.write_bytes(header + b"\n" + line + b"\n" + header + b"\n")
    with pytest.raises(ConfigError, match="line 2 is damaged; start with --overwrite"):
        read_records(path)


def test_the_setting_that_differs_is_named(tmp_path):
    path = tmp_path / "r.jsonl"
    old = {"settings": {"sensor": {"z_max": 1.5}}, "agents": {"spin": {"clearance": 0.45}}}
    RecordFile(path, old).close()
    new = {**old, "settings": {"sensor": {"z_max": 1.0}}}
    with pytest.raises(ConfigError, match=r"settings\.sensor\.z_max was 1\.5 and is now 1\.0"):
        RecordFile(path, new)


def test_agents_may_join_but_not_change(tmp_path):
    path = tmp_path / "r.jsonl"
    for agents in ({"spin": {"clearance": 0.45}}, {"greedy": {"samples": 8}}):
        RecordFile(path, {"seed": 1, "agents": agents}).close()
    both = {"spin": {"clearance": 0.45}, "greedy": {"samples": 8}}
    RecordFile(path, {"seed": 1, "agents": both}).close()
    with pytest.raises(ConfigError, match=r"agents\.greedy\.samples was 8 and is now 9"):
        RecordFile(path, {"seed": 1, "agents": {"greedy": {"samples": 9}}})
