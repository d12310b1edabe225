"""Recordings to frames, and frames to a film."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from io import BytesIO
from itertools import chain, pairwise, repeat
from math import ceil, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from activeloc import checks
from activeloc.envs.rendering.draw import draw
from activeloc.envs.rendering.marks import PAPER
from activeloc.envs.rendering.recording import Recording
from activeloc.errors import ConfigError
from activeloc.files import write_atomically

FPS = 5.0
"""Frames a second, unless others are asked for."""

_HOLD = 2000
"""How long the last frame stays [ms]."""

_GUTTER = 8
"""Between the agents' parts of a frame [px]."""

_COLOURS = 255
"""One fewer than a GIF may have: Pillow marks what did not change with the free one."""

_EXACT = 16
"""How many of the commonest colours are kept as they are."""

_APART = 8
"""Nothing stands this close to those: Pillow looks colours up in steps of 4 and would mix them."""


def frames_of(recordings: Sequence[Recording], size: int = 600) -> Iterator[NDArray[np.uint8]]:
    """A frame for each moment: the agents beside each other, from two rows on in a square.

    An agent whose episode has ended stays as it was.

    Args:
        recordings: One for each agent; on one map.
        size: Longer side of an agent's part of the frame [px], 300 to 4000.

    Raises:
        ConfigError: If there are none, they are of different maps, or the size is out of range.
    """
    if not recordings:
        raise ConfigError("a film needs at least one recording")
    for one, other in pairwise(recordings):
        if one.grid.digest != other.grid.digest:
            raise ConfigError(f"a film shows one map; got {one.grid.name} and {other.grid.name}")
    several = len(recordings) > 1
    for moment in range(max(map(len, recordings))):
        yield _tiled([draw(one.scene(moment, several), size) for one in recordings])


def _tiled(parts: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Pictures of one shape in rows, as many as there are columns or one fewer."""
    height, width, _ = parts[0].shape
    n_cols = ceil(sqrt(len(parts)))
    n_rows = ceil(len(parts) / n_cols)
    down, right = height + _GUTTER, width + _GUTTER
    shape = n_rows * down - _GUTTER, n_cols * right - _GUTTER, 3
    whole = np.full(shape, PAPER[:3], dtype=np.uint8)
    for i, part in enumerate(parts):
        row, col = divmod(i, n_cols)
        whole[row * down :, col * right :][:height, :width] = part
    return whole


def demand_encoder() -> None:
    """Refuse to make an MP4 where there is nothing to make it with.

    Raises:
        ConfigError: If imageio-ffmpeg is not installed.
    """
    if find_spec("imageio_ffmpeg") is None:
        raise ConfigError('.mp4 needs imageio-ffmpeg: pip install "activeloc[video]"')


def write_mp4(frames: Iterable[NDArray[np.uint8]], path: str | Path, fps: float = FPS) -> None:
    """Write frames as an MP4 (H.264) that any browser plays; the last one stays for two seconds.

    The encoder is the ffmpeg that comes with imageio-ffmpeg, ``activeloc[video]``. The file
    appears whole or not at all.

    Args:
        frames: Each ``(H, W, 3)``, all of one shape with even sides.
        path: Of the file; what stands there is replaced.
        fps: Frames a second, above 0 and up to 60.

    Raises:
        ConfigError: If there are no frames, their sides are odd, ``fps`` is out of range, or
            imageio-ffmpeg is not installed.
        OSError: If it cannot be written.
    """
    checks.number("fps", fps, 0.0, 60.0, above_low=True)
    demand_encoder()
    import imageio_ffmpeg

    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise ConfigError("a film needs at least one frame")
    height, width = first.shape[:2]
    if height % 2 or width % 2:
        raise ConfigError(f"frames of an .mp4 must have even sides, got {width} x {height}")
    with TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        encoder = imageio_ffmpeg.write_frames(
            film,
            (width, height),
            fps=fps,
            codec="libx264",
            quality=None,
            macro_block_size=2,
            output_params=["-crf", "20", "-movflags", "+faststart"],
        )
        encoder.send(None)
        last = first
        for last in chain([first], frames):
            encoder.send(np.ascontiguousarray(last))
        for frame in repeat(last, round(fps * _HOLD / 1000)):
            encoder.send(np.ascontiguousarray(frame))
        encoder.close()
        write_atomically(path, film.read_bytes())


def write_gif(frames: Sequence[NDArray[np.uint8]], path: str | Path, fps: float = FPS) -> None:
    """Write frames as a GIF that repeats for ever; the last frame stays for two seconds.

    All frames share one palette, so that nothing flickers. A frame equal to the one before it is
    stored as a longer stay of that one. The file appears whole or not at all.

    Args:
        frames: Each ``(H, W, 3)``, all of one shape.
        path: Of the file; what stands there is replaced.
        fps: Frames a second, above 0 and up to 50; a GIF counts hundredths of a second.

    Raises:
        ConfigError: If there are no frames, they differ in shape, or ``fps`` is out of range.
    """
    if len(frames) == 0:
        raise ConfigError("a film needs at least one frame")
    shapes = sorted({np.shape(frame) for frame in frames})
    if len(shapes) > 1 or len(shapes[0]) != 3 or shapes[0][2] != 3:
        raise ConfigError(f"frames must all be (H, W, 3) of one size, got {shapes[:3]}")
    if not 0.0 < fps <= 50.0:
        raise ConfigError(f"fps must be in (0, 50], got {fps}")
    palette = _palette(frames)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    durations = [round(100.0 / fps) * 10] * (len(images) - 1) + [_HOLD]
    _write(Path(path), images, durations)


def _palette(frames: Sequence[NDArray[np.uint8]]) -> Image.Image:
    """Colours that occur in the frames: the commonest as they are, and a fair choice of the rest.

    A colour counts by the fourth root of its area, in steps of 8 a channel, so that a robot of a
    hundred pixels keeps its blue beside a hundred thousand pixels of floor.
    """
    colours, counts = _census(frames)
    exact = _spaced(colours[:256])[:_EXACT]
    _, first = np.unique(colours >> 3, axis=0, return_index=True)
    strip = np.repeat(colours[first], np.ceil(counts[first] ** 0.25).astype(int), axis=0)
    image = Image.fromarray(strip[None].astype(np.uint8))
    fair = image.quantize(_COLOURS - _EXACT, Image.Quantize.MEDIANCUT).getpalette()
    rest = np.array(fair, dtype=np.int32).reshape(-1, 3)
    distance = np.abs(rest[:, None] - exact).max(axis=-1).min(axis=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([exact, rest[distance >= _APART]]).ravel().tolist())
    return palette


def _census(
    frames: Sequence[NDArray[np.uint8]],
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """The colours of a sample of frames, ``(N, 3)``, and their areas [px]; the commonest first."""
    picked = np.linspace(0, len(frames) - 1, min(len(frames), 24)).round().astype(int)
    pixels = np.concatenate([frames[i].reshape(-1, 3) for i in picked]).astype(np.int32)
    keys, counts = np.unique(pixels @ (1 << 16, 1 << 8, 1), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    keys = keys[order]
    colours = np.stack([keys >> 16, keys >> 8 & 255, keys & 255], axis=-1)
    return colours.astype(np.int32), counts[order]


def _spaced(colours: NDArray[np.int32]) -> NDArray[np.int32]:
    """The colours without those that are close to an earlier one."""
    kept: list[NDArray[np.int32]] = []
    for colour in colours:
        if all(np.abs(colour - other).max() >= _APART for other in kept):
            kept.append(colour)
    return np.array(kept)


def _write(path: Path, images: list[Image.Image], durations: list[int]) -> None:
    """Encode in memory, write beside the target, and put it in its place in one step."""
    encoded = BytesIO()
    images[0].save(
        encoded, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0
    )
    write_atomically(path, encoded.getvalue())
