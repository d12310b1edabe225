"""The transition of a travel as the filter walks through it: a list for each place and lane group.

A lane group's headings lead to much the same cells, so its list says for each cell that any of them
leads to how much of each goes there. Groups whose headings have the same rows share a list: all of
open ground has one for each group, and like places beside obstacles have one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.lanes import N_LANES
from activeloc.beliefs.profiles import room_for, slot_of


class Rows(NamedTuple):
    """Where states lead, each row a list of entries; those of open ground come last.

    Attributes:
        row: ``(K, C)``; row of each state, -1 on open ground.
        first: ``(R + K + 1,)``; where the rows' entries begin, then each stencil's, in
        step: ``(M,)``; places from the state's to the entry's, and
        weight: ``(2, M)``: free, clipped.
        longest: Of the steps, either way.
    """

    row: NDArray[np.int32]
    first: NDArray[np.int64]
    step: NDArray[np.int32]
    weight: NDArray[np.float32]
    longest: int


@njit(cache=True, nogil=True)
def _row_of(rows: Rows, k: int, c: int) -> int:
    """Row of a state, that of its heading's stencil on open ground."""
    if rows.row[k, c] >= 0:
        return int(rows.row[k, c])
    return rows.first.shape[0] - 1 - rows.row.shape[0] + k


@njit(cache=True, nogil=True)
def _sort(
    rows: Rows,
    headings: NDArray[np.int32],
    place: NDArray[np.int32],
    known: NDArray[np.uint64],
    number: NDArray[np.int32],
    keys: NDArray[np.uint64],
    n: int,
    which: NDArray[np.int32],
    cell: NDArray[np.int32],
) -> tuple[int, int]:
    """Tell the lists of one lane group apart, by the rows of its headings.

    Args:
        rows: Of the states.
        headings: Of the group; as many as it has.
        place: ``(C,)``.
        known: An open table, overwritten, and
        number: what it has, overwritten.
        keys: ``(LANES,)``; random, odd.
        n: How many lists there are already.
        which: ``(P,)``, overwritten with the list of each cell's place.
        cell: Overwritten from n on with the first cell of each list.

    Returns:
        How many lists there are, and how many entries the new ones have at most.
    """
    known[:] = 0
    most = 0
    for c in range(place.shape[0]):
        key = np.uint64(0)
        for i in range(headings.shape[0]):
            key += keys[i] * np.uint64(rows.row[headings[i], c] + 2)
        key ^= key >> np.uint64(29)
        at = slot_of(known, key)
        if known[at] == 0:
            known[at], number[at], cell[n] = key, n, c
            n += 1
            for k in headings:
                r = _row_of(rows, k, c)
                most += rows.first[r + 1] - rows.first[r]
        which[place[c]] = number[at]
    return n, most


@njit(cache=True, nogil=True)
def _merge(
    rows: Rows,
    headings: NDArray[np.int32],
    cell: NDArray[np.int32],
    slot: NDArray[np.int64],
    first: NDArray[np.int64],
    step: NDArray[np.int32],
    weight: NDArray[np.float32],
) -> int:
    """Write the lists of one lane group.

    Args:
        rows: Of the states.
        headings: Of the group; as many as it has.
        cell: ``(N,)``; one that has each list.
        slot: ``(2 S + 1,)`` of -1, for steps of up to S places.
        first: ``(N,)``, overwritten with where each list begins in
        step: overwritten, and
        weight: ``(2, ..., LANES)``, too.

    Returns:
        How many entries there are.
    """
    n = 0
    for i in range(cell.shape[0]):
        first[i] = n
        for lane in range(headings.shape[0]):
            r = _row_of(rows, headings[lane], cell[i])
            for e in range(rows.first[r], rows.first[r + 1]):
                at = rows.longest + rows.step[e]
                if slot[at] < 0:
                    slot[at], step[n] = n, rows.step[e]
                    for other in range(N_LANES):
                        weight[0, n, other], weight[1, n, other] = 0.0, 0.0
                    n += 1
                weight[0, slot[at], lane] += rows.weight[0, e]
                weight[1, slot[at], lane] += rows.weight[1, e]
        for j in range(first[i], n):
            slot[rows.longest + step[j]] = -1
    return n


@dataclass(frozen=True, eq=False)
class TravelLists:
    """Where each lane group of a place leads.

    Attributes:
        which: ``(P * G,)``; list of each place and lane group.
        first: ``(L + 1,)``; entries of list l are ``first[l] : first[l + 1]`` of
        step: ``(M,)``; places from the state's to the entry's, and
        weight: ``(2, M, LANES)``; of each heading: free, clipped.
    """

    which: NDArray[np.int32]
    first: NDArray[np.int64]
    step: NDArray[np.int32]
    weight: NDArray[np.float32]
    _mixed: dict[tuple[float, str], tuple[NDArray[np.floating], NDArray[np.floating]]] = field(
        default_factory=dict
    )

    def mixed(
        self, floor: float, precision: str
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Weights where ways that an obstacle cuts short count ``floor``.

        Returns:
            ``(M * LANES,)``, and ``(L * LANES,)``, what each list's sum to.
        """
        if (floor, precision) not in self._mixed:
            mixed = np.multiply(self.weight[1], floor, dtype=precision)
            mixed += self.weight[0]
            left = np.add.reduceat(mixed, self.first[:-1], axis=0)
            self._mixed[floor, precision] = mixed.ravel(), left.ravel()
        return self._mixed[floor, precision]

    @classmethod
    def of(cls, layout: GridLayout, rows: Rows, turned: int) -> TravelLists:
        """From the rows of the states.

        Args:
            layout: Of the states.
            rows: Theirs.
            turned: Heading bins between the robot's heading and the way it travels.
        """
        n_cells, n_groups = len(layout.place), layout.width // N_LANES
        keys = 2 * np.random.default_rng(0).integers(0, 2**63, N_LANES, np.uint64) + 1
        known = np.empty(room_for(n_cells), np.uint64)
        number, cell = np.empty(len(known), np.int32), np.empty(n_cells * n_groups, np.int32)
        which, n, room, groups = np.zeros((n_groups, layout.size), dtype=np.int32), 0, 0, []
        for g in range(n_groups):
            ahead = np.arange(N_LANES * g, min(N_LANES * (g + 1), layout.headings))
            group, begin = ((ahead + turned) % layout.headings).astype(np.int32), n
            n, most = _sort(rows, group, layout.place, known, number, keys, n, which[g], cell)
            groups.append((group, slice(begin, n)))
            room = max(room, most)
        slot, first = np.full(2 * rows.longest + 1, -1, np.int64), np.empty(n + 1, np.int64)
        # Room for one group at a time: what is not touched twice is slow to come by.
        step, weight = np.empty(room, np.int32), np.empty((2, room, N_LANES), np.float32)
        m, steps, weights = 0, [], []
        for group, of in groups:
            many = _merge(rows, group, cell[of], slot, first[of], step, weight)
            first[of] += m
            steps.append(step[:many].copy())
            weights.append(weight[:, :many].copy())
            m += many
        first[n] = m
        return cls(
            np.ascontiguousarray(which.T).ravel(), first,
            np.concatenate(steps), np.concatenate(weights, axis=1),
        )  # fmt: skip
