"""All that robots in mazes are made of, as kernels want it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.lattice import Lattice, LatticeBelief


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
        order: ``(1,)``; what is to be done: ``STEP``, ``START`` or ``SHOW``.
        active: ``(B,)``; to whom.
        actions: ``(B,)`` of 0, 1, 2.
        uniforms: ``(B, 2)`` in [0, 1): noise of the step and of the reading.
        luck: ``(B, 2)`` in [0, 1): where a robot starts, and its first reading's noise.
        pose: ``(3,)``; row, column and heading to start at; negative to be drawn.
        confidence: ``(1,)``; a belief is sure above it.
        doubt: ``(1,)``; what the largest probability is less than, as a reward.
        steps: ``(B,)``; taken.
        state: ``(B,)``; where the robots are.
        reading: ``(B,)``; last depth read, less one.
        scores: ``(6, B)``; entropy [nat], and over the uniform belief's; the largest probability;
            of the state that has it: distance to the truth [cell] and angle [rad]; the last step's
            reward, 0 before the first.
        verdict: ``(B, 3)``; sure and right, the most likely state is true, sure and wrong. By
            robot: threads must not write side by side, into one cache line.
        counts: ``(3, B)``; since when it has been sure and right, or -1; impossible readings; the
            last depth read [cell].
        size: ``(1,)``; m, for the views.
        radius: ``(1,)``; r of the views.
        shown: ``(5,)``; addresses of the arrays to draw observations into, 0 for none.
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
    doubt: NDArray[np.float64]
    steps: NDArray[np.int64]
    state: NDArray[np.int32]
    reading: NDArray[np.int32]
    scores: NDArray[np.float64]
    verdict: NDArray[np.bool_]
    counts: NDArray[np.int64]
    size: NDArray[np.int64]
    radius: NDArray[np.int64]
    shown: NDArray[np.int64]
    view_free: NDArray[np.float32]
    view_readings: NDArray[np.uint64]


def new_batch(
    lattice: Lattice,
    belief: LatticeBelief,
    view: EgocentricView | None,
    confidence: float,
    doubt: float,
) -> Batch:
    """Everything about B robots that have not begun.

    Args:
        lattice: Of their mazes.
        belief: Theirs.
        view: Theirs, if it is observed.
        confidence: A belief is sure above it.
        doubt: What the largest probability is less than, as a reward.
    """
    n, size = lattice.n_robots, lattice.size
    return Batch(
        lattice.free, lattice.n_cells, lattice.cells, lattice.index, lattice.depth,
        lattice.successor, lattice.target, lattice.steps, lattice.p_step,
        lattice.sensor.confusion, lattice.p,
        belief.bel, belief.live, belief.n_live, belief.impossible, belief.largest,
        belief.likeliest, belief.entropy,
        order=np.zeros(1, dtype=np.int64),
        active=np.zeros(n, dtype=np.bool_),
        actions=np.zeros(n, dtype=np.int64),
        uniforms=np.zeros((n, 2)),
        luck=np.zeros((n, 2)),
        pose=np.zeros(3, dtype=np.int64),
        confidence=np.array([confidence]),
        doubt=np.array([doubt]),
        steps=np.zeros(n, dtype=np.int64),
        state=np.zeros(n, dtype=np.int32),
        reading=np.zeros(n, dtype=np.int32),
        scores=np.zeros((6, n)),
        verdict=np.zeros((n, 3), dtype=np.bool_),
        counts=np.zeros((3, n), dtype=np.int64),
        size=np.array([size]),
        radius=np.array([0 if view is None else view.radius]),
        shown=np.zeros(5, dtype=np.int64),
        view_free=np.zeros((0, 4, 0), dtype=np.float32) if view is None else view.free,
        view_readings=np.zeros((0, 4, 0), dtype=np.uint64) if view is None else view.readings,
    )  # fmt: skip
