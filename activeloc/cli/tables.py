"""The tables that ``activeloc evaluate`` prints."""

from __future__ import annotations

from math import isnan
from typing import TYPE_CHECKING

from rich.table import Table

from activeloc.agents.evaluation.headings import HEADINGS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from activeloc.agents.evaluation import Estimate, Report


def scores_table(report: Report) -> Table:
    """A row for each agent, intervals under the scores."""
    return _table(report.scores, "")


def differences_table(report: Report) -> Table:
    """A row for each agent but the first: paired differences."""
    return _table(report.differences, "+")


def kidnap_table(report: Report) -> Table:
    """A row for each agent: what it made of the kidnapping."""
    return _table(report.kidnap_scores, "")


def gains_table(report: Report) -> Table:
    """A row for each planner: what it expected of its scans and what they gave."""
    return _table(report.gains, "")


def _table(rows: Mapping[str, Mapping[str, Estimate]], sign: str) -> Table:
    names = [name for name in HEADINGS if all(name in scores for scores in rows.values())]
    table = Table(box=None, pad_edge=False)
    table.add_column("agent", no_wrap=True)
    for name in names:
        table.add_column(HEADINGS[name][0], justify="right", no_wrap=True)
    for agent, scores in rows.items():
        table.add_row(agent, *(_cell(name, scores[name], sign) for name in names))
    return table


def _cell(name: str, estimate: Estimate, sign: str) -> str:
    """A score over its interval."""
    if isnan(estimate.value):
        return "-"
    form = HEADINGS[name][1]
    low, high = f"{estimate.low:z{form}}", f"{estimate.high:z{form}}"
    return f"{estimate.value:{sign}z{form}}\n{low}..{high}"
