"""The report as one HTML page: tables, curves, and pictures that lead to replays."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isnan
from pathlib import Path

from activeloc.agents.evaluation.chart import chart, swatch
from activeloc.agents.evaluation.headings import HEADINGS
from activeloc.agents.evaluation.records import Record
from activeloc.agents.evaluation.report import Report
from activeloc.agents.evaluation.statistics import Estimate
from activeloc.envs.rendering.page import asset, fill

REPLAYS = "replays"
"""Folder of the replays, beside the page."""

Rows = Mapping[str, Mapping[str, Estimate]]


@dataclass(frozen=True, slots=True)
class Picture:
    """What the page shows of an episode.

    Attributes:
        rank: ``best``, ``median`` or ``worst``.
        record: What was kept of it.
        outcome: How it ended, in words.
        replay: File in :data:`REPLAYS`.
        png: Its last moment.
    """

    rank: str
    record: Record
    outcome: str
    replay: str
    png: bytes


def report_page(report: Report, pictures: Sequence[Picture]) -> bytes:
    """The page; pictures are shown agent by agent, in their order."""
    sweep = report.sweep
    web = Path(__file__).parent / "web"
    configuration = json.dumps(report.summary()["configuration"], indent=2)
    return fill(
        (web / "report.html").read_text("utf-8"),
        style=asset("base.css") + (web / "report.css").read_text("utf-8"),
        title=escape(f"{', '.join(sweep.agents)} on {sweep.where}"),
        about=escape(
            f"{sweep.env}, {sweep.episodes} episodes of at most {sweep.limit} steps, the same "
            f"for every agent; seed {sweep.seed}"
        ),
        tables="".join(_tables(report)),
        legend="".join(
            f"<li>{swatch(i)} {escape(agent)}</li>" for i, agent in enumerate(sweep.agents)
        ),
        entropy=chart(report.curves, "entropy [share of the uniform's]"),
        right=chart(report.right_by_step, "localized, and right [share]"),
        gallery="".join(_shelf(agent, pictures) for agent in sweep.agents),
        command=escape(report.command),
        configuration=escape(configuration),
    )


def _tables(report: Report) -> list[str]:
    first = next(iter(report.sweep.agents))
    tables = [_table("Scores", report.scores, "")]
    if report.kidnap_scores:
        caption = "Carried off and not told: steps since then, false alarms before it"
        tables.append(_table(caption, report.kidnap_scores, ""))
    if report.gains:
        caption = "What a planner's scan was expected to tell, and what it told"
        tables.append(_table(caption, report.gains, ""))
    if report.differences:
        caption = f"Difference from {first}, on the same episodes"
        tables.append(_table(caption, report.differences, "+"))
    return tables


def _table(caption: str, rows: Rows, sign: str) -> str:
    """A row for each agent, intervals under the values."""
    names = [name for name in HEADINGS if all(name in scores for scores in rows.values())]
    head = "".join(f'<th scope="col">{HEADINGS[name][0]}</th>' for name in names)
    body = "".join(
        f'<tr><th scope="row">{escape(agent)}</th>'
        + "".join(f"<td>{_cell(name, scores[name], sign)}</td>" for name in names)
        + "</tr>"
        for agent, scores in rows.items()
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}, with 95 % intervals</caption>"
        f'<thead><tr><th scope="col">agent</th>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _cell(name: str, estimate: Estimate, sign: str) -> str:
    if isnan(estimate.value):
        return "&ndash;"
    form = HEADINGS[name][1]
    low, high = f"{estimate.low:z{form}}", f"{estimate.high:z{form}}"
    return f"{estimate.value:{sign}z{form}}<small>{low} .. {high}</small>"


def _shelf(agent: str, pictures: Sequence[Picture]) -> str:
    """One agent's pictures."""
    figures = "".join(_figure(picture) for picture in pictures if picture.record.agent == agent)
    return f'<h3>{escape(agent)}</h3><div class="shelf">{figures}</div>'


def _figure(picture: Picture) -> str:
    record = picture.record
    source = base64.b64encode(picture.png).decode("ascii")
    end = f"{picture.outcome} after {record.played} steps"
    about = escape(f"episode {record.episode} on {record.map}")
    return (
        f'<figure class="card"><a href="{REPLAYS}/{picture.replay}">'
        f'<img src="data:image/png;base64,{source}" alt="" loading="lazy">'
        f"<span><strong>{picture.rank.capitalize()}</strong>: {about}</span></a>"
        f"<figcaption>{end}; area {record.entropy_auc:.2f}, error {record.error_m:.2f} m"
        "</figcaption></figure>"
    )
