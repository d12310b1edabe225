"""Maps: read from files, or generated.

Every map becomes an :class:`activeloc.grid.OccupancyGrid`: square cells that are free, occupied or
unknown, row 0 at the bottom. What reads or draws one is here; what a map *is* stands there.

Files (:func:`load_map`, :func:`save_map`) are those of ROS's map_server, a YAML file and an image
(:mod:`activeloc.maps.ros`), text (:mod:`activeloc.maps.text`), and bare images. A file is a
stranger's word: it is measured before it is decoded, and refused in one sentence that says what,
where, what was given and what is allowed.

Generators (:data:`GENERATORS`) are frozen dataclasses of their parameters, in metres, whose
``generate(rng)`` draws a map. All they draw is walled in, and the robot's disc of radius 0.2 m can
reach whatever it fits into:

========== =========================================================================
``maze``   perfect mazes of one-metre cells, as in Active Neural Localization
``office`` corridors lined with rooms that look alike but for a few: hard to tell apart
``rooms``  a home: rooms of all sizes, furniture
``cave``   no straight wall, no two places alike
========== =========================================================================

:class:`MapSource` is what an environment holds: it understands ``"office"``, ``"office:0-3"``,
``"office(rooms=6):*"`` and ``"path/to/map.yaml"``, and draws a map for each episode.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from activeloc.maps.formats import load_map, save_map
from activeloc.maps.source import GENERATORS, MapGenerator, MapSource
from activeloc.maps.text import from_text, to_text

if TYPE_CHECKING:
    from activeloc.maps.ros import load_image, load_ros, save_ros

__all__ = [
    "GENERATORS",
    "MapGenerator",
    "MapSource",
    "from_text",
    "load_image",
    "load_map",
    "load_ros",
    "save_map",
    "save_ros",
    "to_text",
]


def __getattr__(name: str) -> Any:
    """What reads YAML and images, at its first use: a generated map needs neither library."""
    if name in ("load_image", "load_ros", "save_ros"):
        from activeloc.maps import ros

        return getattr(ros, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
