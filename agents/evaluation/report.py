"""The results of a sweep as files and as rows of a table.

=============== ==================================================================================
episodes.csv    one row for each episode of each agent
curves.csv      mean entropy step by step, with its interval
summary.json    scores with intervals, differences, configuration, versions, timings
entropy.png     the curves, drawn; only where matplotlib is installed
report.html     all of that as a page, with replays: :mod:`activeloc.agents.evaluation.gallery`
=============== ==================================================================================

The two CSV files hold nothing that depends on the machine's speed: they are the same bytes whatever
the number of processes and however often a run was stopped. Curves are the scored ones (0 after a
right declaration, 1 after a wrong one): their mean over steps 1 to the limit is ``entropy_auc``.
"""

from __future__ import annotations

import csv
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cached_property
from importlib import metadata
from io import StringIO
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import activeloc
from activeloc import plots
from activeloc.agents.evaluation import statistics
from activeloc.agents.evaluation.records import Record
from activeloc.agents.evaluation.statistics import Estimate
from activeloc.agents.evaluation.sweep import Sweep
from activeloc.files import write_atomically

RESULTS = ("episodes.csv", "curves.csv", "summary.json", "entropy.png", "report.html")

_COLUMNS = {
    "agent": "agent",
    "map": "map",
    "seed": "seed",
    "episode": "episode",
    "steps": "steps",
    "success": "success",
    "wrong": "wrong",
    "entropy_auc": "entropy_auc",
    "final_entropy": "final_entropy",
    "error_m": "error_m",
    "error_rad": "error_rad",
    "return": "total_reward",
}
_KIDNAP_COLUMNS = ("kidnapped", "notice_steps", "recover_steps", "false_alarm")
_PACKAGES = ("gymnasium", "numba", "numpy", "scipy")


class Report:
    """What a sweep's episodes say.

    Args:
        sweep: What was played.
        records: All of its episodes, agent by agent in its order, each agent's by number.
        command: What was asked for.
    """

    def __init__(self, sweep: Sweep, records: Sequence[Record], command: str = "") -> None:
        self.sweep = sweep
        self.records = records
        self.command = command
        self.by_agent = {
            name: [record for record in records if record.agent == name] for name in sweep.agents
        }
        self.remarks: list[str] = []

    @cached_property
    def scores(self) -> dict[str, dict[str, Estimate]]:
        """By agent, each score with its interval."""
        kinds = self._kinds
        return {name: statistics.estimates(c, kinds) for name, c in self._columns.items()}

    @property
    def _is_maze(self) -> bool:
        return self.sweep.config().task.kind == "maze"

    @property
    def _kinds(self) -> Mapping[str, statistics.Statistic]:
        """The scores that suit the task."""
        return statistics.MAZE_SCORES if self._is_maze else statistics.SCORES

    @cached_property
    def kidnap_scores(self) -> dict[str, dict[str, Estimate]]:
        """By agent, what is said besides of a kidnapped robot; nothing in another task."""
        if not self._kidnapped:
            return {}
        kinds = statistics.KIDNAP_SCORES
        return {name: statistics.estimates(c, kinds) for name, c in self._columns.items()}

    @property
    def _kidnapped(self) -> bool:
        return self.sweep.config().task.kind == "kidnapped"

    @cached_property
    def gains(self) -> dict[str, dict[str, Estimate]]:
        """By agent that plans, the gains that it expected and had, where they were recorded."""
        return {
            name: statistics.estimates(statistics.gain_columns(records), statistics.GAIN_SCORES)
            for name, records in self.by_agent.items()
            if any(record.gains for record in records)
        }

    @cached_property
    def differences(self) -> dict[str, dict[str, Estimate]]:
        """By agent but the first, each score less the first agent's, episode by episode."""
        first, *others = self._columns
        baseline, kinds = self._columns[first], self._kinds
        return {n: statistics.differences(self._columns[n], baseline, kinds) for n in others}

    @cached_property
    def _columns(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        return {name: statistics.columns_of(records) for name, records in self.by_agent.items()}

    @cached_property
    def curves(self) -> dict[str, NDArray[np.float64]]:
        """By agent, the scored entropy curves ``(n_episodes, limit + 1)``."""
        limit = self.sweep.limit
        return {n: np.array([r.curve(limit) for r in rs]) for n, rs in self.by_agent.items()}

    @cached_property
    def right_by_step(self) -> dict[str, NDArray[np.float64]]:
        """By agent, whether each episode is right by each step: ``(n_episodes, limit + 1)``."""
        steps = np.arange(self.sweep.limit + 1)
        return {
            name: np.array([(steps >= r.steps) & r.success for r in records], dtype=np.float64)
            for name, records in self.by_agent.items()
        }

    def episodes_csv(self) -> bytes:
        """One row for each record; a kidnapped robot's has four columns more, a maze's one."""
        columns = dict(_COLUMNS)
        if self._is_maze:
            columns["likeliest"] = "likeliest"
        if self._kidnapped:
            columns |= {name: name for name in _KIDNAP_COLUMNS}
        rows = [
            [_cell(getattr(record, field)) for field in columns.values()] for record in self.records
        ]
        return _csv([*columns], rows)

    def curves_csv(self) -> bytes:
        """Mean entropy fraction by agent and step, its 95 % interval, and the episodes behind."""
        rows = []
        for name, curves in self.curves.items():
            means, lows, highs = plots.mean_with_band(curves)
            for step, numbers in enumerate(zip(means, lows, highs, strict=True)):
                cells = [_cell(float(number)) for number in numbers]
                rows.append([name, str(step), *cells, str(len(curves))])
        return _csv(["agent", "step", "entropy", "low", "high", "n"], rows)

    def summary(self) -> dict[str, Any]:
        """Everything but the episodes; only ``command`` and ``timing`` vary between equal runs."""
        sweep = self.sweep
        return {
            "command": self.command,
            "configuration": {**sweep.identity(), "map": sweep.where},
            "seed": sweep.seed,
            "episodes": sweep.episodes,
            "steps": sweep.limit,
            "versions": {
                "python": platform.python_version(),
                "activeloc": activeloc.__version__,
                **{name: metadata.version(name) for name in _PACKAGES},
            },
            "scores": {n: _plain_estimates(scores) for n, scores in self.scores.items()},
            **self._extras(),
            "baseline": next(iter(sweep.agents)),
            "differences": {n: _plain_estimates(d) for n, d in self.differences.items()},
            "diagnostics": {n: diagnostics(records) for n, records in self.by_agent.items()},
            "timing": {n: _timing(records) for n, records in self.by_agent.items()},
        }

    def _extras(self) -> dict[str, Any]:
        """Scores that only some sweeps have."""
        extras = {"kidnapping": self.kidnap_scores, "gains": self.gains}
        return {
            what: {name: _plain_estimates(scores) for name, scores in by_agent.items()}
            for what, by_agent in extras.items()
            if by_agent
        }


def write_report(report: Report, folder: Path) -> None:
    """Write the files, each whole or not at all; a figure that cannot be drawn is a remark.

    Raises:
        OSError: If one cannot be written.
    """
    write_atomically(folder / "episodes.csv", report.episodes_csv())
    write_atomically(folder / "curves.csv", report.curves_csv())
    text = json.dumps(report.summary(), indent=2, allow_nan=False) + "\n"
    write_atomically(folder / "summary.json", text.encode())
    try:
        plots.plot_entropy_curves(report.curves, folder / "entropy.png", report.right_by_step)
    except ImportError:
        report.remarks.append("no entropy.png: matplotlib is not installed (activeloc[plot])")


def _cell(value: object) -> str:
    """Truth as 1 and 0, a float by its shortest exact form."""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)


def _csv(header: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue().encode()


def _plain_estimates(estimates: dict[str, Estimate]) -> dict[str, dict[str, float | None]]:
    return {
        name: {key: None if isnan(number) else number for key, number in asdict(e).items()}
        for name, e in estimates.items()
    }


def diagnostics(records: Sequence[Record]) -> dict[str, float | None]:
    """Shares of episodes whose belief lost the truth, all but and wholly; mean particles."""
    counts = [r.n_particles for r in records if r.n_particles is not None]
    return {
        "truth_lost": float(np.mean([record.truth_lost for record in records])),
        "truth_gone": float(np.mean([record.mass_at_truth == 0.0 for record in records])),
        "n_particles": float(np.mean(counts)) if counts else None,
    }


def _timing(records: Sequence[Record]) -> dict[str, float]:
    """Mean durations over all steps of all episodes [ms], and how many steps those were."""
    played = np.array([record.played for record in records], dtype=np.float64)
    total = float(played.sum())
    return {
        "act_ms": float(played @ [record.act_ms for record in records]) / total,
        "step_ms": float(played @ [record.step_ms for record in records]) / total,
        "steps": total,
    }
