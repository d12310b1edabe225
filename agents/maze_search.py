"""Search in belief space in mazes: exact, since a maze's readings are few.

Maximising the sum over the steps is what matters: a planner that looks at its last step alone puts
everything off. :mod:`activeloc.agents.maze_parts` has the search where nothing is noisy,
:mod:`activeloc.agents.maze_noisy_search` the one where steps and readings are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activeloc.agents.maze_greedy import PREFERENCE, TIE
from activeloc.agents.maze_noisy_search import plan_all_noisy
from activeloc.agents.maze_parts import most, plan_all
from activeloc.envs.maze_episodes import MazeKnowledge


def plan_values(knowledge: MazeKnowledge, steps: int) -> NDArray[np.float64]:
    """Mean over K steps of the expected largest probability, for each first action: ``(n, 3)``.

    Args:
        knowledge: Of the robots that are asked for.
        steps: K.
    """
    on, belief, robots = knowledge.lattice, knowledge.belief, knowledge.robots
    values = np.zeros((len(robots), 3))
    n = on.depth.shape[1] * 4
    if on.p_off > 0.0:
        plan_all_noisy(
            robots, belief.bel.reshape(-1, n), on.n_cells, on.target, on.depth.reshape(-1, n),
            on.p_step, on.sensor.confusion, steps, values,
        )  # fmt: skip
        return values
    held = belief.candidates()
    plan_all(
        on.successor.reshape(-1, n, 3)[robots],
        (on.depth.reshape(-1, n)[robots] + 1).astype(np.int8),
        held.states[robots], held.n[robots], steps, values,
    )  # fmt: skip
    return values


def first_actions(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """The best of each row ``(n, 3)``; of equals (to 1e-9) forward, then left: ``(n,)``."""
    ordered = values[:, PREFERENCE]
    best = ordered.max(axis=1, keepdims=True)
    return PREFERENCE[(ordered >= best - TIE).argmax(axis=1)].astype(np.int64)


def optimum(knowledge: MazeKnowledge, steps: int) -> NDArray[np.float64]:
    """Greatest expected return over a whole horizon, for each robot that is asked for: ``(n,)``.

    Args:
        knowledge: Of robots in mazes without noise.
        steps: Steps left in the episode.
    """
    on, held = knowledge.lattice, knowledge.belief.candidates()
    n_states = on.depth.shape[1] * 4
    successor = on.successor.reshape(-1, n_states, 3)
    reading = (on.depth.reshape(-1, n_states) + 1).astype(np.int8)
    return np.array(
        [
            most(successor[b], reading[b], held.states[b, : held.n[b]], steps) / held.n[b]
            for b in knowledge.robots
        ]
    )
