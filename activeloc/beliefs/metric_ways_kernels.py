"""Kernels of the metric view's ways: how far they are open, what a scan at their end tells."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.metric_view_kernels import (
    CLASSES,
    DIRECTIONS,
    OPEN,
    QUARTER,
    direction_of,
    share_of,
    start_of,
)

FINE = 2.0**-40  # Of a nat: whole numbers of these add up to the same in any order.

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


@njit(cache=True, nogil=True)
def follow(
    poses: NDArray[np.float64],
    bearing: int,
    records: NDArray[np.uint32],
    step: float,
    probes: int,
    beams: NDArray[np.int64],
    reach: NDArray[np.int64],
    codes: NDArray[np.int16],
) -> None:
    """Follow one straight way from every pose.

    Args:
        poses: ``(M, 5)`` of column and row among the padded cells, the heading's cosine and sine,
            and its direction.
        bearing: Of the way, in directions.
        records: See :mod:`activeloc.beliefs.metric_view_kernels`.
        step: At which the way is probed [cell],
        probes: so many times between two distances.
        beams: ``(B,)``; bearings as directions.
        reach: ``(M,)``, overwritten with how many distances are open.
        codes: ``(M, distances)``, overwritten as far as that with what the beams are expected to
            read there, as one number.
    """
    n_beams, width, plane = beams.shape[0], records.shape[2], records.shape[1] * records.shape[2]
    flat, angle = records.ravel(), 2.0 * np.pi * bearing / DIRECTIONS
    cos, sin = np.cos(angle) * step, np.sin(angle) * step
    n_probes = probes * (codes.shape[1] - 1)
    at = np.empty(1 + n_probes, np.int32)
    first, shifts = np.empty(n_beams, np.int64), np.empty(n_beams, np.uint32)
    for i in range(poses.shape[0]):
        x, y = poses[i, 0], poses[i, 1]
        dx, dy = poses[i, 2] * cos - poses[i, 3] * sin, poses[i, 3] * cos + poses[i, 2] * sin
        at[0] = int(y) * width + int(x)
        for p in range(n_probes):
            col, row = np.int32(x + (p + 1) * dx), np.int32(y + (p + 1) * dy)
            at[1 + p] = row * np.int32(width) + col
        for j in range(n_beams):
            direction = (int(poses[i, 4]) + bearing + beams[j]) % DIRECTIONS
            first[j] = plane * (direction % QUARTER)
            shifts[j] = np.uint32(8 * (direction // QUARTER) + 4)
        p = 0
        # Unsigned, so that no look-up asks whether it counts from the end.
        while p < n_probes and share_of(flat[np.uint64(first[0] + at[1 + p])]) >= OPEN:
            p += 1
        reach[i] = 1 + p // probes
        for k in range(reach[i]):
            code, place = np.int64(0), at[probes * k]
            for j in range(n_beams):
                seen = np.int64(flat[np.uint64(first[j] + place)] >> shifts[j])
                code = code * CLASSES + (seen & (CLASSES - 1))
            codes[i, k] = code


@njit(cache=True, nogil=True)
def draw_ways(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    bins: NDArray[np.int64],
    frame: NDArray[np.float64],
    records: NDArray[np.uint32],
    margin: int,
    step: float,
    probes: int,
    beams: NDArray[np.int64],
    most: float,
    ways: NDArray[np.float32],
) -> None:
    """Follow the straight ways from every pose, and say what lies along them.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``; 255 at most in all.
        bins: ``(M,)``; of the poses.
        frame: See :class:`activeloc.beliefs.metric_view.Lookup`.
        records: See :mod:`activeloc.beliefs.metric_view_kernels`.
        margin: They are padded by so many cells, more than a way reaches.
        step: See :func:`follow` for these three; B is at most 3.
        probes: .
        beams: .
        most: Information that counts as 1 [nat].
        ways: ``(2, bearings, distances)``, overwritten.
    """
    order, m, n_far, total = sort_by(bins), poses.shape[0], ways.shape[2], counts.sum()
    starts, held_by = np.empty((m, 5)), np.empty(m, np.int64)
    for i in range(m):
        pose = poses[order[i]]
        starts[i, 0], starts[i, 1] = start_of(pose, frame, records.shape[1:], margin)
        starts[i, 2], starts[i, 3] = np.cos(pose[2]), np.sin(pose[2])
        starts[i, 4] = direction_of(pose[2])
        held_by[i] = counts[order[i]]
    groups, terms = groups_of(bins[order]), n_log_n(total)
    reach, codes = np.empty(m, np.int64), np.empty((m, n_far), np.int16)
    held = np.zeros((n_far, CLASSES ** beams.shape[0]), np.uint8)
    told, n_open, spare = np.zeros((3, n_far), np.int64)
    for b in range(ways.shape[1]):
        bearing = b * DIRECTIONS // ways.shape[1]
        follow(starts, bearing, records, step, probes, beams, reach, codes)
        tell(0, m, reach, codes, held_by, terms, held, told, n_open)
        ways[0, b] = n_open / total
        # Less what poses of one bin differ by among themselves.
        for g in range(groups.shape[0]):
            tell(groups[g, 0], groups[g, 1], reach, codes, held_by, terms, held, spare, n_open)
            told -= spare
        for k in range(n_far):
            ways[1, b, k] = min(max(0, told[k]) * FINE / total / most, 1.0)


@njit(cache=True, nogil=True)
def n_log_n(most: int) -> NDArray[np.int64]:
    """Numbers n log n for n = 0 ... most, in :data:`FINE`."""
    terms = np.zeros(most + 1, np.int64)
    for n in range(1, most + 1):
        terms[n] = int(n * np.log(float(n)) / FINE + 0.5)
    return terms


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
    codes: NDArray[np.int16],
    counts: NDArray[np.int64],
    terms: NDArray[np.int64],
    held: NDArray[np.uint8],
    told: NDArray[np.int64],
    n_open: NDArray[np.int64],
) -> None:
    """What is told of some hypotheses by whether a way is open, and by what is read there.

    Args:
        first: Of the poses,
        end: one past the last.
        reach: ``(M,)``; how many distances are open.
        codes: ``(M, distances)``; what is read there.
        counts: ``(M,)``; hypotheses at each pose.
        terms: n log n.
        held: ``(distances, codes)``; zeros.
        told: ``(distances,)``, overwritten: entropy times hypotheses, as ``terms``.
        n_open: ``(distances,)``, overwritten: hypotheses that find the way open.
    """
    total = counts[first:end].sum()
    told[:] = terms[total]
    n_open[:] = 0
    for i in range(first, end):
        for k in range(reach[i]):
            code = np.uint64(codes[i, k])
            before = np.int64(held[k, code])
            held[k, code] = before + counts[i]
            told[k] -= terms[before + counts[i]] - terms[before]
            n_open[k] += counts[i]
    for k in range(told.shape[0]):
        told[k] -= terms[total - n_open[k]]
    if end - first > MANY:
        held[:] = 0
        return
    for i in range(first, end):
        for k in range(reach[i]):
            held[k, np.uint64(codes[i, k])] = 0
