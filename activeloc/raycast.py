"""Exact ray casting through an occupancy grid.

Kernels measure in cells, along the column (x) and row (y) axes; whoever calls one has checked its
arguments, so kernels check nothing and raise nothing. :func:`cast_scan` is the same in metres.

An obstacle is a *closed* square: a beam stops at the first point that it touches, so none slips
between two squares that meet in a corner. A beam that starts on the edge of an obstacle leaves it
freely and is stopped at once when it runs along the edge or into it. Beams that pass a corner
within ``EPS`` of a cell touch it.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.grid import OccupancyGrid

EPS = 1e-9


@njit(cache=True, nogil=True)
def _stops(blocked: NDArray[np.bool_], row: int, col: int) -> bool:
    """Whether a cell stops a beam; the grid's outside does."""
    return not (0 <= row < blocked.shape[0] and 0 <= col < blocked.shape[1]) or blocked[row, col]


@njit(cache=True, nogil=True)
def _first_cell(start: float, direction: float) -> int:
    """Index of the cell that a coordinate enters; the one ahead, if it starts on a line."""
    line = np.floor(start + 0.5)
    if abs(start - line) <= EPS:
        return int(line) if direction >= 0.0 else int(line) - 1
    return int(np.floor(start))


@njit(cache=True, nogil=True)
def _cast_along_axis(
    blocked: NDArray[np.bool_], across: float, start: float, step: int, by_row: bool
) -> float:
    """Range of a beam parallel to an axis; on a grid line it touches the cells of both sides."""
    line = np.floor(across + 0.5)
    if abs(across - line) <= EPS:
        first, last = int(line) - 1, int(line)
    else:
        first = last = int(np.floor(across))
    along = _first_cell(start, step)
    while True:
        for lane in range(first, last + 1):
            row, col = (along, lane) if by_row else (lane, along)
            if _stops(blocked, row, col):
                return max(0.0, (along - start) if step > 0 else (start - along - 1))
        along += step


@njit(cache=True, nogil=True)
def cast_ray(
    blocked: NDArray[np.bool_], x: float, y: float, dx: float, dy: float, z_max: float
) -> float:
    """Distance along one beam to the first blocked cell, or ``z_max``.

    Visits each crossed cell once (Amanatides & Woo, "A fast voxel traversal algorithm for ray
    tracing", 1987), and at a corner the three cells that meet the beam's own there.

    Args:
        blocked: ``(H, W)``; row is ``floor(y)``, column is ``floor(x)``.
        x: Start, anywhere; outside the grid the range is 0.
        y: Start.
        dx: Unit heading along the columns.
        dy: Unit heading along the rows.
        z_max: Longest range reported.
    """
    if abs(dx) < 1e-14:
        return min(z_max, _cast_along_axis(blocked, x, y, 1 if dy > 0.0 else -1, True))
    if abs(dy) < 1e-14:
        return min(z_max, _cast_along_axis(blocked, y, x, 1 if dx > 0.0 else -1, False))
    col, row = _first_cell(x, dx), _first_cell(y, dy)
    if _stops(blocked, row, col):
        return 0.0
    col_step = 1 if dx > 0.0 else -1
    row_step = 1 if dy > 0.0 else -1
    per_col, per_row = 1.0 / dx, 1.0 / dy
    # Ranges at which the beam next crosses a vertical and a horizontal grid line; the lines are
    # counted, not the ranges added up, so no error accumulates along the way.
    next_col = (col + (dx > 0.0) - x) * per_col
    next_row = (row + (dy > 0.0) - y) * per_row
    while True:
        if next_col < next_row - EPS:
            z = next_col
            col += col_step
            if z >= z_max:
                return z_max
            if _stops(blocked, row, col):
                return z
            next_col = (col + (dx > 0.0) - x) * per_col
        elif next_row < next_col - EPS:
            z = next_row
            row += row_step
            if z >= z_max:
                return z_max
            if _stops(blocked, row, col):
                return z
            next_row = (row + (dy > 0.0) - y) * per_row
        else:
            z = min(next_col, next_row)
            if z >= z_max:
                return z_max
            if (
                _stops(blocked, row, col + col_step)
                or _stops(blocked, row + row_step, col)
                or _stops(blocked, row + row_step, col + col_step)
            ):
                return z
            col += col_step
            row += row_step
            next_col = (col + (dx > 0.0) - x) * per_col
            next_row = (row + (dy > 0.0) - y) * per_row


@njit(cache=True, nogil=True)
def cast_beams(
    blocked: NDArray[np.bool_],
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    z_max: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out[i, b]`` with the range of beam ``b`` from pose ``i``, all in cells.

    Args:
        blocked: ``(H, W)``.
        poses: ``(N, 3)`` of column, row (continuous) and heading [rad].
        bearings: ``(B,)`` of beam angles relative to the heading [rad].
        z_max: Longest range reported.
        out: ``(N, B)``, overwritten.
    """
    for i in range(poses.shape[0]):
        for b in range(bearings.shape[0]):
            angle = poses[i, 2] + bearings[b]
            out[i, b] = cast_ray(
                blocked, poses[i, 0], poses[i, 1], np.cos(angle), np.sin(angle), z_max
            )


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
    poses = np.asarray(poses, dtype=np.float64)
    flat = poses.reshape(-1, 3)
    in_cells = np.column_stack([grid.to_cells(flat[:, :2]), flat[:, 2]])
    out = np.empty((len(flat), len(bearings)))
    bearings = np.ascontiguousarray(bearings, dtype=np.float64)
    cast_beams(grid.blocked, in_cells, bearings, z_max / grid.resolution, out)
    # Sensors compare with z_max, which (z_max / resolution) * resolution may miss by a rounding.
    out = np.where(out >= z_max / grid.resolution, z_max, out * grid.resolution)
    return out.reshape(*poses.shape[:-1], len(bearings))
