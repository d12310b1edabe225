"""Figures from plain arrays, as PNG files.

matplotlib is imported when a figure is drawn, never before, and no figure touches pyplot's global
state: nothing here needs a display or leaves a setting changed. Files appear whole or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError
from activeloc.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curves = Mapping[str, NDArray[Any]]

OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours that stay apart for every kind of colour vision (Okabe & Ito, 2008)."""

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
    _save(figure, Path(path))


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


def plot_rank_histograms(counts: Mapping[str, NDArray[Any]], path: str | Path) -> None:
    """Draw how often the truth had each rank in the posterior, a panel for each quantity.

    Behind the bars: the uniform count, and the band that holds 99 % of the counts if the filter is
    calibrated. A hump says that the belief is too wide, a trough that it is too sure, a slope that
    it is off to one side.

    Args:
        counts: By quantity, ``(n_bins,)`` of counts over equal bins of [0, 1].
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If there are none, or one has a wrong shape or no counts.
    """
    from scipy.stats import binom

    bars = {name: np.asarray(values) for name, values in counts.items()}
    for name, values in bars.items():
        if values.ndim != 1 or values.sum() <= 0 or values.min() < 0:
            raise ConfigError(f"{name}: counts must be (n_bins,), not all zero; got {values!r}")
    if not bars:
        raise ConfigError("no ranks to plot")

    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(bars), 2.8), layout="constrained")
    panels = figure.subplots(1, len(bars), squeeze=False, sharey=True)[0]
    for panel, (name, values) in zip(panels, bars.items(), strict=True):
        n, n_bins = int(values.sum()), len(values)
        low, high = binom.ppf([0.005, 0.995], n, 1.0 / n_bins)
        panel.axhspan(low, high, color="0.85", linewidth=0)
        panel.axhline(n / n_bins, color="0.5", linewidth=0.8)
        edges = np.arange(n_bins) / n_bins
        panel.bar(edges, values, 1.0 / n_bins, align="edge", color=OKABE_ITO[0], alpha=0.75)
        panel.set(title=name, xlabel="rank of the truth", xlim=(0.0, 1.0))
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel(f"runs (n = {int(next(iter(bars.values())).sum())})")
    _save(figure, Path(path))


def plot_reliability(
    shares: Mapping[str, Sequence[tuple[float, float, float, float]]], path: str | Path
) -> None:
    """Draw shares that came true against shares that were promised, a panel for each kind.

    Under the diagonal the belief is surer than it is right.

    Args:
        shares: By kind, rows of promised share, share, and the ends of its interval.
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If there are none, or one is not rows of four numbers in [0, 1].
    """
    if not shares:
        raise ConfigError("no shares to plot")
    rows = {name: np.asarray(values, dtype=np.float64) for name, values in shares.items()}
    for name, values in rows.items():
        wrong = values.size and (values.ndim != 2 or values.shape[1] != 4)
        if wrong or not ((values >= 0.0) & (values <= 1.0)).all():
            raise ConfigError(f"{name}: shares must be rows of four numbers in [0, 1]")

    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0 * len(rows), 3.8), layout="constrained")
    panels = figure.subplots(1, len(rows), squeeze=False)[0]
    for panel, (name, values) in zip(panels, rows.items(), strict=True):
        panel.plot([0.0, 1.0], [0.0, 1.0], color="0.5", linewidth=0.8)
        low = 0.0
        if values.size:
            promised, share, ends = values[:, 0], values[:, 1], values[:, 2:].T
            reach = np.abs(ends - share)
            panel.errorbar(promised, share, reach, fmt="o-", color=OKABE_ITO[0], capsize=2)
            low = max(0.0, float(values.min()) - 0.05)
        panel.set(title=name, xlabel="promised", xlim=(low, 1.01), ylim=(low, 1.01))
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.3, linewidth=0.6)
    panels[0].set_ylabel("came true")
    _save(figure, Path(path))


def plot_paths(
    cells: NDArray[np.uint8],
    extent: tuple[float, float, float, float],
    scans: NDArray[np.int64],
    estimate: NDArray[np.float64],
    reference: NDArray[np.float64],
    right: NDArray[np.bool_],
    path: str | Path,
) -> None:
    """Draw where a filter thought that a robot was, and where it was, over the map.

    Estimates that are right are joined; each of the others is a cross, with a line to where the
    robot was. Where scan numbers jump, the robot was carried: lines end, dots say where it went.

    Args:
        cells: ``(H, W)`` of 0 (free), 1 (occupied) and 2 (unknown); row 0 at the smallest y.
        extent: Smallest x, largest x, smallest y, largest y [m].
        scans: ``(T,)``; number of each scan.
        estimate: ``(T, 2 or more)`` of x and y [m].
        reference: An array like it.
        right: ``(T,)``; which estimates count as right.
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If the shapes do not fit together.
    """
    shapes = [estimate.shape[:1], reference.shape[:1], right.shape]
    if any(shape != scans.shape for shape in shapes) or scans.ndim != 1 or not len(scans):
        raise ConfigError(
            f"paths and flags must be of the length of the scans, {scans.shape}, not 0; "
            f"got {shapes}"
        )
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    height = float(np.clip(8.0 * (extent[3] - extent[2]) / (extent[1] - extent[0]), 3.0, 14.0))
    figure = Figure(figsize=(8.4, height + 0.9), layout="constrained")
    axes = figure.subplots()
    grey = ListedColormap(["white", "0.35", "0.88"])
    axes.imshow(
        cells, cmap=grey, vmin=0, vmax=2, origin="lower", extent=extent, interpolation="nearest"
    )
    true = _with_gaps(scans, reference[:, :2])
    axes.plot(*true.T, color=OKABE_ITO[1], linewidth=2.4, label="reference")
    joined = _with_gaps(scans, np.where(right[:, None], estimate[:, :2], np.nan))
    axes.plot(*joined.T, color=OKABE_ITO[0], linewidth=1.1, label="estimate")
    wrong = np.flatnonzero(~right)
    if len(wrong):
        ends = np.stack([reference[wrong, :2], estimate[wrong, :2]], axis=1)
        for (x0, y0), (x1, y1) in ends:
            axes.plot([x0, x1], [y0, y1], color="0.6", linewidth=0.5)
        axes.plot(
            *estimate[wrong, :2].T, "x", color="black", markersize=5, label=f"wrong ({len(wrong)})"
        )
    for i, jump in enumerate(_jumps(scans)):
        carried = reference[jump - 1 : jump + 1, :2]
        label = None if i else "carried"
        axes.plot(*carried.T, ":", color=OKABE_ITO[3], linewidth=1.6, label=label)
    axes.plot(*reference[0, :2], "o", color="black", markersize=6, label="start")
    axes.set(xlabel="x [m]", ylabel="y [m]", xlim=extent[:2], ylim=extent[2:], aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=5, frameon=False)
    _save(figure, Path(path))


def plot_errors(
    scans: NDArray[np.int64],
    errors: Mapping[str, tuple[NDArray[np.float64], float]],
    entropy: NDArray[np.float64],
    path: str | Path,
) -> None:
    """Draw errors and entropy over the scans of a run, a panel each.

    Args:
        scans: ``(T,)``; number of each scan.
        errors: By name with unit, the errors ``(T,)`` and the largest that counts as right; drawn
            on a logarithmic axis.
        entropy: ``(T,)`` [nat].
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If the shapes do not fit together, or there is no scan.
    """
    shapes = {np.shape(values) for values, _ in errors.values()} | {np.shape(entropy)}
    if shapes != {np.shape(scans)} or np.ndim(scans) != 1 or not len(scans):
        raise ConfigError(f"errors and entropy must be {np.shape(scans)}, not empty; got {shapes}")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 2.3 * (len(errors) + 1)), layout="constrained")
    panels = figure.subplots(len(errors) + 1, 1, sharex=True)
    marker = "." if len(scans) < 50 else ""
    along = _with_gaps(scans, scans)
    for i, (name, (values, allowed)) in enumerate(errors.items()):
        shown = _with_gaps(scans, np.maximum(values, 0.01 * allowed))
        panels[i].plot(
            along, shown, marker=marker, linewidth=1.1, color=OKABE_ITO[0], label="error"
        )
        panels[i].axhline(allowed, color=OKABE_ITO[1], linestyle="--", label=f"{allowed:g} allowed")
        panels[i].set(ylabel=name, yscale="log", ylim=(0.01 * allowed, None))
        panels[i].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    nats = _with_gaps(scans, entropy)
    panels[-1].plot(along, nats, marker=marker, linewidth=1.1, color=OKABE_ITO[2], label="entropy")
    panels[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    panels[-1].set(ylabel="entropy [nat]", xlabel="scan", ylim=(0.0, None))
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(axis="y", alpha=0.3, linewidth=0.6)
        for jump in _jumps(scans):
            panel.axvspan(scans[jump - 1], scans[jump], color="0.9", linewidth=0)
            panel.annotate(
                "carried", (0.5 * (scans[jump - 1] + scans[jump]), 0.5),
                xycoords=("data", "axes fraction"), rotation=90, ha="center", va="center",
            )  # fmt: skip
    _save(figure, Path(path))


def plot_egocentric(
    free: NDArray[np.bool_],
    places: NDArray[np.int64],
    view: NDArray[Any],
    path: str | Path,
) -> None:
    """Draw a maze with the robot's candidates, and what the egocentric view makes of them.

    Args:
        free: ``(m, m)``; rows grow upwards.
        places: ``(n, 3)``; row, column and heading of each candidate, the true one first.
        view: ``(5, 2 r + 1, 2 r + 1)``; see :mod:`activeloc.beliefs.egocentric`.
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If an array has a wrong shape.
    """
    shapes = np.shape(free), np.shape(places), np.shape(view)
    if len(shapes[0]) != 2 or shapes[1][1:] != (3,) or shapes[2][:1] != (5,) or len(shapes[2]) != 3:
        raise ConfigError(
            f"free must be (m, m), places (n, 3) and view (5, s, s); got {shapes[0]}, "
            f"{shapes[1]} and {shapes[2]}"
        )

    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.65))
    left, right = halves
    world = left.subplots()
    world.imshow(free, cmap="gray", vmin=-0.6, vmax=1.0, origin="lower")
    angle = 0.5 * np.pi * places[:, 2]
    colours = [OKABE_ITO[1]] + [OKABE_ITO[0]] * (len(places) - 1)
    world.quiver(
        *(places[:, 1], places[:, 0], np.cos(angle), np.sin(angle)),
        color=colours, scale=16.0, width=0.011, pivot="mid",
    )  # fmt: skip
    world.set_title(f"{len(places)} candidates, the true one orange")
    radius = np.shape(view)[1] // 2
    names = ["P(free)", *(f"news of a reading, turned {90 * q}\N{DEGREE SIGN}" for q in range(4))]
    panels = right.subplots(2, 3).ravel()
    for panel, name, plane in zip(panels, names, view, strict=False):
        extent = (-radius - 0.5, radius + 0.5) * 2
        image = panel.imshow(plane, vmin=0.0, vmax=1.0, origin="lower", extent=extent)
        panel.plot(0, 0, marker="^", color="white", markeredgecolor="black", markersize=7)
        panel.set_title(name, fontsize=9)
    for panel in (world, *panels):
        panel.set_xticks([])
        panel.set_yticks([])
    panels[5].set_axis_off()
    right.colorbar(image, ax=list(panels), shrink=0.6)
    _save(figure, Path(path))


def plot_surroundings(
    free: NDArray[np.bool_],
    extent: tuple[float, float, float, float],
    poses: NDArray[np.float64],
    view: NDArray[Any],
    ways: NDArray[Any],
    path: str | Path,
) -> None:
    """Draw a map with what stands for the belief on it, and what the egocentric view makes of it.

    Args:
        free: ``(H, W)``; rows grow upwards.
        extent: Left, right, lower and upper edge of the map [m].
        poses: ``(n, 3)``; the hypotheses, the true pose first.
        view: ``(5, s, s)``,
        ways: ``(2, bearings, distances)``; see :mod:`activeloc.beliefs.metric_view`.
        path: Of the PNG; what stands there is replaced.

    Raises:
        ConfigError: If an array has a wrong shape.
    """
    shapes = np.shape(free), np.shape(poses), np.shape(view), np.shape(ways)
    if [len(shape) for shape in shapes] != [2, 2, 3, 3] or shapes[1][1] != 3 or shapes[3][0] != 2:
        raise ConfigError(
            "free must be (H, W), poses (n, 3), view (5, s, s) and ways (2, b, d); got "
            + ", ".join(map(str, shapes))
        )

    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 6.0), layout="constrained")
    places = figure.add_gridspec(2, 3, width_ratios=(1.0, 1.0, 1.0))
    world = figure.add_subplot(places[0, :2])
    free_way, news = figure.add_subplot(places[0, 2]), figure.add_subplot(places[1, 0])
    polar: list[Any] = [figure.add_subplot(places[1, i], projection="polar") for i in (1, 2)]
    world.imshow(free, cmap="gray", vmin=-0.6, vmax=1.0, origin="lower", extent=extent)
    colours = [OKABE_ITO[1]] + [OKABE_ITO[0]] * (len(poses) - 1)
    world.quiver(
        *(poses[::-1, 0], poses[::-1, 1], np.cos(poses[::-1, 2]), np.sin(poses[::-1, 2])),
        color=colours[::-1], scale=30.0, width=0.006, pivot="mid",
    )  # fmt: skip
    world.set_title(f"{len(poses) - 1} hypotheses, the truth orange")
    world.set(xlabel="x [m]", ylabel="y [m]")
    half = 0.25 * np.shape(view)[1]
    planes = ((free_way, "P(free)", 0), (news, "spread of the range ahead", 1))
    for panel, name, number in planes:
        window = (-half, half) * 2
        image = panel.imshow(view[number], vmin=0.0, vmax=1.0, origin="lower", extent=window)
        panel.plot(0, 0, marker="^", color="white", markeredgecolor="black", markersize=9)
        panel.set(title=name, xlabel="to the right [m]", ylabel="ahead [m]")
    n_bearings, n_distances = np.shape(ways)[1:]
    angle = 2.0 * np.pi * (np.arange(n_bearings + 1) - 0.5) / n_bearings
    distance = np.maximum(0.5 * np.arange(n_distances + 1) - 0.25, 0.0)
    titles = ("ways: P(open)", "what a scan there tells")
    for panel, name, plane in zip(polar, titles, ways, strict=True):
        panel.set_theta_zero_location("N")
        panel.pcolormesh(angle, distance, np.asarray(plane).T, vmin=0.0, vmax=1.0)
        panel.set_title(name)
        panel.set_xticks([])
        panel.set_yticks([1.0, 2.0, 3.0], ["1", "2", "3 m"], color="white")
        panel.grid(color="white", alpha=0.5)
    figure.colorbar(image, ax=[free_way, *polar], shrink=0.5, label="0 to 1, in all")
    _save(figure, Path(path))


def _jumps(scans: NDArray[np.int64]) -> NDArray[np.intp]:
    """Where a run goes on at a scan that does not follow the one before."""
    return np.flatnonzero(np.diff(scans) > 1) + 1


def _with_gaps(scans: NDArray[np.int64], values: NDArray[Any]) -> NDArray[np.float64]:
    """Values, with NaN before each jump: a line through them ends there."""
    return np.insert(np.asarray(values, dtype=np.float64), _jumps(scans), np.nan, axis=0)


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


def _save(figure: Figure, path: Path) -> None:
    """Encode in memory, write beside the target, and put it in its place in one step."""
    encoded = BytesIO()
    figure.savefig(encoded, format="png", dpi=150)
    write_atomically(path, encoded.getvalue())
