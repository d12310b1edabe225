"""Homes and the like: rooms of all sizes, doors between them, furniture along the walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import Cell, OccupancyGrid
from activeloc.maps.parameters import (
    MAX_TRIES,
    check_area,
    demand,
    give_up,
    is_one_space,
    is_symmetric,
)
from activeloc.maps.plan import Box, FloorPlan, Lattice

JAMB = 0.2  # Least wall between a door and a corner [m].
GAP = 0.7  # Least way between two pieces of furniture, or one and a wall or a door [m].
P_STOP = 0.25  # That a room which could be halved, but not quartered, is left as it is.
PIECES = ((1.6, 0.8), (1.2, 0.45), (2.0, 0.9), (1.0, 1.0), (0.6, 0.6))  # Length and depth [m].


class _Wall(NamedTuple):
    """A wall between two halves; the axis is the one it runs along, 0 for y and 1 for x."""

    box: Box
    axis: int


@dataclass(frozen=True, slots=True)
class Rooms:
    """A rectangle that is halved again and again, never at the same place.

    Each wall gets a door, some a second one, so that all rooms hang together and some lie on a
    loop. Furniture stands against walls or free in the room and leaves a way around it.

    Attributes:
        width: Of the map, along x [m].
        height: Of the map, along y [m].
        smallest: Least side of a room [m].
        door: Width of a door [m].
        wall: Thickness of a wall [m].
        p_second_door: Probability that a wall gets a second door.
        furniture: Most pieces that a room may have.
        resolution: Side of a cell [m].
    """

    width: float = 16.0
    height: float = 11.0
    smallest: float = 2.6
    door: float = 0.9
    wall: float = 0.15
    p_second_door: float = 0.25
    furniture: int = 3
    resolution: float = 0.05

    def __post_init__(self) -> None:
        """Refuse plans that cannot be drawn, or that the robot could not walk through."""
        checks.number("rooms width", self.width, 3.0, 1e3)
        checks.number("rooms height", self.height, 3.0, 1e3)
        checks.number("rooms smallest", self.smallest, 1.5, 100.0)
        checks.number("rooms door", self.door, 0.6, 5.0)
        checks.number("rooms wall", self.wall, 0.1, 1.0)
        checks.number("rooms p_second_door", self.p_second_door, 0.0, 1.0)
        checks.integer("rooms furniture", self.furniture, 0, 100)
        checks.number("rooms resolution", self.resolution, 0.01, 0.1)
        # One cell more: the room's side is rounded down and the door's up.
        widest = self.smallest - 2.0 * (JAMB + self.resolution)
        demand(
            self,
            self.door <= widest,
            f"door must be at most {widest:g} m, for rooms of {self.smallest:g} m, "
            f"got {self.door:g}",
        )
        inside = min(self.width, self.height) - 2.0 * (self.wall + self.resolution)
        demand(
            self,
            self.smallest <= inside,
            f"smallest must be at most {inside:g} m, what fits into the map, got {self.smallest:g}",
        )
        check_area(self, self.width, self.height, self.resolution)

    def generate(self, rng: np.random.Generator) -> OccupancyGrid:
        """Draw a home.

        Raises:
            ConfigError: If every draw was symmetric or shut the robot out of some place.
        """
        for _ in range(MAX_TRIES):
            grid = self._draw(rng).to_grid(self.resolution, "rooms")
            if is_one_space(grid) and not is_symmetric(grid.cells):
                return grid
        raise give_up(self, "plan without symmetry that is one space")

    def _draw(self, rng: np.random.Generator) -> FloorPlan:
        lattice = Lattice(self.resolution)
        wall = lattice.up(self.wall)
        plan = FloorPlan(lattice.near(self.width), lattice.near(self.height))
        height, width = plan.cells.shape
        rooms: list[Box] = []
        walls: list[_Wall] = []
        self._halve(Box(wall, wall, width - wall, height - wall), rooms, walls, rng)
        for room in rooms:
            plan.carve(room)
        doors = self._doors(plan, walls, rng)
        for door in doors:
            plan.carve(door)
        kept_clear = [door.grown(lattice.near(GAP)) for door in doors]
        for room in rooms:
            for _ in range(rng.integers(self.furniture + 1)):
                _furnish(plan, room, kept_clear, lattice, rng)
        return plan

    def _halve(
        self, box: Box, rooms: list[Box], walls: list[_Wall], rng: np.random.Generator
    ) -> None:
        """Split a box across its longer side until it is a room."""
        lattice = Lattice(self.resolution)
        wall, smallest = lattice.up(self.wall), lattice.near(self.smallest)
        length = max(box.width, box.height)
        if length < 2 * smallest + wall:
            rooms.append(box)
            return
        if length < 4 * smallest and rng.random() < P_STOP:
            rooms.append(box)
            return
        cut = int(rng.integers(smallest, length - smallest - wall + 1))
        if box.width >= box.height:
            cut += box.left
            between = _Wall(box._replace(left=cut, right=cut + wall), 0)
            halves = box._replace(right=cut), box._replace(left=cut + wall)
        else:
            cut += box.bottom
            between = _Wall(box._replace(bottom=cut, top=cut + wall), 1)
            halves = box._replace(top=cut), box._replace(bottom=cut + wall)
        walls.append(between)
        for half in halves:
            self._halve(half, rooms, walls, rng)

    def _doors(self, plan: FloorPlan, walls: list[_Wall], rng: np.random.Generator) -> list[Box]:
        """A door or two for each wall, where both sides of it are a room's and not a corner's."""
        lattice = Lattice(self.resolution)
        width, jamb = lattice.up(self.door), lattice.near(JAMB)
        doors = []
        for wall in walls:
            starts = _door_starts(plan, wall, width, jamb)
            start = int(rng.choice(starts))
            doors.append(_door(wall, start, width))
            # A second door at the first one's side would be a wide door.
            far = starts[np.abs(starts - start) >= 3 * width]
            if len(far) and rng.random() < self.p_second_door:
                doors.append(_door(wall, int(rng.choice(far)), width))
        return doors


def _door_starts(plan: FloorPlan, wall: _Wall, width: int, jamb: int) -> NDArray[np.intp]:
    """Where along a wall a door may begin, from the wall's beginning."""
    box, free = wall.box, plan.cells == Cell.FREE
    if wall.axis == 0:
        both = free[box.bottom : box.top, box.left - 1] & free[box.bottom : box.top, box.right]
    else:
        both = free[box.bottom - 1, box.left : box.right] & free[box.top, box.left : box.right]
    needed = width + 2 * jamb
    windows = np.lib.stride_tricks.sliding_window_view(both, needed)
    return np.flatnonzero(windows.all(axis=-1)) + jamb


def _door(wall: _Wall, start: int, width: int) -> Box:
    """The part of a wall that a door takes."""
    box = wall.box
    if wall.axis == 0:
        return box._replace(bottom=box.bottom + start, top=box.bottom + start + width)
    return box._replace(left=box.left + start, right=box.left + start + width)


def _furnish(
    plan: FloorPlan, room: Box, kept_clear: list[Box], lattice: Lattice, rng: np.random.Generator
) -> None:
    """Place one piece, unless the place drawn for it is in the way."""
    length, depth = (lattice.near(metres) for metres in PIECES[rng.integers(len(PIECES))])
    if rng.integers(2):
        length, depth = depth, length
    gap = lattice.near(GAP)
    left = _place(room.left, room.right, length, gap, rng)
    bottom = _place(room.bottom, room.top, depth, gap, rng)
    piece = Box(left, bottom, left + length, bottom + depth)
    fits = room.grown(0, piece) == piece
    in_the_way = any(_overlap(piece, zone) for zone in kept_clear)
    if fits and not in_the_way and plan.is_free(piece.grown(gap, room)):
        plan.fill(piece)


def _place(low: int, high: int, length: int, gap: int, rng: np.random.Generator) -> int:
    """Where a piece begins between two walls: against one of them, or a way from both."""
    start = low + int(rng.integers(max(high - low - length, 0) + 1))
    if start - low < gap:
        return low
    return high - length if high - length - start < gap else start


def _overlap(one: Box, other: Box) -> bool:
    """Whether two boxes share a cell."""
    return (
        one.left < other.right
        and other.left < one.right
        and one.bottom < other.top
        and other.bottom < one.top
    )
