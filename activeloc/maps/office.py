"""Office buildings: corridors lined with rooms that look alike, but for a few."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from activeloc import checks
from activeloc.grid import OccupancyGrid
from activeloc.maps.parameters import (
    MAX_TRIES,
    check_area,
    demand,
    give_up,
    is_one_space,
    is_symmetric,
)
from activeloc.maps.plan import Box, FloorPlan, Lattice

JAMB = 0.3  # Wall between a door and the nearest corner of its room [m].
RECESS = 0.7  # How far the front of a recessed room stands back [m].
DESK = (1.6, 0.8)  # Along the back wall and out from it [m].
CABINET = (0.5, 1.0)  # Out from a side wall and along it [m].
CHANGES = ("door", "alcove", "merge", "desk", "cabinet")


class _Size(NamedTuple):
    """An office's parameters in cells."""

    room_width: int
    room_depth: int
    corridor: int
    door: int
    wall: int
    jamb: int
    recess: int

    @property
    def storey(self) -> int:
        """From the bottom of a row of rooms to the bottom of the next."""
        return self.room_depth + self.corridor + 2 * self.wall


@dataclass(frozen=True, slots=True)
class _Room:
    """A room: its box with the wall in front not counted, where its door is, what is odd in it."""

    row: int
    column: int
    box: Box
    faces_up: bool
    door_left: int
    recess: int = 0

    def inside(self) -> Box:
        """The floor, which a recessed front cuts short."""
        if self.faces_up:
            return self.box._replace(top=self.box.top - self.recess)
        return self.box._replace(bottom=self.box.bottom + self.recess)


@dataclass(frozen=True, slots=True)
class Office:
    """Rows of rooms of one size with a corridor between any two rows.

    All doors are at the same place of their rooms, and a row is the one across the corridor turned
    by 180 degrees, so that what a short-sighted robot sees in one place it sees in many. Rooms
    between two corridors open to the one and the other in turn; two cross corridors link the two.
    A few rooms differ: the door is at the other corner, the front stands back from the corridor,
    the wall to the next room is missing, there is a desk or a cabinet. These differences make the
    building unlike its own rotation and its mirror images.

    Attributes:
        rooms: Along one side of a corridor.
        corridors: Number of corridors; there is one row of rooms more.
        room_width: Along the corridor [m].
        room_depth: Away from the corridor [m].
        corridor: Width of a corridor [m].
        door: Width of a door [m].
        wall: Thickness of a wall [m].
        changes: Number of rooms that differ.
        resolution: Side of a cell [m].
    """

    rooms: int = 7
    corridors: int = 2
    room_width: float = 3.4
    room_depth: float = 3.4
    corridor: float = 1.8
    door: float = 0.9
    wall: float = 0.15
    changes: int = 6
    resolution: float = 0.05

    def __post_init__(self) -> None:
        """Refuse buildings that cannot be built, or that the robot could not walk through."""
        checks.integer("office rooms", self.rooms, 2, 200)
        checks.integer("office corridors", self.corridors, 1, 20)
        checks.number("office room_width", self.room_width, 2.4, 20.0)
        checks.number("office room_depth", self.room_depth, 2.4, 20.0)
        checks.number("office corridor", self.corridor, 1.0, 10.0)
        checks.number("office door", self.door, 0.6, 5.0)
        checks.number("office wall", self.wall, 0.1, 1.0)
        checks.integer("office changes", self.changes, 1, 10_000)
        checks.number("office resolution", self.resolution, 0.01, 0.1)
        widest = self.room_width - 2.0 * JAMB
        demand(
            self,
            self.door <= widest,
            f"door must be at most room_width less {2.0 * JAMB:g} m, {widest:g} m, "
            f"got {self.door:g}",
        )
        if self.corridors > 1:
            demand(self, self.rooms >= 4, f"rooms must be at least 4, got {self.rooms}")
            demand(
                self,
                self.corridor <= self.room_width,
                f"corridor must be at most room_width, {self.room_width:g} m, "
                f"for the cross corridors, got {self.corridor:g}",
            )
        n_rooms = self.rooms * (self.corridors + 1) - 2 * (self.corridors - 1)
        demand(
            self,
            self.changes <= n_rooms,
            f"changes must be at most the number of rooms, {n_rooms}, got {self.changes}",
        )
        width = self.rooms * (self.room_width + self.wall) + self.wall
        height = (self.corridors + 1) * (self.room_depth + 2.0 * self.wall + self.corridor)
        check_area(self, width, height, self.resolution)

    def generate(self, rng: np.random.Generator) -> OccupancyGrid:
        """Draw a building.

        Raises:
            ConfigError: If every draw was symmetric or shut the robot out of some place.
        """
        size = self._size()
        for _ in range(MAX_TRIES):
            grid = self._draw(size, rng).to_grid(self.resolution, "office")
            if is_one_space(grid) and not is_symmetric(grid.cells):
                return grid
        raise give_up(self, "building without symmetry that is one space")

    def _size(self) -> _Size:
        lattice = Lattice(self.resolution)
        return _Size(
            room_width=lattice.near(self.room_width),
            room_depth=lattice.near(self.room_depth),
            corridor=lattice.near(self.corridor),
            door=lattice.up(self.door),
            wall=lattice.up(self.wall),
            jamb=lattice.near(JAMB),
            recess=lattice.near(RECESS),
        )

    def _draw(self, size: _Size, rng: np.random.Generator) -> FloorPlan:
        width = self.rooms * (size.room_width + size.wall) + size.wall
        height = self.corridors * size.storey + size.room_depth + 2 * size.wall
        plan = FloorPlan(width, height)
        for number in range(self.corridors):
            bottom = number * size.storey + size.room_depth + 2 * size.wall
            plan.carve(Box(size.wall, bottom, width - size.wall, bottom + size.corridor))
        links = self._carve_links(plan, size, rng)
        rooms = self._rooms(size, links, rng)
        changed = self._choose(rooms, rng)
        for kind in ("door", "alcove"):
            for number in changed[kind]:
                rooms[number] = _rebuilt(rooms[number], kind, size)
        for room in rooms:
            _carve_room(plan, room, size)
        for number in changed["merge"]:
            if not _merge(plan, rooms, number, rng):
                changed["desk"].append(number)
        for kind in ("desk", "cabinet"):
            for number in changed[kind]:
                _furnish(plan, rooms[number], kind, Lattice(self.resolution), rng)
        return plan

    def _carve_links(
        self, plan: FloorPlan, size: _Size, rng: np.random.Generator
    ) -> set[tuple[int, int]]:
        """Carve two cross corridors through each inner row; row and column of the rooms lost."""
        links = set()
        half = self.rooms // 2
        for row in range(1, self.corridors):
            for column in (rng.integers(half), rng.integers(half, self.rooms)):
                box = _box(row, int(column), size)
                left = box.left + int(rng.integers(2)) * (size.room_width - size.corridor)
                bottom, top = box.bottom - size.wall, box.top + size.wall
                plan.carve(Box(left, bottom, left + size.corridor, top))
                links.add((row, int(column)))
        return links

    def _rooms(
        self, size: _Size, links: set[tuple[int, int]], rng: np.random.Generator
    ) -> list[_Room]:
        """All rooms, alike; the rooms of the inner rows face down and up in turn."""
        at_left = bool(rng.integers(2))
        phase = int(rng.integers(2))
        rooms = []
        for row in range(self.corridors + 1):
            inner = 0 < row < self.corridors
            for column in range(self.rooms):
                if (row, column) in links:
                    continue
                faces_up = (column + phase) % 2 == 0 if inner else row == 0
                near = size.jamb
                far = size.room_width - size.door - size.jamb
                door_left = near if at_left == faces_up else far
                rooms.append(_Room(row, column, _box(row, column, size), faces_up, door_left))
        return rooms

    def _choose(self, rooms: list[_Room], rng: np.random.Generator) -> dict[str, list[int]]:
        """Which rooms change, by the kind of change; the kinds take turns."""
        chosen = rng.permutation(len(rooms))[: self.changes]
        kinds = rng.permutation(CHANGES)
        changed: dict[str, list[int]] = {kind: [] for kind in CHANGES}
        for turn, number in enumerate(chosen):
            changed[str(kinds[turn % len(kinds)])].append(int(number))
        return changed


def _box(row: int, column: int, size: _Size) -> Box:
    """The inside of a room."""
    left = size.wall + column * (size.room_width + size.wall)
    bottom = size.wall + row * size.storey
    return Box(left, bottom, left + size.room_width, bottom + size.room_depth)


def _rebuilt(room: _Room, kind: str, size: _Size) -> _Room:
    """The room with its door at the other corner, or with its front standing back."""
    if kind == "door":
        return replace(room, door_left=size.room_width - size.door - room.door_left)
    return replace(room, recess=size.recess)


def _carve_room(plan: FloorPlan, room: _Room, size: _Size) -> None:
    """Carve a room, its door and what a recessed front adds to the corridor."""
    inside = room.inside()
    plan.carve(inside)
    if room.faces_up:
        front = Box(inside.left, inside.top, inside.right, inside.top + size.wall)
        niche = Box(front.left, front.top, front.right, room.box.top + size.wall)
    else:
        front = Box(inside.left, inside.bottom - size.wall, inside.right, inside.bottom)
        niche = Box(front.left, room.box.bottom - size.wall, front.right, front.bottom)
    plan.carve(niche)
    door = front.left + room.door_left
    plan.carve(front._replace(left=door, right=door + size.door))


def _merge(plan: FloorPlan, rooms: list[_Room], number: int, rng: np.random.Generator) -> bool:
    """Take away the wall between a room and one beside it; false if there is none beside it."""
    room = rooms[number]
    beside = [r for r in rooms if r.row == room.row and abs(r.column - room.column) == 1]
    if not beside:
        return False
    one, other = room.inside(), beside[rng.integers(len(beside))].inside()
    left, right = sorted((one, other))
    bottom, top = max(one.bottom, other.bottom), min(one.top, other.top)
    plan.carve(Box(left.right, bottom, right.left, top))
    return True


def _furnish(
    plan: FloorPlan, room: _Room, kind: str, lattice: Lattice, rng: np.random.Generator
) -> None:
    """Put a desk to the back wall or a cabinet to a side wall."""
    inside = room.inside()
    along, out = (lattice.near(length) for length in (DESK if kind == "desk" else CABINET))
    if kind == "desk":
        left = inside.left + int(rng.integers(3)) * ((inside.width - along) // 2)
        bottom = inside.bottom if room.faces_up else inside.top - out
    else:
        left = inside.left + int(rng.integers(2)) * (inside.width - along)
        bottom = inside.bottom + (inside.height - out) // 2
    plan.fill(Box(left, bottom, left + along, bottom + out))
