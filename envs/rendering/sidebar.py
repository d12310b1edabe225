"""A column of words and gauges to the right of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from activeloc.envs.rendering.marks import PAPER, QUIET, RULE, SUPERSAMPLE, TEXT, Pen
from activeloc.envs.rendering.panel import LINE, PAD, wrap

WIDTH = 19.0
"""Of the column, in letters."""


@dataclass(frozen=True, slots=True)
class Block:
    """A heading over some lines.

    Attributes:
        heading: Large.
        lines: Each a text and whether it is said quietly; long ones are broken.
        share: In [0, 1], drawn as a gauge under the heading; None for no gauge.
    """

    heading: str
    lines: Sequence[tuple[str, bool]] = ()
    share: float | None = None


def with_sidebar(
    frame: NDArray[np.uint8], blocks: Sequence[Block], text: float
) -> NDArray[np.uint8]:
    """A frame with a column beside it; what does not fit below the last line is left out.

    Args:
        frame: ``(H, W, 3)``.
        blocks: From top to bottom.
        text: Height of the letters [px].

    Returns:
        ``(H, W + column, 3)``; the column's width depends on ``text`` only.
    """
    height = frame.shape[0]
    width = round(WIDTH * text / 2) * 2
    image = Image.new("RGB", (width * SUPERSAMPLE, height * SUPERSAMPLE))
    pen = Pen(image)
    pen.rectangle((0, 0, width, height), PAPER)
    pen.rectangle((0, 0, 1, height), RULE)
    top = PAD * text
    for block in blocks:
        top = _draw(pen, block, (PAD * text, top, width - PAD * text, height), text) + PAD * text
    column = np.asarray(image.resize((width, height), Image.Resampling.LANCZOS))
    return np.concatenate([frame, column], axis=1)


def _draw(pen: Pen, block: Block, box: tuple[float, float, float, float], text: float) -> float:
    """Draw a block from the top of a box; returns where it ends."""
    left, top, right, bottom = box
    pen.text((left, top), block.heading, 1.15 * text)
    top += 1.15 * LINE * text
    if block.share is not None:
        pen.rectangle((left, top, right, top + 0.6 * text), RULE)
        end = left + block.share * (right - left)
        pen.rectangle((left, top, end, top + 0.6 * text), TEXT)
        top += LINE * text
    for words, quiet in block.lines:
        for line in wrap(pen, words, right - left, text, 3):
            if top + text > bottom:
                return top
            pen.text((left, top), line, text, QUIET if quiet else TEXT)
            top += LINE * text
    return top
