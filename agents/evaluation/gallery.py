"""Each agent's best, median and worst episode, played again to be seen."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path

from PIL import Image

from activeloc.agents.evaluation.episodes import Player
from activeloc.agents.evaluation.lock import locked
from activeloc.agents.evaluation.page import REPLAYS, Picture, report_page
from activeloc.agents.evaluation.records import Record
from activeloc.agents.evaluation.report import Report
from activeloc.envs.rendering import Recording, draw, layout, write_page
from activeloc.files import write_atomically

THUMBNAIL = 420
"""Longer side of a picture [px]."""


@dataclass(frozen=True, slots=True)
class Choice:
    """An episode worth seeing.

    Attributes:
        rank: ``best``, ``median`` or ``worst``.
        record: What was kept of it.
    """

    rank: str
    record: Record


def choices(records: Sequence[Record]) -> list[Choice]:
    """The best, median and worst of an agent's episodes by penalised area, then by steps.

    Of equals the earlier one is the better; of fewer than three, there are as many.
    """
    order = sorted(records, key=lambda r: (r.entropy_auc, r.steps, r.episode))
    ranks = {"best": 0, "median": (len(order) - 1) // 2, "worst": len(order) - 1}
    if len(order) < 3:
        ranks.pop("median")
    chosen = {place: rank for rank, place in reversed(ranks.items())}
    return [Choice(chosen[place], order[place]) for place in sorted(chosen)]


def write_gallery(
    report: Report, folder: Path, on_choice: Callable[[Choice], None] = lambda _: None
) -> Path:
    """Write ``report.html`` and the replays that it links to; returns the page's path.

    The chosen episodes are played again; one that comes out otherwise than it was recorded is
    remarked upon.

    Args:
        report: What to show.
        folder: That of the results.
        on_choice: Called with each episode before it is played.

    Raises:
        ConfigError: If another run is writing there.
        OSError: If a file cannot be written.
    """
    player = Player(report.sweep)
    with locked(folder):
        (folder / REPLAYS).mkdir(exist_ok=True)
        pictures = []
        for agent, records in report.by_agent.items():
            for choice in choices(records):
                on_choice(choice)
                record, recording = player.record(agent, choice.record.episode)
                if record.entropy != choice.record.entropy:
                    report.remarks.append(
                        f"episode {record.episode} of {agent} came out otherwise when it was "
                        "played again: its replay is not what was scored"
                    )
                pictures.append(_shown(choice, recording, folder))
        page = folder / "report.html"
        write_atomically(page, report_page(report, pictures))
    return page


def replay_name(record: Record) -> str:
    """File name of an episode's replay, whatever the agent is called."""
    name = re.sub(r"[^A-Za-z0-9]+", "-", record.agent)
    if name != record.agent:  # Another agent's may come out the same.
        name += f"-{sha256(record.agent.encode()).hexdigest()[:6]}"
    return f"{name}-{record.episode}.html"


def _shown(choice: Choice, recording: Recording, folder: Path) -> Picture:
    """Write an episode's replay; returns what the page shows of it."""
    record = choice.record
    name = replay_name(record)
    write_page([recording], folder / REPLAYS / name, f"episode {record.episode}, {choice.rank}")
    png = BytesIO()
    width, height = layout(recording.grid, THUMBNAIL).map_size
    frame = draw(recording.scene(len(recording)), THUMBNAIL)[:height, :width]
    Image.fromarray(frame).save(png, "PNG", optimize=True)
    return Picture(choice.rank, record, recording.outcome, name, png.getvalue())
