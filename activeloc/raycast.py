"""Exact ray casting through an occupancy grid.

Kernels measure in cells, along the column (x) and row (y) axes; whoever calls one has checked its
arguments, so kernels check nothing and raise nothing. Scans are in metres.

An obstacle is a *closed* square: a beam stops at the first point that it touches, so none slips
between two squares that meet in a corner. A beam that starts on the edge of an obstacle leaves it
freely and is stopped at once when it runs along the edge or into it. Beams that pass a corner
within ``EPS`` of a cell touch it.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.free_squares import LONGEST
from activeloc.grid import OccupancyGrid

EPS = 1e-9
NEAR = 1e-6  # Wider than EPS and all rounding.


@njit(cache=True, nogil=True)
def _first_cell(start: float, direction: float) -> int:
    """Index of the cell that a coordinate enters; the one ahead, if it starts on a line."""
    line = np.floor(start + 0.5)
    if abs(start - line) <= EPS:
        return int(line) if direction >= 0.0 else int(line) - 1
    return int(np.floor(start))


@njit(cache=True, nogil=True)
def _cast_along_axis(
    squares: NDArray[np.uint8], across: float, start: float, step: int, by_row: bool
) -> float:
    """Range of a beam parallel to an axis; on a grid line it touches the cells of both sides."""
    line = np.floor(across + 0.5)
    if abs(across - line) <= EPS:
        first, last = int(line) - 1, int(line)
    else:
        first = last = int(np.floor(across))
    along = _first_cell(start, step)
    height, width = squares.shape[1] - 2, squares.shape[2] - 2
    length, lanes = (height, width) if by_row else (width, height)
    if not (0 <= along < length and first >= 0 and last < lanes):
        return max(0.0, (along - start) if step > 0 else (start - along - 1))
    quadrant = 0 if step > 0 else 3
    leap = 1
    while leap > 0:
        leap = LONGEST
        for lane in range(first, last + 1):
            row, col = (along, lane) if by_row else (lane, along)
            leap = min(leap, int(squares[quadrant, row + 1, col + 1]))
        along += leap * step
    return max(0.0, (along - start) if step > 0 else (start - along - 1))


@njit(cache=True, nogil=True)
def cast_ray(
    squares: NDArray[np.uint8], x: float, y: float, dx: float, dy: float, z_max: float
) -> float:
    """Distance along one beam to the first blocked cell, or ``z_max``.

    The beam leaps from one free square to the next, and is followed cell by cell (Amanatides & Woo,
    "A fast voxel traversal algorithm for ray tracing", 1987) where a leap would end within ``NEAR``
    of a corner; there it meets three cells besides its own. Only the grid line that it ends at is
    used for the range, so the leaps leave no trace in it.

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`activeloc.free_squares.free_squares`. The row is
            ``floor(y)``, the column ``floor(x)``.
        x: Start, anywhere; outside the grid the range is 0.
        y: Start.
        dx: Unit heading along the columns.
        dy: Unit heading along the rows.
        z_max: Longest range reported.
    """
    if abs(dx) < 1e-14:
        return min(z_max, _cast_along_axis(squares, x, y, 1 if dy > 0.0 else -1, True))
    if abs(dy) < 1e-14:
        return min(z_max, _cast_along_axis(squares, y, x, 1 if dx > 0.0 else -1, False))
    col, row = _first_cell(x, dx), _first_cell(y, dy)
    if not (0 <= row < squares.shape[1] - 2 and 0 <= col < squares.shape[2] - 2):
        return 0.0
    ahead = squares[(0 if dx > 0.0 else 1) + (0 if dy > 0.0 else 2)]
    col_step, row_step = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    # From a cell's index to the grid line behind which it is entered.
    col_line, row_line = (0 if dx > 0.0 else 1), (0 if dy > 0.0 else 1)
    per_col, per_row = 1.0 / dx, 1.0 / dy
    z, beyond = 0.0, z_max + NEAR  # At a corner the other line may be met a little sooner.
    while True:
        # Unsigned, for numba looks after negative indices.
        side = int(ahead[np.uint64(row + 1), np.uint64(col + 1)])
        if side == 0:
            return min(z, z_max)
        next_col, next_row = col + side * col_step, row + side * row_step
        # Lines are counted, not ranges added up, so no error accumulates along the way.
        z_col = (next_col + col_line - x) * per_col
        z_row = (next_row + row_line - y) * per_row
        # Two branches: the processor guesses better than it waits.
        if z_col < z_row:
            z = z_col
            if z >= beyond:
                return z_max
            beside = y + z * dy
            cell = int(beside)
            if NEAR < beside - cell < 1.0 - NEAR:
                col, row = next_col, cell
                continue
        else:
            z = z_row
            if z >= beyond:
                return z_max
            beside = x + z * dx
            cell = int(beside)
            if NEAR < beside - cell < 1.0 - NEAR:
                col, row = cell, next_row
                continue
        next_col, next_row = col + col_step, row + row_step
        z_col = (next_col + col_line - x) * per_col
        z_row = (next_row + row_line - y) * per_row
        z = min(z_col, z_row)
        col_first, row_first = z_col < z_row - EPS, z_row < z_col - EPS
        if (
            not col_first
            and not row_first
            and (
                ahead[np.uint64(row + 1), np.uint64(next_col + 1)] == 0
                or ahead[np.uint64(next_row + 1), np.uint64(col + 1)] == 0
            )
        ):
            return min(z, z_max)
        col, row = col if row_first else next_col, row if col_first else next_row


@njit(cache=True, nogil=True)
def cast_beams(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    z_max: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out[i, b]`` with the range of beam ``b`` from pose ``i`` [m].

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`cast_ray`.
        frame: x and y of the map's corner, and its resolution [m].
        poses: ``(N, 3)`` of x, y [m] and heading [rad].
        bearings: ``(B,)`` of beam angles relative to the heading [rad].
        z_max: Longest range reported [m].
        out: ``(N, B)``, overwritten.
    """
    cos, sin, reach = np.cos(bearings), np.sin(bearings), z_max / frame[2]
    for i in range(poses.shape[0]):
        x, y = (poses[i, 0] - frame[0]) / frame[2], (poses[i, 1] - frame[1]) / frame[2]
        ahead, aside = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        for b in range(bearings.shape[0]):
            dx, dy = ahead * cos[b] - aside * sin[b], aside * cos[b] + ahead * sin[b]
            z = cast_ray(squares, x, y, dx, dy, reach)
            # Sensors compare with z_max, which reach * resolution may miss by a rounding.
            out[i, b] = z_max if z >= reach else z * frame[2]


def cast_scan(
    grid: OccupancyGrid, poses: NDArray[np.float64], bearings: NDArray[np.float64], z_max: float
) -> NDArray[np.float64]:
    """Noise-free ranges from each pose: ``(..., B)`` [m].

    Args:
        grid: The map.
        poses: ``(..., 3)`` of x [m], y [m], theta [rad].
        bearings: ``(B,)`` of beam angles relative to the heading [rad].
        z_max: Longest range reported [m].
    """
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    bearings = np.ascontiguousarray(bearings, dtype=np.float64)
    out = np.empty((*poses.shape[:-1], len(bearings)))
    flat = out.reshape(-1, len(bearings))
    cast_beams(grid.squares, grid.frame, poses.reshape(-1, 3), bearings, z_max, flat)
    return out
