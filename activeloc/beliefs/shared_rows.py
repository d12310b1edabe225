"""Where a travel leads from beside obstacles: a row for each state, like ones worked out once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import travel_rows as kernels
from activeloc.beliefs.free_distance import FreeDistances
from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.landings import Landings
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.profiles import room_for


@dataclass(frozen=True, eq=False)
class SharedRows:
    """The rows of a travel; states that have one in common refer to it by its number.

    Attributes:
        row: ``(K, C)``; of each state, -1 on open ground.
        first: ``(R + 1,)``; entries of row r are ``first[r] : first[r + 1]`` of
        step: ``(M,)``; from the state's place to the entry's, and
        weight: ``(2, M)``: free, clipped. Summing to one per row.
        held: ``(R,)``; sum of the open ground's shares of the cells of all states that have it.
    """

    row: NDArray[np.int32]
    first: NDArray[np.int64]
    step: NDArray[np.int32]
    weight: NDArray[np.float32]
    held: NDArray[np.float64]

    def mixed(self, floor: float) -> NDArray[np.float64]:
        """``(M,)``; weights where ways that an obstacle cuts short count ``floor``."""
        result: NDArray[np.float64] = self.weight[0] + floor * self.weight[1].astype(np.float64)
        return result

    def left(self, floor: float) -> float:
        """Mass that the travel leaves of the uniform belief over the open ground."""
        mass = np.add.reduceat(self.mixed(floor), self.first[:-1])
        # A state without a row is open ground, whose stencil sums to one.
        return 1.0 - float(self.held @ (1.0 - mass)) / len(self.row)


class RowBuilder:
    """Works the rows of a travel out, heading by heading.

    Args:
        grid: Cells and headings.
        free: Its free distances.
        lands: Where the travel ends on open ground.
        p_free: ``(256,)``; probability that the way was open, by free distance in units.
        is_safe: For each kind of free distances, whether all ways are open without doubt.

    Attributes:
        rows: Of all states.
    """

    def __init__(
        self,
        grid: PoseGrid,
        free: FreeDistances,
        lands: Landings,
        p_free: NDArray[np.float64],
        is_safe: NDArray[np.bool_],
    ) -> None:
        self._layout, self._free, self._lands = GridLayout(grid), free, lands
        half, n_cells = lands.half, len(grid.cells)
        self._exists = np.pad((grid.index >= 0).astype(np.uint8), half)
        self._corner = (grid.cells @ (self._exists.shape[1], 1)).astype(np.int64)
        n_slots, room = (2 * half + 1) ** 2, room_for(n_cells)
        self._keys = 2 * np.random.default_rng(0).integers(0, 2**63, n_slots, np.uint64) + 1
        self._known, self._number = np.empty(room, np.uint64), np.empty(room, np.int32)
        self._share = grid.area / grid.area.sum()
        self._row = np.empty((grid.headings, n_cells), dtype=np.int32)
        room = n_cells * max(len(slots) for slots in lands.ends)
        self._cell, self._first = np.empty(n_cells, np.int32), np.empty(n_cells, np.int64)
        self._held = np.empty(n_cells)
        self._step, self._weight = np.empty(room, np.int32), np.empty((2, room), np.float32)
        firsts, steps, weights, helds, n_rows, n = [], [], [], [], 0, 0
        for k in range(grid.headings):
            n_new = self._sort(k, is_safe)
            n_entries = self._fill(k, n_new, p_free)
            self._row[k] += np.where(self._row[k] >= 0, np.int32(n_rows), np.int32(0))
            firsts.append(self._first[:n_new] + n)
            steps.append(self._step[:n_entries].copy())
            weights.append(self._weight[:, :n_entries].copy())
            helds.append(self._held[:n_new].copy())
            n_rows, n = n_rows + n_new, n + n_entries
        self.rows = SharedRows(
            self._row, np.append(np.concatenate(firsts), n), np.concatenate(steps),
            np.concatenate(weights, axis=1), np.concatenate(helds),
        )  # fmt: skip

    def _of(self, k: int) -> tuple[NDArray[np.int64], NDArray[np.uint16], NDArray[np.float64]]:
        """Landings of heading k: where each probe's begin, slots and shares."""
        start = self._lands.start[k]
        of = slice(start[0], start[-1])
        return start - start[0], self._lands.slot[of], self._lands.share[of]

    def _sort(self, k: int, is_safe: NDArray[np.bool_]) -> int:
        """Number the rows of heading k; returns how many there are."""
        lands = self._lands
        stencil = lands.stencil_step[slice(*lands.stencil_start[k : k + 2])]
        n: int = kernels.sort_states(
            self._free.kind[k], is_safe, self._layout.place, self._share, self._exists,
            lands.half, stencil, lands.ends[k], self._keys,
            self._known, self._number, self._row[k], self._cell, self._held,
        )  # fmt: skip
        return n

    def _fill(self, k: int, n: int, p_free: NDArray[np.float64]) -> int:
        """Work out n rows of heading k; returns how many entries they have."""
        free, lands, cell = self._free, self._lands, self._cell[:n]
        n_entries: int = kernels.fill_rows(
            free.units, free.is_open, free.kind[k, cell], self._corner[cell], self._exists,
            lands.half, *self._of(k), lands.stop[k], lands.ends[k], p_free, self._first,
            self._step, self._weight,
        )  # fmt: skip
        return n_entries
