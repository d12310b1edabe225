"""A step and a start of many robots in mazes, one kernel call each, shared by threads or not.

The kernels here only put others in order: those of :mod:`activeloc.beliefs.lattice_kernels` move
the robots, those of :mod:`activeloc.beliefs.lattice_filter` follow their beliefs. Robots are
independent of each other; a share of the work is a range of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import sharing
from activeloc.beliefs import lattice_filter, lattice_kernels
from activeloc.beliefs.egocentric import draw_views, turn_mazes

STEP, START = 0, 1
STAY = 3


class Batch(NamedTuple):
    """All that B robots in mazes are made of: arrays that stay where they are, and are overwritten.

    Attributes:
        free: See :class:`activeloc.beliefs.lattice.Lattice` for these eleven.
        n_cells: .
        cells: .
        index_of: Its ``index``.
        depth: .
        successor: .
        target: .
        steps_of: Its ``steps``.
        p_step: .
        confusion: Of its sensor.
        p: .
        bel: See :class:`activeloc.beliefs.lattice.LatticeBelief` for these seven.
        live: .
        n_live: .
        impossible: .
        largest: .
        likeliest: .
        entropy: .
        order: ``(1,)``; what is to be done: ``STEP`` or ``START``.
        active: ``(B,)``; to whom.
        actions: ``(B,)`` of 0, 1, 2.
        uniforms: ``(B, 2)`` in [0, 1): noise of the step and of the reading.
        luck: ``(B, 2)`` in [0, 1): where a robot starts, and its first reading's noise.
        pose: ``(3,)``; row, column and heading to start at; negative to be drawn.
        confidence: ``(1,)``; a belief is sure above it.
        steps: ``(B,)``; taken.
        state: ``(B,)``; where the robots are.
        reading: ``(B,)``; last depth read, less one.
        scores: ``(5, B)``; entropy [nat], and over the uniform belief's; the largest probability;
            of the state that has it: distance to the truth [cell] and angle [rad].
        verdict: ``(3, B)``; sure and right, the most likely state is true, sure and wrong.
        counts: ``(3, B)``; since when it has been sure and right, or -1; impossible readings; the
            last depth read [cell].
        size: ``(1,)``; m, for the views.
        views: ``(B, 5, s, s)``, or ``(0, 5, 0, 0)`` for none.
        view_free: See :class:`activeloc.beliefs.egocentric.EgocentricView`.
        view_readings: .
    """

    free: NDArray[np.bool_]
    n_cells: NDArray[np.int32]
    cells: NDArray[np.int32]
    index_of: NDArray[np.int32]
    depth: NDArray[np.int32]
    successor: NDArray[np.int16]
    target: NDArray[np.int32]
    steps_of: NDArray[np.int64]
    p_step: NDArray[np.float64]
    confusion: NDArray[np.float64]
    p: NDArray[np.float64]
    bel: NDArray[np.float64]
    live: NDArray[np.int32]
    n_live: NDArray[np.int32]
    impossible: NDArray[np.int32]
    largest: NDArray[np.float64]
    likeliest: NDArray[np.int32]
    entropy: NDArray[np.float64]
    order: NDArray[np.int64]
    active: NDArray[np.bool_]
    actions: NDArray[np.int64]
    uniforms: NDArray[np.float64]
    luck: NDArray[np.float64]
    pose: NDArray[np.int64]
    confidence: NDArray[np.float64]
    steps: NDArray[np.int64]
    state: NDArray[np.int32]
    reading: NDArray[np.int32]
    scores: NDArray[np.float64]
    verdict: NDArray[np.bool_]
    counts: NDArray[np.int64]
    size: NDArray[np.int64]
    views: NDArray[np.float32]
    view_free: NDArray[np.float32]
    view_readings: NDArray[np.uint64]


@njit(cache=True, nogil=True)
def lead(batch: Batch, board: NDArray[np.int64], n_shares: int) -> None:
    """Carry out the order for all robots, alone or with helpers that take some of the shares."""
    n = batch.active.shape[0]
    sharing.publish(board, n_shares)
    while True:
        share = sharing.take(board)
        if share < 0:
            break
        i = share % n_shares
        carry_out(batch, i * n // n_shares, (i + 1) * n // n_shares)
        sharing.finish(board)
    sharing.wait_for_others(board)


@njit(cache=True, nogil=True)
def help_out(batch: Batch, n_shares: int, board: NDArray[np.int64], helper: int) -> None:
    """A helper's part in :func:`lead`, again and again until nothing comes."""
    n, idle = batch.active.shape[0], 0
    while True:
        share = sharing.take(board)
        if share >= 0:
            i = share % n_shares
            carry_out(batch, i * n // n_shares, (i + 1) * n // n_shares)
            sharing.finish(board)
            idle = 0
        elif sharing.is_worth_waiting(board, helper, idle):
            idle += 1
        else:
            return


@njit(cache=True, nogil=True)
def carry_out(batch: Batch, first: int, last: int) -> None:
    """The order, for the active ones of a range of robots."""
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
    if batch.views.shape[0] > 0:
        draw(batch, first, last)


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
    if batch.views.shape[0] > 0:
        turn_mazes(
            some, batch.size[0], n_cells, cells, depth, batch.view_free[first:last],
            batch.view_readings[first:last],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def draw(batch: Batch, first: int, last: int) -> None:
    """The views of the active robots."""
    for b in range(first, last):
        if batch.active[b]:
            one = slice(b, b + 1)
            batch.views[b] = 0.0
            draw_views(
                batch.size[0], batch.bel[one], batch.live[one], batch.n_live[one],
                batch.largest[one], batch.cells[one], batch.view_free[one],
                batch.view_readings[one], batch.views[one],
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
        sure, is_true = batch.largest[b] > batch.confidence[0], truth == guess
        verdict[0, b] = sure and is_true
        verdict[1, b] = is_true
        verdict[2, b] = sure and not is_true
        if not verdict[0, b]:
            counts[0, b] = -1
        elif counts[0, b] < 0:
            counts[0, b] = batch.steps[b]
        counts[1, b] = batch.impossible[b]
        counts[2, b] = batch.reading[b] + 1
