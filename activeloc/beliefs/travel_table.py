"""How far the robot can travel from each state, and where a travel of a given length leads.

For every sub-pose of every cell and heading the free distance is kept once per map. From it, the
transition of a travelled distance is put together on demand: for each state the cells that the
robot may be in afterwards, with the sub-cell position, the heading within its bin and the noise
integrated over. Each weight is split in two: *free* (the whole way was open) and *clipped* (an
obstacle cut it short, and the robot stands there). The two sum to one over a row: p(x' | u, x, m).

Travels come in steps of half a cell (*levels*); the filter carries the remainder over.
"""

from __future__ import annotations

from functools import cached_property
from math import ceil, erf, sqrt

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.free_distance import UNITS, FreeDistances
from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.landings import landings
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.shared_rows import RowBuilder
from activeloc.beliefs.travel import Travel
from activeloc.motion import MotionNoise


class TravelTable:
    """Free distances of a pose grid, and the transitions made from them.

    Args:
        grid: Cells and headings.
        noise: Of the odometry; its translation and heading noise are in the transitions.
    """

    def __init__(self, grid: PoseGrid, noise: MotionNoise) -> None:
        self.grid = grid
        self.noise = noise
        self.step = grid.cell_size / 2.0
        self.layout = GridLayout(grid)
        self._levels: dict[tuple[int, int], Travel] = {}

    @cached_property
    def free(self) -> FreeDistances:
        """Free distance of each state's probes."""
        return FreeDistances(self.grid)

    @cached_property
    def near(self) -> NDArray[np.float32]:
        """``(P * W,)``; share of each state's probes with an obstacle within a cell ahead."""
        return self.layout.laid_out(self.free.near[self.free.kind].T, "float32")

    @property
    def p_contact(self) -> NDArray[np.float32]:
        """``(C, K)``; the same by cell."""
        return self.layout.by_cell(self.near)

    @property
    def longest_level(self) -> int:
        """Longest travel of one transition, in levels; longer ones take several."""
        return int(200.0 / UNITS / self.step)

    def level(self, level: int, hops: int = 1) -> Travel:
        """The transition of a travel of ``level`` half cells forward, made at its first use.

        As one of ``hops`` equal parts of a travel, it has its share of that travel's variance.
        """
        if (level, hops) not in self._levels:
            self._levels[level, hops] = self._build(level, hops)
        return self._levels[level, hops]

    def _build(self, level: int, hops: int) -> Travel:
        grid, length = self.grid, level * self.step
        scale = length * sqrt(hops)
        spread = max(self.noise.translation_from_translation * scale, 0.005)
        bend = self.noise.rotation_from_translation * scale
        lands = landings(grid.headings, grid.cell_size, length, spread, bend)
        # A travel is rounded to its level, so a way that is half a level short may have been open.
        longest = length + 3.0 * spread
        p_free = _open_chance(1.0 / UNITS, length - self.step / 2.0, spread, longest)
        is_safe = self.free.least >= min(255, ceil(longest * UNITS - 1e-9))
        built = RowBuilder(grid, self.free, lands, p_free, is_safe)
        return Travel(
            lands.stencil_start, lands.stencil_step, lands.stencil_weight,
            built.rows, self.layout,
        )  # fmt: skip


def _open_chance(unit: float, threshold: float, spread: float, safe: float) -> NDArray[np.float64]:
    """``(256,)``; probability that a way was open whose free distance is so many units.

    Args:
        unit: Its length, and that of
        threshold: the free distance that is as likely open as not,
        spread: its standard deviation, and
        safe: a free distance with no doubt open.
    """
    p = np.ones(256)
    for f in range(256):
        if f * unit < safe:
            x = (f * unit - threshold) / (spread * sqrt(2.0))
            p[f] = 0.5 * (1.0 + erf(x)) if x > -4.5 else 0.0  # 1e-10
    return p
