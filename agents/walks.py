"""The cheapest walks from where a robot stands, through an expected occupancy.

A walk is made of the turns and drives that the robot can be told. A node of the search is a cell of
the window and a sector of headings; it keeps the exact place and heading of the cheapest walk that
has come to it, and goes on from there (hybrid-state A*: Dolgov, Thrun, Montemerlo & Diebel, 2008,
without a heuristic). So a walk that is found can be carried out as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.agents.commands import FORWARD, LEFT, RIGHT
from activeloc.agents.expected_occupancy import ExpectedOccupancy
from activeloc.envs.actions import Actions

FULL_TURN = 2.0 * np.pi
SHORT_OF = 8.0
"""What a drive's length between a node and its target weighs against a step of the walk there."""


@dataclass(frozen=True, slots=True)
class Moves:
    """What a walk is made of: several steps at a time, where single ones are short.

    Attributes:
        turn: Angle of a turn [rad].
        drive: Length of a drive [m].
        turn_steps: Steps of a turn.
        drive_steps: Steps of a drive.
    """

    turn: float
    drive: float
    turn_steps: int
    drive_steps: int

    @classmethod
    def of(cls, actions: Actions, turn: float, drive: float) -> Moves:
        """As many steps as come nearest to a turn [rad] and a drive [m], and one at least."""
        turns = max(1, round(turn / actions.turn))
        drives = max(1, round(drive / actions.forward))
        return cls(turns * actions.turn, drives * actions.forward, turns, drives)

    @property
    def sectors(self) -> int:
        """Headings told apart."""
        return max(1, round(FULL_TURN / self.turn))

    @property
    def headings(self) -> NDArray[np.float64]:
        """``(sectors,)``; their middles, from straight ahead to the left [rad]."""
        return FULL_TURN * np.arange(self.sectors) / self.sectors


@dataclass(frozen=True, slots=True)
class Walks:
    """The cheapest walk to every node: N of them, by row, column and sector.

    Attributes:
        cost: ``(N,)``; steps, and the drives' penalties [step]. inf where no walk leads.
        length: ``(N,)``; moves.
        place: ``(N, 3)``; x and y [m] and the turns made, positive to the left.
        parent: ``(N,)``; the node before; -1 at the start.
        moves: What the walks are made of.
    """

    cost: NDArray[np.float64]
    length: NDArray[np.int64]
    place: NDArray[np.float64]
    parent: NDArray[np.int64]
    moves: Moves

    @classmethod
    def search(
        cls,
        occupancy: ExpectedOccupancy,
        moves: Moves,
        refused: NDArray[np.bool_],
        penalty: float,
        closed: float,
        longest: int,
    ) -> Walks:
        """All walks of up to ``longest`` moves.

        Args:
            occupancy: Of the window.
            moves: What the walks are made of.
            refused: ``(sectors,)``; whether a drive that way from the start is known to fail.
            penalty: Of a drive through a place that is occupied for certain [step].
            closed: Expected occupancy from which a place is not driven through.
            longest: Moves.
        """
        n = occupancy.p.size * moves.sectors
        cost, length = np.full(n, np.inf), np.zeros(n, np.int64)
        place, parent = np.zeros((n, 3)), np.full(n, -1)
        find_walks(
            occupancy.p, occupancy.pitch, (moves.turn, moves.drive),
            (moves.turn_steps, moves.drive_steps), (penalty, closed, longest), refused,
            cost, length, place, parent,
        )  # fmt: skip
        return cls(cost, length, place, parent, moves)

    def ends(self, bearings: int, distances: tuple[float, ...]) -> list[int]:
        """The node that serves best as each target that can be served, none of them the start's.

        A target is a bearing, of that many around the robot, and a distance [m]. It is served by
        the nodes that are nearer in bearing to none other, and then in distance.
        """
        rings = np.unique(np.asarray(distances, dtype=np.float64))
        best = np.full((bearings, len(rings)), -1)
        nearest_ends(self.cost, self.place, rings, SHORT_OF / self.moves.drive, best)
        return [int(node) for node in best.ravel() if node >= 0]

    def walk_to(self, node: int) -> list[int]:
        """The single turns and drives that lead to a node."""
        walk: list[int] = []
        while (before := int(self.parent[node])) >= 0:
            turns = self.place[node, 2] - self.place[before, 2]
            if turns == 0.0:
                walk += [FORWARD] * self.moves.drive_steps
            else:
                walk += [LEFT if turns > 0.0 else RIGHT] * self.moves.turn_steps
            node = before
        return walk[::-1]


@njit(cache=True, nogil=True)
def worst_on_way(
    p: NDArray[np.float64], pitch: float, x: float, y: float, dx: float, dy: float
) -> float:
    """Largest expected occupancy on the way from (x, y) to (x + dx, y + dy); 2 outside.

    The place left is not asked: the robot stands there. Arguments as :func:`find_walks`.
    """
    radius = p.shape[0] // 2
    probes = int(np.ceil(np.hypot(dx, dy) / pitch - 1e-9))
    worst = 0.0
    for k in range(1, probes + 1):
        row = int(np.floor((y + dy * k / probes) / pitch + 0.5)) + radius
        col = int(np.floor((x + dx * k / probes) / pitch + 0.5)) + radius
        if not (0 <= row < p.shape[0] and 0 <= col < p.shape[1]):
            return 2.0
        worst = max(worst, p[row, col])
    return worst


@njit(cache=True, nogil=True)
def find_walks(
    p: NDArray[np.float64],
    pitch: float,
    sizes: tuple[float, float],
    prices: tuple[int, int],
    limits: tuple[float, float, int],
    refused: NDArray[np.bool_],
    cost: NDArray[np.float64],
    length: NDArray[np.int64],
    place: NDArray[np.float64],
    parent: NDArray[np.int64],
) -> None:
    """Dijkstra's search (1959) over turns and drives.

    Args:
        p: ``(S, S)``; expected occupancy, the robot in the middle.
        pitch: Of its cells [m].
        sizes: Of a turn [rad] and a drive [m].
        prices: Steps of a turn and of a drive.
        limits: Penalty of a drive through an obstacle, occupancy that is closed, most moves.
        refused: ``(K,)``; sectors of headings in which no drive from the start's cell succeeds.
        cost: ``(N,)``, all inf; filled, as are the next three.
        length: ``(N,)``, zeros.
        place: ``(N, 3)``, zeros.
        parent: ``(N,)``, all -1.
    """
    side, sectors, middle = p.shape[0], refused.shape[0], p.size // 2
    penalty, closed, longest = limits
    cost[middle * sectors] = 0.0
    queue = [(0.0, middle * sectors)]
    while len(queue) > 0:
        paid, node = heappop(queue)
        if paid > cost[node] or length[node] == longest:
            continue
        for move in range(3):
            x, y, turns = place[node, 0], place[node, 1], place[node, 2]
            if move == FORWARD:
                if node // sectors == middle and refused[node % sectors]:
                    continue
                dx, dy = sizes[1] * np.cos(turns * sizes[0]), sizes[1] * np.sin(turns * sizes[0])
                occupied = worst_on_way(p, pitch, x, y, dx, dy)
                if occupied >= closed:
                    continue
                x, y, price = x + dx, y + dy, prices[1] + penalty * occupied
            else:
                turns, price = turns + (1.0 if move == LEFT else -1.0), float(prices[0])
            row = int(np.floor(y / pitch + 0.5)) + side // 2
            col = int(np.floor(x / pitch + 0.5)) + side // 2
            sector = int(np.floor(turns * sizes[0] / FULL_TURN * sectors + 0.5)) % sectors
            goal = (row * side + col) * sectors + sector
            # Sums of the same prices in another order are no cheaper.
            if paid + price < cost[goal] - 1e-9:
                cost[goal], length[goal], parent[goal] = paid + price, length[node] + 1, node
                place[goal, 0], place[goal, 1], place[goal, 2] = x, y, turns
                heappush(queue, (paid + price, goal))


@njit(cache=True, nogil=True)
def nearest_ends(
    cost: NDArray[np.float64],
    place: NDArray[np.float64],
    rings: NDArray[np.float64],
    short_of: float,
    best: NDArray[np.int64],
) -> None:
    """The node of least cost and distance from each target; the first of equals.

    Args:
        cost: ``(N,)``; of the walks.
        place: ``(N, 3)``.
        rings: ``(D,)``; distances of the targets, rising [m].
        short_of: Price of the distance between node and target [step / m].
        best: ``(bearings, D)``, all -1; overwritten where there is a node.
    """
    least = np.full(best.shape, np.inf)
    step = FULL_TURN / best.shape[0]
    for node in range(cost.shape[0]):
        x, y = place[node, 0], place[node, 1]
        # Turns leave the exact middle, and drives may come back to it.
        if cost[node] == np.inf or (abs(x) < 1e-9 and abs(y) < 1e-9):
            continue
        bearing = int(np.floor(np.arctan2(y, x) / step + 0.5)) % best.shape[0]
        ring = int(np.argmin(np.abs(rings - np.hypot(x, y))))
        away = np.hypot(
            x - rings[ring] * np.cos(bearing * step), y - rings[ring] * np.sin(bearing * step)
        )
        if cost[node] + short_of * away < least[bearing, ring] - 1e-9:
            least[bearing, ring] = cost[node] + short_of * away
            best[bearing, ring] = node
