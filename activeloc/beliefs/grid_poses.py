"""Kernels that find poses in a belief: the mass around one, those at shares of it all."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import LANES
from activeloc.beliefs.lanes import N_LANES, add, fill, load, total


@njit(cache=True, nogil=True)
def add_up(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    width: int,
    sums: NDArray[np.float64],
) -> None:
    """What comes before each place, and all of it.

    Args:
        values: ``(P * W,)``.
        places: Of the belief.
        n: How many.
        width: W.
        sums: ``(n + 1,)``, overwritten.
    """
    w = np.uint64(width)
    sums[0] = 0.0
    for c in range(n):
        at, of = np.uint64(places[c]) * w, fill(values.dtype.type(0))
        for g in range(np.uint64(0), w, LANES):
            of = add(of, load(values, at + g))
        sums[c + 1] = sums[c] + total(of)


@njit(cache=True, nogil=True)
def near(
    values: NDArray[np.float32],
    width: int,
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    frame: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    angle: float,
    out: NDArray[np.float64],
) -> None:
    """Mass within ``radius`` [m] and ``angle`` [rad] of a pose, and its first moments about it.

    Args:
        values: ``(P * W,)``.
        width: W.
        index: ``(rows, cols)`` of cell or -1.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        frame: x and y of the lower left corner [m], and cells per metre.
        pose: ``(3,)``.
        radius: Of the window; cells count by their centre.
        angle: Of the window.
        out: ``(4,)``, overwritten: mass, and mass times mean offset in x, y and theta.
    """
    out[:] = 0.0
    rows, cols = index.shape
    reach = radius * frame[2] + 1.0
    col, row = (pose[0] - frame[0]) * frame[2], (pose[1] - frame[1]) * frame[2]
    if not (-reach <= col <= cols + reach and -reach <= row <= rows + reach):
        return
    last_row, last_col = min(rows, int(row + reach) + 1), min(cols, int(col + reach) + 1)
    turns = (thetas - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    within = np.flatnonzero(np.abs(turns) <= angle)
    for y in range(max(0, int(row - reach)), last_row):
        for x in range(max(0, int(col - reach)), last_col):
            c = index[y, x]
            if c < 0:
                continue
            dx, dy = centres[c, 0] - pose[0], centres[c, 1] - pose[1]
            if dx * dx + dy * dy > radius * radius:
                continue
            mass, turned, at = 0.0, 0.0, (y * cols + x) * width
            for k in within:
                p = np.float64(values[at + k])
                mass += p
                turned += p * turns[k]
            out[0] += mass
            out[1] += mass * dx
            out[2] += mass * dy
            out[3] += turned


@njit(cache=True, nogil=True)
def estimate(
    values: NDArray[np.float32],
    width: int,
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    frame: NDArray[np.float64],
    mode: int,
    radius: float,
    angle: float,
    out: NDArray[np.float64],
) -> None:
    """The mean of the mass around the mode; see :func:`near`.

    Args:
        values: ``(P * W,)``.
        width: W.
        index: ``(rows, cols)``.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        frame: See there.
        mode: The likeliest state.
        radius: Of the window.
        angle: Of the window.
        out: ``(4,)``, overwritten with the pose and the mass around it.
    """
    place, k = mode // width, mode % width
    c = index[place // index.shape[1], place % index.shape[1]]
    pose, moments = np.array([centres[c, 0], centres[c, 1], thetas[k]]), np.empty(4)
    for _ in range(2):
        near(values, width, index, centres, thetas, frame, pose, radius, angle, moments)
        for i in range(3):
            pose[i] += moments[1 + i] / moments[0]
        pose[2] = (pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    near(values, width, index, centres, thetas, frame, pose, radius, angle, moments)
    out[:3], out[3] = pose, moments[0]


@njit(cache=True, nogil=True)
def _last_held(values: NDArray[np.float32], places: NDArray[np.int32], c: int, width: int) -> int:
    """The last state that holds anything, up to those of the c-th place."""
    while c > 0 and not values[places[c] * width : (places[c] + 1) * width].any():
        c -= 1
    at = (places[c] + 1) * width - 1
    while at > places[c] * width and values[at] <= 0.0:
        at -= 1
    return at


@njit(cache=True, nogil=True)
def at_shares(
    values: NDArray[np.float32],
    places: NDArray[np.int32],
    n: int,
    width: int,
    sums: NDArray[np.float64],
    shares: NDArray[np.float64],
    states: NDArray[np.int64],
) -> None:
    """States at given shares of the whole mass, counted state by state.

    Args:
        values: ``(P * W,)``.
        places: Of ``values``.
        n: How many.
        width: W.
        sums: ``(n + 1,)``; see :func:`add_up`.
        shares: ``(N,)`` in [0, 1), ascending.
        states: ``(N,)``, overwritten.
    """
    c = 0
    for j in range(shares.shape[0]):
        pointer = shares[j] * sums[n]
        # The last place before which there is no more: looked for ever further ahead, then between.
        ahead = 1
        while c + ahead < n and sums[c + ahead] <= pointer:
            c += ahead
            ahead *= 2
        while ahead > 1:
            ahead //= 2
            if c + ahead < n and sums[c + ahead] <= pointer:
                c += ahead
        at, end, cumulative = places[c] * width, (places[c] + 1) * width, sums[c]
        while at < end:
            group = total(load(values, np.uint64(at)))
            if cumulative + group > pointer:
                break
            cumulative += group
            at += N_LANES
        while at < end and cumulative + values[at] <= pointer:
            cumulative += values[at]
            at += 1
        if at == end:  # The sums were rounded, or the rest holds nothing.
            at = _last_held(values, places, c, width)
        states[j] = at


@njit(cache=True, nogil=True)
def gather(
    states: NDArray[np.int64],
    width: int,
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> int:
    """Poses of ascending states, each once, and how often it comes.

    Args:
        states: ``(N,)``.
        width: W.
        index: ``(rows * cols,)`` of cell or -1.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        poses: ``(N, 3)``, overwritten from the first on.
        counts: ``(N,)``, overwritten alike.

    Returns:
        How many poses that is.
    """
    m = 0
    for j in range(states.shape[0]):
        if j > 0 and states[j] == states[j - 1]:
            counts[m - 1] += 1
            continue
        c = index[states[j] // width]
        poses[m, 0], poses[m, 1] = centres[c, 0], centres[c, 1]
        poses[m, 2] = thetas[states[j] % width]
        counts[m] = 1
        m += 1
    return m


@njit(cache=True, nogil=True)
def share_near(
    share: NDArray[np.float64],
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    frame: NDArray[np.float64],
    pose: NDArray[np.float64],
    radius: float,
    angle: float,
) -> float:
    """Mass near a pose, as :func:`near`, of a belief that is alike in all headings.

    Args:
        share: ``(C,)``; mass of each cell.
        index: ``(rows, cols)`` of cell or -1.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        frame: x and y of the lower left corner [m], and cells per metre.
        pose: ``(3,)``.
        radius: Of the window; cells count by their centre.
        angle: Of the window.
    """
    rows, cols = index.shape
    reach, total, headings = radius * frame[2] + 1.0, 0.0, 0
    col, row = (pose[0] - frame[0]) * frame[2], (pose[1] - frame[1]) * frame[2]
    if not (-reach <= col <= cols + reach and -reach <= row <= rows + reach):
        return 0.0
    for y in range(max(0, int(row - reach)), min(rows, int(row + reach) + 1)):
        for x in range(max(0, int(col - reach)), min(cols, int(col + reach) + 1)):
            c = index[y, x]
            if c >= 0:
                dx, dy = centres[c, 0] - pose[0], centres[c, 1] - pose[1]
                if dx * dx + dy * dy <= radius * radius:
                    total += share[c]
    for k in range(thetas.shape[0]):
        headings += abs((thetas[k] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi) <= angle
    return total * headings / thetas.shape[0]
