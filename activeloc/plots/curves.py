"""Curves over the steps of many episodes, with their bands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError
from activeloc.plots.canvas import OKABE_ITO, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Curves = Mapping[str, NDArray[Any]]

_STROKES = ("-", "--", ":")
_RESAMPLES = 2000
_LABEL_GAP = 0.06
"""Distance that two labels at the right keep, as a part of the axis."""


def plot_entropy_curves(
    curves: Curves, path: str | Path, right_by_step: Curves | None = None
) -> None:
    """Draw how the entropy falls, agent by agent, and how many episodes are right by then.

    Lines are means over episodes, bands their 95 % bootstrap intervals. An episode that has ended
    keeps its last value: a mean over those still running would be one over the hard ones.

    Args:
        curves: By agent, ``(n_episodes, T + 1)`` of entropies as fractions of the uniform's, from
            step 0; NaN after an episode's end.
        path: Of the PNG; what stands there is replaced.
        right_by_step: By agent, the share of episodes that declared, rightly, by each step:
            ``(T + 1,)``, or ``(n_episodes, T + 1)`` of 0 and 1 for a band around it.

    Raises:
        ConfigError: If there are no curves, or one has a wrong shape, no first value, an infinite
            one, or a value outside [0, 1] among the shares.
    """
    entropy = {agent: _episodes(agent, values) for agent, values in _some(curves).items()}
    right = {agent: _shares(agent, values) for agent, values in (right_by_step or {}).items()}
    styles = {agent: _style(i) for i, agent in enumerate({**entropy, **right})}

    from matplotlib.figure import Figure

    n_panels = 2 if right else 1
    figure = Figure(figsize=(6.4 * n_panels, 4.2), layout="constrained")
    panels = figure.subplots(1, n_panels, squeeze=False)[0]
    _panel(panels[0], entropy, styles, "entropy [fraction of the uniform's]")
    if right:
        _panel(panels[1], right, styles, "localized, and right [share of episodes]")
    save(figure, Path(path))


def mean_with_band(
    episodes: NDArray[np.float64], coverage: float = 0.95, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean over episodes with its percentile bootstrap interval, step by step.

    Whole episodes are drawn, so steps of one episode stay together.

    Args:
        episodes: ``(n_episodes, T + 1)``, without NaN.
        coverage: Of the interval, in (0, 1).
        seed: Of the draws; same seed, same band.

    Returns:
        Mean, lower and upper end, each ``(T + 1,)``.
    """
    n = len(episodes)
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(n, np.full(n, 1.0 / n), size=_RESAMPLES) @ episodes / n
    tail = 50.0 * (1.0 - coverage)
    low, high = np.percentile(drawn, [tail, 100.0 - tail], axis=0)
    return episodes.mean(axis=0), low, high


def _some(curves: Curves) -> Curves:
    if not curves:
        raise ConfigError("no curves to plot: give at least one agent's")
    return curves


def _episodes(agent: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """One agent's curves, checked, each episode's last value held to the end."""
    episodes = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if episodes.ndim != 2 or episodes.size == 0:
        raise ConfigError(f"{agent}: curves must be (n_episodes, T + 1), got {np.shape(values)}")
    if np.isnan(episodes[:, 0]).any() or np.isinf(episodes).any():
        raise ConfigError(f"{agent}: each curve must start with a number and hold no infinity")
    steps = np.where(np.isnan(episodes), 0, np.arange(episodes.shape[1]))
    held: NDArray[np.float64] = np.take_along_axis(
        episodes, np.maximum.accumulate(steps, axis=1), axis=1
    )
    return held


def _shares(agent: str, values: NDArray[Any]) -> NDArray[np.float64]:
    shares = _episodes(agent, values)
    if shares.min() < 0.0 or shares.max() > 1.0:
        raise ConfigError(
            f"{agent}: shares must lie in [0, 1], got {shares.min():g} to {shares.max():g}"
        )
    return shares


def _style(i: int) -> dict[str, Any]:
    """Colour and stroke of the i-th agent; strokes tell apart those that share a colour."""
    turn, place = divmod(i, len(OKABE_ITO))
    return {"color": OKABE_ITO[place], "linestyle": _STROKES[turn % len(_STROKES)]}


def _panel(
    axes: Axes, curves: dict[str, NDArray[np.float64]], styles: dict[str, dict[str, Any]], name: str
) -> None:
    """One axis of curves, each with its agent's name at its end."""
    ends = {}
    for agent, episodes in curves.items():
        mean, low, high = mean_with_band(episodes)
        steps = np.arange(len(mean))
        axes.plot(steps, mean, linewidth=1.8, **styles[agent])
        axes.fill_between(steps, low, high, alpha=0.18, linewidth=0, color=styles[agent]["color"])
        ends[agent] = float(mean[-1])
    last = max(episodes.shape[1] for episodes in curves.values()) - 1
    top = max(1.0, *(float(episodes.mean(axis=0).max()) for episodes in curves.values()))
    axes.set(xlabel="step", ylabel=name, xlim=(0, max(last, 1)), ylim=(0.0, 1.02 * top))
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", alpha=0.3, linewidth=0.6)
    _label(axes, curves, ends, styles)


def _label(
    axes: Axes,
    curves: dict[str, NDArray[np.float64]],
    ends: dict[str, float],
    styles: dict[str, dict[str, Any]],
) -> None:
    """Names and episode counts right of the axis, moved apart where lines end close together."""
    top = axes.get_ylim()[1]
    heights = _apart(np.array(list(ends.values())) / top, _LABEL_GAP)
    for agent, height in zip(ends, heights, strict=True):
        n = len(curves[agent])
        axes.annotate(
            f"{agent} (n = {n})" if n > 1 else agent,
            xy=(1.0, height),
            xytext=(6, 0),
            xycoords="axes fraction",
            textcoords="offset points",
            color=styles[agent]["color"],
            verticalalignment="center",
            annotation_clip=False,
        )


def _apart(heights: NDArray[np.float64], gap: float) -> NDArray[np.float64]:
    """Heights moved, in their order, until neighbours are a gap apart and none is below zero."""
    order = np.argsort(heights, kind="stable")
    slots = gap * np.arange(len(heights))
    # Blocks of labels that push each other: pool neighbours until the free positions ascend.
    blocks: list[list[float]] = []
    for free in (heights[order] - slots).tolist():
        blocks.append([free])
        while len(blocks) > 1 and np.mean(blocks[-2]) > np.mean(blocks[-1]):
            blocks[-2:] = [blocks[-2] + blocks[-1]]
    placed = np.concatenate([np.full(len(block), np.mean(block)) for block in blocks])
    result = np.empty_like(heights)
    result[order] = np.maximum(placed, 0.0) + slots
    return result
