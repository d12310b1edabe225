"""Kernels of the metric view: hypotheses laid over each other.

Places are looked up in ``records``: nine words for each cell of the map's look-up, which is padded
so that nothing looks beyond. The bytes of word d are of the directions d, d + 9, d + 18 and d + 27,
a quarter turn apart: the class of the range in the upper half; in the lower, the same in all four,
the cell's open share less one. A closed cell is :data:`CLOSED`. The words of one d lie together: a
robot looks into few.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.raycast import cast_ray

CLASSES = 8  # Of an expected range: seven up to the longest, one for nothing in range.
DIRECTIONS = 36
QUARTER = DIRECTIONS // 4
SHARES = 16  # Open shares of a cell are told apart this finely,
OPEN = 4  # and with fewer of them it stops a way.
CLOSED = 0x80808080


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


def record(classes: NDArray[np.uint8], shares: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """The words of some cells: ``(9, ...)``.

    Args:
        classes: ``(DIRECTIONS, ...)``.
        shares: ``(...)``; open sixteenths.
    """
    parts = (classes.astype(np.uint32) << 4).reshape(4, QUARTER, *shares.shape)
    words = parts[0] | parts[1] << 8 | parts[2] << 16 | parts[3] << 24
    words |= 0x01010101 * (shares.astype(np.uint32) - np.uint32(shares > 0))
    return np.where(shares > 0, words, np.uint32(CLOSED))


@njit(cache=True, nogil=True)
def share_of(word: np.uint32) -> np.int32:
    """The open share of a word's cell."""
    return np.int32(0) if word & np.uint32(0x80) else np.int32(word & np.uint32(15)) + np.int32(1)


@njit(cache=True, nogil=True)
def direction_of(theta: float) -> int:
    """The nearest of the look-up's directions."""
    return int(np.floor(theta / (2.0 * np.pi) * DIRECTIONS + 0.5)) % DIRECTIONS


@njit(cache=True, nogil=True)
def start_of(
    pose: NDArray[np.float64], frame: NDArray[np.float64], shape: tuple[int, int], margin: int
) -> tuple[float, float]:
    """Column and row of a pose among the padded cells; off the map, at its edge."""
    col, row = (pose[0] - frame[0]) * frame[2], (pose[1] - frame[1]) * frame[2]
    col = min(max(col, 0.0), float(shape[1] - 2 * margin))
    row = min(max(row, 0.0), float(shape[0] - 2 * margin))
    return col + margin, row + margin


@njit(cache=True, nogil=True)
def turn_back(words: NDArray[np.uint32], quarters: int) -> None:
    """Let the bytes begin with the one of so many quarter turns, in place."""
    if quarters > 0:
        right = np.uint32(8 * quarters)
        left = np.uint32(32) - right
        for i in range(words.shape[0]):
            words[i] = np.uint32(words[i] >> right) | np.uint32(words[i] << left)


@njit(cache=True, nogil=True)
def count(bytes_: NDArray[np.uint8], n: np.uint8, of: NDArray[np.uint8]) -> None:
    """Count n hypotheses with the class of each place: ``of (CLASSES, N)``, by class."""
    for c in range(CLASSES):
        own, held = np.uint8(c << 4), of[c]
        for i in range(bytes_.shape[0]):
            held[i] += n if bytes_[i] & np.uint8(0xF0) == own else np.uint8(0)


@njit(cache=True, nogil=True)
def lay_over(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    frame: NDArray[np.float64],
    records: NDArray[np.uint32],
    margin: int,
    pixel: float,
    classes: NDArray[np.uint8],
    free: NDArray[np.int32],
) -> None:
    """Count the classes seen from each place, and the open shares, over all hypotheses.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``; hypotheses at each pose, 255 at most in all.
        frame: See :class:`activeloc.beliefs.metric_view.Lookup`.
        records: ``(9, rows, cols)``, padded.
        margin: By so many cells, more than the window reaches.
        pixel: Side of a pixel [cell].
        classes: ``(CLASSES, S * S * 4)`` of zeros; hypotheses, by class, place and quarter turn.
        free: ``(S, S)`` of zeros; sixteenths.
    """
    side, width, plane = free.shape[0], records.shape[2], records.shape[1] * records.shape[2]
    seen, at = np.empty(side * side, np.uint32), np.empty(side * side, np.int32)
    sums, bytes_, words = free.ravel(), seen.view(np.uint8), records.ravel()
    up, right = np.empty(side * side), np.empty(side * side)
    for j in range(side * side):
        up[j], right[j] = pixel * (j // side - side // 2), pixel * (j % side - side // 2)
    for i in range(poses.shape[0]):
        n, ahead = np.int32(counts[i]), direction_of(poses[i, 2])
        cos, sin = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        x, y = start_of(poses[i], frame, records.shape[1:], margin)
        for j in range(at.shape[0]):
            col = np.int32(x + up[j] * cos + right[j] * sin)
            row = np.int32(y + up[j] * sin - right[j] * cos)
            at[j] = row * np.int32(width) + col
        first = plane * (ahead % QUARTER)
        for j in range(at.shape[0]):
            # Unsigned, so that no look-up asks whether it counts from the end.
            seen[j] = words[np.uint64(first + at[j])]
        turn_back(seen, ahead // QUARTER)
        for j in range(seen.shape[0]):
            sums[j] += n * share_of(seen[j])
        count(bytes_, np.uint8(n), classes)


@njit(cache=True, nogil=True)
def draw_window(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    frame: NDArray[np.float64],
    records: NDArray[np.uint32],
    margin: int,
    pixel: float,
    view: NDArray[np.float32],
) -> None:
    """Average the turned map, and find the spread of the expected ranges.

    Args:
        poses: See :func:`lay_over` for these six.
        counts: .
        frame: .
        records: .
        margin: .
        pixel: .
        view: ``(5, S, S)``, overwritten.
    """
    side = view.shape[1]
    free = np.zeros((side, side), np.int32)
    classes = np.zeros((CLASSES, side * side * 4), np.uint8)
    lay_over(poses, counts, frame, records, margin, pixel, classes, free)
    total, most = counts.sum(), np.log(float(CLASSES))
    terms = np.zeros(256)
    for n in range(1, 256):
        terms[n] = n * np.log(float(n))
    for place in range(side * side):
        top, left = place // side, place % side
        view[0, top, left] = free[top, left] / (SHARES * total)
        for q in range(4):
            seen, spread = 0, 0.0
            for c in range(CLASSES):
                n = classes[c, 4 * place + q]
                seen += n
                spread += terms[n]
            nats = max(0.0, (terms[seen] - spread) / seen) if seen > 0 else 0.0
            view[1 + q, top, left] = nats / most
