"""Cost against size on logarithmic axes, a PNG for each plot.

Ours are solid lines, each with a colour and a marker of its own; yardsticks are dashed; what no
code can go under on the machine is dotted: grey or, of several, in the colour of what it is of.
matplotlib is imported when a figure is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from activeloc.benchmarks.report import Curve
from activeloc.files import write_atomically
from activeloc.plots import OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = "osD^vP*"
TICKS = (
    (6.0, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)),
    (200.0, (1.0, 2.0, 5.0)),
    (inf, (1.0,)),
)
"""Which multiples of powers of ten are written, on axes whose ends have less than a ratio."""


def write_figures(curves: Sequence[Curve], folder: Path) -> list[Path]:
    """Draw every plot that there are curves for.

    Returns:
        The files, in the plots' order.

    Raises:
        OSError: If one cannot be written.
    """
    paths = []
    for plot in dict.fromkeys(curve.plot for curve in curves):
        paths.append(folder / f"{plot}.png")
        write_atomically(paths[-1], _png([curve for curve in curves if curve.plot == plot]))
    return paths


def _png(curves: Sequence[Curve]) -> bytes:
    """One figure, encoded."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    n_floors, i = sum(curve.kind == "floor" for curve in curves), -1
    for curve in curves:
        i += curve.kind != "floor"
        _draw(axes, curve, i, "0.4" if n_floors == 1 else OKABE_ITO[i % len(OKABE_ITO)])
    axes.set(
        xscale="log", yscale="log", xlabel=curves[0].x_label, ylabel=curves[0].y_label,
    )  # fmt: skip
    axes.grid(which="major", alpha=0.4, linewidth=0.6)
    axes.grid(which="minor", alpha=0.15, linewidth=0.4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)
    _plain_ticks(axes)
    encoded = BytesIO()
    figure.savefig(encoded, format="png", dpi=150)
    return encoded.getvalue()


def _draw(axes: Axes, curve: Curve, i: int, floor: str) -> None:
    """A line; the i-th that is no floor, or the floor in a colour."""
    colour = OKABE_ITO[i % len(OKABE_ITO)]
    styles: dict[str, dict[str, Any]] = {
        "ours": {"linestyle": "-", "color": colour, "marker": MARKERS[i % len(MARKERS)]},
        "yardstick": {"linestyle": "--", "color": colour, "marker": MARKERS[i % len(MARKERS)]},
        "floor": {"linestyle": ":", "color": floor, "linewidth": 2.0},
    }
    axes.plot(curve.x, curve.y, label=curve.label, markersize=5, **styles[curve.kind])


def _plain_ticks(axes: Axes) -> None:
    """Numbers as they are read, also between the powers of ten of a short axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        subs = next(subs for most, subs in TICKS if high / low < most)
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        axis.set_minor_formatter(NullFormatter())
