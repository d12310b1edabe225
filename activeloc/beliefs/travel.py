"""The transition of one travelled distance, as :mod:`activeloc.beliefs.travel_table` makes it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.shared_rows import SharedRows
from activeloc.beliefs.travel_lists import Rows, TravelLists


@dataclass(frozen=True, eq=False)
class Travel:
    """The transition of one travelled distance: stencils for open ground, rows beside obstacles.

    Attributes:
        stencil_start: ``(K + 1,)``; entries of heading k are ``stencil_start[k] : [k + 1]`` of
        stencil_step: ``(E, 2)`` of row and column steps and
        stencil_weight: ``(E,)``, summing to one per heading.
        rows: Of the states beside obstacles.
        layout: Of the states.
    """

    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]
    rows: SharedRows
    layout: GridLayout
    _lists: dict[bool, TravelLists] = field(default_factory=dict)

    def lists(self, backward: bool = False) -> TravelLists:
        """What the filter walks through, where the robot travels ahead or back."""
        if backward not in self._lists:
            turned = self.layout.headings // 2 if backward else 0
            self._lists[backward] = TravelLists.of(self.layout, self._all_rows(), turned)
        return self._lists[backward]

    def _all_rows(self) -> Rows:
        """The rows, and the stencils as rows of which nothing is clipped."""
        rows, weight = self.rows, self.stencil_weight
        steps = (self.stencil_step @ (self.layout.cols, 1)).astype(np.int32)
        first = np.append(rows.first, rows.first[-1] + self.stencil_start[1:])
        step = np.append(rows.step, steps)
        weight = np.hstack([rows.weight, [weight, np.zeros_like(weight)]])
        return Rows(rows.row, first, step, weight, int(np.abs(step).max()))
