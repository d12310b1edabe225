"""Map files of any kind, told apart by their suffix."""

from __future__ import annotations

import os
from pathlib import Path

from activeloc.errors import MapError
from activeloc.grid import MAX_CELLS, OccupancyGrid
from activeloc.maps.files import read_bytes, write_atomically
from activeloc.maps.text import from_text, to_text

ROS_SUFFIXES = (".yaml", ".yml")
TEXT_SUFFIXES = (".txt",)
IMAGE_SUFFIXES = (".png", ".pgm", ".pnm", ".bmp")
SUFFIXES = ROS_SUFFIXES + TEXT_SUFFIXES + IMAGE_SUFFIXES


def load_map(
    path: str | os.PathLike[str],
    *,
    resolution: float | None = None,
    allow_external_image: bool = False,
) -> OccupancyGrid:
    """Read a map from a file.

    ``.yaml`` and ``.yml`` are map_server maps, ``.txt`` is a text map, and a bare ``.png``,
    ``.pgm``, ``.pnm`` or ``.bmp`` is read with map_server's default thresholds. The map is named
    after the file's stem.

    Args:
        path: The file.
        resolution: Side of a cell [m], for the files that do not say it; 1 m for a text and
            0.05 m for a bare image unless given.
        allow_external_image: Whether a map_server map's image may lie outside its folder.

    Raises:
        MapError: If the suffix is none of these, a resolution is given to a file that says its
            own, or the file cannot be used.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in ROS_SUFFIXES:
        from activeloc.maps.ros import load_ros

        if resolution is not None:
            raise MapError(f"{path}: the file says its own resolution; do not pass {resolution}")
        return load_ros(path, allow_external_image=allow_external_image)
    if suffix in IMAGE_SUFFIXES:
        from activeloc.maps.ros import load_image

        return load_image(path, 0.05 if resolution is None else resolution)
    if suffix in TEXT_SUFFIXES:
        return _load_text(path, 1.0 if resolution is None else resolution)
    raise MapError(f"{path}: a map file ends in {', '.join(SUFFIXES)}; got {path.suffix!r}")


def save_map(grid: OccupancyGrid, path: str | os.PathLike[str]) -> None:
    """Write a map to a file, at once.

    ``.yaml`` and ``.yml`` write a map_server map with a PGM image beside it, from which
    :func:`load_map` reads an equal map. ``.txt`` writes the cells only: a text says neither the
    resolution nor the origin.

    Raises:
        MapError: If the suffix is none of these or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in ROS_SUFFIXES:
        from activeloc.maps.ros import save_ros

        save_ros(grid, path)
    elif suffix in TEXT_SUFFIXES:
        write_atomically(path, to_text(grid).encode())
    else:
        allowed = ", ".join(ROS_SUFFIXES + TEXT_SUFFIXES)
        raise MapError(f"{path}: maps are written to {allowed}; got {path.suffix!r}")


def _load_text(path: Path, resolution: float) -> OccupancyGrid:
    content = read_bytes(path, 2 * MAX_CELLS, "the map")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: not UTF-8 text, at byte {error.start}") from None
    return from_text(text, resolution, name=path.stem)
