"""The panel beside or below the map: step and caption, the entropy's course, the legend.

Lengths are in pixels of the frame; most are multiples of ``text``, the height of the letters, so
that the panel keeps its proportions from thumbnails to posters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from activeloc.envs.rendering.marks import (
    BELIEF_COLOURS,
    PAPER,
    PARTICLE,
    QUIET,
    RULE,
    TEXT,
    WHITE,
    Marks,
    Pen,
)

LINE = 1.3
"""Height of a line of text, in letters."""

PAD = 0.7
"""Margin around and between the blocks, in letters."""

HEIGHT = 5 * LINE + 2 * PAD
"""Height of a panel that lies below the map, in letters."""

WIDTH = 12.5
"""Width of a panel that stands beside the map, in letters."""

_LEGEND_WIDTH = 9.0
_SHORTEST_AXIS = 20

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Account:
    """What the panel tells.

    Attributes:
        step: Steps taken.
        caption: Any words; what does not fit is cut.
        entropy: Of the belief, as a fraction of the uniform's.
        history: The fractions before that, oldest first; what is not finite is left out.
        has_particles: Whether the legend has a line for particles.
    """

    step: int
    caption: str
    entropy: float
    history: Sequence[float]
    has_particles: bool = False


def draw_panel(pen: Pen, marks: Marks, account: Account, box: Box, text: float) -> None:
    """Fill a box of left, top, right, bottom; its shape decides how the blocks are arranged."""
    left, top, right, bottom = box
    pen.rectangle(box, PAPER)
    wide = right - left > bottom - top
    rule: Box = (left, top, right, top + 1) if wide else (left, top, left + 1, bottom)
    pen.rectangle(rule, RULE)
    words, curve, legend = _beside(box, text) if wide else _stacked(box, text)
    _words(pen, account, words, text)
    _entropy(pen, account, curve, text)
    _legend(pen, marks, account, legend, text)


def _beside(box: Box, text: float) -> tuple[Box, Box, Box]:
    """Words, curve and legend from left to right; the curve takes what the others leave."""
    left, top, right, bottom = box
    pad = PAD * text
    top, bottom = top + pad, bottom - pad
    words_end = left + pad + 0.3 * (right - left)
    legend_start = right - pad - _LEGEND_WIDTH * text
    return (
        (left + pad, top, words_end, bottom),
        (words_end + pad, top, legend_start - 1.5 * pad, bottom),
        (legend_start, top, right - pad, bottom),
    )


def _stacked(box: Box, text: float) -> tuple[Box, Box, Box]:
    """Words, curve and legend from top to bottom."""
    left, top, right, bottom = box
    pad = PAD * text
    left, right = left + pad, right - pad
    words_end = top + pad + 7 * LINE * text
    legend_start = bottom - pad - 5 * LINE * text
    curve_end = min(legend_start - 2 * pad, words_end + 11 * LINE * text)
    return (
        (left, top + pad, right, words_end),
        (left, words_end, right, curve_end),
        (left, legend_start, right, bottom - pad),
    )


def _words(pen: Pen, account: Account, box: Box, text: float) -> None:
    left, top, right, bottom = box
    pen.text((left, top), f"step {account.step}", 1.35 * text)
    top += 1.75 * LINE * text
    room = int((bottom - top) / (LINE * text) + 0.3)
    for i, line in enumerate(wrap(pen, account.caption, right - left, text, room)):
        pen.text((left, top + i * LINE * text), line, text, QUIET)


def wrap(pen: Pen, words: str, width: float, text: float, room: int) -> list[str]:
    """Break words into at most ``room`` lines; cut what is too long and say so by an ellipsis."""
    lines: list[str] = []
    for word in words.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and pen.length(longer, text) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > room:
        lines = lines[:room]
        lines[-1:] = [line + "..." for line in lines[-1:]]
    return [_cut(pen, line, width, text) for line in lines]


def _cut(pen: Pen, line: str, width: float, text: float) -> str:
    if pen.length(line, text) <= width:
        return line
    stem = line.removesuffix("...")
    while stem and pen.length(stem + "...", text) > width:
        stem = stem[:-1]
    return stem + "..."


def _entropy(pen: Pen, account: Account, box: Box, text: float) -> None:
    """The number, its course so far, and a gauge on the same scale: empty is certain."""
    left, top, right, bottom = box
    known = isfinite(account.entropy)
    share = f"{100 * account.entropy:.0f} %" if known else "unknown"
    words = f"entropy {share}"
    pen.text((left, top), words if pen.length(words, text) <= right - left else share, text)
    top += 1.45 * text
    gauge = right - 0.9 * text
    plot: Box = (left, top, gauge - 0.5 * text, bottom)
    for frame in (plot, (gauge, top, right, bottom)):
        pen.rectangle(frame, RULE)
        pen.rectangle((frame[0] + 1, frame[1] + 1, frame[2] - 1, frame[3] - 1), WHITE)
    half = _height(0.5, top + 1, bottom - 1)
    pen.rectangle((plot[0], half - 0.5, plot[2], half + 0.5), RULE)
    level = _height(account.entropy if known else 0.0, top + 1, bottom - 1)
    pen.rectangle((gauge + 1, level, right - 1, bottom - 1), TEXT)
    _course(pen, [*account.history, account.entropy], plot, text)


def _course(pen: Pen, fractions: Sequence[float], box: Box, text: float) -> None:
    left, top, right, bottom = box
    dot = 0.2 * text
    step = (right - left - 2 * dot - 2) / max(len(fractions) - 1, _SHORTEST_AXIS)
    points = [
        (left + 1 + dot + i * step, _height(fraction, top + 1 + dot, bottom - 1))
        for i, fraction in enumerate(fractions)
        if isfinite(fraction)
    ]
    if points:
        feet = [(points[-1][0], bottom - 1.0), (points[0][0], bottom - 1.0)]
        pen.polygon([*points, *feet], (*TEXT[:3], 36))
        pen.line(points, TEXT, max(1.0, 0.11 * text))
        pen.disc(points[-1], dot, TEXT)


def _height(fraction: float, top: float, bottom: float) -> float:
    return bottom - min(max(fraction, 0.0), 1.0) * (bottom - top)


def _legend(pen: Pen, marks: Marks, account: Account, box: Box, text: float) -> None:
    left, top, _, _ = box
    middle = left + 1.0 * text
    rows = [top + (i + 0.5) * LINE * text for i in range(6)]
    marks.robot((middle, rows[0]), 0.0, 0.42 * text)
    marks.estimate((middle, rows[1]), 0.0, 0.3 * text)
    marks.beam((left, rows[2]), (left + 1.8 * text, rows[2]), hit=True)
    marks.heading((middle, rows[3]), 0.0, 1.1 * text)
    _colour_bar(pen, (left, rows[4] - 0.35 * text, left + 2 * text, rows[4] + 0.35 * text))
    names = ["true pose", "estimate", "scan", "likely heading", "belief"]
    if account.has_particles:
        names[4] = "belief, particles"
        for dx, dy in ((0.4, -0.15), (0.8, 0.2), (1.1, -0.1), (1.5, 0.12), (1.7, -0.2)):
            pen.disc((left + dx * text, rows[4] + dy * text), 0.07 * text, PARTICLE)
    for row, name in zip(rows, names, strict=False):
        pen.text((left + 2.5 * text, row), name, text, anchor="lm")


def _colour_bar(pen: Pen, box: Box) -> None:
    left, top, right, bottom = box
    pen.rectangle((left - 1, top - 1, right + 1, bottom + 1), RULE)
    n = 32
    for i in range(n):
        red, green, blue = (int(value) for value in BELIEF_COLOURS[i * 255 // (n - 1)])
        start, end = (left + (right - left) * part / n for part in (i, i + 1))
        pen.rectangle((start, top, end, bottom), (red, green, blue))
