"""The transition of one travelled distance, as :mod:`activeloc.beliefs.travel_table` makes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.plane_layout import BLOCK, PlaneLayout
from activeloc.beliefs.shared_rows import SharedRows


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
        target: ``(N,)`` of places and :meth:`mixed` weights.
        rows: What the weights are taken from.
        plain: ``(K * P,)``; 1 in the states on open ground.
        layout: Of the planes.
    """

    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]
    edge_start: NDArray[np.int64]
    source: NDArray[np.unsignedinteger]
    target: NDArray[np.unsignedinteger]
    rows: SharedRows
    plain: NDArray[np.uint8]
    layout: PlaneLayout
    _mixed: dict[tuple[float, str], NDArray[np.floating]] = field(default_factory=dict)
    _fours: dict[str, tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.floating]]] = field(
        default_factory=dict
    )

    def mixed(self, floor: float, precision: str) -> NDArray[np.floating]:
        """``(N,)``; weights where ways that an obstacle cuts short count ``floor``."""
        if (floor, precision) not in self._mixed:
            mixed = self.rows.mixed(floor).astype(precision)
            self._mixed[floor, precision] = self.rows.spread(mixed, len(self.source))
        return self._mixed[floor, precision]

    @property
    def weight(self) -> NDArray[np.floating]:
        """``(2, N)``: free, clipped. Summing to one per row."""
        return np.stack([self.rows.spread(of, len(self.source)) for of in self.rows.weight])

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
