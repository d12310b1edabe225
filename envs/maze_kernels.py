"""Steps, starts and observations of many robots in mazes, one kernel call each, shared by threads.

The kernels here only put others in order: those of :mod:`activeloc.beliefs.lattice_kernels` move
the robots, those of :mod:`activeloc.beliefs.lattice_filter` follow their beliefs. Robots are
independent of each other; a share of the work is a range of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, typeof, types
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from activeloc import sharing
from activeloc.beliefs import lattice_filter, lattice_kernels
from activeloc.beliefs.egocentric import PLANES, draw_views, turn_mazes
from activeloc.envs.egocentric import FAR, LONG
from activeloc.envs.maze_batch import Batch

STEP, START, SHOW = 0, 1, 2
STAY = 3
BELIEF, MAP, DEPTH, TIME, VIEW = range(5)


type_of: Any = typeof  # Untyped, to the type checkers.
_compiled: list[Callable[[Batch, NDArray[np.int64], int], None]] = []


@njit(cache=True, nogil=True)
def lead(batch: Batch, board: NDArray[np.int64], n_each: int) -> None:
    """Carry out the order for all robots, alone or with helpers that take some of the shares."""
    sharing.publish(board, n_each)
    while take_part(batch, board, 0, n_each):
        pass
    sharing.wait_for_others(board)


def run(batch: Batch, board: NDArray[np.int64], n_each: int) -> None:
    """:func:`lead`, compiled: its types are always the same, and to ask takes as long as a step."""
    if not _compiled:
        _compiled.append(lead.compile((type_of(batch), type_of(board), types.intp)))
    _compiled[0](batch, board, n_each)


@njit(cache=True, nogil=True)
def are_within(numbers: NDArray[np.int64], n: int) -> bool:
    """Whether all are in 0 ... n - 1."""
    n_within = 0
    for number in numbers:
        n_within += 0 <= number < n
    return n_within == numbers.shape[0]


@njit(cache=True, nogil=True)
def aim(
    shown: NDArray[np.int64],
    belief: NDArray[np.float32],
    maps: NDArray[np.float32],
    depth: NDArray[np.float32],
    time: NDArray[np.float32],
    view: NDArray[np.float32],
) -> None:
    """Note where observations are to be drawn; arrays of no size are not."""
    shown[BELIEF], shown[MAP], shown[DEPTH] = (
        belief.ctypes.data, maps.ctypes.data, depth.ctypes.data,
    )  # fmt: skip
    shown[TIME] = time.ctypes.data if time.size > 0 else 0
    shown[VIEW] = view.ctypes.data if view.size > 0 else 0


@njit(cache=True, nogil=True)
def take_part(batch: Batch, board: NDArray[np.int64], thread: int, n_each: int) -> bool:
    """One share of the work, if one is left."""
    share = sharing.take(board, thread, n_each)
    if share < 0:
        return False
    n, n_shares = batch.active.shape[0], n_each * sharing.n_threads(board)
    carry_out(batch, share * n // n_shares, (share + 1) * n // n_shares)
    sharing.finish(board)
    return True


@njit(cache=True, nogil=True)
def help_out(batch: Batch, n_each: int, board: NDArray[np.int64], helper: int) -> None:
    """A helper's part in :func:`lead`, again and again until nothing comes."""
    idle = 0
    while True:
        if take_part(batch, board, helper, n_each):
            idle = 0
        elif sharing.is_worth_waiting(board, helper, idle):
            idle += 1
        else:
            return


@njit(cache=True, nogil=True)
def carry_out(batch: Batch, first: int, last: int) -> None:
    """The order, for the active ones of a range of robots; all of them are shown."""
    if batch.order[0] == SHOW:
        show(batch, first, last)
        return
    if batch.order[0] == START:
        start(batch, first, last)
    else:
        step(batch, first, last)
    active = batch.active[first:last]
    lattice_filter.summarise(
        active, batch.bel[first:last], batch.live[first:last], batch.n_live[first:last],
        batch.largest[first:last], batch.likeliest[first:last], batch.entropy[first:last],
    )  # fmt: skip
    hold_against_truth(batch, first, last)


@njit(cache=True, nogil=True)
def step(batch: Batch, first: int, last: int) -> None:
    """The robots act and read; their beliefs are predicted and corrected."""
    active, actions = batch.active[first:last], batch.actions[first:last]
    depth, target = batch.depth[first:last], batch.target[first:last]
    state, reading = batch.state[first:last], batch.reading[first:last]
    lattice_kernels.move_and_read(
        active, actions, batch.uniforms[first:last], batch.p_step, batch.confusion, depth, target,
        state, reading,
    )  # fmt: skip
    lattice_filter.advance(
        active, actions, reading, batch.bel[first:last], batch.live[first:last],
        batch.n_live[first:last], depth, target, batch.p_step, batch.p,
        batch.impossible[first:last],
    )  # fmt: skip
    for b in range(first, last):
        batch.steps[b] += batch.active[b]


@njit(cache=True, nogil=True)
def start(batch: Batch, first: int, last: int) -> None:
    """The mazes' tables, where the robots stand, what they read, what they believe then."""
    some = np.flatnonzero(batch.active[first:last])
    n_cells, cells, depth = (
        batch.n_cells[first:last], batch.cells[first:last], batch.depth[first:last],
    )  # fmt: skip
    index, target = batch.index_of[first:last], batch.target[first:last]
    state, reading = batch.state[first:last], batch.reading[first:last]
    lattice_kernels.survey_all(
        some, batch.free[first:last], n_cells, cells, index, depth, target,
        batch.steps_of[0], batch.successor[first:last],
    )  # fmt: skip
    stay, noise = np.full(last - first, STAY), np.zeros((last - first, 2))
    row, col, heading = batch.pose
    for i in some:
        if heading < 0:
            state[i] = int(batch.luck[first + i, 0] * (4 * n_cells[i]))
        else:
            state[i] = 4 * index[i, row, col] + heading
        noise[i, 1] = batch.luck[first + i, 1]
        batch.steps[first + i] = 0
        batch.impossible[first + i] = 0
        batch.counts[0, first + i] = -1
    lattice_kernels.move_and_read(
        batch.active[first:last], stay, noise, batch.p_step, batch.confusion, depth, target,
        state, reading,
    )  # fmt: skip
    lattice_filter.begin(
        some, reading, n_cells, depth, batch.p, batch.bel[first:last], batch.live[first:last],
        batch.n_live[first:last],
    )  # fmt: skip
    if batch.view_free.shape[0] > 0:
        turn_mazes(
            some, batch.size[0], n_cells, cells, depth, batch.view_free[first:last],
            batch.view_readings[first:last],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def show(batch: Batch, first: int, last: int) -> None:
    """Draw the observations: see :class:`activeloc.envs.egocentric.MazeObservation`."""
    n, m = batch.free.shape[:2]
    bel, live, n_live = batch.bel[first:last], batch.live[first:last], batch.n_live[first:last]
    largest, cells = batch.largest[first:last], batch.cells[first:last]
    planes = carray(sharing.floats_at(batch.shown[BELIEF]), (n, 4, m, m))
    lattice_filter.picture(bel, live, n_live, cells, largest, planes[first:last])
    maps = carray(sharing.floats_at(batch.shown[MAP]), (n, m * m))
    free = batch.free[first:last].reshape(last - first, m * m)
    for i in range(last - first):
        for place in range(m * m):
            maps[first + i, place] = np.float32(free[i, place])
    depth = carray(sharing.floats_at(batch.shown[DEPTH]), (n,))
    for b in range(first, last):
        depth[b] = np.float32(min(batch.reading[b] + 1, FAR)) / np.float32(FAR)
    if batch.shown[TIME] != 0:
        time = carray(sharing.floats_at(batch.shown[TIME]), (n,))
        for b in range(first, last):
            time[b] = np.float32(min(batch.steps[b], LONG)) / np.float32(LONG)
    if batch.shown[VIEW] != 0:
        side = 2 * batch.radius[0] + 1
        views = carray(sharing.floats_at(batch.shown[VIEW]), (n, PLANES, side, side))
        views[first:last] = 0.0
        draw_views(
            batch.size[0], bel, live, n_live, largest, cells, batch.view_free[first:last],
            batch.view_readings[first:last], views[first:last],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def hold_against_truth(batch: Batch, first: int, last: int) -> None:
    """Score the beliefs of the active robots: ``scores``, ``verdict`` and ``counts``."""
    scores, verdict, counts = batch.scores, batch.verdict, batch.counts
    for b in range(first, last):
        if not batch.active[b]:
            continue
        truth, guess = batch.state[b], batch.likeliest[b]
        here, there = batch.cells[b, truth // 4], batch.cells[b, guess // 4]
        quarters = (truth - guess) % 4
        scores[0, b] = batch.entropy[b]
        scores[1, b] = batch.entropy[b] / np.log(4.0 * batch.n_cells[b])
        scores[2, b] = batch.largest[b]
        scores[3, b] = np.hypot(here[0] - there[0], here[1] - there[1])
        scores[4, b] = min(quarters, 4 - quarters) * (0.5 * np.pi)
        scores[5, b] = batch.largest[b] - batch.doubt[0] if batch.steps[b] > 0 else 0.0
        sure, is_true = batch.largest[b] > batch.confidence[0], truth == guess
        verdict[b, 0] = sure and is_true
        verdict[b, 1] = is_true
        verdict[b, 2] = sure and not is_true
        if not verdict[b, 0]:
            counts[0, b] = -1
        elif counts[0, b] < 0:
            counts[0, b] = batch.steps[b]
        counts[1, b] = batch.impossible[b]
        counts[2, b] = batch.reading[b] + 1
