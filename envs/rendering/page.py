"""Recordings as one HTML file: everything is in it, nothing is fetched, no server is needed.

Beliefs are the bulk of an episode. They are written as shades on a scale of logarithms, 128 levels
for places and 32 for the slices by heading, which a picture does not tell from more; each block is
deflated, and the browser inflates it. Slices stay packed until somebody asks for them.
"""

from __future__ import annotations

import base64
import html
import json
import zlib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.envs.rendering.marks import BELIEF_ANCHORS
from activeloc.envs.rendering.recording import Recording
from activeloc.errors import ConfigError
from activeloc.files import write_atomically
from activeloc.grid import Cell, OccupancyGrid

MAP_SIDE = 1200
"""Most cells of the map along its longer side; a finer map is made coarser."""

DOTS = 300
"""Most particles of a moment."""

_PLACE_LEVELS, _SLICE_LEVELS = 128, 32
_SCRIPTS = ("codec.js", "stage.js", "curve.js", "panes.js", "replay.js")

# Dark to light: on dark paper more belief is more light, in the order of luminance throughout.
_DARK_ANCHORS = (
    (23, 26, 32),
    (92, 44, 40),
    (140, 58, 44),
    (178, 76, 40),
    (208, 100, 40),
    (232, 134, 48),
    (247, 176, 76),
    (253, 214, 130),
    (255, 246, 204),
)


def write_page(recordings: Sequence[Recording], path: str | Path, about: str = "") -> None:
    """Write recordings of one map, side by side, as a page to be replayed in a browser.

    Args:
        recordings: One for each agent.
        path: Of the HTML file; what stands there is replaced, whole or not at all.
        about: A line of text under the title.

    Raises:
        ConfigError: If there is none, or they are of different maps.
        OSError: If it cannot be written.
    """
    write_atomically(path, page_of(recordings, about))


def page_of(recordings: Sequence[Recording], about: str = "") -> bytes:
    """The page of :func:`write_page`.

    Raises:
        ConfigError: If there are no recordings, or they are of different maps.
    """
    if not recordings:
        raise ConfigError("a replay needs at least one recording")
    grid = recordings[0].grid
    for recording in recordings:
        if recording.grid.digest != grid.digest:
            raise ConfigError(f"a replay shows one map; got {grid.name} and {recording.grid.name}")
    replay = {
        "ramps": {"light": BELIEF_ANCHORS, "dark": _DARK_ANCHORS},
        "map": _map(grid),
        "tracks": [_track(recording) for recording in recordings],
    }
    agents = " and ".join(recording.agent for recording in recordings)
    return fill(
        asset("replay.html"),
        title=html.escape(f"{agents} on {grid.name}"),
        about=html.escape(about),
        style=asset("base.css") + asset("replay.css"),
        data=json_of(replay),
        script="".join(asset(name) for name in _SCRIPTS),
    )


@cache
def asset(name: str) -> str:
    """A file of the folder ``web`` beside this one."""
    return (Path(__file__).parent / "web" / name).read_text("utf-8")


def fill(template: str, **parts: str) -> bytes:
    """A page from its template; the parts are taken as they are."""
    return Template(template).substitute(parts).encode()


def json_of(value: Any) -> str:
    """JSON that may stand inside a ``<script>``."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _map(grid: OccupancyGrid) -> dict[str, Any]:
    cells = _coarse(grid.cells, -(-max(grid.shape) // MAP_SIDE))
    return {
        "name": grid.name,
        "extent": grid.extent,
        "shape": cells.shape,
        "packed": _packed(cells),
    }


def _coarse(cells: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Blocks of cells as one: occupied if any is, else unknown if any is, else free."""
    rows, cols = cells.shape
    padded = np.pad(cells, ((0, -rows % factor), (0, -cols % factor)), "edge")
    blocks = padded.reshape(padded.shape[0] // factor, factor, -1, factor)
    occupied, unknown = (
        (blocks == cell).any(axis=(1, 3)) for cell in (Cell.OCCUPIED, Cell.UNKNOWN)
    )
    coarse = np.where(occupied, Cell.OCCUPIED, np.where(unknown, Cell.UNKNOWN, Cell.FREE))
    return coarse.astype(np.uint8)


def _track(recording: Recording) -> dict[str, Any]:
    """What the page has to know of one recording."""
    scans = np.minimum(recording.scans, recording.z_max)
    return {
        "agent": recording.agent,
        "outcome": recording.outcome,
        "origin": recording.origin,
        "shades": _block(recording.shades, recording.resolution, _PLACE_LEVELS),
        "slices": _block(recording.slices, recording.slice_resolution, _SLICE_LEVELS),
        "headings": [_rounded(poses.ravel(), 2) for poses in recording.headings],
        "particles": _particles(recording),
        "poses": _rounded(recording.poses, 3),
        "estimates": _rounded(recording.estimates, 3),
        "scans": [[None if z != z else z for z in scan] for scan in _rounded(scans, 3)],
        "bearings": _rounded(recording.bearings, 4),
        "z_max": recording.z_max,
        "radius": recording.radius,
        "entropy": _rounded(recording.entropy, 4),
        "fraction": _rounded(recording.entropy_fraction, 4),
        "mass": _rounded(recording.mass, 4),
        "error_m": _rounded(recording.error_m, 3),
        "error_rad": _rounded(recording.error_rad, 4),
        "commands": recording.commands,
        "carried_at": recording.carried_at,
    }


def _block(shades: NDArray[np.uint8], resolution: float, levels: int) -> dict[str, Any]:
    """Shades in fewer levels; only what is zero stays zero."""
    coarse = np.maximum(shades // (256 // levels), shades > 0).astype(np.uint8)
    return {
        "shape": shades.shape,
        "resolution": resolution,
        "levels": levels,
        "packed": _packed(coarse),
    }


def _particles(recording: Recording) -> Mapping[str, Any] | None:
    """Places of particles, as parts of the map's sides in 16 bits."""
    if not recording.particles:
        return None
    x_min, x_max, y_min, y_max = recording.grid.extent
    size = np.array([x_max - x_min, y_max - y_min])
    chosen = [cloud[:: -(-len(cloud) // DOTS), :2] for cloud in recording.particles]
    parts = (np.concatenate(chosen) - (x_min, y_min)) / size
    counts = [len(cloud) for cloud in chosen]
    return {
        "counts": counts,
        "ends": np.cumsum(counts).tolist(),
        "packed": _packed((parts.clip(0.0, 1.0) * 65535).round().astype("<u2")),
    }


def _packed(values: NDArray[Any]) -> str:
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode("ascii")


def _rounded(values: NDArray[np.floating], digits: int) -> list[Any]:
    rounded: list[Any] = np.asarray(values, dtype=np.float64).round(digits).tolist()
    return rounded
