"""Mazes as a lattice of states, and the exact belief over it, for a batch of robots.

A state is a free cell c and a heading k (0 along the columns, 1 along the rows, then counter-
clockwise), as one number ``s = 4 c + k``. There are three actions: 0 turns left, 1 turns right, 2
goes one cell forward; into a wall the robot stays. A reading z is the number of cells from the
robot's own to the wall ahead, at least 1. With noise, a step forward is one cell short or long with
probability ``p_off`` each, clipped at walls, and a reading off by one likewise.

The belief is kept as ``(B, C, 4)`` and followed by kernels of its own
(:mod:`activeloc.beliefs.lattice_filter`). Without noise it is uniform over the states that agree
with all readings. Source: Chaplot, Parisotto and Salakhutdinov, "Active Neural Localization" (ICLR
2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import lattice_filter as filter_kernels
from activeloc.beliefs import lattice_kernels as kernels
from activeloc.errors import MapError
from activeloc.sensors.depth import DepthSensor

ACTIONS = ("left", "right", "forward")
MAX_SIZE = 81


class Lattice:
    """Tables of B mazes, and how robots move and read in them.

    Attributes:
        n_robots: B.
        size: m, cells along a side, walls included.
        p_off: Probability that a step is one cell short, and of being one long; of readings too.
        p: ``(Z, D)``; p(reading | depth), both less one.
        p_step: ``(J,)``; how likely each length of a step is.
        steps: ``(J,)`` of those lengths [cell].
        sensor: p(z | depth).
        free: ``(B, m, m)``; ``free[b, row, col]``.
        n_cells: ``(B,)``; how many are free: C_b. Tables hold nothing of use beyond.
        cells: ``(B, C, 2)`` of row, column.
        index: ``(B, m, m)``; the free cells' numbers, -1 for walls.
        depth: ``(B, C, 4)``; cells to the wall ahead, less one.
        successor: ``(B, C, 4, 3)``; the state that each action means to lead to.
        target: ``(B, C * 4 * J)``; for state s and step j the cell at ``s * J + j``.

    Args:
        n_robots: B.
        size: m, odd or even.
        p_off: In [0, 0.5].

    Raises:
        ConfigError: If a number is out of its range.
    """

    def __init__(self, n_robots: int, size: int, p_off: float = 0.0) -> None:
        checks.integer("lattice size", size, 3, MAX_SIZE)
        checks.number("lattice p_off", p_off, 0.0, 0.5)
        self.n_robots, self.size, self.p_off = n_robots, size, float(p_off)
        noisy = p_off > 0.0
        self.steps = np.array([0, 1, 2] if noisy else [1])
        self.p_step = np.array([p_off, 1.0 - 2.0 * p_off, p_off] if noisy else [1.0])
        depths = size - 2
        self.sensor = DepthSensor.off_by_one(depths, p_off) if noisy else DepthSensor.exact(depths)
        n, n_states = (size - 2) ** 2, 4 * (size - 2) ** 2
        self.free = np.zeros((n_robots, size, size), dtype=np.bool_)
        self.n_cells = np.zeros(n_robots, dtype=np.int32)
        self.cells = np.zeros((n_robots, n, 2), dtype=np.int32)
        self.index = np.full((n_robots, size, size), -1, dtype=np.int32)
        self.depth = np.zeros((n_robots, n, 4), dtype=np.int32)
        self.successor = np.zeros((n_robots, n, 4, 3), dtype=np.int16)
        self.target = np.zeros((n_robots, n_states * len(self.steps)), dtype=np.int32)
        self.p = np.ascontiguousarray(self.sensor.confusion.T)

    def place(self, robots: NDArray[np.intp], free: NDArray[np.bool_]) -> None:
        """Put robots into mazes.

        Args:
            robots: ``(n,)``; which.
            free: ``(n, m, m)``, one maze each.

        Raises:
            MapError: If a maze is of another size, has no wall around it or no free cell.
        """
        free = np.asarray(free, dtype=np.bool_)
        check_mazes(free, len(robots), self.size)
        self.free[robots] = free
        kernels.survey_all(
            robots, self.free, self.n_cells, self.cells, self.index, self.depth, self.target,
            int(self.steps[0]), self.successor,
        )  # fmt: skip

    def state_of(self, robot: int, row: int, col: int, heading: int) -> int:
        """The state at a place.

        Raises:
            MapError: If it is no free cell, or the heading is none of 0, 1, 2, 3.
        """
        inside = 0 <= row < self.size and 0 <= col < self.size
        if not (inside and self.free[robot, row, col] and 0 <= heading < 4):
            raise MapError(
                f"pose ({row}, {col}, {heading}) is in an obstacle or outside of the maze; "
                f"expected row, column of a free cell of {self.size} x {self.size}, heading 0 to 3"
            )
        return 4 * int(self.index[robot, row, col]) + heading

    def pose_of(self, robot: int, state: int) -> NDArray[np.float64]:
        """Row, column and heading ``(3,)`` of a state."""
        row, col = self.cells[robot, state // 4]
        return np.array([row, col, state % 4], dtype=np.float64)

    def move_and_read(
        self,
        active: NDArray[np.bool_],
        actions: NDArray[np.int64],
        uniforms: NDArray[np.float64],
        state: NDArray[np.int32],
        reading: NDArray[np.int32],
    ) -> None:
        """Carry out actions; see :func:`activeloc.beliefs.lattice_kernels.move_and_read`."""
        kernels.move_and_read(
            active, actions, uniforms, self.p_step, self.sensor.confusion, self.depth, self.target,
            state, reading,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Candidates:
    """The states that hold mass, as lists.

    Attributes:
        states: ``(B, S)`` of int16; the first ``n[b]`` of each row, ascending by cell, then
            heading, where the filter keeps its cells in that order.
        p: ``(B, S)``; their probabilities.
        n: ``(B,)``; how many there are.
    """

    states: NDArray[np.int16]
    p: NDArray[np.float64]
    n: NDArray[np.int32]


class LatticeBelief:
    """The exact Bayes filter of B robots on their lattices.

    Attributes:
        bel: ``(B, C, 4)``.
        live: ``(B, C)``; the first ``n_live[b]`` are the cells that hold mass.
        n_live: ``(B,)``.
        impossible: ``(B,)``; readings so far that no state explained: they changed nothing.
        largest: ``(B,)``; the largest probability.
        likeliest: ``(B,)``; the first state that has it.
        entropy: ``(B,)`` [nat].

    Args:
        lattice: Where the robots are.
    """

    def __init__(self, lattice: Lattice) -> None:
        self.lattice = lattice
        n_robots, n = lattice.depth.shape[:2]
        self.bel = np.zeros((n_robots, n, 4))
        self.live = np.zeros((n_robots, n), dtype=np.int32)
        self.n_live = np.zeros(n_robots, dtype=np.int32)
        self.impossible = np.zeros(n_robots, dtype=np.int32)
        self.largest = np.zeros(n_robots)
        self.likeliest = np.zeros(n_robots, dtype=np.int32)
        self.entropy = np.zeros(n_robots)

    def reset(self, robots: NDArray[np.intp], reading: NDArray[np.int32]) -> None:
        """Begin with the posterior of a first reading under a uniform prior.

        Args:
            robots: Which.
            reading: ``(B,)``; less one. One that the sensor cannot give is impossible evidence.
        """
        on = self.lattice
        filter_kernels.begin(
            robots, reading, on.n_cells, on.depth, on.p, self.bel, self.live, self.n_live
        )
        active = np.zeros(on.n_robots, dtype=np.bool_)
        active[robots] = True
        self.impossible[robots] = 0
        self._summarise(active)

    def step(
        self,
        active: NDArray[np.bool_],
        actions: NDArray[np.int64],
        reading: NDArray[np.int32],
    ) -> None:
        """Predict by an action, correct by a reading.

        Args:
            active: ``(B,)``; the others are left alone.
            actions: ``(B,)`` of 0, 1, 2; any other number stays.
            reading: ``(B,)``; less one. One that the sensor cannot give is impossible evidence.
        """
        on = self.lattice
        filter_kernels.advance(
            active, actions, reading, self.bel, self.live, self.n_live, on.depth, on.target,
            on.p_step, on.p, self.impossible,
        )  # fmt: skip
        self._summarise(active)

    def _summarise(self, active: NDArray[np.bool_]) -> None:
        filter_kernels.summarise(
            active, self.bel, self.live, self.n_live, self.largest, self.likeliest, self.entropy
        )

    def candidates(self) -> Candidates:
        """The states that hold mass: new arrays."""
        n_robots, n = self.live.shape
        states = np.zeros((n_robots, 4 * n), dtype=np.int16)
        p, count = np.zeros((n_robots, 4 * n)), np.zeros(n_robots, dtype=np.int32)
        filter_kernels.list_states(self.bel, self.live, self.n_live, states, p, count)
        return Candidates(states, p, count)

    def planes(self) -> NDArray[np.float32]:
        """Pictures of p / max p in the maze's frame: new ``(B, 4, m, m)``."""
        size = self.lattice.size
        out = np.empty((self.lattice.n_robots, 4, size, size), dtype=np.float32)
        filter_kernels.picture(
            self.bel, self.live, self.n_live, self.lattice.cells, self.largest, out
        )
        return out


def check_mazes(free: NDArray[np.bool_], n: int, size: int) -> None:
    """Refuse what is not n mazes ``(n, size, size)`` with walls around them.

    Raises:
        MapError: With what was wrong.
    """
    if free.shape != (n, size, size):
        raise MapError(f"a maze here has {size} x {size} cells; got shape {free.shape[1:]}")
    rim = free[:, [0, -1]].any() or free[:, :, [0, -1]].any()
    if rim:
        raise MapError("a maze must have walls along its rim; a cell of the rim is free")
    if not free.any(axis=(1, 2)).all():
        raise MapError("a maze must have a free cell; every cell is a wall")
