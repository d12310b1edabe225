"""What the pictures are drawn with: colours, a pen, and the marks that map and legend share.

Positions and lengths are pixels of the finished frame, from its upper left corner; headings are
those of the world, counter-clockwise from +x, so the vertical axis is turned here and only here.
The pen draws at twice the size, and the finished frame is scaled down: smooth edges everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

SUPERSAMPLE = 2

Colour = tuple[int, int, int] | tuple[int, int, int, int]
Point = tuple[float, float]

WHITE: Colour = (255, 255, 255)
WALL: Colour = (43, 50, 61)
SOLID: Colour = (156, 163, 173)
UNKNOWN: Colour = (201, 205, 210)
PAPER: Colour = (247, 247, 248)
RULE: Colour = (208, 211, 216)
TEXT: Colour = (33, 37, 43)
QUIET: Colour = (98, 105, 115)
TRUTH: Colour = (0, 98, 178)
BEAM: Colour = (0, 114, 190)
ESTIMATE: Colour = (20, 20, 24)
HEADING: Colour = (36, 8, 12)
PARTICLE: Colour = (110, 6, 24)

# White to dark red, each darker than the one before: ordered for every kind of colour vision and
# in print. Blue and black, which mark the robot and the estimate, lie off its path.
BELIEF_ANCHORS = (
    (255, 255, 255),
    (254, 232, 200),
    (253, 208, 148),
    (253, 176, 110),
    (249, 134, 80),
    (232, 90, 60),
    (204, 44, 34),
    (165, 8, 18),
    (120, 0, 14),
)


def _belief_colours() -> NDArray[np.uint8]:
    anchors = np.asarray(BELIEF_ANCHORS, dtype=np.float64)
    at, ends = np.linspace(0.0, 1.0, 256), np.linspace(0.0, 1.0, len(anchors))
    return np.stack([np.interp(at, ends, band) for band in anchors.T], axis=-1).astype(np.uint8)


BELIEF_COLOURS: NDArray[np.uint8] = _belief_colours()
"""``(256, 3)``; no belief is white, so that multiplying a map by it leaves the map as it is."""


@lru_cache(maxsize=16)
def _font(pixels: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=pixels * SUPERSAMPLE)


class Pen:
    """Draws on an image of twice the frame's size, in pixels of the frame.

    Args:
        image: RGB, :data:`SUPERSAMPLE` times the frame; drawn on in place.
    """

    def __init__(self, image: Image.Image) -> None:
        self._ink = ImageDraw.Draw(image, "RGBA")

    def line(self, points: Sequence[Point], colour: Colour, width: float = 1.0) -> None:
        """A polyline; fewer than two points draw nothing."""
        if len(points) > 1:
            self._ink.line(_scaled(points), colour, round(width * SUPERSAMPLE), joint="curve")

    def polygon(self, points: Sequence[Point], colour: Colour) -> None:
        """A filled polygon."""
        self._ink.polygon(_scaled(points), colour)

    def rectangle(self, box: tuple[float, float, float, float], colour: Colour) -> None:
        """A filled rectangle of left, top, right, bottom; an empty one draws nothing."""
        left, top, right, bottom = (round(value * SUPERSAMPLE) for value in box)
        if left < right and top < bottom:
            self._ink.rectangle((left, top, right - 1, bottom - 1), colour)

    def disc(self, centre: Point, radius: float, colour: Colour) -> None:
        """A filled disc."""
        self._ink.ellipse(_around(centre, radius), colour)

    def ring(self, centre: Point, radius: float, colour: Colour, width: float) -> None:
        """A circle of a given stroke; ``radius`` is the stroke's middle."""
        stroke = round(width * SUPERSAMPLE)
        self._ink.ellipse(_around(centre, radius + width / 2), None, colour, stroke)

    def text(
        self, at: Point, words: str, pixels: float, colour: Colour = TEXT, anchor: str = "lt"
    ) -> None:
        """Words at a point; ``anchor`` as in Pillow."""
        self._ink.text(_scaled([at])[0], words, colour, _font(pixels), anchor)

    def length(self, words: str, pixels: float) -> float:
        """How wide the words will be."""
        return self._ink.textlength(words, _font(pixels)) / SUPERSAMPLE


def _scaled(points: Sequence[Point]) -> list[Point]:
    return [(x * SUPERSAMPLE, y * SUPERSAMPLE) for x, y in points]


def _around(centre: Point, radius: float) -> tuple[float, float, float, float]:
    (x, y), s = centre, SUPERSAMPLE
    # Pillow's boxes include their last pixel.
    return (x - radius) * s, (y - radius) * s, (x + radius) * s - 1, (y + radius) * s - 1


def ahead(at: Point, heading: float, distance: float) -> Point:
    """The point a distance ahead on the picture, where y grows downwards."""
    return at[0] + distance * cos(heading), at[1] - distance * sin(heading)


@dataclass(frozen=True)
class Marks:
    """The marks of one frame, in sizes that suit it.

    Attributes:
        pen: What to draw with.
        unit: One at a frame of 600 pixels; strokes grow with it, and never vanish.
    """

    pen: Pen
    unit: float

    def robot(self, at: Point, heading: float, radius: float) -> None:
        """The true robot: a blue disc rimmed white, a white tick to the front."""
        stroke = max(1.0, 1.5 * self.unit)
        self.pen.disc(at, radius + stroke, WHITE)
        self.pen.disc(at, radius, TRUTH)
        self.pen.line([at, ahead(at, heading, radius)], WHITE, max(1.5, 0.3 * radius))

    def estimate(self, at: Point, heading: float, radius: float) -> None:
        """The estimate: a black ring rimmed white, a cross through it, longer to the front."""
        stroke = max(1.0, 1.7 * self.unit)
        spokes = [(heading + turn, 1.5) for turn in (pi / 2, pi, -pi / 2)] + [(heading, 2.1)]
        for colour, width in ((WHITE, 2.6 * stroke), (ESTIMATE, stroke)):
            self.pen.ring(at, radius, colour, width)
            for direction, reach in spokes:
                ends = [ahead(at, direction, part * radius) for part in (1.0, reach)]
                self.pen.line(ends, colour, width)

    def heading(self, at: Point, heading: float, length: float) -> None:
        """A likely heading: a slim dark wedge, its point to the front."""
        for colour, grow in ((WHITE, 1.3 * self.unit), (HEADING, 0.0)):
            tip = ahead(at, heading, 0.62 * length + 2.0 * grow)
            feet = [ahead(at, heading + turn, 0.42 * length + 1.2 * grow) for turn in (2.45, -2.45)]
            notch = ahead(at, heading + pi, 0.16 * length)
            self.pen.polygon([tip, feet[0], notch, feet[1]], colour)

    def beam(self, start: Point, end: Point, hit: bool, opacity: float = 1.0) -> None:
        """A beam; one that met something ends in a dot, one of maximum range is fainter."""
        strength = round(255 * opacity * (0.62 if hit else 0.3))
        self.pen.line([start, end], (*BEAM[:3], strength), max(0.75, 1.1 * self.unit))
        if hit:
            self.pen.disc(end, max(1.3, 2.1 * self.unit), (*BEAM[:3], round(255 * opacity)))
