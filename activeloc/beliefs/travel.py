"""The transition of one travelled distance, as :mod:`activeloc.beliefs.travel_table` makes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, PlaneLayout


@njit(cache=True, nogil=True)
def lay_out(
    row: NDArray[np.int32],
    place: NDArray[np.int32],
    first: NDArray[np.int64],
    step: NDArray[np.int32],
    shared: NDArray[np.float32],
    block_start: NDArray[np.int64],
    source: NDArray[np.uint16],
    target: NDArray[np.uint16],
    weight: NDArray[np.float32],
) -> None:
    """Write out the row of every state that has one.

    Args:
        row: ``(K, C)``; of each state, -1 for none.
        place: ``(C,)``, ascending.
        first: ``(R + 1,)``; entries of each row.
        step: ``(M,)``; from the state's place to the entry's.
        shared: ``(2, M)``; the rows' weights.
        block_start: ``(K * P / BLOCK + 1,)``, overwritten with the first entry of each block.
        source: ``(N,)``, overwritten with places, and
        target: ``(N,)`` too.
        weight: ``(2, N)``, overwritten.
    """
    n, b, per_plane = 0, 0, (block_start.shape[0] - 1) // row.shape[0]
    for k in range(row.shape[0]):
        for c in range(place.shape[0]):
            p, r = place[c], row[k, c]
            if r < 0:
                continue
            block = k * per_plane + p // BLOCK
            while b <= block:
                block_start[b] = n
                b += 1
            for e in range(first[r], first[r + 1]):
                source[n], target[n] = p, p + step[e]
                weight[0, n], weight[1, n] = shared[0, e], shared[1, e]
                n += 1
    block_start[b:] = n


@njit(cache=True, nogil=True)
def _mix(weight: NDArray[np.float32], floor: float, out: NDArray[np.floating]) -> None:
    """``out[i] = weight[0, i] + floor weight[1, i]``."""
    free, clipped = weight[0], weight[1]
    for i in range(out.shape[0]):
        out[i] = np.float64(free[i]) + floor * np.float64(clipped[i])


@njit(cache=True, nogil=True)
def _expect(
    share: NDArray[np.float64],
    source: NDArray[np.uint16],
    weight: NDArray[np.float32],
    floor: float,
) -> float:
    """Sum of what places that hold a share ``(P,)`` send off, clipped ways counting ``floor``."""
    total = 0.0
    for i in range(source.shape[0]):
        total += share[source[i]] * (weight[0, i] + floor * weight[1, i])
    return total


@dataclass(frozen=True, eq=False)
class Travel:
    """The transition of one travelled distance: stencils for open ground, rows beside obstacles.

    Cells are known by their places in a plane (:class:`~activeloc.beliefs.plane_layout`).

    Attributes:
        stencil_start: ``(K + 1,)``; entries of heading k are ``stencil_start[k] : [k + 1]`` of
        stencil_step: ``(E, 2)`` of row and column steps and
        stencil_weight: ``(E,)``, summing to one per heading.
        edge_start: ``(K * P / BLOCK + 1,)``; entries of the rows in each block of states are
            ``edge_start[b] : [b + 1]`` of
        source: ``(N,)`` of places, ascending for each heading,
        target: ``(N,)`` of places and
        weight: ``(2, N)``: free, clipped. Summing to one per row.
        plain: ``(K * P,)``; 1 in the states on open ground.
        layout: Of the planes.
    """

    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]
    edge_start: NDArray[np.int64]
    source: NDArray[np.unsignedinteger]
    target: NDArray[np.unsignedinteger]
    weight: NDArray[np.float32]
    plain: NDArray[np.uint8]
    layout: PlaneLayout
    _mixed: dict[tuple[float, str], NDArray[np.floating]] = field(default_factory=dict)
    _fours: dict[str, tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.floating]]] = field(
        default_factory=dict
    )

    def mixed(self, floor: float, precision: str) -> NDArray[np.floating]:
        """``(N,)``; weights where ways that an obstacle cuts short count ``floor``."""
        if (floor, precision) not in self._mixed:
            mixed = np.empty(self.weight.shape[1], dtype=precision)
            _mix(self.weight, floor, mixed)
            self._mixed[floor, precision] = mixed
        return self._mixed[floor, precision]

    @property
    def row_start(self) -> NDArray[np.int64]:
        """``(K * C + 1,)``; entries of state ``k * C + c``; none on open ground."""
        headings, place = self.layout.headings, self.layout.place
        plane = self.edge_start[:: self.layout.size // BLOCK]
        heading = np.repeat(np.arange(headings), np.diff(plane))
        state = heading * len(place) + np.searchsorted(place, self.source)
        return np.searchsorted(state, np.arange(headings * len(place) + 1))

    def fours(
        self, precision: str
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.floating]]:
        """The stencils as starts, shifts of places and weights.

        They are filled up to fours with nothing, unless only one is left over.
        """
        if precision not in self._fours:
            self._fours[precision] = self._filled_up(precision)
        return self._fours[precision]

    def _filled_up(
        self, precision: str
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.floating]]:
        size = np.diff(self.stencil_start)
        start = np.append(0, (size + np.where(size % 4 > 1, -size % 4, 0)).cumsum())
        shift, weight = np.zeros(start[-1], np.int32), np.zeros(start[-1], precision)
        owner = np.repeat(np.arange(len(size)), size)
        at = np.arange(len(owner)) - self.stencil_start[owner] + start[owner]
        shift[at] = self.stencil_step @ np.array([self.layout.cols, 1])
        weight[at] = self.stencil_weight
        return start, shift, weight

    @cached_property
    def box(self) -> NDArray[np.int32]:
        """``(K, 4)``; what can be reached: first and last row, first column and one past the last.

        Between where it starts and where a free travel ends, with a cell to spare on each side.
        """
        at = self.stencil_start[:-1]
        low = np.minimum(np.minimum.reduceat(self.stencil_step, at), 0) - 1
        high = np.maximum(np.maximum.reduceat(self.stencil_step, at), 0) + 1
        return np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]])

    def left(self, share: NDArray[np.float64], floor: float) -> float:
        """Mass that the travel leaves of a belief ``(P,)`` that is the same in every heading."""
        # A state without a row is open ground, whose stencil sums to one.
        of_each = self.plain.reshape(self.layout.headings, -1).sum(axis=0)
        beside = _expect(share, self.source, self.weight, floor)
        return float(share @ of_each + beside) / self.layout.headings
