"""A scene as a picture: the map, the belief over it, the robot, its scan, and the entropy.

:func:`draw` turns plain arrays into an RGB frame with Pillow and numpy alone: no display, no
window, and the same bytes for the same scene.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from activeloc.envs.rendering.ground import draw_ground
from activeloc.envs.rendering.marks import SUPERSAMPLE, Marks, Pen, Point
from activeloc.envs.rendering.panel import Account, draw_panel
from activeloc.envs.rendering.scene import Layout, Scene, layout

_SPACING = 30.0
"""Smallest distance between two places whose headings are shown, in a frame of 600 [px]."""

_FAINTEST_PLACE = 0.04
"""Cells that hold less than this part of the fullest cell's mass show no heading."""


def draw(scene: Scene, size: int = 600) -> NDArray[np.uint8]:
    """Draw a scene.

    Args:
        scene: What to draw.
        size: Longer side of the frame [px], 300 to 4000.

    Returns:
        ``(H, W, 3)``; H and W depend on the map's shape and ``size`` only.

    Raises:
        ConfigError: If the size is out of range.
    """
    place = layout(scene.grid, size)
    ground = draw_ground(scene, place)
    frame = Image.new("RGB", (place.width * SUPERSAMPLE, place.height * SUPERSAMPLE))
    width, height = place.map_size
    enlarged = (width * SUPERSAMPLE, height * SUPERSAMPLE)
    frame.paste(Image.fromarray(ground).resize(enlarged, Image.Resampling.NEAREST))
    pen = Pen(frame)
    marks = Marks(pen, place.unit)
    _headings(scene, place, marks)
    _scan(scene, place, marks)
    _robots(scene, place, marks)
    account = Account(
        scene.step, scene.caption, scene.entropy, scene.history, scene.particles is not None
    )
    draw_panel(pen, marks, account, place.panel, place.text)
    return np.asarray(frame.resize((place.width, place.height), Image.Resampling.LANCZOS)).copy()


def _headings(scene: Scene, place: Layout, marks: Marks) -> None:
    """Wedges for the likely headings, at the likely places."""
    poses = scene.headings if scene.headings is not None else likely_poses(scene, place)
    for at, heading in zip(place.to_pixels(poses[:, :2]), poses[:, 2], strict=True):
        marks.heading(_point(at), float(heading), 17.0 * place.unit)


def likely_poses(scene: Scene, place: Layout) -> NDArray[np.float64]:
    """Likely places with the headings that stand out there: ``(M, 3)``.

    Args:
        scene: With the belief.
        place: Of the frame they are for: they are as far apart as it has room for.
    """
    belief = np.asarray(scene.belief)
    if len(belief) < 2:
        return np.empty((0, 3))
    cell = scene.belief_resolution * place.scale
    reach = max(0, round(_SPACING * place.unit / 2.0 / cell - 0.5))
    peaks = _peaks(scene.marginal, 2 * reach)
    centres, shares = _around(belief, peaks, reach)
    bins, which = np.nonzero(_outstanding(shares))
    headings = -np.pi + (bins + 0.5) * 2.0 * np.pi / len(belief)
    xy = (centres * scene.belief_resolution + scene.belief_origin)[which]
    return np.column_stack([xy, headings])


def _peaks(marginal: NDArray[np.floating], apart: int) -> NDArray[np.intp]:
    """``(P, 2)``: rows and columns of the fullest cells, no two within ``apart`` of each other."""
    left = np.array(marginal)
    faintest = max(_FAINTEST_PLACE * float(left.max()), 1e-12)
    peaks = []
    while left.flat[top := int(left.argmax())] >= faintest:
        row, col = divmod(top, left.shape[1])
        peaks.append((row, col))
        left[max(row - apart, 0) : row + apart + 1, max(col - apart, 0) : col + apart + 1] = 0.0
    return np.array(peaks, dtype=np.intp).reshape(-1, 2)


def _around(
    belief: NDArray[np.floating], peaks: NDArray[np.intp], reach: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What lies in the squares around some cells.

    Args:
        belief: ``(T, R, C)``.
        peaks: ``(P, 2)`` of row, column; each cell holds mass.
        reach: Cells from a square's middle to its sides.

    Returns:
        Centres of mass, ``(P, 2)`` of x, y in cells; shares of the headings, ``(T, P)``.
    """
    _, n_rows, n_cols = belief.shape
    offsets = np.arange(-reach, reach + 1)
    rows = peaks[:, 0, None, None] + offsets[:, None]
    cols = peaks[:, 1, None, None] + offsets
    inside = (rows >= 0) & (rows < n_rows) & (cols >= 0) & (cols < n_cols)
    mass = belief[:, rows.clip(0, n_rows - 1), cols.clip(0, n_cols - 1)] * inside
    flat = mass.sum(axis=0, dtype=np.float64)
    total = flat.sum(axis=(1, 2))
    x, y = (((at + 0.5) * flat).sum(axis=(1, 2)) / total for at in (cols, rows))
    return np.stack([x, y], axis=-1), mass.sum(axis=(2, 3), dtype=np.float64) / total


def _outstanding(shares: NDArray[np.float64]) -> NDArray[np.bool_]:
    """``(T, P)``: which headings stand out of the histograms over all of them."""
    threshold = np.maximum(min(3.0 / len(shares), 0.4), 0.5 * shares.max(axis=0, initial=0.0))
    summit = (shares >= np.roll(shares, 1, axis=0)) & (shares >= np.roll(shares, -1, axis=0))
    result: NDArray[np.bool_] = summit & (shares >= threshold)
    return result


def _scan(scene: Scene, place: Layout, marks: Marks) -> None:
    """The beams, from the true pose; without one, from the estimate."""
    pose = scene.pose if scene.pose is not None else scene.estimate
    if scene.scan is None or scene.bearings is None or pose is None:
        return
    read = ~np.isnan(scene.scan)
    ranges = np.minimum(scene.scan[read], scene.z_max)
    angles = pose[2] + scene.bearings[read]
    ends = pose[:2] + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    opacity = float(np.clip(12.0 / max(len(ranges), 1), 0.35, 1.0))
    start = _point(place.to_pixels(pose[:2]))
    for end, z in zip(place.to_pixels(ends), ranges, strict=True):
        marks.beam(start, _point(end), hit=bool(z < scene.z_max), opacity=opacity)


def _robots(scene: Scene, place: Layout, marks: Marks) -> None:
    """The estimate, and over it the true robot."""
    radius = max((scene.radius or 0.0) * place.scale, 7.0 * place.unit, 4.0)
    if scene.estimate is not None:
        at = _point(place.to_pixels(scene.estimate[:2]))
        marks.estimate(at, float(scene.estimate[2]), 1.7 * radius)
    if scene.pose is not None:
        marks.robot(_point(place.to_pixels(scene.pose[:2])), float(scene.pose[2]), radius)


def _point(xy: NDArray[np.float64]) -> Point:
    return float(xy[0]), float(xy[1])
