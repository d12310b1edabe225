"""An exact range the slow way: every crossing of a ray with a grid line, sorted.

Nothing is shared with :mod:`activeloc.raycast`: no stepping, no running sums. Between two crossings
a ray is in one cell, that of the middle. Where it passes a corner within a tolerance it may touch
what meets there or not, so a range is given as an interval; else its ends are the same.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

TOLERANCE = 1e-7
"""Nearness of a corner at which either answer is right [cell]."""


def _blocked_at(blocked: NDArray[np.bool_], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the cells that points ``(n, 2)`` of column, row lie in stop a ray."""
    col, row = np.floor(points).astype(np.int64).T
    inside = (col >= 0) & (row >= 0) & (col < blocked.shape[1]) & (row < blocked.shape[0])
    result = np.ones(len(points), dtype=np.bool_)
    result[inside] = blocked[row[inside], col[inside]]
    return result


def range_of(
    blocked: NDArray[np.bool_], x: float, y: float, theta: float, reach: float
) -> tuple[float, float]:
    """Least and greatest range that is right [cell].

    Args:
        blocked: ``(H, W)``; the outside is blocked too.
        x: Start, column.
        y: Start, row.
        theta: Heading [rad].
        reach: Longest range [cell].
    """
    heading, start = np.array([np.cos(theta), np.sin(theta)]), np.array([x, y])
    crossings = [np.array([0.0, reach])]
    for axis in range(2):
        if abs(heading[axis]) > 1e-14:
            ends = np.sort([start[axis], start[axis] + reach * heading[axis]])
            lines = np.arange(np.ceil(ends[0]), np.floor(ends[1]) + 1.0)
            crossings.append((lines - start[axis]) / heading[axis])
    at = np.unique(np.clip(np.concatenate(crossings), 0.0, reach))
    middles = start + 0.5 * (at[1:] + at[:-1])[:, None] * heading
    long = np.diff(at) > TOLERANCE
    stopped = np.flatnonzero(_blocked_at(blocked, middles) & long)
    greatest = float(at[stopped[0]]) if len(stopped) else reach
    # Beside the ray, at every crossing: what a closed square's corner would stop.
    aside, points = np.array([-heading[1], heading[0]]), at[:, None] * heading + start
    touched = np.zeros(len(at), dtype=np.bool_)
    for along, across in product((-1.0, 1.0), (-4.0, -1.5, 1.5, 4.0)):
        around = TOLERANCE * (along * heading + across * aside)
        touched |= _blocked_at(blocked, points + around)
    near = np.flatnonzero(touched & (at > TOLERANCE) & (at <= greatest))
    least = float(at[near[0]]) if len(near) else greatest
    return min(least, greatest), greatest


def count_wrong(
    blocked: NDArray[np.bool_],
    poses: NDArray[np.float64],
    bearings: NDArray[np.float64],
    reach: float,
    ranges: NDArray[np.float64],
    tolerance: float = 1e-5,
) -> int:
    """How many ranges are not what they should be.

    Args:
        blocked: ``(H, W)``.
        poses: ``(N, 3)`` of column, row, heading.
        bearings: ``(B,)`` [rad].
        reach: Longest range [cell].
        ranges: ``(N, B)`` [cell].
        tolerance: By how much one may be off [cell].
    """
    wrong = 0
    for (x, y, theta), row in zip(poses, ranges, strict=True):
        for bearing, z in zip(bearings, row, strict=True):
            least, greatest = range_of(blocked, x, y, theta + bearing, reach)
            wrong += not least - tolerance <= z <= greatest + tolerance
    return wrong
