"""Maps drawn with characters: ``#`` occupied, ``.`` or space free, ``?`` unknown.

The first line is the top of the map, where y is largest, so a map reads as it looks::

    #####
    #..?#
    #.###
    #####

A text says neither its resolution nor its origin; whoever reads it does.
"""

from __future__ import annotations

import numpy as np

from activeloc.errors import MapError
from activeloc.grid import MAX_CELLS, Cell, OccupancyGrid

_CELL_OF = {"#": Cell.OCCUPIED, ".": Cell.FREE, " ": Cell.FREE, "?": Cell.UNKNOWN}
_CHARACTER_OF = np.array([".", "#", "?"])


def from_text(
    text: str,
    resolution: float = 1.0,
    origin: tuple[float, float] = (0.0, 0.0),
    name: str = "text",
) -> OccupancyGrid:
    """Read a map from lines of equal length.

    Args:
        text: The lines; empty lines before the first and after the last are ignored.
        resolution: Side of a cell [m].
        origin: x and y of the lower left corner of the last line's first character [m].
        name: What to call the map.

    Raises:
        MapError: If a line is longer or shorter than the first or has a foreign character, or
            :class:`OccupancyGrid` refuses the map.
    """
    if len(text) > 2 * MAX_CELLS:
        raise MapError(f"{name}: {len(text)} characters; at most {MAX_CELLS} cells are allowed")
    lines = [line.removesuffix("\r") for line in text.split("\n")]
    drawn = [number for number, line in enumerate(lines) if line]
    if not drawn:
        raise MapError(f"{name}: the text is empty; expected lines of '#', '.', ' ' and '?'")
    first, last = drawn[0], drawn[-1]
    width = len(lines[first])
    rows = []
    for number in range(first, last + 1):
        line = lines[number]
        if len(line) != width:
            raise MapError(
                f"{name}, line {number + 1}: {len(line)} characters; all lines must have as many "
                f"as line {first + 1}, {width}"
            )
        rows.append(_cells_of(line, f"{name}, line {number + 1}"))
    return OccupancyGrid(np.array(rows[::-1], dtype=np.uint8), resolution, origin, name)


def to_text(grid: OccupancyGrid) -> str:
    """Draw a map; a line for each row, from the top, each ended by a newline."""
    return "".join("".join(row) + "\n" for row in _CHARACTER_OF[grid.cells[::-1]])


def _cells_of(line: str, where: str) -> list[Cell]:
    """The cells of one line."""
    foreign = set(line) - set(_CELL_OF)
    if foreign:
        column = min(line.index(character) for character in foreign)
        raise MapError(
            f"{where}: character {line[column]!r} in column {column + 1}; "
            "allowed are '#', '.', ' ' and '?'"
        )
    return [_CELL_OF[character] for character in line]
