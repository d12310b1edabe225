"""Curves with bands as SVG, for pages: scripts and plotting libraries are not needed."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

from activeloc.plots import mean_with_band

DASHES = ("", "7 4", "2 3", "9 3 2 3", "4 2")
"""Strokes of the series; with five colours, they tell twenty-five apart with these."""

_WIDTH, _HEIGHT = 480, 290
_LEFT, _RIGHT, _TOP, _FOOT = 56, 462, 10, 246


def chart(curves: Mapping[str, NDArray[np.float64]], y_name: str) -> str:
    """Means over episodes with their 95 % bands, in [0, 1], step by step.

    Args:
        curves: By agent, ``(n_episodes, T + 1)``.
        y_name: What the curves are of, and its unit.
    """
    last = max(values.shape[1] for values in curves.values()) - 1
    parts = [_axes(last, y_name)]
    ends = []
    for i, (agent, episodes) in enumerate(curves.items()):
        mean, low, high = mean_with_band(episodes)
        band = _points(np.concatenate([low, high[::-1]]), last, len(low))
        parts.append(f'<polygon points="{band}" style="fill:{colour(i)};opacity:0.15"/>')
        parts.append(
            f'<polyline points="{_points(mean, last)}" stroke-dasharray="{dash(i)}" '
            f'style="fill:none;stroke:{colour(i)};stroke-width:2.2"/>'
        )
        ends.append(f"{agent} ends at {mean[-1]:.2f}")
    words = escape(f"{y_name} by step, from 0 to {last}: {'; '.join(ends)}")
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{words}">'
        f"{''.join(parts)}</svg>"
    )


def swatch(i: int) -> str:
    """A piece of the i-th series' line, for a legend."""
    return (
        '<svg class="swatch" viewBox="0 0 28 8" aria-hidden="true"><line x1="0" x2="28" y1="4" '
        f'y2="4" stroke-dasharray="{dash(i)}" style="stroke:{colour(i)};stroke-width:3"/></svg>'
    )


def colour(i: int) -> str:
    """Of the i-th series, as the pages' style sheet has it."""
    return f"var(--series-{i % 5 + 1})"


def dash(i: int) -> str:
    """Stroke of the i-th series."""
    return DASHES[(i + i // 5) % 5]


def _x(step: float, last: int) -> float:
    return _LEFT + (_RIGHT - _LEFT) * step / max(last, 1)


def _y(value: float) -> float:
    return _FOOT - (_FOOT - _TOP) * value


def _points(values: NDArray[np.float64], last: int, turn: int | None = None) -> str:
    """A polyline; with ``turn``, one that goes back from there."""
    steps = [i if turn is None or i < turn else 2 * turn - 1 - i for i in range(len(values))]
    return " ".join(
        f"{_x(s, last):.1f},{_y(float(v)):.1f}" for s, v in zip(steps, values, strict=True)
    )


def _axes(last: int, y_name: str) -> str:
    parts = []
    for tenths in range(0, 11, 2):
        y = _y(tenths / 10)
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{_RIGHT}" y1="{y}" y2="{y}"/>')
        words = f"{tenths / 10:.1f}"
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4}" text-anchor="end">{words}</text>')
    apart = next(n for n in (1, 2, 5, 10, 20, 25, 50, 100, 200, 500, 10**9) if last / n <= 8)
    for step in range(0, last + 1, apart):
        x = _x(step, last)
        parts.append(
            f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" y1="{_FOOT}" y2="{_FOOT + 4}"/>'
        )
        parts.append(f'<text x="{x:.1f}" y="{_FOOT + 18}" text-anchor="middle">{step}</text>')
    middle = (_LEFT + _RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{_HEIGHT - 6}" text-anchor="middle">step</text>')
    turn = f"translate(12 {(_TOP + _FOOT) / 2}) rotate(-90)"
    parts.append(f'<text transform="{turn}" text-anchor="middle">{escape(y_name)}</text>')
    return "".join(parts)
