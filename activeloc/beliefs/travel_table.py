"""How far the robot can travel from each state, and where a travel of a given length leads.

For every sub-pose of every cell and heading the free distance is kept once per map. From it, the
transition of a travelled distance is put together on demand: for each state the cells that the
robot may be in afterwards, with the sub-cell position, the heading within its bin and the noise
integrated over. Each weight is split in two: *free* (the whole way was open) and *clipped* (an
obstacle cut it short, and the robot stands there). The two sum to one over a row: p(x' | u, x, m).

Travels come in steps of half a cell (*levels*); the filter carries the remainder over.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import SUB, PoseGrid
from activeloc.motion import MARGIN, MotionNoise
from activeloc.raycast import cast_ray

UNITS = 200  # Free distances are kept in 1 / UNITS of a metre, up to 255 of them.
TURNS = (0.0, -1.0 / 3.0, 1.0 / 3.0)  # Headings probed across a bin [bin]; the first is its centre.
MAX_TARGETS = 40  # More cells than one travel can reach from one state.
# Gauss-Hermite nodes of a standard normal variable, three of them, and their weights.
_NODES = np.array([-sqrt(3.0), 0.0, sqrt(3.0)])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0


@njit(cache=True, nogil=True)
def _fill_free(
    squares: NDArray[np.uint8],
    sub_poses: NDArray[np.float64],
    is_open: NDArray[np.bool_],
    angles: NDArray[np.float64],
    unit: float,
    free: NDArray[np.uint8],
) -> None:
    """Fill ``free[c, k, s]`` with the free distance in units, 255 for more.

    A probe s is a sub-pose and a heading in the bin.

    Args:
        squares: ``(4, H + 2, W + 2)``; of the cells that are open to the robot's centre.
        sub_poses: ``(C, S, 2)`` of column and row [cell].
        is_open: ``(C, S)``; closed sub-poses get 0.
        angles: ``(K, S)``; heading of each probe.
        unit: Length of a unit [cell].
        free: ``(C, K, S)``, overwritten.
    """
    for k in range(angles.shape[0]):
        for s in range(angles.shape[1]):
            dx, dy = np.cos(angles[k, s]), np.sin(angles[k, s])
            for c in range(sub_poses.shape[0]):
                free[c, k, s] = 0
                if is_open[c, s]:
                    x, y = sub_poses[c, s, 0], sub_poses[c, s, 1]
                    z = cast_ray(squares, x, y, dx, dy, 256.0 * unit) - MARGIN
                    free[c, k, s] = min(255, int(max(0.0, z) / unit))


@njit(cache=True, nogil=True)
def _fill_stencils(
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


@njit(cache=True, nogil=True)
def _add(
    targets: NDArray[np.int32], parts: NDArray[np.float64], n: int, cell: int, part: int, w: float
) -> int:
    """Add a weight to a cell's entry in a short list; returns the list's new length."""
    for j in range(n):
        if targets[j] == cell:
            parts[part, j] += w
            return n
    if n == MAX_TARGETS:
        parts[part, n - 1] += w
        return n
    targets[n] = cell
    parts[:, n] = 0.0
    parts[part, n] = w
    return n + 1


@njit(cache=True, nogil=True)
def _at(index: NDArray[np.int32], row: int, col: int) -> int:
    """The belief's cell at a place, -1 where it has none."""
    inside = 0 <= row < index.shape[0] and 0 <= col < index.shape[1]
    return index[row, col] if inside else -1


@njit(cache=True, nogil=True)
def _add_probe(
    targets: NDArray[np.int32],
    parts: NDArray[np.float64],
    n: int,
    cell: int,
    row: int,
    col: int,
    weight: float,
    length: float,
    offset: NDArray[np.float64],
    angle: float,
    index: NDArray[np.int32],
    step: NDArray[np.int32],
    share: NDArray[np.float32],
    landings: tuple[int, int],
    reach: NDArray[np.float64],
) -> tuple[int, bool]:
    """Add one probe's ways to its state's row; the row's new length, and whether all were open.

    Args:
        targets: ``(MAX_TARGETS,)``; cells of the row so far.
        parts: ``(2, MAX_TARGETS)``; their free and clipped weights.
        n: Length of the row so far.
        cell: The state's cell,
        row: its row and
        col: column.
        weight: Of the probe in the row.
        length: Free distance of the probe [cell].
        offset: ``(2,)``; its place in the cell [cell].
        angle: Its heading [rad].
        index: ``(rows, cols)`` of cell or -1.
        step: ``(E, 2)``; see :func:`_fill_rows`.
        share: ``(E,)``.
        landings: First and one past the last of the probe's entries in those.
        reach: See :func:`_fill_rows`.
    """
    threshold, spread, safe, travel = reach[1:]
    p_free = 0.5 * (1.0 + erf((length - threshold) / (spread * sqrt(2.0))))
    landing = 0.0
    for e in range(landings[0], landings[1]):
        if _at(index, row + step[e, 0], col + step[e, 1]) >= 0:
            landing += share[e]
    # A way that is open along the probe's heading but ends on no cell of the belief.
    if landing < 1e-3:
        p_free = 0.0
    if p_free > 0.0:
        for e in range(landings[0], landings[1]):
            there = _at(index, row + step[e, 0], col + step[e, 1])
            if there >= 0:
                n = _add(targets, parts, n, there, 0, weight * p_free * share[e] / landing)
    stopped = min(length, travel)
    stop_row = row + int(np.floor(offset[1] + stopped * np.sin(angle)))
    stop_col = col + int(np.floor(offset[0] + stopped * np.cos(angle)))
    there = _at(index, stop_row, stop_col)
    n = _add(targets, parts, n, there if there >= 0 else cell, 1, weight * (1.0 - p_free))
    return n, length >= safe and landing > 0.9999


@njit(cache=True, nogil=True)
def _fill_rows(
    first: int,
    last: int,
    cells: NDArray[np.int32],
    index: NDArray[np.int32],
    is_open: NDArray[np.bool_],
    free: NDArray[np.uint8],
    lattice: NDArray[np.float64],
    angles: NDArray[np.float64],
    start: NDArray[np.int64],
    step: NDArray[np.int32],
    share: NDArray[np.float32],
    reach: NDArray[np.float64],
    size: NDArray[np.int32],
    target: NDArray[np.int32],
    weight: NDArray[np.float32],
) -> int:
    """Write the rows of cells ``first ... last - 1`` that obstacles touch; returns entries written.

    A state whose every probe is open, free and lands on the belief's cells gets an empty row:
    its transition is its heading's stencil.

    Args:
        first: First cell.
        last: One past the last.
        cells: ``(C, 2)`` of row and column.
        index: ``(rows, cols)`` of cell or -1.
        is_open: ``(C, S)``.
        free: ``(C, K, S)`` in units.
        lattice: ``(S, 2)`` of offsets of the probes [cell].
        angles: ``(K, S)``; heading of each probe.
        start: ``(K * S + 1,)``; landings of heading k from probe s, entries ``k * S + s``, of
        step: ``(E, 2)`` of row and column steps and
        share: ``(E,)``, summing to one per heading and probe.
        reach: Unit, free distance that counts as open, its spread, that with no doubt open, and
            the travel itself [cell].
        size: ``((last - first) * K,)``, overwritten with entries per row.
        target: Overwritten with cells.
        weight: ``(2, ...)``, overwritten with free and clipped weights.
    """
    n_probes = is_open.shape[1]
    targets = np.empty(MAX_TARGETS, dtype=np.int32)
    parts = np.zeros((2, MAX_TARGETS))
    written = 0
    for c in range(first, last):
        row, col = cells[c]
        n_open = is_open[c].sum()
        for k in range(angles.shape[0]):
            n = 0
            plain = n_open == n_probes
            for s in range(n_probes):
                if not is_open[c, s]:
                    continue
                landings = start[k * n_probes + s], start[k * n_probes + s + 1]
                n, is_plain = _add_probe(
                    targets, parts, n, c, row, col, 1.0 / n_open, free[c, k, s] * reach[0],
                    lattice[s], angles[k, s], index, step, share, landings, reach,
                )  # fmt: skip
                plain = plain and is_plain
            if plain:
                n = 0
            size[(c - first) * angles.shape[0] + k] = n
            target[written : written + n] = targets[:n]
            weight[:, written : written + n] = parts[:, :n]
            written += n
    return written


@dataclass(frozen=True, eq=False)
class Travel:
    """The transition of one travelled distance: stencils for open ground, rows beside obstacles.

    Attributes:
        stencil_start: ``(K + 1,)``; entries of heading k are ``stencil_start[k] : [k + 1]`` of
        stencil_step: ``(E, 2)`` of row and column steps and
        stencil_weight: ``(E,)``, summing to one per heading.
        row_start: ``(C * K + 1,)``; entries of state ``c * K + k``; none on open ground.
        target: ``(N,)`` of cells.
        weight: ``(2, N)``: free, clipped. Summing to one per row.
    """

    stencil_start: NDArray[np.int64]
    stencil_step: NDArray[np.int32]
    stencil_weight: NDArray[np.float32]
    row_start: NDArray[np.int64]
    target: NDArray[np.int32]
    weight: NDArray[np.float32]


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
        world = grid.terrain.grid
        # Probes: every sub-pose at every one of TURNS, the sub-poses of one heading together.
        self._lattice = np.tile(grid.lattice, (len(TURNS), 1))
        self._is_open = np.tile(grid.is_open, (1, len(TURNS)))
        turns = np.repeat(TURNS, SUB * SUB) * grid.bin_width
        self._angles = grid.thetas[:, None] + turns
        self.free = np.empty((len(grid.cells), *self._angles.shape), dtype=np.uint8)
        sub_poses = np.tile(world.to_cells(grid.sub_poses()), (1, len(TURNS), 1))
        unit = 1.0 / UNITS / world.resolution
        _fill_free(grid.terrain.squares, sub_poses, self._is_open, self._angles, unit, self.free)
        near = (self.free < grid.cell_size * UNITS) & self._is_open[:, None, :]
        n_open = self._is_open.sum(axis=-1)[:, None]
        self.p_contact = (near.sum(axis=-1) / n_open).astype(np.float32)
        self._levels: dict[tuple[int, int], Travel] = {}

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
        window = np.zeros((grid.headings, len(self._lattice), 2 * half + 1, 2 * half + 1))
        for i, turn in enumerate(TURNS):
            part = window[:, i * SUB * SUB : (i + 1) * SUB * SUB]
            middle = turns + turn * grid.bin_width
            _fill_stencils(grid.thetas, grid.lattice, middle, lengths, _WEIGHTS, part)
        start, step, weight = _sparse(window.mean(axis=1))
        # A travel is rounded to its level, so a way that is half a level short may have been open.
        reach = (
            np.array([1.0 / UNITS, length - self.step / 2.0, spread, length + 3.0 * spread, length])
            / grid.cell_size
        )
        subs = _sparse(window.reshape(-1, *window.shape[2:]))
        return Travel(start, step, weight, *self._rows(subs, reach))

    def _rows(
        self,
        landings: tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]],
        reach: NDArray[np.float64],
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
        grid, chunk = self.grid, 128
        sizes, targets, weights = [], [], []
        target = np.empty(chunk * grid.headings * MAX_TARGETS, dtype=np.int32)
        weight = np.empty((2, len(target)), dtype=np.float32)
        for first in range(0, len(grid.cells), chunk):
            last = min(first + chunk, len(grid.cells))
            size = np.empty((last - first) * grid.headings, dtype=np.int32)
            n = _fill_rows(
                first, last, grid.cells, grid.index, self._is_open, self.free, self._lattice,
                self._angles, *landings, reach, size, target, weight,
            )  # fmt: skip
            sizes.append(size)
            targets.append(target[:n].copy())
            weights.append(weight[:, :n].copy())
        start = np.concatenate([[0], np.concatenate(sizes).cumsum(dtype=np.int64)])
        return start, np.concatenate(targets), np.concatenate(weights, axis=1)


def _sparse(
    window: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """Starts, steps and weights of the entries of ``(N, 2 R + 1, 2 R + 1)`` that are not zero."""
    heading, row, col = np.nonzero(window)
    half = window.shape[1] // 2
    start = np.searchsorted(heading, np.arange(len(window) + 1))
    step = np.column_stack([row - half, col - half]).astype(np.int32)
    return start, step, window[heading, row, col].astype(np.float32)
