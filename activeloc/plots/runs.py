"""Figures of a filter on a recorded run: its path, its errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError
from activeloc.plots.canvas import OKABE_ITO, save

if TYPE_CHECKING:
    pass


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
    save(figure, Path(path))


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
    save(figure, Path(path))


def _jumps(scans: NDArray[np.int64]) -> NDArray[np.intp]:
    """Where a run goes on at a scan that does not follow the one before."""
    return np.flatnonzero(np.diff(scans) > 1) + 1


def _with_gaps(scans: NDArray[np.int64], values: NDArray[Any]) -> NDArray[np.float64]:
    """Values, with NaN before each jump: a line through them ends there."""
    return np.insert(np.asarray(values, dtype=np.float64), _jumps(scans), np.nan, axis=0)
