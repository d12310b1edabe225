"""Free distances of a pose grid's probes, each set of them that states have in common kept once.

A *probe* is a sub-pose of a cell at a heading within a bin. Along a straight wall the probes of one
cell are as free as those of the next, so there are far fewer sets of distances, *kinds*, than
states. They are told apart by 64-bit hashes.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.beliefs.profiles import masks, room_for, slot_of
from activeloc.beliefs.sweep import Sweep
from activeloc.motion import MARGIN

UNITS = 200  # Free distances are kept in 1 / UNITS of a metre, up to 255 of them.
TURNS = (0.0, -1.0 / 3.0, 1.0 / 3.0)  # Headings probed across a bin [bin]; the first is its centre.


@njit(cache=True, nogil=True)
def _add_keys(
    free: NDArray[np.uint8],
    mask: NDArray[np.uint8],
    keys: NDArray[np.uint64],
    sums: NDArray[np.uint64],
) -> None:
    """Add to the sums of places ``(P,)`` what their free distances ``(T, S, P)`` come to.

    Args:
        free: In units.
        mask: ``(S, P)``; all bits set where a sub-pose is open.
        keys: ``(T, S)``.
        sums: Added to.
    """
    n_sub = free.shape[1]
    for t in range(free.shape[0]):
        for s in range(0, n_sub, 2):
            of, also, key, other = free[t, s], free[t, s + 1], keys[t, s], keys[t, s + 1]
            one, two = mask[s], mask[s + 1]
            for p in range(sums.shape[0]):
                sums[p] += key * np.uint64(of[p] & one[p]) + other * np.uint64(also[p] & two[p])


@njit(cache=True, nogil=True)
def _sort(
    free: NDArray[np.uint8],
    mask: NDArray[np.uint8],
    keys: NDArray[np.uint64],
    sums: NDArray[np.uint64],
    place: NDArray[np.int32],
    units: int,
    known: NDArray[np.uint64],
    number: NDArray[np.int32],
    kind: NDArray[np.int32],
    kept: NDArray[np.uint8],
    least: NDArray[np.uint8],
    near: NDArray[np.float32],
    cell: NDArray[np.int32],
) -> int:
    """Number the kinds of one heading as they come; returns how many there are.

    Args:
        free: ``(T, S, P)`` in units.
        mask: ``(S, P)``; all bits set where a sub-pose is open.
        keys: ``(T, S)``.
        sums: ``(P,)``; a key of the sub-poses that are open at each place, overwritten.
        place: ``(C,)``.
        units: Free distance that is no longer near.
        known: An open table, overwritten, and
        number: what it has, overwritten.
        kind: ``(C,)``, overwritten.
        kept: ``(C, T S)``, overwritten with the distances of each kind,
        least: ``(C,)`` with the least of them, 0 if a sub-pose is closed,
        near: ``(C,)`` with the share of open probes that have less than ``units`` ahead, and
        cell: ``(C,)`` with the first cell of it.
    """
    _add_keys(free, mask, keys, sums)
    known[:] = 0
    n, n_sub = 0, free.shape[1]
    for c in range(place.shape[0]):
        at = slot_of(known, sums[place[c]])
        if known[at] == 0:
            known[at], number[at], cell[n] = sums[place[c]], n, c
            lowest, n_near, n_open = np.uint8(255), 0, 0
            for i in range(kept.shape[1]):
                of, is_open = free[i // n_sub, i % n_sub, place[c]], mask[i % n_sub, place[c]] != 0
                kept[n, i], lowest = of, min(lowest, of if is_open else np.uint8(0))
                n_open += is_open
                n_near += is_open and of < units
            least[n], near[n] = lowest, n_near / n_open
            n += 1
        kind[c] = number[at]
    return n


class FreeDistances:
    """How far the way is open from each probe.

    Args:
        grid: Cells and headings.

    Attributes:
        kind: ``(K, C)``; of each state. Those of heading k are ``first[k] ... first[k + 1] - 1``.
        first: ``(K + 1,)``.
        units: ``(N, T S)``; distances of each kind, 255 for more. Where a sub-pose is closed it
            says nothing.
        is_open: ``(N, S)``; its open sub-poses.
        least: ``(N,)``; least of its distances, 0 if a sub-pose is closed.
        near: ``(N,)``; share of its open probes with less than a cell free ahead.
    """

    def __init__(self, grid: PoseGrid) -> None:
        world, layout = grid.terrain.grid, GridLayout(grid)
        unit = 1.0 / UNITS / world.resolution
        sweep = Sweep(grid, grid.terrain, np.arange(1, 256, dtype=np.float64) * unit + MARGIN)
        n_cells, shape = len(grid.cells), (len(TURNS), SUB * SUB)
        keys = np.random.default_rng(0).integers(0, 2**63, (1 + len(TURNS), SUB * SUB), np.uint64)
        keys = 2 * keys + 1
        mask = masks(grid.is_open, layout)
        which = (keys[0, :, None] * (mask > 0)).sum(axis=0, dtype=np.uint64)
        free, sums = np.empty((*shape, layout.size), dtype=np.uint8), np.empty_like(which)
        known, number = (
            np.empty(room_for(n_cells), np.uint64),
            np.empty(room_for(n_cells), np.int32),
        )
        kept, cell = np.empty((n_cells, shape[0] * shape[1]), np.uint8), np.empty(n_cells, np.int32)
        least, near = np.empty(n_cells, dtype=np.uint8), np.empty(n_cells, dtype=np.float32)
        self.kind = np.empty((grid.headings, n_cells), dtype=np.int32)
        found, self.first = [], np.zeros(grid.headings + 1, dtype=np.int64)
        cell_units = ceil(grid.cell_size * UNITS - 1e-9)
        for k, theta in enumerate(grid.thetas):
            for t, turn in enumerate(TURNS):
                sweep.along(np.array([theta + turn * grid.bin_width]), free[t])
            sums[:] = which
            n = _sort(
                free, mask, keys[1:], sums, layout.place, cell_units, known, number, self.kind[k],
                kept, least, near, cell,
            )  # fmt: skip
            self.kind[k] += self.first[k]
            self.first[k + 1] = self.first[k] + n
            found.append(
                (kept[:n].copy(), grid.is_open[cell[:n]], least[:n].copy(), near[:n].copy())
            )
        self.units, self.is_open, self.least, self.near = map(
            np.concatenate, zip(*found, strict=True)
        )
