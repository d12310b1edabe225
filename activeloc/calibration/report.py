"""What an experiment's replicates say, as numbers and as plain data."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from importlib import metadata
from math import isfinite
from typing import Any

import numpy as np

import activeloc
from activeloc.calibration.experiment import Experiment, Outcome
from activeloc.calibration.posterior import QUANTITIES
from activeloc.calibration.scores import (
    LEAST_P,
    LEVELS,
    THRESHOLDS,
    Nees,
    Share,
    Uniformity,
    coverage,
    declarations,
    nees,
    uniformity,
)

_PACKAGES = ("numba", "numpy", "scipy")


class Report:
    """Scores of an experiment.

    Args:
        experiment: What was replicated.
        outcomes: By start, the replicates' outcomes with a leading axis of replicates.
        seconds: That they took, added up over processes.
    """

    def __init__(
        self,
        experiment: Experiment,
        outcomes: Mapping[str, Outcome],
        seconds: float,
    ) -> None:
        self.experiment = experiment
        self.outcomes = outcomes
        self.seconds = seconds

    @property
    def replicates(self) -> int:
        """How many started anywhere."""
        return len(self.outcomes["global"].ranks)

    @property
    def tracks(self) -> int:
        """How many started where the filter nearly knew."""
        return len(self.outcomes["tracking"].ranks) if "tracking" in self.outcomes else 0

    @property
    def ms_per_replicate(self) -> float:
        """Time of one process for one replicate [ms]."""
        return 1e3 * self.seconds / (self.replicates + self.tracks)

    @property
    def impossible(self) -> int:
        """Scans that no hypothesis explained."""
        return sum(outcome.impossible for outcome in self.outcomes.values())

    @cached_property
    def ranks(self) -> dict[str, Uniformity]:
        """By quantity."""
        ranks = self.outcomes["global"].ranks
        return {name: uniformity(ranks[:, i]) for i, name in enumerate(QUANTITIES)}

    @cached_property
    def coverage(self) -> dict[float, Share]:
        """By level of the credible set."""
        ranks = self.outcomes["global"].ranks[:, QUANTITIES.index("posterior")]
        return dict(zip(LEVELS, coverage(ranks), strict=True))

    @cached_property
    def declarations(self) -> dict[float, Share]:
        """Share wrong, by threshold."""
        outcome = self.outcomes["global"]
        return dict(zip(THRESHOLDS, declarations(outcome.mass, outcome.right), strict=True))

    @cached_property
    def nees(self) -> list[Nees]:
        """After each scan of the tracking runs; none if there were no such runs."""
        if "tracking" not in self.outcomes:
            return []
        values, variances = np.moveaxis(self.outcomes["tracking"].nees, 1, 0)
        return [nees(*columns) for columns in zip(values.T, variances.T, strict=True)]

    @property
    def least_p(self) -> float:
        """The smallest p-value of the ranks."""
        return min(one.p for one in self.ranks.values())

    @property
    def uniform(self) -> bool:
        """Whether every rank passes."""
        return self.least_p > LEAST_P

    def summary(self, command: str = "") -> dict[str, Any]:
        """Plain data for a file; only ``command`` and ``timing`` vary between equal runs."""
        given = self.experiment
        return {
            "command": command,
            "configuration": {
                "map": {"name": given.grid.name, "digest": given.grid.digest},
                "belief": _settings(given.belief),
                "sensor": _settings(given.sensor),
                "motion": _settings(given.motion),
                "filter_sensor": _settings(given.filter_sensor),
                "filter_motion": _settings(given.filter_motion),
                "commands": [list(command) for command in given.commands],
                **{
                    name: getattr(given, name)
                    for name in ("world", "control", "steps", "sigma", "seed", "defect")
                },
            },
            "replicates": self.replicates,
            "tracks": self.tracks,
            "versions": {
                "python": platform.python_version(),
                "activeloc": activeloc.__version__,
                **{name: metadata.version(name) for name in _PACKAGES},
            },
            "ranks": {
                name: {
                    "chi2_p": one.chi2_p,
                    "ks_p": one.ks_p,
                    "mean": one.mean,
                    "counts": one.counts.tolist(),
                }
                for name, one in self.ranks.items()
            },
            "least_p": self.least_p,
            "coverage": [{"level": level, **_plain(s)} for level, s in self.coverage.items()],
            "wrong": [{"threshold": t, **_plain(s)} for t, s in self.declarations.items()],
            "nees": [asdict(one) for one in self.nees],
            "impossible": self.impossible,
            "timing": {
                "seconds": self.seconds,
                "ms_per_replicate": self.ms_per_replicate,
            },
        }


def _settings(value: Any) -> dict[str, Any]:
    """A frozen object's fields; what JSON has no number for, as a word."""

    def plain(item: Any) -> Any:
        if isinstance(item, dict):
            return {name: plain(one) for name, one in item.items()}
        return str(item) if isinstance(item, float) and not isfinite(item) else item

    return {"kind": type(value).__name__, **plain(asdict(value))}


def _plain(share: Share) -> dict[str, float | int | None]:
    low, high = share.interval
    nothing = share.n == 0
    return {
        "promised": None if nothing else share.promised,
        "share": None if nothing else share.value,
        "low": low,
        "high": high,
        "n": share.n,
    }
