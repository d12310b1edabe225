"""Rows and curves, and the file they are kept in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Spread:
    """Repeated measurements.

    Attributes:
        median: Of them.
        low: 10 % are lower.
        high: 10 % are higher.
        n: How many there are.
    """

    median: float
    low: float
    high: float
    n: int

    @classmethod
    def of(cls, values: NDArray[np.float64] | Sequence[float] | float) -> Spread:
        """Of ``(n,)`` values, or of one."""
        given = np.atleast_1d(np.asarray(values, dtype=np.float64))
        low, median, high = (float(x) for x in np.quantile(given, (0.1, 0.5, 0.9)))
        return cls(median, low, high, len(given))


@dataclass(frozen=True, slots=True)
class Target:
    """What a row is aimed at.

    Attributes:
        of: The row's ``value``, or its ``ratio`` to the yardstick.
        at: ``most`` or ``least``.
        limit: How much.
    """

    of: Literal["value", "ratio"]
    at: Literal["most", "least"]
    limit: float

    def is_met(self, value: float) -> bool:
        """Whether a value keeps to the limit."""
        return value <= self.limit if self.at == "most" else value >= self.limit


def at_most(limit: float) -> Target:
    """A value to stay under."""
    return Target("value", "most", limit)


def at_least(limit: float) -> Target:
    """A value to reach."""
    return Target("value", "least", limit)


def ratio_at_most(limit: float) -> Target:
    """Ours over theirs, to stay under."""
    return Target("ratio", "most", limit)


def ratio_at_least(limit: float) -> Target:
    """Ours over theirs, to reach."""
    return Target("ratio", "least", limit)


@dataclass(frozen=True, slots=True)
class Row:
    """One thing that was measured.

    Attributes:
        subject: What it belongs to.
        name: What it is.
        unit: Of the values.
        ours: Measured.
        yardstick: What it is held against; empty if nothing.
        theirs: Measured; None if there is no yardstick, or it is not installed.
        ratio: Median over the rounds of ours over theirs.
        target: What it is aimed at, if anything.
        note: What else there is to know.
    """

    subject: str
    name: str
    unit: str
    ours: Spread
    yardstick: str = ""
    theirs: Spread | None = None
    ratio: float | None = None
    target: Target | None = None
    note: str = ""

    @classmethod
    def of(
        cls,
        subject: str,
        name: str,
        unit: str,
        ours: NDArray[np.float64] | Sequence[float] | float,
        yardstick: str = "",
        theirs: NDArray[np.float64] | Sequence[float] | float | None = None,
        target: Target | None = None,
        note: str = "",
    ) -> Row:
        """From measurements ``(n,)``, those of one round at the same place in both."""
        if theirs is None:
            return cls(subject, name, unit, Spread.of(ours), yardstick, None, None, target, note)
        ratio = float(np.median(np.atleast_1d(ours) / np.atleast_1d(theirs)))
        both = Spread.of(ours), Spread.of(theirs)
        return cls(subject, name, unit, both[0], yardstick, both[1], ratio, target, note)

    @property
    def is_met(self) -> bool | None:
        """Whether the target is met; None if there is none, or nothing to hold it against."""
        if self.target is None:
            return None
        value = self.ours.median if self.target.of == "value" else self.ratio
        return None if value is None else self.target.is_met(value)


@dataclass(frozen=True, slots=True)
class Curve:
    """Cost against size.

    Attributes:
        plot: Name of the figure it is in.
        x_label: What the size is.
        y_label: What the cost is, with its unit.
        label: Which of the figure's curves.
        x: ``(n,)``.
        y: ``(n,)``.
        kind: ``ours``, a ``yardstick``, or the ``floor`` that no code can go under.
    """

    plot: str
    x_label: str
    y_label: str
    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["ours", "yardstick", "floor"] = "ours"


@dataclass(frozen=True, slots=True)
class Absent:
    """What was not measured.

    Attributes:
        subject: What it belongs to.
        name: What it is.
        reason: Why not.
    """

    subject: str
    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Report:
    """A run of the benchmarks.

    Attributes:
        machine: What it ran on, by name.
        settings: How it was run, by name.
        rows: In the order they were measured.
        curves: Likewise.
        absent: What could not be measured here.
        seconds: Of each subject.
    """

    machine: dict[str, Any]
    settings: dict[str, Any]
    rows: list[Row] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    absent: list[Absent] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """As it is written to ``bench.json``."""
        return {
            "schema": SCHEMA,
            "machine": self.machine,
            "settings": self.settings,
            "rows": [{**asdict(row), "is_met": row.is_met} for row in self.rows],
            "curves": [asdict(curve) for curve in self.curves],
            "absent": [asdict(what) for what in self.absent],
            "seconds": self.seconds,
        }

    def to_json(self) -> bytes:
        """The file's content."""
        return (json.dumps(self.plain(), indent=1, allow_nan=False) + "\n").encode()
