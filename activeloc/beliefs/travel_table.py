"""How far the robot can travel from each state, and where a travel of a given length leads.

For every sub-pose of every cell and heading the free distance is kept once per map. From it, the
transition of a travelled distance is put together on demand: for each state the cells that the
robot may be in afterwards, with the sub-cell position, the heading within its bin and the noise
integrated over. Each weight is split in two: *free* (the whole way was open) and *clipped* (an
obstacle cut it short, and the robot stands there). The two sum to one over a row: p(x' | u, x, m).

Travels come in steps of half a cell (*levels*); the filter carries the remainder over.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import travel_kernels as kernels
from activeloc.beliefs.plane_layout import BLOCK, PlaneLayout
from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.beliefs.sweep import Sweep
from activeloc.motion import MARGIN, MotionNoise

UNITS = 200  # Free distances are kept in 1 / UNITS of a metre, up to 255 of them.
TURNS = (0.0, -1.0 / 3.0, 1.0 / 3.0)  # Headings probed across a bin [bin]; the first is its centre.
# Gauss-Hermite nodes of a standard normal variable, three of them, and their weights.
_NODES = np.array([-sqrt(3.0), 0.0, sqrt(3.0)])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
_ROOM = 1 << 18  # Entries that are written at a time.


@dataclass(frozen=True, eq=False)
class Travel:
    """The transition of one travelled distance: stencils for open ground, rows beside obstacles.

    Cells are known by their places in a plane (:class:`~activeloc.beliefs.plane_layout`).

    Attributes:
        stencil_start: ``(K + 1,)``; entries of heading k are ``stencil_start[k] : [k + 1]`` of
        stencil_step: ``(E, 2)`` of row and column steps and
        stencil_weight: ``(E,)``, summing to one per heading.
        row_start: ``(K * C + 1,)``; entries of state ``k * C + c``; none on open ground.
        source: ``(N,)`` of places, ascending for each heading.
        target: ``(N,)`` of places.
        weight: ``(2, N)``: free, clipped. Summing to one per row.
        plain: ``(K * P,)``; 1 in the states on open ground.
        layout: Of the planes.
    """

    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]
    row_start: NDArray[np.int64]
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
            weight = self.weight[0] + floor * self.weight[1].astype(np.float64)
            self._mixed[floor, precision] = weight.astype(precision)
        return self._mixed[floor, precision]

    @cached_property
    def edge_start(self) -> NDArray[np.int64]:
        """``(K * P / BLOCK + 1,)``; entries of the rows in each block of states."""
        place, size = self.layout.place, self.layout.size
        cell = np.searchsorted(place, np.arange(0, size, BLOCK))
        state = np.arange(self.layout.headings)[:, None] * len(place) + cell
        return np.append(self.row_start[state.ravel()], self.row_start[-1])

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
        boxes = np.zeros((len(self.stencil_start) - 1, 4), np.int32)
        for k, (first, last) in enumerate(
            zip(self.stencil_start[:-1], self.stencil_start[1:], strict=True)
        ):
            low = np.minimum(self.stencil_step[first:last].min(axis=0), 0) - 1
            high = np.maximum(self.stencil_step[first:last].max(axis=0), 0) + 1
            boxes[k] = low[0], high[0], low[1], high[1]
        return boxes


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
        self.layout = PlaneLayout(grid)
        self._levels: dict[tuple[int, int], Travel] = {}

    @cached_property
    def free(self) -> NDArray[np.uint8]:
        """``(K, T, S, P)``; free distance of each probe in units, 255 for more.

        A probe is a sub-pose at one of :data:`TURNS`. Where a sub-pose is closed it says nothing.
        """
        grid, world = self.grid, self.grid.terrain.grid
        unit = 1.0 / UNITS / world.resolution
        sweep = Sweep(grid, grid.terrain, np.arange(1, 256, dtype=np.float64) * unit + MARGIN)
        free = np.empty((grid.headings, len(TURNS), SUB * SUB, self.layout.size), dtype=np.uint8)
        for k, theta in enumerate(grid.thetas):
            for t, turn in enumerate(TURNS):
                sweep.along(np.array([theta + turn * grid.bin_width]), free[k, t])
        return free

    @cached_property
    def _is_open(self) -> NDArray[np.bool_]:
        return np.ascontiguousarray(self.grid.is_open.T)

    @cached_property
    def near(self) -> NDArray[np.float32]:
        """``(K * P,)``; share of each state's probes with an obstacle within a cell ahead."""
        near = np.zeros((self.grid.headings, self.layout.size), dtype=np.float32)
        units = ceil(self.grid.cell_size * UNITS - 1e-9)
        kernels.count_near(self.free, self._is_open, self.layout.place, units, near)
        return near.ravel()

    @property
    def p_contact(self) -> NDArray[np.float32]:
        """``(C, K)``; the same by cell."""
        near = self.near.reshape(self.grid.headings, -1)
        return np.ascontiguousarray(near[:, self.layout.place].T)

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
        grid = self.grid
        length = level * self.step
        scale = length * np.sqrt(hops)
        spread = max(self.noise.translation_from_translation * scale, 0.005)
        bend = self.noise.rotation_from_translation * scale
        # Equally likely headings: a third of the bin's width, and the turn's noise at three nodes.
        within = ((np.arange(2) + 0.5) / 2 - 0.5) / len(TURNS) * grid.bin_width
        nodes = np.repeat(_NODES * bend, (1, 4, 1))
        turns = (within[:, None] + nodes).ravel()
        lengths = (length + _NODES * spread) / grid.cell_size
        half = int(np.ceil(lengths.max())) + 1
        n_sub = SUB * SUB
        window = np.zeros((grid.headings, len(TURNS) * n_sub, 2 * half + 1, 2 * half + 1))
        for i, turn in enumerate(TURNS):
            part = window[:, i * n_sub : (i + 1) * n_sub]
            middle = turns + turn * grid.bin_width
            kernels.fill_stencils(grid.thetas, grid.lattice, middle, lengths, _WEIGHTS, part)
        start, step, weight = _sparse(window.mean(axis=1))
        # A travel is rounded to its level, so a way that is half a level short may have been open.
        p_free = kernels.open_chance(
            1.0 / UNITS, length - self.step / 2.0, spread, length + 3.0 * spread
        )
        reach = np.array([1.0 / UNITS, length]) / grid.cell_size
        safe = min(255, ceil((length + 3.0 * spread) * UNITS - 1e-9))
        rows = self._rows(window, p_free, reach, safe)
        return Travel(start, step, weight.astype(np.float32), *rows, self.layout)

    def _rows(
        self,
        window: NDArray[np.float64],
        p_free: NDArray[np.float64],
        reach: NDArray[np.float64],
        safe: int,
    ) -> tuple[NDArray[np.int64], NDArray[Any], NDArray[Any], NDArray[np.float32],
               NDArray[np.uint8]]:  # fmt: skip
        grid, layout, half = self.grid, self.layout, window.shape[2] // 2
        exists_at = (grid.index >= 0).astype(np.uint8)
        exists = np.pad(exists_at, half)
        whole = np.zeros(layout.size, dtype=np.uint8)
        whole[layout.place] = grid.is_open.all(axis=1)
        q = np.zeros((SUB * SUB, layout.size))
        q[:, layout.place] = self._is_open / (len(TURNS) * self._is_open.sum(axis=0))
        plain = np.zeros((grid.headings, layout.size), dtype=np.uint8)
        sizes = np.zeros((grid.headings, layout.size), dtype=np.int64)
        small = np.dtype(np.uint16 if layout.size <= 2**16 else np.uint32)
        room = max(_ROOM, layout.cols * window.shape[2] ** 2)
        target, weight = np.empty(room, small), np.empty((2, room), np.float32)
        targets, weights, turns = [], [], np.array(TURNS) * grid.bin_width
        for k in range(grid.headings):
            start, step, share = _sparse(window[k])
            slot = (step + half) @ np.array([2 * half + 1, 1])
            places = plain[k, : exists_at.size].reshape(grid.shape)
            free = self.free[k].reshape(-1, layout.size)
            kernels.fill_plain(free, whole, exists, np.unique(step, axis=0), safe, places)
            first = 0
            while first < grid.shape[0]:
                first, n = kernels.fill_rows(
                    first, self.free[k], q, exists, places, grid.lattice, grid.thetas[k] + turns,
                    start, slot, share, p_free, reach, sizes[k], target, weight,
                )  # fmt: skip
                targets.append(target[:n].copy())
                weights.append(weight[:, :n].copy())
        own = np.arange(layout.size, dtype=small)
        source = np.repeat(np.tile(own, grid.headings), sizes.ravel())
        row_start = np.append(0, sizes[:, layout.place].ravel().cumsum())
        return (
            row_start, source, np.concatenate(targets), np.concatenate(weights, axis=1),
            plain.ravel(),
        )  # fmt: skip


def _sparse(
    window: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """Starts, steps and weights of the entries of ``(N, 2 R + 1, 2 R + 1)`` that are not zero."""
    heading, row, col = np.nonzero(window)
    half = window.shape[1] // 2
    start = np.searchsorted(heading, np.arange(len(window) + 1))
    step = np.column_stack([row - half, col - half]).astype(np.int32)
    return start, step, window[heading, row, col]
