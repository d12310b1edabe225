"""Figures of what a policy sees: the egocentric views."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError
from activeloc.plots.canvas import OKABE_ITO, save

if TYPE_CHECKING:
    pass


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
    save(figure, Path(path))


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
    save(figure, Path(path))
