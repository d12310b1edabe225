"""Kernels of the metric view: hypotheses laid over each other.

Places are looked up in ``records``: nine words for each cell of the map's look-up, with a ring of
closed cells around it for whatever lies beyond. The bytes of word d are of the directions d, d + 9,
d + 18 and d + 27, a quarter turn apart: the class of the range in the upper half; in the lower, the
same in all four, the cell's open share less one. A closed cell is :data:`CLOSED`. The words of one
d lie together: a robot looks into few.
"""

from math import log

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
RING = 2  # Cells: a way that is probed every 0.25 m does not leap over them.
LANES = 4  # Hypotheses that are counted at a time.
N_LOG_N = np.array([0.0, *(n * log(n) for n in range(1, 256))])


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
    """Column and row of a pose, counted from a margin around the map; off the map, at its edge."""
    col, row = (pose[0] - frame[0]) * frame[2], (pose[1] - frame[1]) * frame[2]
    col = min(max(col, 0.0), float(shape[1] - 2 * RING))
    row = min(max(row, 0.0), float(shape[0] - 2 * RING))
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
def count(bytes_: NDArray[np.uint8], n: NDArray[np.uint8], of: NDArray[np.uint8]) -> None:
    """Count hypotheses with the class of each place.

    Args:
        bytes_: ``(LANES, N)``; classes in the upper halves, the lower ones empty.
        n: ``(LANES,)``; how many hypotheses each stands for.
        of: ``(CLASSES, N)``, added to.
    """
    byte, none = np.uint8, np.uint8(0)
    first, second, third, fourth = bytes_[0], bytes_[1], bytes_[2], bytes_[3]
    n0, n1, n2, n3 = n[0], n[1], n[2], n[3]
    for c in range(CLASSES):
        own, held = byte(c << 4), of[c]
        for i in range(held.shape[0]):
            one = byte((n0 if first[i] == own else none) + (n1 if second[i] == own else none))
            two = byte((n2 if third[i] == own else none) + (n3 if fourth[i] == own else none))
            held[i] += byte(one + two)


@njit(cache=True, nogil=True)
def look_up(
    x: float,
    y: float,
    cos: float,
    sin: float,
    up: NDArray[np.float64],
    right: NDArray[np.float64],
    shape: tuple[int, int],
    margin: int,
    words: NDArray[np.uint32],
    first: int,
    at: NDArray[np.int32],
    seen: NDArray[np.uint32],
) -> None:
    """The words of all pixels of one window.

    Args:
        x: Column and
        y: row of the pose; see :func:`start_of`.
        cos: Of its heading,
        sin: and the sine.
        up: ``(S * S,)``; pixels ahead of the pose,
        right: ``(S * S,)``; and to its right [cell].
        shape: Rows and columns of the records.
        margin: See :func:`start_of`; farther than the window reaches, so that nothing is negative.
        words: Records of all directions, one after another,
        first: those of one from here on.
        at: ``(S * S,)``, overwritten.
        seen: ``(S * S,)``, overwritten with the words.
    """
    whole, zero, low = np.int32, np.int32(0), np.int32(margin - RING)
    width, last_col, last_row = whole(shape[1]), whole(shape[1] - 1), whole(shape[0] - 1)
    for j in range(at.shape[0]):
        col = whole(whole(x + up[j] * cos + right[j] * sin) - low)
        row = whole(whole(y + up[j] * sin - right[j] * cos) - low)
        # All in 32 bits: min() and max() would be in 64, and half as fast.
        col = col if col > zero else zero
        row = row if row > zero else zero
        col = col if col < last_col else last_col
        row = row if row < last_row else last_row
        at[j] = row * width + col
    for j in range(at.shape[0]):
        # Unsigned, so that no look-up asks whether it counts from the end.
        seen[j] = words[np.uint64(first + at[j])]


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
        records: ``(9, rows, cols)``.
        margin: More cells than the window reaches.
        pixel: Side of a pixel [cell].
        classes: ``(CLASSES, >= S * S * 4)`` of zeros; hypotheses, by class, place and quarter turn.
        free: ``(S, S)`` of zeros; sixteenths.
    """
    side, plane = free.shape[0], records.shape[1] * records.shape[2]
    n_places, sums, words = side * side, free.ravel(), records.ravel()
    seen, at = np.empty(n_places, np.uint32), np.empty(n_places, np.int32)
    up, right = np.empty(n_places), np.empty(n_places)
    for top in range(side):
        for left in range(side):
            up[top * side + left] = pixel * (top - side // 2)
            right[top * side + left] = pixel * (left - side // 2)
    held = np.full((LANES, classes.shape[1] // 4), np.uint32(CLOSED))
    n_held = np.zeros(LANES, np.uint8)
    for i in range(poses.shape[0]):
        n, ahead, lane = np.int32(counts[i]), direction_of(poses[i, 2]), i % LANES
        cos, sin = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        x, y = start_of(poses[i], frame, records.shape[1:], margin)
        first = plane * (ahead % QUARTER)
        look_up(x, y, cos, sin, up, right, records.shape[1:], margin, words, first, at, seen)
        turn_back(seen, ahead // QUARTER)
        for j in range(n_places):
            sums[j] += n * share_of(seen[j])
            held[lane, j] = seen[j] & np.uint32(0xF0F0F0F0)
        n_held[lane] = n
        if lane == LANES - 1 or i == poses.shape[0] - 1:
            count(held.view(np.uint8), n_held, classes)
            n_held[:] = 0


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
    # Whole stretches of 32 bytes: none is left over.
    classes = np.zeros((CLASSES, -(-side * side // 8) * 32), np.uint8)
    lay_over(poses, counts, frame, records, margin, pixel, classes, free)
    whole, most = 1.0 / (SHARES * counts.sum()), np.log(float(CLASSES))
    share = np.zeros(256)
    for n in range(1, 256):
        share[n] = 1.0 / (n * most)
    for place in range(side * side):
        top, left = place // side, place % side
        view[0, top, left] = free[top, left] * whole
        for q in range(4):
            seen, spread = 0, 0.0
            for c in range(CLASSES):
                n = classes[c, 4 * place + q]
                seen += n
                spread += N_LOG_N[n]
            view[1 + q, top, left] = max(0.0, N_LOG_N[seen] - spread) * share[seen]
