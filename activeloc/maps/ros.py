"""Maps in the format of ROS's map_server: a YAML file and the image it names.

What a pixel means follows nav2's ``map_io``. Its *darkness* is 1 - grey/white, or grey/white where
``negate`` is set; colours count as the mean of their channels. In the modes ``trinary`` and
``scale`` a pixel at least as dark as ``occupied_thresh`` is occupied, one at most as dark as
``free_thresh`` is free, and what lies between is unknown: a cell of ours is one of the three, so
the graded occupancy that ``scale`` gives such a pixel is not kept. In the mode ``raw`` the grey
level itself is the occupancy in percent, held against the same thresholds, and more than 100 is
unknown; ``negate`` has no part in it. A pixel that is not fully opaque is unknown in every mode.

The thresholds decide: the savers' grey for unknown, 205, has darkness 0.19608, which is *free*
under a ``free_thresh`` of 0.25 and unknown under 0.196. :meth:`OccupancyGrid.count` tells.

The image's first row is its top, where y is largest; it is flipped here, and nowhere else.
"""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from activeloc.errors import MapError
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps.files import reason_of, write_atomically
from activeloc.maps.header import (
    MAX_ORIGIN,
    MAX_RESOLUTION,
    MIN_RESOLUTION,
    MapHeader,
    read_header,
)
from activeloc.maps.image import GreyImage, read_image

OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
_GREY_OF = np.array([254, 0, 205], dtype=np.uint8)  # Of free, occupied and unknown cells.


def load_ros(path: str | os.PathLike[str], *, allow_external_image: bool = False) -> OccupancyGrid:
    """Read a map_server map.

    Args:
        path: The YAML file; its stem becomes the map's name.
        allow_external_image: Whether the image may lie outside the YAML file's folder.

    Raises:
        MapError: If either file cannot be used; the message says which part and what is allowed.
    """
    path = Path(path)
    header = read_header(path)
    image = _find_image(path, header.image, allow_external_image)
    return _to_grid(read_image(image, header.sha256), header, path)


def load_image(
    path: str | os.PathLike[str],
    resolution: float = 0.05,
    origin: tuple[float, float] = (0.0, 0.0),
) -> OccupancyGrid:
    """Read an image that has no YAML file, under map_server's default thresholds.

    Args:
        path: A PNG, PGM or BMP file; its stem becomes the map's name.
        resolution: Side of a pixel [m].
        origin: x and y of the lower left pixel's corner [m].

    Raises:
        MapError: If the image cannot be used.
    """
    path = Path(path)
    header = MapHeader(path.name, resolution, origin, False, OCCUPIED_THRESH, FREE_THRESH)
    return _to_grid(read_image(path), header, path)


def save_ros(grid: OccupancyGrid, path: str | os.PathLike[str]) -> None:
    """Write a map as a YAML file and a PGM image beside it, to be read back cell for cell.

    Each file appears whole or not at all. The YAML file carries the image's SHA-256, so that an
    interruption between the two cannot pair a new image with old words unnoticed.

    Args:
        grid: The map.
        path: The YAML file; the image gets its stem and the suffix ``.pgm``.

    Raises:
        MapError: If the suffix is not ``.yaml`` or ``.yml``, the file's name, the resolution or
            the origin is one that :func:`load_ros` would refuse, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise MapError(f"{path}: a map_server map is written to .yaml or .yml, got {path.suffix!r}")
    image = path.with_suffix(".pgm")
    if not image.name.isprintable() or image.name.startswith("~"):
        raise MapError(f"{str(path)!r}: a map's file name must be printable and not begin with ~")
    if not MIN_RESOLUTION <= grid.resolution <= MAX_RESOLUTION:
        allowed = f"[{MIN_RESOLUTION:g}, {MAX_RESOLUTION:g}]"
        raise MapError(f"{path}: resolution must be in {allowed} m, got {grid.resolution}")
    if max(map(abs, grid.origin)) > MAX_ORIGIN:
        raise MapError(f"{path}: origin must be within {MAX_ORIGIN:g} m, got {grid.origin}")
    height, width = grid.shape
    pgm = f"P5\n{width} {height}\n255\n".encode() + _GREY_OF[grid.cells[::-1]].tobytes()
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.resolution,
        "origin": [*grid.origin, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
        "sha256": sha256(pgm).hexdigest(),
    }
    text = yaml.safe_dump(header, sort_keys=False, allow_unicode=True, width=4096)
    write_atomically(image, pgm)
    write_atomically(path, text.encode())


def _find_image(path: Path, name: str, allow_external_image: bool) -> Path:
    """The image file that a YAML file names, with all links followed."""
    if "://" in name:
        raise MapError(f"{path}: image must be a file, not a URL, got {name!r}")
    try:
        folder = path.parent.resolve(strict=True)
        relative = Path(name).expanduser() if allow_external_image else Path(name)
        image = (folder / relative).resolve(strict=True)
    except (OSError, RuntimeError, ValueError) as error:
        raise MapError(f"{path}: image {name[:60]!r} cannot be found: {reason_of(error)}") from None
    if not (allow_external_image or image.is_relative_to(folder)):
        raise MapError(
            f"{path}: image {name[:60]!r} lies outside the map's folder; "
            "pass allow_external_image to allow that"
        )
    return image


def _to_grid(image: GreyImage, header: MapHeader, path: Path) -> OccupancyGrid:
    """The map that an image shows, flipped so that row 0 is the bottom."""
    cells = _class_of_level(image.white, header)[image.level]
    cells[~image.opaque] = Cell.UNKNOWN
    if not (cells == Cell.FREE).any():
        n_occupied = int((cells == Cell.OCCUPIED).sum())
        raise MapError(
            f"{path}: no free cell, {n_occupied} occupied, {cells.size - n_occupied} unknown; "
            "are negate, mode and the thresholds right?"
        )
    return OccupancyGrid(cells[::-1], header.resolution, header.origin, path.stem)


def _class_of_level(white: int, header: MapHeader) -> NDArray[np.uint8]:
    """``(white + 1,)``; the cell that each grey level stands for."""
    shade = np.arange(white + 1) / white
    if header.mode == "raw":
        percent = np.rint(shade * 255.0)
        darkness = np.where(percent <= 100.0, percent / 100.0, np.nan)
    else:
        darkness = shade if header.negate else 1.0 - shade
    cell = np.full(white + 1, Cell.UNKNOWN, dtype=np.uint8)
    cell[darkness <= header.free_thresh] = Cell.FREE
    cell[darkness >= header.occupied_thresh] = Cell.OCCUPIED
    return cell
