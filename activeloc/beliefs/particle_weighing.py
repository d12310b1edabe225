"""Kernels that weigh particles by a scan."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.range_table import LEVELS, cast_level, cell_of, directions_of
from activeloc.raycast import cast_beams

POINT = 32  # Bits behind the point.


@njit(cache=True, nogil=True)
def weigh_by_table(
    table: NDArray[np.uint8],
    index: NDArray[np.int32],
    squares: NDArray[np.uint8],
    headings: NDArray[np.float64],
    frame: NDArray[np.float64],
    reach: float,
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    log_p: NDArray[np.float32],
    log_w: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        table: ``(C, D)``; see :class:`activeloc.range_table.RangeTable` for these six.
        index: ``(H, W)``.
        squares: ``(4, H + 2, W + 2)``; of the map.
        headings: ``(D, 2)``.
        frame: ``(3,)``.
        reach: [cell].
        poses: ``(N, 3)``.
        bearings: ``(B,)`` of the readings that count [rad].
        log_p: ``(B, LEVELS)``; weighted log P(what beam b read | level of the range).
        log_w: ``(N,)``, overwritten.
    """
    n_directions, n_beams = table.shape[1], bearings.shape[0]
    # Directions in fixed point, for integers are added and cut sooner than numbers are rounded.
    circle = n_directions << POINT
    offset, fraction = np.empty(n_beams, dtype=np.int64), np.empty(n_beams)
    directions_of(bearings - np.pi, n_directions, fraction)
    outside = 0.0
    for b in range(n_beams):
        offset[b] = min(int(fraction[b] * (1 << POINT)), circle - 1)
        outside += log_p[b, 0]
    per_radian, half = n_directions / (2.0 * np.pi) * (1 << POINT), (1 << POINT) // 2
    for i in range(poses.shape[0]):
        cell, row, col = cell_of(index, frame, poses[i, 0], poses[i, 1])
        if cell < 0:
            log_w[i] += outside
            continue
        ahead = int((poses[i, 2] + np.pi) * per_radian) + half
        ahead -= circle if ahead >= circle else 0
        total = 0.0
        for b in range(n_beams):
            turned = ahead + offset[b]
            turned -= circle if turned >= circle else 0
            direction = turned >> POINT
            level = table[np.uint64(cell), np.uint64(direction)]
            if level == 0:
                level = cast_level(squares, row, col, headings[direction], reach)
                table[cell, direction] = level
            total += log_p[b, np.uint64(level) - np.uint64(1)]
        log_w[i] += total


@njit(cache=True, nogil=True)
def weigh_by_rays(
    squares: NDArray[np.uint8],
    frame: NDArray[np.float64],
    z_max: float,
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    log_p: NDArray[np.float32],
    log_w: NDArray[np.float64],
) -> None:
    """:func:`weigh_by_table` without a table: every ray is cast from where its particle stands.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the map.
        frame: x and y of the map's corner, and its resolution [m].
        z_max: [m].
        poses: ``(N, 3)``.
        bearings: ``(B,)`` of the readings that count [rad].
        log_p: ``(B, LEVELS)``.
        log_w: ``(N,)``, overwritten.
    """
    expected = np.empty((1, bearings.shape[0]))
    for i in range(poses.shape[0]):
        cast_beams(squares, frame, poses[i : i + 1], bearings, z_max, expected)
        total = 0.0
        for b in range(bearings.shape[0]):
            z = expected[0, b]
            level = LEVELS - 1
            if z < z_max:
                level = min(int(z / z_max * (LEVELS - 1)), LEVELS - 2)
            total += log_p[b, level]
        log_w[i] += total


@njit(cache=True, nogil=True)
def weigh_by_rows(
    log_w: NDArray[np.float64],
    rows: NDArray[np.int32],
    log_p: NDArray[np.float32],
    readings: NDArray[np.int32],
    weights: NDArray[np.float64],
) -> None:
    """Add each reading's log-likelihood to each particle's log-weight, in place.

    Args:
        log_w: ``(N,)``.
        rows: ``(N, B)``; row of the table for each particle and beam.
        log_p: ``(Z, R)``.
        readings: ``(B,)`` of bins; -1 for no reading.
        weights: ``(B,)``; how much each reading counts.
    """
    for b in range(readings.shape[0]):
        if readings[b] >= 0 and weights[b] > 0.0:
            for i in range(log_w.shape[0]):
                log_w[i] += weights[b] * log_p[readings[b], rows[i, b]]
