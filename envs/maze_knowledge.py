"""What robots in mazes know, and what plans with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.lattice import Lattice, LatticeBelief
from activeloc.envs.actions import Actions


@dataclass(frozen=True, slots=True)
class MazeKnowledge:
    """What robots in mazes know: all that an agent may look at. The truth is not in it.

    It holds the whole batch, so that a planner may choose for all robots in one call: arrays have a
    leading axis of B. ``robots`` are those that it is asked for (all of them, or one). Belief and
    tables are the environment's own: read them before the next step, and write into none.

    Attributes:
        lattice: The mazes as tables: free cells, depths, and the state that each action means to
            lead to (:class:`Lattice`: ``free, n_cells, cells, index, depth, successor``), the law
            of steps and readings (``steps, p_step, sensor, target``).
        belief: Its ``candidates()`` are the states that hold mass, with their probabilities;
            ``bel`` ``(B, C, 4)`` the same as an array; ``largest``, ``likeliest``, ``entropy``.
        robots: ``(n,)``.
        actions: 0 turns left, 1 right, 2 goes forward.
        reading: ``(B,)``; last depths read [cell], at least 1.
        step: ``(B,)``; steps taken.
    """

    lattice: Lattice
    belief: LatticeBelief
    robots: NDArray[np.intp]
    actions: Actions
    reading: NDArray[np.int32]
    step: NDArray[np.int64]


class MazePlanner(Protocol):
    """An agent that plays mazes, one robot or a batch."""

    def act_all(self, knowledge: MazeKnowledge) -> NDArray[np.int64]:
        """An action for each of ``knowledge.robots``: ``(n,)``."""
        ...
