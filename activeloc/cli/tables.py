"""The tables that ``activeloc evaluate`` prints."""

from __future__ import annotations

from math import degrees, isnan
from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from activeloc.agents.evaluation import Estimate, Report

_HEADS = {
    "right": ("right", "{:.2f}"),
    "wrong": ("wrong\nand sure", "{:.2f}"),
    "wrong_of_declared": ("wrong of\ndeclared", "{:.2f}"),
    "steps": ("steps", "{:.0f}"),
    "entropy_auc": ("area", "{:.2f}"),
    "error_m": ("error\n[m]", "{:.2f}"),
    "error_rad": ("error\n[deg]", "{:.0f}"),
}


def scores_table(report: Report) -> Table:
    """A row for each agent, intervals under the scores."""
    sweep = report.sweep
    title = (
        f"{sweep.env} on {sweep.map.spec}: {sweep.episodes} episodes of {sweep.limit} steps at "
        "most, 95 % intervals"
    )
    return _table(title, report.scores, "")


def differences_table(report: Report) -> Table:
    """A row for each agent but the first: paired differences."""
    first = next(iter(report.by_agent))
    return _table(f"less {first}'s, episode by episode", report.differences, "+")


def _table(title: str, rows: Mapping[str, Mapping[str, Estimate]], sign: str) -> Table:
    table = Table(box=None, pad_edge=False, title=title, title_justify="left", title_style="bold")
    table.add_column("agent")
    for head, _ in _HEADS.values():
        table.add_column(head, justify="right", no_wrap=True)
    for agent, scores in rows.items():
        table.add_row(agent, *(_cell(name, scores[name], sign) for name in _HEADS))
    return table


def _cell(name: str, estimate: Estimate, sign: str) -> str:
    """A score over its interval."""
    if isnan(estimate.value):
        return "-"
    unit = degrees if name == "error_rad" else float
    form = _HEADS[name][1].replace(":", f":{sign}")
    value, low, high = (form.format(unit(x)) for x in (estimate.value, estimate.low, estimate.high))
    return f"{value}\n{low}..{high}"
