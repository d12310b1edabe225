"""Kernels of the metric view: hypotheses laid over each other.

Places are looked up in ``records``: of each cell of the map's look-up, padded so that nothing looks
beyond, the class of the range along each direction and, last, the open share.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.raycast import cast_ray

CLASSES = 8  # Of an expected range: seven up to the longest, one for nothing in range.
DIRECTIONS = 36
SHARES = 16  # Open shares of a cell are told apart this finely,
OPEN = 4  # and with fewer of them it stops a way.


@njit(cache=True, nogil=True)
def classify(
    squares: NDArray[np.uint8],
    places: NDArray[np.float64],
    reach: float,
    classes: NDArray[np.uint8],
) -> None:
    """Class of the range from each place in each direction.

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`cast_ray`.
        places: ``(C, 2)`` of column and row [cell].
        reach: Longest range [cell].
        classes: ``(D, C)``, overwritten.
    """
    for d in range(classes.shape[0]):
        angle = 2.0 * np.pi * d / classes.shape[0]
        dx, dy = np.cos(angle), np.sin(angle)
        for c in range(places.shape[0]):
            z = cast_ray(squares, places[c, 0], places[c, 1], dx, dy, reach)
            # A range on the edge of a class goes up in every like room.
            classes[d, c] = min(int(z / reach * (CLASSES - 1) + 1e-9), CLASSES - 1)


@njit(cache=True, nogil=True)
def direction_of(theta: float) -> int:
    """The nearest of the look-up's directions."""
    return int(np.floor(theta / (2.0 * np.pi) * DIRECTIONS + 0.5)) % DIRECTIONS


@njit(cache=True, nogil=True)
def _start(
    pose: NDArray[np.float64], frame: NDArray[np.float64], shape: tuple[int, int], margin: int
) -> tuple[float, float]:
    """Column and row of a pose among the padded cells; off the map, at its edge."""
    col, row = (pose[0] - frame[0]) * frame[2], (pose[1] - frame[1]) * frame[2]
    col = min(max(col, 0.0), float(shape[1] - 2 * margin))
    row = min(max(row, 0.0), float(shape[0] - 2 * margin))
    return col + margin, row + margin


@njit(cache=True, nogil=True)
def draw_window(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    frame: NDArray[np.float64],
    records: NDArray[np.uint8],
    margin: int,
    pixel: float,
    view: NDArray[np.float32],
) -> None:
    """Average the turned map, and find the spread of the expected ranges.

    Classes are counted in the eight bytes of a word, for all hypotheses at each place.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``; hypotheses at each pose, 255 at most in all.
        frame: See :class:`activeloc.beliefs.metric_view.Lookup`.
        records: ``(rows, cols, DIRECTIONS + 1)``, padded.
        margin: By so many cells, more than the window reaches.
        pixel: Side of a pixel [cell].
        view: ``(5, S, S)``, overwritten.
    """
    side, radius, quarter = view.shape[1], view.shape[1] // 2, DIRECTIONS // 4
    words = np.zeros((side * side, 4), np.uint64)
    free = np.zeros(side * side, np.int64)
    flat, each = records.ravel(), np.uint64(records.shape[2])
    width, area = np.uint64(records.shape[1]), np.uint64(DIRECTIONS)
    total = counts.sum()
    for i in range(poses.shape[0]):
        n, word = counts[i], np.uint64(counts[i])
        dx, dy = np.cos(poses[i, 2]) * pixel, np.sin(poses[i, 2]) * pixel
        ahead = direction_of(poses[i, 2])
        a, b = np.uint64(ahead), np.uint64((ahead + quarter) % DIRECTIONS)
        c = np.uint64((ahead + 2 * quarter) % DIRECTIONS)
        d = np.uint64((ahead + 3 * quarter) % DIRECTIONS)
        x, y = _start(poses[i], frame, records.shape[:2], margin)
        for u in range(side):
            col = x + (u - radius) * dx - radius * dy
            row = y + (u - radius) * dy + radius * dx
            there, held = words[u * side : (u + 1) * side], free[u * side : (u + 1) * side]
            for v in range(side):
                at = (np.uint64(row) * width + np.uint64(col)) * each
                share = flat[at + area]
                if share > 0:
                    held[v] += n * share
                    there[v, 0] += word << (np.uint64(flat[at + a]) * np.uint64(8))
                    there[v, 1] += word << (np.uint64(flat[at + b]) * np.uint64(8))
                    there[v, 2] += word << (np.uint64(flat[at + c]) * np.uint64(8))
                    there[v, 3] += word << (np.uint64(flat[at + d]) * np.uint64(8))
                col, row = col + dy, row - dx
    terms = np.zeros(256)
    for held_by in range(1, 256):
        terms[held_by] = held_by * np.log(held_by)
    for i in range(side * side):
        top, left = i // side, i % side
        view[0, top, left] = free[i] / (SHARES * total)
        for q in range(4):
            seen, spread, lanes = 0, 0.0, words[i, q]
            while lanes != 0:
                lane = int(lanes & np.uint64(255))
                seen += lane
                spread += terms[lane]
                lanes >>= np.uint64(8)
            view[1 + q, top, left] = 0.0
            if seen > 0:
                nats = (terms[seen] - spread) / seen
                view[1 + q, top, left] = max(0.0, nats) / np.log(float(CLASSES))


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
def draw_ways(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    bins: NDArray[np.int64],
    frame: NDArray[np.float64],
    records: NDArray[np.uint8],
    margin: int,
    step: float,
    probes: int,
    beams: NDArray[np.int64],
    most: float,
    ways: NDArray[np.float32],
) -> None:
    """Follow the straight ways from every pose.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``.
        bins: ``(M,)``; of the poses.
        frame: See :class:`activeloc.beliefs.metric_view.Lookup`.
        records: ``(rows, cols, DIRECTIONS + 1)``, padded.
        margin: By so many cells, more than a way reaches.
        step: At which a way is probed [cell],
        probes: so many times between two distances.
        beams: ``(B,)``, B at most 3; bearings as directions.
        most: Information that counts as 1 [nat].
        ways: ``(2, bearings, distances)``, overwritten.
    """
    order = sort_by(bins)
    m, total, n_far = poses.shape[0], counts.sum(), ways.shape[2]
    stopped = CLASSES ** beams.shape[0]
    codes = np.empty((n_far, m), np.int64)
    held = np.zeros(stopped + 1, np.int64)
    terms = np.zeros(total + 1)
    for n in range(1, total + 1):
        terms[n] = n * np.log(float(n))
    flat, each = records.ravel(), np.uint64(records.shape[2])
    width, area = np.uint64(records.shape[1]), np.uint64(DIRECTIONS)
    looks = np.empty(beams.shape[0], np.uint64)
    for b in range(ways.shape[1]):
        turn = 2.0 * np.pi * b / ways.shape[1]
        for i in range(m):
            pose = poses[order[i]]
            theta = pose[2] + turn
            dx, dy = np.cos(theta) * step, np.sin(theta) * step
            ahead = direction_of(theta)
            for j in range(beams.shape[0]):
                looks[j] = np.uint64((ahead + beams[j]) % DIRECTIONS)
            col, row = _start(pose, frame, records.shape[:2], margin)
            is_open = True
            for k in range(n_far):
                for _ in range(probes if k > 0 else 0):
                    col, row = col + dx, row + dy
                    at = (np.uint64(row) * width + np.uint64(col)) * each
                    is_open = is_open and flat[at + area] >= OPEN
                if not is_open:
                    for far in range(k, n_far):
                        codes[far, i] = stopped
                    break
                at = (np.uint64(row) * width + np.uint64(col)) * each
                code = 0
                for j in range(beams.shape[0]):
                    code = code * CLASSES + int(flat[at + looks[j]])
                codes[k, i] = code
        for k in range(n_far):
            for i in range(m):
                held[codes[k, i]] += counts[order[i]]
            ways[0, b, k] = 1.0 - held[stopped] / total
            told = terms[total] - _take(codes[k], held, terms, 0, m)
            # Less what poses of one bin differ by among themselves.
            first = 0
            while first < m:
                end, n = first + 1, counts[order[first]]
                while end < m and bins[order[end]] == bins[order[first]]:
                    n += counts[order[end]]
                    end += 1
                if end > first + 1:
                    for i in range(first, end):
                        held[codes[k, i]] += counts[order[i]]
                    told -= terms[n] - _take(codes[k], held, terms, first, end)
                first = end
            ways[1, b, k] = min(max(0.0, told) / total / most, 1.0)


@njit(cache=True, nogil=True)
def _take(
    codes: NDArray[np.int64],
    held: NDArray[np.int64],
    terms: NDArray[np.float64],
    first: int,
    end: int,
) -> float:
    """Sum of n log n over what is held for ``codes[first:end]``, which is set to zero."""
    total = 0.0
    for i in range(first, end):
        n = held[codes[i]]
        held[codes[i]] = 0
        total += terms[n]
    return total
