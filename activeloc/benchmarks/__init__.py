"""What the parts cost, beside what others take for the same: ``activeloc bench``.

A *subject* is a module of :mod:`activeloc.benchmarks.subjects`; it yields rows (a cost, a
yardstick, a target) and curves (cost against size). Yardsticks are code of other projects, or the
plain way to do it; ours and theirs are timed in turns (:mod:`activeloc.benchmarks.clock`), so that
whatever else the machine does falls on both.

===============  ===================================================================================
subject          what is measured
===============  ===================================================================================
rays             exact rays, and how many of them are wrong
ranges           look-ups in the table of ranges
histogram        predict and correct on an open map, dense; a whole step, dense and localized
likelihood       the likelihood of a scan over a grid
particles        a whole update; resampling
field            the likelihood field
environments     steps a second: mazes and the metric task, by number of environments and threads
views            the egocentric view
maps             the tables of a map that is new
planners         decisions a second over whole episodes
training         share of the wall time that is torch's
startup          the command's help; a first step in a new process
memory           growth while stepping; bytes of tables
machine          bandwidth and arithmetic: what no code on this machine can beat
===============  ===================================================================================
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module

from activeloc.benchmarks.report import Absent, Curve, Row
from activeloc.benchmarks.settings import Settings, maps_from_environment
from activeloc.configuration import unknown

SUBJECTS = (
    "machine",
    "rays",
    "ranges",
    "histogram",
    "likelihood",
    "particles",
    "field",
    "environments",
    "views",
    "maps",
    "planners",
    "training",
    "startup",
    "memory",
)

__all__ = [
    "SUBJECTS",
    "Absent",
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


def measure(subject: str, settings: Settings) -> Iterator[Row | Curve | Absent]:
    """Rows and curves of a subject, each as soon as it is known, and what could not be measured."""
    module = import_module(f"activeloc.benchmarks.subjects.{subject}")
    yield from module.measure(settings)
