"""The cheapest walks, against a plain Dijkstra on a lattice and by carrying them out."""

import itertools

import numpy as np
import pytest

from activeloc.agents.commands import FORWARD, LEFT, RIGHT
from activeloc.agents.expected_occupancy import ExpectedOccupancy
from activeloc.agents.walks import Moves, Walks
from activeloc.envs.actions import Actions

PENALTY, CLOSED = 5.0, 0.9
PITCH = 0.23  # No drive ends on the edge of a cell.
SQUARE = Actions(turn=np.pi / 2, forward=1.0)


def window(seed, side=9, pitch=1.0):
    rng = np.random.default_rng(seed)
    return ExpectedOccupancy(rng.random((side, side)) ** 0.7, pitch)


def search(around, actions=SQUARE, longest=100, refused=(), penalty=PENALTY):
    moves = Moves.of(actions, np.pi / 6, 0.5)
    closed = np.zeros(moves.sectors, dtype=bool)
    closed[list(refused)] = True
    return Walks.search(around, moves, closed, penalty, CLOSED, longest)


def plain_dijkstra(p, refused=(), longest=100):
    """Cost of every (row, column, quarter): of all walks of so many moves, step after step."""
    side = len(p)
    costs = {(side // 2, side // 2, 0): 0.0}
    for _ in range(longest):
        after = dict(costs)
        for (row, col, k), cost in costs.items():
            ways = [((row, col, (k + 1) % 4), 1.0), ((row, col, (k - 1) % 4), 1.0)]
            r, c = row + (0, 1, 0, -1)[k], col + (1, 0, -1, 0)[k]
            starts_badly = (row, col) == (side // 2, side // 2) and k in refused
            if 0 <= r < side and 0 <= c < side and p[r, c] < CLOSED and not starts_badly:
                ways.append(((r, c, k), 1.0 + PENALTY * p[r, c]))
            for node, price in ways:
                after[node] = min(after.get(node, np.inf), cost + price)
        if after == costs:
            break
        costs = after
    return costs


@pytest.mark.parametrize("refused", [(), (0,), (1, 2)])
@pytest.mark.parametrize("seed", range(4))
def test_costs_are_those_of_a_plain_search(seed, refused):
    around = window(seed)
    walks = search(around, refused=refused)
    expected = np.full((9, 9, 4), np.inf)
    for node, cost in plain_dijkstra(around.p, refused).items():
        expected[node] = cost
    np.testing.assert_allclose(walks.cost.reshape(9, 9, 4), expected)
    assert 20 < np.isfinite(expected).sum() < expected.size


def carried_out(walk, actions):
    """Places after each move of a walk, and its heading at the end."""
    x = y = theta = 0.0
    places = [(0.0, 0.0)]
    for move in walk:
        if move == FORWARD:
            x, y = x + actions.forward * np.cos(theta), y + actions.forward * np.sin(theta)
        else:
            theta += actions.turn if move == LEFT else -actions.turn
        places.append((x, y))
    return np.array(places), theta


@pytest.mark.parametrize(
    "actions", [Actions(), Actions(turn=0.1, forward=0.2), Actions(turn=1.0, forward=0.7)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_walk_leads_where_it_says_and_costs_what_it_says(seed, actions):
    around = window(seed, side=25, pitch=PITCH)
    walks, n_checked = search(around, actions), 0
    per_drive = walks.moves.drive_steps
    for node in np.flatnonzero(np.isfinite(walks.cost))[::37]:
        walk = walks.walk_to(node)
        places, theta = carried_out(walk, actions)
        np.testing.assert_allclose(places[-1], walks.place[node, :2], atol=1e-9)
        assert theta == pytest.approx(walks.place[node, 2] * walks.moves.turn)
        row, col, sector = np.unravel_index(node, (25, 25, walks.moves.sectors))
        assert (row - 12, col - 12) == tuple(np.floor(places[-1][::-1] / PITCH + 0.5))
        off = theta / walks.moves.headings[1] - sector
        assert abs(off - round(off / walks.moves.sectors) * walks.moves.sectors) <= 0.5 + 1e-6
        cost = float(len(walk))
        ends = [i + 1 for i, move in enumerate(walk) if move == FORWARD][per_drive - 1 :: per_drive]
        for end in ends:
            a, b = places[end - per_drive], places[end]
            probes = int(np.ceil(np.hypot(*(b - a)) / PITCH - 1e-9))
            cells = [
                np.floor((a + (b - a) * k / probes) / PITCH + 0.5) for k in range(1, probes + 1)
            ]
            worst = max(around.p[int(y) + 12, int(x) + 12] for x, y in cells)
            assert worst < CLOSED
            cost += PENALTY * worst
        assert walks.cost[node] == pytest.approx(cost)
        n_checked += 1
    assert n_checked > 20


def test_walks_are_no_longer_than_asked():
    around = ExpectedOccupancy(np.zeros((9, 9)), 1.0)
    walks = search(around, longest=3)
    reached = {tuple(walks.walk_to(node)) for node in np.flatnonzero(np.isfinite(walks.cost))}
    assert max(map(len, reached)) == 3
    reachable = {
        (tuple(np.round(places[-1]).astype(int)), round(theta / SQUARE.turn) % 4)
        for n in range(4)
        for walk in itertools.product((LEFT, RIGHT, FORWARD), repeat=n)
        for places, theta in [carried_out(walk, SQUARE)]
    }
    assert len(reached) == len(reachable)


def test_the_way_through_a_door_is_found():
    """A wall 1 m ahead with a door 1.5 m to the left."""
    p = np.zeros((25, 25))
    p[:, 16], p[17:20, 16] = 1.0, 0.0
    walks = search(ExpectedOccupancy(p, 0.25), Actions())
    (node,) = walks.ends(1, (2.0,))
    places, _ = carried_out(walks.walk_to(node), Actions())
    np.testing.assert_allclose(places[-1], (2.0, 0.0), atol=0.5)
    crossing = places[np.flatnonzero(places[:, 0] > 1.0)[0]]
    assert 1.0 < crossing[1] < 2.0


def test_short_steps_are_put_together_and_long_ones_are_not():
    short = Moves.of(Actions(turn=0.1, forward=0.02), np.pi / 6, 0.5)
    assert (short.turn_steps, short.drive_steps) == (5, 25)
    np.testing.assert_allclose((short.turn, short.drive), (0.5, 0.5))
    assert Moves.of(Actions(turn=np.pi, forward=3.0), np.pi / 6, 0.5) == Moves(np.pi, 3.0, 1, 1)


@pytest.mark.parametrize("bearings", [1, 5, 7])
def test_ends_are_the_best_of_their_bearing_and_distance(bearings):
    walks = search(window(1, side=25, pitch=0.25), Actions(), penalty=2.0)
    rings = (1.0, 2.5)
    ends = walks.ends(bearings, rings)
    best = {}
    for node in np.flatnonzero(np.isfinite(walks.cost)):
        x, y, _ = walks.place[node]
        if np.hypot(x, y) < 1e-6:
            continue
        towards = [2 * np.pi * b / bearings for b in range(bearings)]
        bearing = max(towards, key=lambda angle, x=x, y=y: x * np.cos(angle) + y * np.sin(angle))
        ring = min(rings, key=lambda r, x=x, y=y: abs(r - np.hypot(x, y)))
        away = np.hypot(x - ring * np.cos(bearing), y - ring * np.sin(bearing))
        score = walks.cost[node] + 16.0 * away
        best[bearing, ring] = min(best.get((bearing, ring), np.inf), score)
    assert len(ends) == len(best) == 2 * bearings
    for node, key in zip(ends, sorted(best), strict=True):
        x, y, _ = walks.place[node]
        away = np.hypot(x - key[1] * np.cos(key[0]), y - key[1] * np.sin(key[0]))
        assert walks.cost[node] + 16.0 * away == pytest.approx(best[key])
