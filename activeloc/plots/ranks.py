"""Figures of a calibration: rank histograms, and what came true of what was promised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError
from activeloc.plots.canvas import OKABE_ITO, save

if TYPE_CHECKING:
    pass


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
    save(figure, Path(path))


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
    save(figure, Path(path))
