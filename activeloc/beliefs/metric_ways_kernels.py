"""Kernels of the metric view's ways: how far they are open, what a scan at their end tells."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.metric_view_kernels import (
    CLASSES,
    DIRECTIONS,
    N_LOG_N,
    OPEN,
    RING,
    direction_of,
    start_of,
)

FINE = 2.0**-40  # Of a nat: whole numbers of these add up to the same in any order.
TERMS = (N_LOG_N / FINE + 0.5).astype(np.int64)

MANY = 32  # Poses from which on it is quicker to clear a whole table than what they have marked.


@njit(cache=True, nogil=True)
def sort_by(bins: NDArray[np.int64]) -> NDArray[np.int64]:
    """Order of a short list, ascending and stable."""
    order = np.arange(bins.shape[0])
    for i in range(1, order.shape[0]):
        j, own = i, bins[i]
        while j > 0 and bins[order[j - 1]] > own:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


def code(classes: NDArray[np.uint8], beams: tuple[int, ...]) -> NDArray[np.uint16]:
    """What some beams are expected to read, as one number for each direction and cell.

    Args:
        classes: ``(DIRECTIONS, ...)``.
        beams: Bearings as directions, at most 5.

    Returns:
        ``(DIRECTIONS, ...)``.
    """
    codes = np.zeros(classes.shape, dtype=np.uint16)
    for beam in beams:
        codes *= CLASSES
        codes += np.roll(classes, -beam, axis=0)
    return codes


@njit(cache=True, nogil=True)
def follow(
    poses: NDArray[np.float64],
    ahead: NDArray[np.int64],
    bearing: int,
    codes: NDArray[np.uint16],
    shares: NDArray[np.uint8],
    margin: int,
    step: float,
    probes: int,
    reach: NDArray[np.int64],
    read: NDArray[np.uint16],
) -> None:
    """Follow one straight way from every pose.

    Args:
        poses: ``(M, 4)`` of column and row, counted from the margin, and the heading's cosine and
            sine.
        ahead: ``(M,)``; their directions.
        bearing: Of the way, in directions.
        codes: ``(DIRECTIONS, rows, cols)``; see :func:`code`.
        shares: ``(rows, cols)``; open sixteenths of the same cells.
        margin: More cells than a way reaches.
        step: At which the way is probed [cell],
        probes: so many times between two distances.
        reach: ``(M,)``, overwritten with how many distances are open.
        read: ``(M, distances)``, overwritten as far as that with the codes there.
    """
    width, plane = codes.shape[2], codes.shape[1] * codes.shape[2]
    flat, open_, angle = codes.ravel(), shares.ravel(), 2.0 * np.pi * bearing / DIRECTIONS
    cos, sin = np.cos(angle) * step, np.sin(angle) * step
    n_probes, outside = probes * (read.shape[1] - 1), np.int32((margin - RING) * (width + 1))
    at = np.empty(1 + n_probes, np.int32)
    for i in range(poses.shape[0]):
        x, y = poses[i, 0], poses[i, 1]
        dx, dy = poses[i, 2] * cos - poses[i, 3] * sin, poses[i, 3] * cos + poses[i, 2] * sin
        for p in range(n_probes):
            col, row = np.int32(x + (p + 1) * dx), np.int32(y + (p + 1) * dy)
            at[1 + p] = row * np.int32(width) + col - outside
        at[0] = np.int32(y) * np.int32(width) + np.int32(x) - outside
        p = 0
        # Unsigned, so that no look-up asks whether it counts from the end.
        while p < n_probes and open_[np.uint64(at[1 + p])] >= OPEN:
            p += 1
        reach[i] = 1 + p // probes
        first = plane * ((ahead[i] + bearing) % DIRECTIONS)
        for k in range(reach[i]):
            read[i, k] = flat[np.uint64(first + at[probes * k])]


@njit(cache=True, nogil=True)
def draw_ways(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    bins: NDArray[np.int64],
    frame: NDArray[np.float64],
    codes: NDArray[np.uint16],
    shares: NDArray[np.uint8],
    margin: int,
    step: float,
    probes: int,
    n_codes: int,
    most: float,
    ways: NDArray[np.float32],
) -> None:
    """Follow the straight ways from every pose, and say what lies along them.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``; 255 at most in all.
        bins: ``(M,)``; of the poses.
        frame: See :class:`activeloc.beliefs.metric_view.Lookup`.
        codes: See :func:`follow` for these five.
        shares: .
        margin: .
        step: .
        probes: .
        n_codes: One more than the largest code.
        most: Information that counts as 1 [nat].
        ways: ``(2, bearings, distances)``, overwritten.
    """
    order, m, n_far, total = sort_by(bins), poses.shape[0], ways.shape[2], counts.sum()
    starts, ahead, held_by = np.empty((m, 4)), np.empty(m, np.int64), np.empty(m, np.int64)
    for i in range(m):
        pose = poses[order[i]]
        starts[i, 0], starts[i, 1] = start_of(pose, frame, codes.shape[1:], margin)
        starts[i, 2], starts[i, 3] = np.cos(pose[2]), np.sin(pose[2])
        ahead[i] = direction_of(pose[2])
        held_by[i] = counts[order[i]]
    groups = groups_of(bins[order])
    reach, read = np.empty(m, np.int64), np.empty((m, n_far), np.uint16)
    held = np.zeros((n_far, n_codes), np.uint8)
    told, n_open, spare = np.zeros((3, n_far), np.int64)
    for b in range(ways.shape[1]):
        bearing = b * DIRECTIONS // ways.shape[1]
        follow(starts, ahead, bearing, codes, shares, margin, step, probes, reach, read)
        tell(0, m, reach, read, held_by, held, told, n_open)
        ways[0, b] = n_open / total
        # Less what poses of one bin differ by among themselves.
        for g in range(groups.shape[0]):
            tell(groups[g, 0], groups[g, 1], reach, read, held_by, held, spare, n_open)
            told -= spare
        for k in range(n_far):
            ways[1, b, k] = min(max(0, told[k]) * FINE / total / most, 1.0)


@njit(cache=True, nogil=True)
def groups_of(bins: NDArray[np.int64]) -> NDArray[np.int64]:
    """``(G, 2)``; first and one past the last of equal numbers, where there are several."""
    groups, n, first = np.empty((bins.shape[0], 2), np.int64), 0, 0
    for end in range(1, bins.shape[0] + 1):
        if end == bins.shape[0] or bins[end] != bins[first]:
            if end > first + 1:
                groups[n, 0], groups[n, 1] = first, end
                n += 1
            first = end
    return groups[:n]


@njit(cache=True, nogil=True)
def tell(
    first: int,
    end: int,
    reach: NDArray[np.int64],
    read: NDArray[np.uint16],
    counts: NDArray[np.int64],
    held: NDArray[np.uint8],
    told: NDArray[np.int64],
    n_open: NDArray[np.int64],
) -> None:
    """What is told of some hypotheses by whether a way is open, and by what is read there.

    Args:
        first: Of the poses,
        end: one past the last.
        reach: ``(M,)``; how many distances are open.
        read: ``(M, distances)``; codes of what is read there.
        counts: ``(M,)``; hypotheses at each pose.
        held: ``(distances, codes)``; zeros.
        told: ``(distances,)``, overwritten: entropy times hypotheses, in :data:`FINE`.
        n_open: ``(distances,)``, overwritten: hypotheses that find the way open.
    """
    total = counts[first:end].sum()
    told[:] = TERMS[total]
    n_open[:] = 0
    for i in range(first, end):
        for k in range(reach[i]):
            code = np.uint64(read[i, k])
            before = np.int64(held[k, code])
            held[k, code] = before + counts[i]
            told[k] -= TERMS[before + counts[i]] - TERMS[before]
            n_open[k] += counts[i]
    for k in range(told.shape[0]):
        told[k] -= TERMS[total - n_open[k]]
    if end - first > MANY:
        held[:] = 0
        return
    for i in range(first, end):
        for k in range(reach[i]):
            held[k, np.uint64(read[i, k])] = 0
