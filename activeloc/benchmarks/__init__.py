"""What the parts cost, beside what others take for the same: ``activeloc bench``.

A *subject* is a module of :mod:`activeloc.benchmarks.subjects`; it yields rows (a cost, a
yardstick, a target) and curves (cost against size). Yardsticks are code of other projects, or the
plain way to do it; ours and theirs are timed in turns (:mod:`activeloc.benchmarks.clock`), so that
whatever else the machine does falls on both.

===============  ===================================================================================
subject          what is measured
===============  ===================================================================================
rays             exact rays, and how many of them are wrong
histogram        predict and correct on an open map, dense; a whole step, dense and localized
particles        a whole update; resampling
===============  ===================================================================================
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module

from activeloc.benchmarks.report import Curve, Row
from activeloc.benchmarks.settings import Settings, maps_from_environment
from activeloc.configuration import unknown

SUBJECTS = ("rays", "histogram", "particles")

__all__ = [
    "SUBJECTS",
    "Curve",
    "Row",
    "Settings",
    "check_subjects",
    "maps_from_environment",
    "measure",
]


def check_subjects(names: Sequence[str]) -> tuple[str, ...]:
    """The subjects that are asked for, in the table's order; all of them if none is named.

    Raises:
        ConfigError: If one is unknown.
    """
    for name in names:
        if name not in SUBJECTS:
            raise unknown("subject", name, SUBJECTS)
    return tuple(name for name in SUBJECTS if not names or name in names)


def measure(subject: str, settings: Settings) -> Iterator[Row | Curve]:
    """Rows and curves of a subject, each as soon as it is known."""
    module = import_module(f"activeloc.benchmarks.subjects.{subject}")
    yield from module.measure(settings)
