"""Caves: no straight wall, no right angle, no two places alike."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from activeloc import checks
from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.maps.parameters import (
    MAX_TRIES,
    ROBOT_RADIUS,
    check_area,
    demand,
    give_up,
    is_one_space,
)
from activeloc.maps.plan import Lattice

BORDER = 0.1  # Rock around the map [m].


@dataclass(frozen=True, slots=True)
class Cave:
    """A cellular automaton's cave, smoothed, of which one connected part is kept.

    Coarse cells start as rock with probability ``rock``; at each of ``rounds`` a cell becomes what
    most of the nine cells around it are. The outcome is drawn finely with its corners rounded. Of
    the free space, what the robot's disc sweeps in the largest part that it can travel remains.

    Attributes:
        width: Of the map, along x [m].
        height: Of the map, along y [m].
        rock: Probability that a coarse cell starts as rock.
        rounds: Of the automaton; more give wider halls and smoother walls.
        grain: Side of a coarse cell [m].
        min_share: Least share of the map that must be free.
        resolution: Side of a cell of the map [m].
    """

    width: float = 24.0
    height: float = 16.0
    rock: float = 0.45
    rounds: int = 4
    grain: float = 0.4
    min_share: float = 0.35
    resolution: float = 0.05

    def __post_init__(self) -> None:
        """Refuse parameters that give no cave."""
        checks.number("cave width", self.width, 3.0, 1e3)
        checks.number("cave height", self.height, 3.0, 1e3)
        checks.number("cave rock", self.rock, 0.2, 0.6)
        checks.integer("cave rounds", self.rounds, 0, 100)
        checks.number("cave grain", self.grain, 0.1, 5.0)
        checks.number("cave min_share", self.min_share, 0.0, 0.9)
        checks.number("cave resolution", self.resolution, 0.01, 0.2)
        demand(
            self,
            self.grain >= 2.0 * self.resolution,
            f"grain must be at least twice the resolution of {self.resolution:g} m, "
            f"got {self.grain:g} m",
        )
        check_area(self, self.width, self.height, self.resolution)

    def generate(self, rng: np.random.Generator) -> OccupancyGrid:
        """Draw a cave.

        Raises:
            ConfigError: If no draw left ``min_share`` of the map free.
        """
        for _ in range(MAX_TRIES):
            rock = self._draw(rng)
            if 1.0 - rock.mean() <= self.min_share:
                continue
            try:
                grid = _keep_one_space(
                    OccupancyGrid(rock.astype(np.uint8), self.resolution, name="cave")
                )
            except MapError:  # Nowhere is there room for the robot.
                continue
            # The swept floor may hold a place where the disc fits but that it cannot get to.
            if grid.free.mean() >= self.min_share and is_one_space(grid):
                return grid
        raise give_up(self, f"cave with {self.min_share:g} of the map free")

    def _draw(self, rng: np.random.Generator) -> NDArray[np.bool_]:
        """``(H, W)``; where the rock is before unreachable parts are filled."""
        shape = (round(self.height / self.resolution), round(self.width / self.resolution))
        zoom = self.grain / self.resolution
        coarse = rng.random([ceil(n / zoom) + 1 for n in shape]) < self.rock
        for _ in range(self.rounds):
            n_rock = ndimage.convolve(coarse.astype(np.int8), np.ones((3, 3), np.int8), cval=1)
            coarse = n_rock >= 5
        row, col = ((np.arange(n) / zoom).astype(np.intp) for n in shape)
        fine = coarse[np.ix_(row, col)].astype(np.float32)
        smooth = ndimage.gaussian_filter(fine, 0.5 * zoom, mode="constant", cval=1.0)
        rock = smooth > 0.5
        border = Lattice(self.resolution).up(BORDER)
        inner = (slice(border, -border), slice(border, -border))
        return np.pad(rock[inner], border, constant_values=True)


def _keep_one_space(grid: OccupancyGrid) -> OccupancyGrid:
    """The map whose free space is what a robot's disc sweeps in its largest part."""
    disc = _disc(ROBOT_RADIUS / grid.resolution)
    swept = ndimage.binary_dilation(grid.passable(ROBOT_RADIUS), disc) & grid.free
    return OccupancyGrid((~swept).astype(np.uint8), grid.resolution, name=grid.name)


def _disc(radius: float) -> NDArray[np.bool_]:
    """The squares that a disc around the middle one's centre touches, its radius in cells."""
    reach = ceil(radius)
    gap = np.maximum(np.abs(np.arange(-reach, reach + 1)) - 0.5, 0.0)
    touched: NDArray[np.bool_] = np.hypot(gap[:, None], gap) <= radius + 1e-9
    return touched
