"""Where travels of one length lead on open ground: the same on every map.

A *window* is the square of cells around the one that a travel starts in, as far as it may lead; its
*slots* are numbered row by row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.free_distance import TURNS, UNITS
from activeloc.beliefs.pose_grid import SUB, bin_centres, sub_lattice

# Gauss-Hermite nodes of a standard normal variable, three of them, and their weights.
_NODES = np.array([-sqrt(3.0), 0.0, sqrt(3.0)])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0


@njit(cache=True, nogil=True)
def _fill_windows(
    thetas: NDArray[np.float64],
    lattice: NDArray[np.float64],
    turns: NDArray[np.float64],
    lengths: NDArray[np.float64],
    weights: NDArray[np.float64],
    window: NDArray[np.float64],
) -> None:
    """Add up where a travel ends: ``window[k, s, row, col]`` around the cell it starts in.

    Args:
        thetas: ``(K,)``.
        lattice: ``(S, 2)`` of sub-pose offsets [cell].
        turns: ``(A,)``; equally likely headings, relative to the bin's centre [rad].
        lengths: ``(L,)``; travels [cell], with
        weights: ``(L,)``.
        window: ``(K, S, 2 R + 1, 2 R + 1)``, zeros.
    """
    half = window.shape[2] // 2
    share = 1.0 / (turns.shape[0] * SUB * SUB)
    for k in range(thetas.shape[0]):
        for t in range(turns.shape[0]):
            dx, dy = np.cos(thetas[k] + turns[t]), np.sin(thetas[k] + turns[t])
            for n in range(lengths.shape[0]):
                for s in range(lattice.shape[0]):
                    for i in range(SUB):
                        x = lattice[s, 0] + ((i + 0.5) / SUB - 0.5) / SUB + lengths[n] * dx
                        col = int(np.floor(x)) + half
                        for j in range(SUB):
                            y = lattice[s, 1] + ((j + 0.5) / SUB - 0.5) / SUB + lengths[n] * dy
                            window[k, s, int(np.floor(y)) + half, col] += share * weights[n]


@dataclass(frozen=True, eq=False)
class Landings:
    """Where a travel ends: from each probe, and from all of a cell's together.

    Attributes:
        half: R; a window has ``2 R + 1`` rows and columns.
        start: ``(K, T S + 1)``; landings of each probe, entries of
        slot: ``(E,)`` that they fall into and
        share: ``(E,)``, summing to one for each.
        stop: ``(K, T S, F)``; slot that each probe stands in after so many units of free distance;
            the last where nothing stops it.
        ends: For each heading, slots that a way may end in, ascending.
        stencil_start: ``(K + 1,)``; entries of each heading in
        stencil_step: ``(F, 2)`` of row and column steps and
        stencil_weight: ``(F,)``, summing to one for each.
    """

    half: int
    start: NDArray[np.int64]
    slot: NDArray[np.uint16]
    share: NDArray[np.float64]
    stop: NDArray[np.uint16]
    ends: list[NDArray[np.intp]]
    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]


def _stops(headings: int, cell_size: float, length: float, half: int) -> NDArray[np.uint16]:
    """See :class:`Landings`."""
    z = np.minimum(np.arange(min(256, ceil(length * UNITS) + 1)) / UNITS, length) / cell_size
    angles = bin_centres(headings)[:, None] + np.array(TURNS) * (2.0 * np.pi / headings)
    angles = angles[:, :, None, None]
    x, y = sub_lattice().T[:, :, None]
    row = np.floor(y + z * np.sin(angles)).astype(np.int32) + half
    col = np.floor(x + z * np.cos(angles)).astype(np.int32) + half
    return (row * (2 * half + 1) + col).astype(np.uint16).reshape(headings, -1, len(z))


def _ends(
    start: NDArray[np.int64], slot: NDArray[np.intp], stop: NDArray[np.uint16], half: int
) -> list[NDArray[np.intp]]:
    """See :class:`Landings`."""
    is_end = np.zeros((len(stop), (2 * half + 1) ** 2), dtype=np.bool_)
    is_end[:, is_end.shape[1] // 2] = True
    for k, of in enumerate(is_end):
        of[slot[start[k, 0] : start[k, -1]]] = of[stop[k]] = True
    return [np.flatnonzero(of) for of in is_end]


@lru_cache(maxsize=16)
def landings(
    headings: int, cell_size: float, length: float, spread: float, bend: float
) -> Landings:
    """Landings of a travel, kept for the 16 used last.

    Args:
        headings: K.
        cell_size: Side of a cell [m].
        length: Of the travel [m].
        spread: Its standard deviation [m].
        bend: Standard deviation of its heading [rad].
    """
    width, n_sub = 2.0 * np.pi / headings, SUB * SUB
    # Equally likely headings: a third of the bin's width, and the turn's noise at three nodes.
    within = ((np.arange(2) + 0.5) / 2 - 0.5) / len(TURNS) * width
    turns = (within[:, None] + np.repeat(_NODES * bend, (1, 4, 1))).ravel()
    lengths = (length + _NODES * spread) / cell_size
    half = ceil(lengths.max()) + 1
    side = 2 * half + 1
    window = np.zeros((headings, len(TURNS) * n_sub, side, side))
    for i, turn in enumerate(TURNS):
        part = window[:, i * n_sub : (i + 1) * n_sub]
        _fill_windows(
            bin_centres(headings), sub_lattice(), turns + turn * width, lengths, _WEIGHTS, part
        )  # fmt: skip
    probe, slot = np.divmod(np.flatnonzero(window), side * side)
    first = np.searchsorted(probe, np.arange(headings * len(TURNS) * n_sub + 1))
    start = first[
        np.arange(headings)[:, None] * len(TURNS) * n_sub + np.arange(len(TURNS) * n_sub + 1)
    ]
    mean = window.mean(axis=1)
    heading, row, col = np.nonzero(mean)
    stop = _stops(headings, cell_size, length, half)
    return Landings(
        half, start, slot.astype(np.uint16), window.ravel()[np.flatnonzero(window)],
        stop, _ends(start, slot, stop, half),
        np.searchsorted(heading, np.arange(headings + 1)),
        np.column_stack([row - half, col - half]).astype(np.int32),
        mean[heading, row, col].astype(np.float32),
    )  # fmt: skip
