"""Kernels that weigh particles by a scan."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.range_table import cast_level, cell_of, directions_of


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
    n_directions = table.shape[1]
    offset = np.empty(bearings.shape[0])
    directions_of(bearings, n_directions, offset)
    per_radian = n_directions / (2.0 * np.pi)
    for i in range(poses.shape[0]):
        cell, row, col = cell_of(index, frame, poses[i, 0], poses[i, 1])
        ahead = poses[i, 2] * per_radian + 0.5
        if ahead < 0.5:
            ahead += n_directions
        total = 0.0
        for b in range(bearings.shape[0]):
            if cell < 0:
                total += log_p[b, 0]
                continue
            direction = int(ahead + offset[b])
            while direction >= n_directions:
                direction -= n_directions
            level = table[cell, direction]
            if level == 0:
                level = cast_level(squares, row, col, headings[direction], reach)
                table[cell, direction] = level
            total += log_p[b, level - 1]
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
