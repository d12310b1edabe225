"""What a picture shows, and where on it: plain arrays, and the frame that suits a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activeloc.envs.rendering.panel import HEIGHT, WIDTH, Box
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid

_SIZES = (300, 4000)


@dataclass(frozen=True, eq=False)
class Scene:
    """What there is to see at one moment. Arrays are read, never written.

    Attributes:
        grid: The map.
        belief: ``(T, R, C)`` of probabilities; heading bin t is centred at
            ``-pi + (t + 0.5) * 2 * pi / T``, rows grow with y.
        belief_resolution: Side of a cell of the belief [m].
        belief_origin: x and y of the lower left corner of the belief's first cell [m].
        pose: ``(3,)``; the true x [m], y [m], theta [rad], if known.
        estimate: ``(3,)``; where the robot thinks it is, if it does.
        scan: ``(B,)`` of ranges [m]; NaN is no reading, infinity one of maximum range.
        bearings: ``(B,)``; of the beams, from the robot's heading [rad].
        z_max: Longest range of a beam [m].
        entropy: Of the belief, as a fraction of the uniform's.
        history: The fractions before that, oldest first.
        step: Steps taken.
        caption: Words for the panel.
        radius: Of the robot [m]; without it the robot has a size that is easy to see.
        particles: ``(N, 3)`` of poses, drawn as dots.
        headings: ``(M, 3)`` of poses, drawn as wedges; found in the belief if None.

    Raises:
        ConfigError: If an array has the wrong shape or the belief's resolution is not positive.
    """

    grid: OccupancyGrid
    belief: NDArray[np.floating]
    belief_resolution: float
    belief_origin: tuple[float, float] = (0.0, 0.0)
    pose: NDArray[np.float64] | None = None
    estimate: NDArray[np.float64] | None = None
    scan: NDArray[np.floating] | None = None
    bearings: NDArray[np.floating] | None = None
    z_max: float = 10.0
    entropy: float = 1.0
    history: Sequence[float] = ()
    step: int = 0
    caption: str = ""
    radius: float | None = None
    particles: NDArray[np.floating] | None = None
    headings: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        shape = np.shape(self.belief)
        if len(shape) != 3 or 0 in shape:
            raise ConfigError(f"belief must be (T, R, C), not empty; got shape {shape}")
        if not (np.isfinite(self.belief_resolution) and self.belief_resolution > 0.0):
            raise ConfigError(f"belief_resolution must be > 0 m, got {self.belief_resolution}")
        for name in ("pose", "estimate"):
            pose = getattr(self, name)
            if pose is not None and np.shape(pose) != (3,):
                raise ConfigError(f"{name} must be (3,), got shape {np.shape(pose)}")
        if (self.scan is None) != (self.bearings is None):
            raise ConfigError("scan and bearings go together: give both or neither")
        if self.scan is not None and self.bearings is not None:
            scan, bearings = np.shape(self.scan), np.shape(self.bearings)
            if scan != bearings or len(scan) != 1:
                raise ConfigError(f"scan and bearings must both be (B,), got {scan}, {bearings}")
        for name in ("particles", "headings"):
            poses = getattr(self, name)
            if poses is not None and (np.ndim(poses) != 2 or np.shape(poses)[1] != 3):
                raise ConfigError(f"{name} must be (N, 3), got shape {np.shape(poses)}")

    @cached_property
    def marginal(self) -> NDArray[np.floating]:
        """``(R, C)``; the belief over places, whatever the heading."""
        result: NDArray[np.floating] = np.asarray(self.belief).sum(axis=0)
        return result


@dataclass(frozen=True)
class Layout:
    """Where a frame has its map and its panel.

    Attributes:
        width: Of the frame [px]; even, as video encoders like it.
        height: Of the frame [px]; even.
        map_size: Width and height of the map, which has the upper left corner [px].
        extent: Smallest x, largest x, smallest y, largest y of the map [m].
        text: Height of the panel's letters [px].
        unit: One at a frame of 600 pixels.
    """

    width: int
    height: int
    map_size: tuple[int, int]
    extent: tuple[float, float, float, float]
    text: float
    unit: float

    @property
    def panel(self) -> Box:
        """Left, top, right, bottom: the strip that the map leaves [px]."""
        width, height = self.map_size
        below = width >= self.width
        return (0 if below else width, height if below else 0, self.width, self.height)

    @property
    def scale(self) -> float:
        """Pixels a metre."""
        return self.map_size[0] / (self.extent[1] - self.extent[0])

    def to_pixels(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """Metres to pixels: ``(..., 2)`` of x, y to distance from the left, from the top."""
        x_min, x_max, y_min, y_max = self.extent
        part = (np.asarray(xy, dtype=np.float64) - (x_min, y_max)) / (x_max - x_min, y_min - y_max)
        result: NDArray[np.float64] = part * self.map_size
        return result


def layout(grid: OccupancyGrid, size: int = 600) -> Layout:
    """The frame of a map: the panel goes below or beside it, whichever leaves more of it.

    Args:
        grid: The map.
        size: Longer side of the frame [px], 300 to 4000.

    Raises:
        ConfigError: If the size is out of range.
    """
    if not _SIZES[0] <= size <= _SIZES[1]:
        raise ConfigError(f"size must be {_SIZES[0]} to {_SIZES[1]} px, got {size}")
    size = size // 2 * 2
    text = max(9.5, 13.5 * size / 600)
    (rows, cols), low, wide = grid.shape, HEIGHT * text, WIDTH * text
    below = min(size / cols, (size - low) / rows)
    beside = min((size - wide) / cols, size / rows)
    scale = max(below, beside)
    map_size = max(2, round(cols * scale / 2) * 2), max(2, round(rows * scale / 2) * 2)
    panel = (0, round(low / 2) * 2) if below >= beside else (round(wide / 2) * 2, 0)
    width, height = (min(size, a + b) for a, b in zip(map_size, panel, strict=True))
    return Layout(width, height, map_size, grid.extent, text, size / 600)
