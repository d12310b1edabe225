"""Where a travel leads from beside obstacles: a row for each state, like ones worked out once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import travel_rows as kernels
from activeloc.beliefs.free_distance import TURNS, UNITS, FreeDistances
from activeloc.beliefs.landings import Landings
from activeloc.beliefs.plane_layout import BLOCK, PlaneLayout
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.profiles import room_for
from activeloc.beliefs.travel import lay_out


class SharedRows:
    """The rows of a travel; states that have one in common refer to it by its number.

    Args:
        grid: Cells and headings.
        free: Its free distances.
        lands: Where the travel ends on open ground.
        length: Of the travel [cell].
        p_free: ``(256,)``; probability that the way was open, by free distance in units.
        is_safe: For each kind of free distances, whether all ways are open without doubt.

    Attributes:
        row: ``(K, C)``; of each state, -1 on open ground.
        plain: ``(K, P)``; 1 in the states on open ground.
        first: ``(R + 1,)``; entries of row r are ``first[r] : first[r + 1]`` of
        step: ``(M,)``; from the state's place to the entry's, and
        weight: ``(2, M)``: free, clipped. Summing to one per row.
    """

    def __init__(
        self,
        grid: PoseGrid,
        free: FreeDistances,
        lands: Landings,
        length: float,
        p_free: NDArray[np.float64],
        is_safe: NDArray[np.bool_],
    ) -> None:
        self._layout, self._free, self._lands = PlaneLayout(grid), free, lands
        half, n_cells = lands.half, len(grid.cells)
        self._exists = np.pad((grid.index >= 0).astype(np.uint8), half)
        self._corner = (grid.cells @ (self._exists.shape[1], 1)).astype(np.int64)
        n_slots, room = (2 * half + 1) ** 2, room_for(n_cells)
        self._keys = 2 * np.random.default_rng(0).integers(0, 2**63, n_slots, np.uint64) + 1
        self._known, self._number = np.empty(room, np.uint64), np.empty(room, np.int32)
        self.row = np.empty((grid.headings, n_cells), dtype=np.int32)
        self.plain = np.zeros((grid.headings, self._layout.size), dtype=np.uint8)
        reach = np.array([1.0 / UNITS / grid.cell_size, length])
        turns = np.array(TURNS) * grid.bin_width
        firsts, steps, weights, n_rows, n = [], [], [], 0, 0
        for k, theta in enumerate(grid.thetas):
            stop = kernels.find_stops(grid.lattice, theta + turns, reach, half)
            ends = kernels.ends_of(self._slots(k), stop, half)
            cell = self._sort(k, ends, is_safe, n_rows)
            first, step, weight = self._fill(k, cell, stop, ends, p_free)
            firsts.append(first + n)
            steps.append(step)
            weights.append(weight)
            n_rows, n = n_rows + len(cell), n + len(step)
        self.first = np.append(np.concatenate(firsts), n)
        self.step, self.weight = np.concatenate(steps), np.concatenate(weights, axis=1)

    def _slots(self, k: int) -> NDArray[np.int64]:
        """What the probes' ways of heading k land in."""
        start = self._lands.start[k]
        return self._lands.slot[start[0] : start[-1]]

    def _sort(
        self, k: int, ends: NDArray[np.int64], is_safe: NDArray[np.bool_], n_before: int
    ) -> NDArray[np.int32]:
        """Number the rows of heading k from ``n_before`` on; returns the first cell of each."""
        lands, shape = self._lands, np.array(self._exists.shape) - 2 * self._lands.half
        step = lands.stencil_step[lands.stencil_start[k] : lands.stencil_start[k + 1]]
        stencil, around = np.empty(shape, np.uint8), np.empty(shape, np.uint64)
        kernels.look_around(self._exists, step, ends, self._keys, stencil, around)
        cell = np.empty(self.row.shape[1], dtype=np.int32)
        self._known[:] = 0
        n = kernels.sort_states(
            self._free.kind[k], is_safe, self._layout.place, stencil.ravel(), around.ravel(),
            self._known, self._number, n_before, self.row[k], self.plain[k], cell,
        )  # fmt: skip
        return cell[:n]

    def _fill(
        self,
        k: int,
        cell: NDArray[np.int32],
        stop: NDArray[np.int64],
        ends: NDArray[np.int64],
        p_free: NDArray[np.float64],
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
        """The rows of heading k that these cells have: first entries, steps, weights."""
        lands, free = self._lands, self._free
        start, room = lands.start[k], len(cell) * len(ends)
        first, step = np.empty(len(cell), np.int64), np.empty(room, np.int32)
        weight = np.empty((2, room), np.float32)
        n = kernels.fill_rows(
            free.units, free.is_open, free.kind[k, cell], self._corner[cell], self._exists,
            lands.half, start - start[0], self._slots(k), lands.share[start[0] : start[-1]], stop,
            ends, p_free, first, step, weight,
        )  # fmt: skip
        return first, step[:n].copy(), weight[:, :n].copy()

    def laid_out(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[Any], NDArray[Any], NDArray[np.float32]]:
        """Where each block's entries start; sources, targets and weights of all states' rows."""
        layout = self._layout
        n = int(np.diff(self.first)[self.row[self.row >= 0]].sum())
        small = np.dtype(np.uint16 if layout.size <= 2**16 else np.uint32)
        start = np.empty(layout.headings * layout.size // BLOCK + 1, dtype=np.int64)
        source, target = np.empty(n, small), np.empty(n, small)
        weight = np.empty((2, n), np.float32)
        lay_out(
            self.row, layout.place, self.first, self.step, self.weight, start, source, target,
            weight,
        )  # fmt: skip
        return start, source, target, weight
