"""The ground of a picture: the map, tinted by the belief over it, strewn with particles.

Colours of the belief are absolute: one shade means one probability in every frame of a map, so a
film shows a belief sharpen instead of re-scaling it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from activeloc.envs.rendering.marks import BELIEF_COLOURS, PARTICLE, SOLID, UNKNOWN, WALL, WHITE
from activeloc.envs.rendering.scene import Layout, Scene
from activeloc.grid import Cell, OccupancyGrid

UNIFORM_SHADE = 0.2
_FAINTEST = 0.01
"""A place this many times as likely as under the uniform belief is white."""


def draw_ground(scene: Scene, place: Layout) -> NDArray[np.uint8]:
    """Map, belief and particles: ``(H, W, 3)``, the map's part of the frame."""
    return _particles(scene, place, _tinted(scene, place))


@lru_cache(maxsize=8)
def _background(grid: OccupancyGrid, map_size: tuple[int, int], rim: int) -> NDArray[np.uint8]:
    """The map alone: ``(H, W, 3)``, read-only.

    Args:
        grid: The map.
        map_size: Width and height [px].
        rim: Walls are dark up to this far from free space, and lighter behind [px].
    """
    # Walls thinner than a pixel stay dark: a cell counts for the pixels it stands for.
    boost = float(np.clip(grid.shape[1] / map_size[0], 1.0, 3.0))
    wall = np.minimum(boost * _share(grid, Cell.OCCUPIED, map_size), 1.0)
    unknown = _share(grid, Cell.UNKNOWN, map_size)
    free = Image.fromarray(_share(grid, Cell.FREE, map_size)[..., 0] > 0.0).convert("L")
    near = np.asarray(free.filter(ImageFilter.MaxFilter(2 * rim + 1)))[..., None] > 0
    floor = (1.0 - unknown) * np.array(WHITE) + unknown * np.array(UNKNOWN)
    picture = (1.0 - wall) * floor + wall * np.where(near, WALL, SOLID)
    result: NDArray[np.uint8] = picture.round().astype(np.uint8)
    result.flags.writeable = False
    return result


def _share(grid: OccupancyGrid, cell: Cell, map_size: tuple[int, int]) -> NDArray[np.float64]:
    """How much of each pixel is of one kind: ``(H, W, 1)``, the map's top row first."""
    mask = Image.fromarray((grid.cells[::-1] == cell).astype(np.uint8) * 255)
    shrunk = np.asarray(mask.resize(map_size, Image.Resampling.BOX))
    result: NDArray[np.float64] = shrunk[..., None] / 255.0
    return result


def _tinted(scene: Scene, place: Layout) -> NDArray[np.uint8]:
    """The map, coloured by the belief: ``(H, W, 3)``."""
    marginal, resolution = scene.marginal, scene.belief_resolution
    pool = max(1, int(1.0 / (resolution * place.scale)))
    if pool > 1:  # No cell is finer than a pixel.
        marginal, resolution = pooled(marginal, pool), resolution * pool
    shade = Image.fromarray(shades_of(marginal, places_of(scene.grid, resolution)))
    fitted = _fitted(shade, resolution, scene.belief_origin, place)
    background = _background(scene.grid, place.map_size, round(4.0 * place.unit) + 1)
    product = background.astype(np.uint16) * BELIEF_COLOURS[np.asarray(fitted)]
    result: NDArray[np.uint8] = (product // 255).astype(np.uint8)
    return result


def _fitted(
    shade: Image.Image, resolution: float, origin: tuple[float, float], place: Layout
) -> Image.Image:
    """An image of the belief's cells, row 0 the lowest, laid over the map; white beyond them.

    Cells are blended into one another, unless they are so large that they are a picture themselves.
    """
    x_min, x_max, y_min, y_max = place.extent
    width, height = place.map_size
    # From pixels to cells: affine in each axis.
    right, down = (x_max - x_min) / width / resolution, (y_min - y_max) / height / resolution
    left, top = (x_min - origin[0]) / resolution, (y_max - origin[1]) / resolution
    large = place.scale * resolution > 12.0 * place.unit
    filtering = Image.Resampling.NEAREST if large else Image.Resampling.BILINEAR
    affine = (right, 0.0, left, 0.0, down, top)
    return shade.transform(place.map_size, Image.Transform.AFFINE, affine, filtering)


def pooled(belief: NDArray[np.floating], pool: int) -> NDArray[np.floating]:
    """Sums of ``(..., R, C)`` over squares of ``pool`` cells a side; the last may be filled up."""
    *before, rows, cols = belief.shape
    padded = np.pad(belief, [(0, 0)] * len(before) + [(0, -rows % pool), (0, -cols % pool)])
    blocks = padded.reshape(*before, padded.shape[-2] // pool, pool, -1, pool)
    result: NDArray[np.floating] = blocks.sum(axis=(-3, -1))
    return result


def places_of(grid: OccupancyGrid, resolution: float) -> float:
    """How many cells of a belief the map's free ground fills, at least 2."""
    free_area = grid.free.sum() * grid.resolution**2
    return max(float(free_area / resolution**2), 2.0)


def shades_of(p: NDArray[np.floating], n: float) -> NDArray[np.uint8]:
    """Probabilities to shades, 0 to 255, on a scale of logarithms.

    255 is certainty, :data:`UNIFORM_SHADE` of that the uniform belief over ``n`` cells, zero a
    hundredth of the uniform belief.
    """
    lift = np.log(np.maximum(p * n, 1e-12))
    at = [np.log(_FAINTEST), 0.0, np.log(n)]
    return (255.0 * np.interp(lift, at, [0.0, UNIFORM_SHADE, 1.0])).astype(np.uint8)


def probabilities_of(shades: NDArray[np.uint8], n: float) -> NDArray[np.float64]:
    """What :func:`shades_of` turns into these shades: the middle of each one's interval."""
    middle = np.where(shades > 0, (shades + 0.5) / 255.0, -1.0)
    lift = np.interp(middle, [0.0, UNIFORM_SHADE, 1.0], [np.log(_FAINTEST), 0.0, np.log(n)])
    result: NDArray[np.float64] = np.where(shades > 0, np.exp(lift) / n, 0.0)
    return result


def _particles(scene: Scene, place: Layout, ground: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The ground with a dot per particle, the fainter the more there are."""
    if scene.particles is None or len(scene.particles) == 0:
        return ground
    (width, height), n = place.map_size, len(scene.particles)
    dot = max(1, round(1.5 * place.unit))
    at = place.to_pixels(scene.particles[:, :2]) - (dot - 1) / 2
    corner = np.floor(at[((at > -dot) & (at < place.map_size)).all(axis=1)]).astype(int)
    counts = np.zeros(width * height)
    for dx, dy in np.ndindex(dot, dot):
        col, row = corner[:, 0] + dx, corner[:, 1] + dy
        seen = (col >= 0) & (col < width) & (row >= 0) & (row < height)
        counts += np.bincount((row * width + col)[seen], minlength=width * height)
    opacity = 1.0 - (1.0 - np.clip(1500.0 / n, 0.15, 0.6)) ** counts.reshape(height, width, 1)
    mixed = (1.0 - opacity) * ground + opacity * np.array(PARTICLE)
    result: NDArray[np.uint8] = mixed.astype(np.uint8)
    return result
