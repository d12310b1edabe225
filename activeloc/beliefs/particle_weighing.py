"""Kernels that weigh particles by a scan."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.range_levels import LEVELS
from activeloc.range_table import (
    POINT,
    ahead_of,
    cast_missing,
    cell_of,
    direction_of,
    directions_of,
)
from activeloc.raycast import cast_beams

BLOCK = 128  # Particles that are weighed together.


@njit(cache=True, nogil=True)
def locate(
    index: NDArray[np.int32],
    frame: NDArray[np.float64],
    n_directions: int,
    poses: NDArray[np.float64],
    row: NDArray[np.int64],
    ahead: NDArray[np.uint32],
) -> None:
    """Where in the table of ranges each pose's beams are looked up.

    Args:
        index: ``(H, W)``.
        frame: ``(3,)``.
        n_directions: D.
        poses: ``(n, 3)``.
        row: ``(>= n,)``, overwritten with where the cell's row begins; -1 where it is not free.
        ahead: ``(>= n,)``, overwritten with the heading; see :func:`directions_of`.
    """
    circle = np.uint32(n_directions << POINT)
    per_radian = n_directions / (2.0 * np.pi) * (1 << POINT)
    for i in range(poses.shape[0]):
        row[i] = cell_of(index, frame, poses[i, 0], poses[i, 1])[0] * n_directions
        ahead[i] = ahead_of(poses[i, 2], per_radian, circle)


@njit(cache=True, nogil=True)
def add_readings(
    flat: NDArray[np.uint8],
    row: NDArray[np.int64],
    ahead: NDArray[np.uint32],
    offset: NDArray[np.uint32],
    circle: np.uint32,
    log_p: NDArray[np.float32],
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (n,)`` with the log-likelihood of all readings; anything where ``row`` is -1.

    Beam by beam, so that the look-ups of many particles are waited for together.

    Args:
        flat: ``(C * D,)``; the table.
        row: ``(>= n,)``; see :func:`locate`.
        ahead: ``(>= n,)``.
        offset: ``(B,)``; of the beams.
        circle: D in fixed point.
        log_p: ``(B, LEVELS + 1)``; by the table's byte.
        out: ``(n,)``, overwritten.
    """
    out[:] = 0.0
    for b in range(offset.shape[0]):
        for i in range(out.shape[0]):
            at = max(0, row[i]) + direction_of(ahead[i], offset[b], circle)
            # Unsigned, for numba looks after negative indices.
            out[i] += log_p[b, np.uint64(flat[np.uint64(at)])]


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
    n_directions, n_beams, outside = table.shape[1], bearings.shape[0], 0.0
    offset, by_byte = np.empty(n_beams, np.uint32), np.empty((n_beams, LEVELS + 1), np.float32)
    directions_of(bearings - np.pi, n_directions, offset)
    for b in range(n_beams):
        outside += log_p[b, 0]
        by_byte[b, 0], by_byte[b, 1:] = np.nan, log_p[b]  # What has not been cast will be noticed.
    flat, circle = table.reshape(-1), np.uint32(n_directions << POINT)
    row, ahead = np.empty(BLOCK, dtype=np.int64), np.empty(BLOCK, dtype=np.uint32)
    total = np.empty(BLOCK)
    for first in range(0, poses.shape[0], BLOCK):
        block = poses[first : first + BLOCK]
        locate(index, frame, n_directions, block, row, ahead)
        sums = total[: block.shape[0]]
        add_readings(flat, row, ahead, offset, circle, by_byte, sums)
        for i in range(block.shape[0]):
            if row[i] < 0:
                sums[i] = outside
            elif np.isnan(sums[i]):
                place = cell_of(index, frame, block[i, 0], block[i, 1])
                cast_missing(table, squares, headings, place, ahead[i], offset, reach)
                one = slice(i, i + 1)
                add_readings(flat, row[one], ahead[one], offset, circle, by_byte, sums[one])
            log_w[first + i] += sums[i]


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
    expected = np.empty((BLOCK, bearings.shape[0]))
    for first in range(0, poses.shape[0], BLOCK):
        block = poses[first : first + BLOCK]
        cast_beams(squares, frame, block, bearings, z_max, expected)
        for i in range(block.shape[0]):
            total = 0.0
            for b in range(bearings.shape[0]):
                z = expected[i, b]
                level = LEVELS - 1
                if z < z_max:
                    level = min(int(z / z_max * (LEVELS - 1)), LEVELS - 2)
                total += log_p[b, level]
            log_w[first + i] += total


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
