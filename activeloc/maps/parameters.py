"""What generators have in common: how they refuse parameters, and what their maps must be."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from activeloc.errors import ConfigError
from activeloc.grid import MAX_CELLS, OccupancyGrid

ROBOT_RADIUS = 0.2  # [m]; of the disc that must reach all of a generated building.
MAX_TRIES = 100  # Draws before a generator says that its parameters give no such map.


def demand(owner: object, holds: bool, sentence: str) -> None:
    """Refuse parameters that do not go together; the sentence says which and why."""
    if not holds:
        raise ConfigError(f"{_title(owner)}: {sentence}")


def check_area(owner: object, width: float, height: float, resolution: float) -> None:
    """Refuse a map of more cells than :class:`OccupancyGrid` takes."""
    n_cells = width * height / resolution**2
    demand(
        owner,
        n_cells <= MAX_CELLS,
        f"{width:.4g} x {height:.4g} m at a resolution of {resolution:g} m are {n_cells:.3g} "
        f"cells; at most {MAX_CELLS} are allowed",
    )


def give_up(owner: object, wanted: str) -> ConfigError:
    """The error of a generator whose every draw was rejected."""
    return ConfigError(f"{_title(owner)}: {MAX_TRIES} draws gave no {wanted}; got {owner}")


def is_one_space(grid: OccupancyGrid) -> bool:
    """Whether the robot's disc can go from anywhere it fits to anywhere else it fits."""
    _, n_parts = ndimage.label(grid.clearance >= ROBOT_RADIUS)
    return bool(n_parts == 1)


def is_symmetric(cells: NDArray[np.uint8]) -> bool:
    """Whether a plan of shape ``(H, W)`` equals its rotation by 180 degrees or a mirror image."""
    return any(
        np.array_equal(cells, twin) for twin in (cells[::-1, ::-1], cells[::-1], cells[:, ::-1])
    )


def _title(owner: object) -> str:
    return type(owner).__name__.lower()
