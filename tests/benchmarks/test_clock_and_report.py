"""Timing in turns, and what a row makes of it."""

import json

import numpy as np
import pytest

from activeloc.benchmarks.clock import Prepared, alternate
from activeloc.benchmarks.markdown import number, to_markdown
from activeloc.benchmarks.report import (
    Curve,
    Report,
    Row,
    Spread,
    at_least,
    at_most,
    ratio_at_least,
    ratio_at_most,
)


class Ticks:
    """A clock that only the calls move on."""

    def __init__(self):
        self.now, self.done = 0.0, []

    def __call__(self):
        return self.now

    def call(self, name, seconds):
        def spend():
            self.done.append(name)
            self.now += seconds

        return spend


def test_calls_take_turns():
    clock = Ticks()
    calls = {"a": clock.call("a", 1.0), "b": clock.call("b", 2.0)}
    seconds = alternate(calls, budget=12.0, rounds=(1, 9), clock=clock)
    assert clock.done == ["a", "a", "b", "b"] + ["a", "b"] * 3
    assert seconds["a"].tolist() == [1.0] * 4
    assert seconds["b"].tolist() == [2.0] * 4


def test_short_calls_are_repeated_and_divided():
    clock = Ticks()
    seconds = alternate({"a": clock.call("a", 1e-4)}, budget=0.0, rounds=(2, 2), clock=clock)
    assert len(clock.done) == 2 + 2 * 20
    assert seconds["a"] == pytest.approx([1e-4, 1e-4])


def test_what_is_prepared_is_not_timed():
    clock = Ticks()
    call = Prepared(clock.call("prepare", 50.0), clock.call("call", 1.0))
    seconds = alternate({"a": call}, budget=3.0, rounds=(1, 5), clock=clock)
    assert seconds["a"].tolist() == [1.0] * 3
    assert clock.done == ["prepare", "call"] * 4


def test_a_spread_is_the_middle_and_the_tenths():
    assert Spread.of(np.arange(11.0)) == Spread(5.0, 1.0, 9.0, 11)


def test_a_ratio_is_taken_round_by_round():
    # The machine slows down: medians would say 2.5 / 4.
    row = Row.of("rays", "a", "ns", np.array([1.0, 2.0, 8.0]), "b", np.array([2.0, 4.0, 16.0]))
    assert row.ratio == 0.5


@pytest.mark.parametrize(
    ("target", "met"),
    [
        (at_most(2.0), True),
        (at_most(1.9), False),
        (at_least(2.0), True),
        (at_least(2.1), False),
        (ratio_at_most(0.5), True),
        (ratio_at_most(0.4), False),
        (ratio_at_least(0.5), True),
        (ratio_at_least(0.6), False),
        (None, None),
    ],
)
def test_targets(target, met):
    assert Row.of("s", "n", "ns", 2.0, "b", 4.0, target).is_met is met


def test_without_a_yardstick_a_ratio_is_neither_met_nor_missed():
    assert (
        Row.of("s", "n", "ns", 2.0, "amcl (not installed)", None, ratio_at_most(1)).is_met is None
    )
    assert Row.of("s", "n", "ns", 2.0, target=at_most(1.0)).is_met is False


def report():
    machine = {
        "processor": "P", "processors": 2, "system": "Linux", "python": "3.11",
        "versions": {"numpy": "2"}, "load_average": 0.5,
    }  # fmt: skip
    rows = [
        Row.of("rays", "a", "ns", [1.0, 2.0, 3.0], "plain", [2.0, 4.0, 6.0], ratio_at_most(0.75)),
        Row.of("rays", "b", "rays/s", 123456.0, note="said once"),
    ]
    curves = [Curve("rays", "x", "y", "ours", (1, 10), (2.0, 3.0))]
    return Report(machine, {"quick": True}, rows, curves, [], {"rays": 1.0})


def test_the_file_says_everything():
    plain = json.loads(report().to_json())
    assert set(plain) == {"schema", "machine", "settings", "rows", "curves", "absent", "seconds"}
    first, second = plain["rows"]
    assert first["ours"] == {"median": 2.0, "low": 1.2, "high": 2.8, "n": 3}
    assert (first["ratio"], first["is_met"]) == (0.5, True)
    assert first["target"] == {"of": "ratio", "at": "most", "limit": 0.75}
    assert (second["theirs"], second["target"], second["is_met"]) == (None, None, None)


def test_numbers_that_are_none_are_not_written():
    broken = Report({}, {}, [Row.of("s", "n", "ns", float("nan"))])
    with pytest.raises(ValueError, match="not JSON compliant"):
        broken.to_json()


def test_the_page_has_a_table_a_subject():
    page = to_markdown(report(), "activeloc bench").splitlines()
    assert "| a [ns] | 2 | 1.2 ... 2.8 | plain | 4 | 0.50 x | <= 0.75 x | yes |" in page
    assert "| b [rays/s] | 123,456 |  |  |  |  |  |  |" in page
    assert "b: said once." in page
    assert "`activeloc bench`: 1 of 1 targets met." in page


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.01234, "0.0123"), (12.34, "12.3"), (999.9, "1e+03"), (1234.5, "1,234")],
)
def test_numbers_have_three_figures(value, text):
    assert number(value) == text
