"""Kernels that find poses in a belief on planes: the likeliest, the mass around one, at shares."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, CHUNK


@njit(cache=True, nogil=True)
def _fold_fours(
    of: NDArray[np.float32], at: np.uint64, n: np.uint64, to: NDArray[np.float32]
) -> None:
    """Add the four quarters of 4 n states up, several states at once: ``to (n,)``, overwritten."""
    second, third, fourth = at + n, at + np.uint64(2) * n, at + np.uint64(3) * n
    for i in range(n):
        to[i] = (of[at + i] + of[second + i]) + (of[third + i] + of[fourth + i])


@njit(cache=True, nogil=True)
def survey(
    values: NDArray[np.float32],
    bits: NDArray[np.int32],
    runs: NDArray[np.int32],
    n: int,
    sums: NDArray[np.float64],
) -> int:
    """State of the largest probability, the first of equals; and what each run sums to.

    Args:
        values: ``(K * P,)``.
        bits: The same seen as integers of its width, which are ordered alike.
        runs: Of the belief.
        n: How many.
        sums: ``(n,)``, overwritten.
    """
    best, where = bits.dtype.type(0), -1
    folded = np.empty(CHUNK // 4, dtype=values.dtype)
    for r in range(n):
        first, quarter = np.uint64(runs[r, 0]), np.uint64((runs[r, 1] - runs[r, 0]) // 4)
        top = bits.dtype.type(0)
        for i in range(first, np.uint64(runs[r, 1])):
            top = max(top, bits[i])
        if top > best:
            best, where = top, r
        # Runs are whole blocks of sixteen: what is left after two foldings adds up to them.
        _fold_fours(values, first, quarter, folded)
        _fold_fours(folded, np.uint64(0), quarter // np.uint64(4), folded)
        sums[r] = 0.0
        for i in range(quarter // np.uint64(4)):
            sums[r] += folded[i]
    if where >= 0:
        for s in range(runs[where, 0], runs[where, 1]):
            if bits[s] == best:
                return s
    return 0


@njit(cache=True, nogil=True)
def near(
    values: NDArray[np.float32],
    size: int,
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
        values: ``(K * P,)``.
        size: P.
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
    for k in range(thetas.shape[0]):
        turn = (thetas[k] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
        if abs(turn) > angle:
            continue
        for y in range(max(0, int(row - reach)), last_row):
            for x in range(max(0, int(col - reach)), last_col):
                p = np.float64(values[k * size + y * cols + x])
                if p > 0.0:
                    c = index[y, x]
                    dx, dy = centres[c, 0] - pose[0], centres[c, 1] - pose[1]
                    if dx * dx + dy * dy <= radius * radius:
                        out[0] += p
                        out[1] += p * dx
                        out[2] += p * dy
                        out[3] += p * turn


@njit(cache=True, nogil=True)
def estimate(
    values: NDArray[np.float32],
    size: int,
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
        values: ``(K * P,)``.
        size: P.
        index: ``(rows, cols)``.
        centres: ``(C, 2)`` [m].
        thetas: ``(K,)`` [rad].
        frame: See there.
        mode: The likeliest state.
        radius: Of the window.
        angle: Of the window.
        out: ``(4,)``, overwritten with the pose and the mass around it.
    """
    k, place = mode // size, mode % size
    c = index[place // index.shape[1], place % index.shape[1]]
    pose, moments = np.array([centres[c, 0], centres[c, 1], thetas[k]]), np.empty(4)
    for _ in range(2):
        near(values, size, index, centres, thetas, frame, pose, radius, angle, moments)
        for i in range(3):
            pose[i] += moments[1 + i] / moments[0]
        pose[2] = (pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    near(values, size, index, centres, thetas, frame, pose, radius, angle, moments)
    out[:3], out[3] = pose, moments[0]


@njit(cache=True, nogil=True)
def _block_sum(of: NDArray[np.float32]) -> float:
    """Sum of a block, in four parts at once."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(0, BLOCK, 4):
        a, b, c, d = a + of[i], b + of[i + 1], c + of[i + 2], d + of[i + 3]
    return (a + b) + (c + d)


@njit(cache=True, nogil=True)
def at_shares(
    values: NDArray[np.float32],
    runs: NDArray[np.int32],
    n: int,
    sums: NDArray[np.float64],
    shares: NDArray[np.float64],
    states: NDArray[np.int64],
) -> None:
    """States at given shares of the whole mass, counted state by state.

    Args:
        values: ``(K * P,)``.
        runs: Of ``values``.
        n: How many.
        sums: ``(n,)``; what each run sums to; see :func:`survey`.
        shares: ``(N,)`` in [0, 1), ascending.
        states: ``(N,)``, overwritten.
    """
    whole = 0.0
    for r in range(n):
        whole += sums[r]
    final = n - 1
    while final > 0 and sums[final] == 0.0:
        final -= 1
    r, before = 0, 0.0
    at, cumulative = runs[0, 0], 0.0
    for j in range(shares.shape[0]):
        pointer = shares[j] * whole
        while r < final and before + sums[r] <= pointer:
            before += sums[r]
            r += 1
            at, cumulative = runs[r, 0], before
        while at < runs[r, 1]:
            if at % BLOCK == 0:
                block = _block_sum(values[at : at + BLOCK])
                if cumulative + block <= pointer and at + BLOCK < runs[r, 1]:
                    cumulative += block
                    at += BLOCK
                    continue
            if cumulative + values[at] > pointer:
                break
            cumulative += values[at]
            at += 1
        last = at
        if at == runs[r, 1]:  # The sums were rounded.
            last = at - 1
            while values[last] <= 0.0:
                last -= 1
        states[j] = last


@njit(cache=True, nogil=True)
def gather(
    states: NDArray[np.int64],
    size: int,
    index: NDArray[np.int32],
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> int:
    """Poses of ascending states, each once, and how often it comes.

    Args:
        states: ``(N,)``.
        size: P.
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
        c = index[states[j] % size]
        poses[m, 0], poses[m, 1] = centres[c, 0], centres[c, 1]
        poses[m, 2] = thetas[states[j] // size]
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
