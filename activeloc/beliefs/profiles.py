"""Distinct shares of classes: which cells and directions have the same distribution of ranges.

The classes of a state's rays are counted, its *profile*, and the counts rounded to multiples of
``1 / LEVELS`` by largest remainder. Profiles are told apart by sums of 64-bit hashes of their rays'
classes, so that most states cost an addition a ray and one look-up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import GridLayout

LEVELS = 32  # Shares of a cell's rays are rounded to multiples of 1 / LEVELS.


def room_for(n: int) -> int:
    """Length of an open table of n keys."""
    return 1 << (2 * n).bit_length()


@njit(cache=True, nogil=True)
def round_to_levels(counts: NDArray[np.int32], levels: int) -> None:
    """Scale counts to integers that sum to ``levels``, by largest remainder; in place."""
    total, given = counts.sum(), 0
    remainder = np.empty(counts.shape[0])
    for q in range(counts.shape[0]):
        exact = counts[q] * levels / total
        counts[q] = int(exact)
        remainder[q] = exact - counts[q]
        given += counts[q]
    for _ in range(levels - given):
        best = remainder.argmax()
        counts[best] += 1
        remainder[best] = -1.0


@njit(cache=True, nogil=True)
def slot_of(known: NDArray[np.uint64], key: np.uint64) -> np.uint64:
    """Where a key, not 0, is in an open table, or would go; its length is a power of two."""
    mask = np.uint64(known.shape[0] - 1)
    at = (key ^ (key >> np.uint64(32))) & mask
    while known[at] != 0 and known[at] != key:
        at = (at + np.uint64(1)) & mask
    return at


def masks(is_open: NDArray[np.bool_], layout: GridLayout) -> NDArray[np.uint8]:
    """``(S, P)``; all bits set where a sub-pose of a cell ``(C, S)`` is open."""
    result = np.zeros((is_open.shape[1], layout.size), dtype=np.uint8)
    result[:, layout.place] = np.where(is_open.T, 255, 0)
    return result


@njit(cache=True, nogil=True, inline="always")
def _mixed(x: np.uint32) -> np.uint32:
    x = np.uint32(x + np.uint32(0x9E3779B9))
    x = np.uint32(np.uint32(x ^ (x >> np.uint32(16))) * np.uint32(0x85EBCA6B))
    x = np.uint32(np.uint32(x ^ (x >> np.uint32(13))) * np.uint32(0xC2B2AE35))
    return np.uint32(x ^ (x >> np.uint32(16)))


@njit(cache=True, nogil=True)
def _add_up(
    classes: NDArray[Any], mask: NDArray[np.uint8], high: NDArray[np.uint32],
    low: NDArray[np.uint32],
) -> None:  # fmt: skip
    """Sum of the hashes of each place's classes.

    Twice the finalizer of MurmurHash3 (A. Appleby, 2011), whose arithmetic of 32 bits a processor
    does for many places at a time.

    Args:
        classes: ``(A, S, P)``; of each ray.
        mask: ``(S, P)``; see :func:`masks`.
        high: ``(P,)``, overwritten, as is
        low: ``(P,)``.
    """
    high[:] = low[:] = 0
    for a in range(classes.shape[0]):
        for s in range(classes.shape[1]):
            of, counted = classes[a, s], mask[s]
            for p in range(of.shape[0]):
                x = _mixed(np.uint32(of[p]))
                counts = np.uint32(np.int32(np.int8(counted[p])))
                high[p] += np.uint32(x & counts)
                low[p] += np.uint32(_mixed(x) & counts)


@njit(cache=True, nogil=True)
def _assign(
    classes: NDArray[Any],
    mask: NDArray[np.uint8],
    place: NDArray[np.int32],
    first: int,
    high: NDArray[np.uint32],
    low: NDArray[np.uint32],
    keys: NDArray[np.uint64],
    known: NDArray[np.uint64],
    known_row: NDArray[np.int32],
    profiles: NDArray[np.int32],
    used: NDArray[np.int64],
    row: NDArray[np.int32],
) -> int:
    """Find the row of each cell from its rays; returns the cell that there was no room for.

    Args:
        classes: ``(A, S, P)``; of each ray.
        mask: ``(S, P)``; see :func:`masks`.
        place: ``(C,)``.
        first: Cell to begin with.
        high: ``(P,)``; sum of each place's hashes, overwritten at the first cell, and
        low: ``(P,)``, its lower half.
        keys: ``(Q + 1,)``; random keys of the rounded classes.
        known: ``(2, N)``; open tables of the keys of counts and of rounded counts.
        known_row: ``(2, N)``; their rows.
        profiles: ``(R, Q + 1)``; rounded counts of each row.
        used: ``(3,)``; entries of the two tables, and rows.
        row: ``(P,)``, overwritten at the cells.
    """
    n_cells, n_angles, n_sub = place.shape[0], classes.shape[0], classes.shape[1]
    if first == 0:
        _add_up(classes, mask, high, low)
    for c in range(first, n_cells):
        p = place[c]
        total = np.uint64(high[p]) << np.uint64(32) | np.uint64(low[p])
        at = slot_of(known[0], total)
        if known[0, at] == 0:
            if 2 * max(used[0], used[1]) >= known.shape[1] or used[2] == profiles.shape[0]:
                return c
            profile, key = profiles[used[2]], np.uint64(0)
            profile[:] = 0
            for a in range(n_angles):
                for s in range(n_sub):
                    if mask[s, p] != 0:
                        profile[classes[a, s, p]] += 1
            round_to_levels(profile, LEVELS)
            for q in range(profile.shape[0]):
                key += np.uint64(profile[q]) * keys[q]
            there = slot_of(known[1], key)
            if known[1, there] == 0:
                known[1, there], known_row[1, there] = key, used[2]
                used[1] += 1
                used[2] += 1
            known[0, at], known_row[0, at] = total, known_row[1, there]
            used[0] += 1
        row[p] = known_row[0, at]
    return n_cells


@njit(cache=True, nogil=True)
def _moved(
    known: NDArray[np.uint64], known_row: NDArray[np.int32], length: int
) -> tuple[NDArray[np.uint64], NDArray[np.int32]]:
    """Open tables of a new length with the same entries."""
    longer = np.zeros((2, length), dtype=np.uint64)
    rows = np.zeros((2, length), dtype=np.int32)
    for t in range(2):
        for i in range(known.shape[1]):
            if known[t, i] != 0:
                at = slot_of(longer[t], known[t, i])
                longer[t, at], rows[t, at] = known[t, i], known_row[t, i]
    return longer, rows


class Profiles:
    """The distinct profiles so far.

    Args:
        n_classes: Q + 1.
        is_open: ``(C, S)``; which sub-poses count.
        layout: Places of the cells.
    """

    def __init__(self, n_classes: int, is_open: NDArray[np.bool_], layout: GridLayout) -> None:
        self._mask, self._place = masks(is_open, layout), layout.place
        self._high, self._low = np.empty((2, layout.size), dtype=np.uint32)
        self._keys = 2 * np.random.default_rng(0).integers(0, 2**63, n_classes, np.uint64) + 1
        self._known = np.zeros((2, 1 << 14), dtype=np.uint64)
        self._rows = np.zeros((2, 1 << 14), dtype=np.int32)
        self._profiles = np.zeros((1 << 10, n_classes), dtype=np.int32)
        self._used = np.zeros(3, dtype=np.int64)

    def assign(self, classes: NDArray[Any], row: NDArray[np.int32]) -> None:
        """Give every cell its row; see :func:`_assign` for the arguments."""
        first = 0
        while first < len(self._place):
            first = _assign(
                classes, self._mask, self._place, first, self._high, self._low, self._keys,
                self._known, self._rows, self._profiles, self._used, row,
            )  # fmt: skip
            if 2 * self._used[:2].max() >= self._known.shape[1]:
                self._known, self._rows = _moved(self._known, self._rows, 4 * self._known.shape[1])
            if self._used[2] == len(self._profiles):
                self._profiles = np.concatenate([self._profiles, np.zeros_like(self._profiles)])

    @property
    def shares(self) -> NDArray[np.float64]:
        """``(R, Q + 1)``; share of each class in each row."""
        shares: NDArray[np.float64] = self._profiles[: self._used[2]] / LEVELS
        return shares
