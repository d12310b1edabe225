"""Transitions: sums and targets over all states, and one step against the simulator itself.

The oracle of :func:`test_one_step_matches_the_simulator` starts samples uniformly in one cell and
heading bin, moves them by the model that the filter assumes, weighs them as the filter does, and
compares where they are with the filter's prediction from a one-cell belief: total variation over
(cell, heading bin). Readings are rounded to half cells and their small rotations left out, because
the filter carries such remainders over to later steps; heading noise that it still carries over is
put into the prediction here.
"""

import itertools
from dataclasses import dataclass
from itertools import pairwise
from math import erf, sqrt

import numpy as np
import pytest

from activeloc.beliefs.free_distance import TURNS, FreeDistances
from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig, turn_taps
from activeloc.beliefs.lanes import N_LANES
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.sweep import Sweep
from activeloc.beliefs.travel_table import TravelTable
from activeloc.grid import OccupancyGrid
from activeloc.motion import MARGIN, MotionModel, MotionNoise, Terrain, move
from activeloc.sensors import BeamModel

MOTION = MotionModel(
    actuation=MotionNoise(2 / 30, 0.0494, 0.02), odometry=MotionNoise(4 / 30, 0.0494, 0.05)
)

NODES = (-sqrt(3), 0.0, sqrt(3))  # Of a standard normal variable: they count 1, 4 and 1 sixths.


def building():
    """4.2 m x 5.2 m: doors, a thin wall, pillars, a staircase wall; asymmetric, origin off zero."""
    cells = np.zeros((84, 104), dtype=np.uint8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 1
    cells[20:23, :40] = cells[20:23, 58:80] = 1
    cells[23:60, 44:47] = 1
    cells[40:44, 70:76] = cells[60:63, 70:] = cells[66:70, 20:24] = 1
    i = np.arange(18)
    cells[i + 50, i + 8] = cells[i + 50, i + 9] = 1
    return OccupancyGrid(cells, 0.05, (-1.3, 2.7))


def lumber_room():
    """On this map a travel of eight half cells once carried mass to the map's last cell."""
    cells = np.zeros((60, 90), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[10:14, 20:40] = cells[30:50, 33] = cells[20:22, 45:60] = 1
    return OccupancyGrid(cells, 0.05)


# --- every state ---------------------------------------------------------------------------------

GRIDS = [
    (building, 0.2, 72),
    (lumber_room, 0.2, 72),
    (building, 0.1, 24),
    (lumber_room, 0.3, 20),
    (building, 0.17, 12),
]


def entries_of(travel):
    """Entries of all states beside obstacles: heading, cell, step of places, ``(2, N)`` weights."""
    rows = travel.rows
    heading, cell = np.nonzero(rows.row >= 0)
    row = rows.row[heading, cell]
    size = rows.first[row + 1] - rows.first[row]
    of = np.repeat(rows.first[row] - np.append(0, size.cumsum()[:-1]), size) + np.arange(size.sum())
    return np.repeat(heading, size), np.repeat(cell, size), rows.step[of], rows.weight[:, of]


@pytest.mark.parametrize(("world", "cell_size", "headings"), GRIDS)
def test_every_state_keeps_its_mass_on_the_cells_of_the_belief(world, cell_size, headings):
    poses = PoseGrid(Terrain(world(), 0.2), cell_size, headings)
    table = TravelTable(poses, MOTION.odometry)
    (rows, cols), n_cells = poses.shape, len(poses.cells)
    for level in range(1, min(9, table.longest_level + 1)):
        travel = table.level(level)
        # Beside obstacles: rows sum to one, and lead to cells that exist.
        heading, cell, step, weight = entries_of(travel)
        sums = np.bincount(heading * n_cells + cell, weight.sum(axis=0), headings * n_cells)
        is_open = travel.rows.row.ravel() < 0
        np.testing.assert_allclose(sums[~is_open], 1.0, atol=1e-6)
        assert not sums[is_open].any()
        assert weight.min() >= 0.0
        end = poses.cells[cell] @ (cols, 1) + step
        assert poses.index.ravel()[end].min() >= 0
        # On open ground: stencils sum to one, and every entry lands on a cell of the belief.
        entries = np.diff(travel.stencil_start)
        weights = np.bincount(
            np.repeat(np.arange(headings), entries), travel.stencil_weight, headings
        )
        np.testing.assert_allclose(weights, 1.0, atol=1e-6)
        heading, cell = np.divmod(np.flatnonzero(is_open), n_cells)
        for k in range(headings):
            start = poses.cells[cell[heading == k]]
            steps = travel.stencil_step[travel.stencil_start[k] : travel.stencil_start[k + 1]]
            row, col = np.moveaxis(start[:, None] + steps, -1, 0)
            assert ((row >= 0) & (row < rows) & (col >= 0) & (col < cols)).all()
            assert (poses.index[row, col] >= 0).all()


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize(("world", "cell_size", "headings"), GRIDS)
def test_lists_lead_where_the_rows_of_their_headings_do(world, cell_size, headings, backward):
    """Also with headings that fill no whole lane group, and half a circle on for the way back."""
    poses = PoseGrid(Terrain(world(), 0.2), cell_size, headings)
    travel = TravelTable(poses, MOTION.odometry).level(3)
    lists, layout, rows = travel.lists(backward), travel.layout, travel.rows
    which = lists.which.reshape(layout.size, -1)[layout.place]
    assert len(np.unique(which)) == len(lists.first) - 1 < which.size
    steps = travel.stencil_step @ (layout.cols, 1)
    for c, g in np.random.default_rng(0).integers(
        (len(poses.cells), which.shape[1]), size=(300, 2)
    ):
        got = {}
        for e in range(*lists.first[which[c, g] : which[c, g] + 2]):
            assert lists.step[e] not in got
            got[lists.step[e]] = lists.weight[:, e]
        expected = {}
        for lane in range(min(N_LANES, headings - N_LANES * g)):
            k = (N_LANES * g + lane + (headings // 2 if backward else 0)) % headings
            if rows.row[k, c] < 0:
                of = slice(*travel.stencil_start[k : k + 2])
                weight = np.stack([travel.stencil_weight[of], np.zeros(of.stop - of.start)])
                entries = zip(steps[of], weight.T, strict=True)
            else:
                of = slice(*rows.first[rows.row[k, c] : rows.row[k, c] + 2])
                entries = zip(rows.step[of], rows.weight[:, of].T, strict=True)
            for step, weight in entries:
                expected.setdefault(step, np.zeros((2, N_LANES), np.float32))[:, lane] = weight
        assert got.keys() == expected.keys()
        for step, weight in expected.items():
            np.testing.assert_array_equal(got[step], weight)
    mixed, left = (of.reshape(-1, N_LANES) for of in lists.mixed(0.25, "float64"))
    np.testing.assert_allclose(mixed, lists.weight[0] + 0.25 * lists.weight[1], rtol=1e-6)
    sums = [mixed[slice(*ends)].sum(axis=0) for ends in pairwise(lists.first)]
    np.testing.assert_allclose(left, sums, rtol=1e-12)


@pytest.mark.parametrize("level", [1, 2, 5, 8])
@pytest.mark.parametrize(("radius", "leak"), [(0.0, 0.01), (0.1, 1e-3), (0.2, 1e-6)])
def test_nothing_travels_through_a_wall_or_too_far(level, radius, leak):
    """A wall one cell thin with a door far away; a point robot may leak what rounding takes.

    A way up to half a level short counts as open, so that a little of it ends behind a wall of five
    centimetres; less the thicker a robot's radius makes the wall.
    """
    cells = np.zeros((60, 90), dtype=np.uint8)
    cells[:, 41] = 1
    cells[28:40, 41] = 0
    poses = PoseGrid(Terrain(OccupancyGrid(cells, 0.05), radius), 0.2, 24)
    travel = TravelTable(poses, MOTION.odometry).level(level)
    heading, cell, step, weight = entries_of(travel)
    owner, weight = heading * len(poses.cells) + cell, weight.sum(axis=0)
    start = poses.cells[cell]
    end = np.column_stack(np.divmod(start @ (poses.shape[1], 1) + step, poses.shape[1]))
    far = np.hypot(*((end - start) * poses.cell_size).T)
    assert far[weight > 0].max() <= level * 0.1 * 1.15 + 0.2 * np.sqrt(2) + 1e-9
    through = (start[:, 0] < 2) & (end[:, 0] < 2) & (start[:, 1] < 10) & (end[:, 1] > 10)
    assert np.bincount(owner[through], weight[through], 1).max() <= leak


def test_free_distances_are_those_of_a_march():
    poses = PoseGrid(Terrain(building(), 0.2), 0.2, 24)
    table = TravelTable(poses, MOTION.odometry)
    assert table.free.kind.shape == (24, len(poses.cells))
    assert sorted(TURNS) == pytest.approx([-1 / 3, 0.0, 1 / 3])
    subs, rng = poses.sub_poses(), np.random.default_rng(0)
    reach = np.arange(0.0, 1.3, 0.0025)
    for _ in range(200):
        c, k = rng.integers(len(poses.cells)), rng.integers(24)
        turn, sub = divmod(rng.integers(48), 16)
        if not poses.is_open[c, sub]:
            continue
        theta = poses.thetas[k] + TURNS[turn] * poses.bin_width
        way = np.array([np.cos(theta), np.sin(theta)])
        stopped = ~poses.terrain.contains(subs[c, sub] + reach[:, None] * way)
        first = reach[stopped.argmax()] if stopped.any() else 1.3
        free = table.free.units[table.free.kind[k, c]].reshape(3, 16)[turn, sub]
        assert free / 200 == pytest.approx(min(first, 255 / 200), abs=0.0101)


@pytest.mark.parametrize(("world", "cell_size", "headings"), GRIDS)
def test_states_of_one_kind_have_the_same_free_distances(world, cell_size, headings):
    poses = PoseGrid(Terrain(world(), 0.2), cell_size, headings)
    free, layout = FreeDistances(poses), GridLayout(poses)
    unit = 0.005 / poses.terrain.grid.resolution
    sweep = Sweep(poses, poses.terrain, np.arange(1, 256) * unit + MARGIN)
    out = np.empty((16, layout.size), dtype=np.uint8)
    assert free.units.shape == (free.first[-1], 48)
    assert len(free.units) <= 0.7 * free.kind.size
    for k in range(0, headings, 5):
        assert free.kind[k].min() == free.first[k]
        assert free.kind[k].max() == free.first[k + 1] - 1
        np.testing.assert_array_equal(free.is_open[free.kind[k]], poses.is_open)
        for t, turn in enumerate(TURNS):
            sweep.along(np.array([poses.thetas[k] + turn * poses.bin_width]), out)
            got = free.units[free.kind[k]].reshape(-1, 3, 16)[:, t][poses.is_open]
            np.testing.assert_array_equal(got, out[:, layout.place].T[poses.is_open])


def row_of(table, level, k, c):
    """Where a travel leads from one state, worked out alone: ``(2, rows, cols)``, free and clipped.

    Each open probe counts alike. Its way ends where one of 288 ways from around it would, on cells
    of the belief; as probable as its free distance is longer than the travel, but for half a level,
    with a Gaussian error. Otherwise the robot stands at its free distance, or where it was.
    """
    poses, length, (row, col) = table.grid, level * table.step, table.grid.cells[c]
    spread, bend = max(MOTION.odometry.translation_from_translation * length, 0.005), 0.05 * length
    index = np.pad(poses.index, 20, constant_values=-1)
    out, subs = np.zeros((2, *index.shape)), np.flatnonzero(poses.is_open[c])
    free = table.free.units[table.free.kind[k, c]].reshape(3, 16) / 200
    fine = ((np.arange(4) + 0.5) / 4 - 0.5) / 4
    ways = np.array([*itertools.product((-1 / 12, 1 / 12), NODES, NODES, fine, fine)])
    p = np.where(ways[:, 1:3] == 0.0, 2 / 3, 1 / 6).prod(axis=1) / 32
    for (t, turn), s in itertools.product(enumerate(TURNS), subs):
        middle, probe = poses.thetas[k] + turn * poses.bin_width, poses.lattice[s]
        theta = middle + ways[:, 0] * poses.bin_width + ways[:, 1] * bend
        z = (length + ways[:, 2] * spread) / poses.cell_size
        x, y = probe[:, None] + ways[:, 3:].T + z * np.array([np.cos(theta), np.sin(theta)])
        at = 20 + row + np.floor(y).astype(int), 20 + col + np.floor(x).astype(int)
        landing = p * (index[at] >= 0)
        gap = (free[t, s] - (length - table.step / 2)) / spread
        p_free = 0.5 * (1 + erf(gap / sqrt(2)))
        if free[t, s] >= length + 3 * spread or free[t, s] == 255 / 200:
            p_free = 1.0
        if landing.sum() < 1e-3:
            p_free = 0.0
        else:
            np.add.at(out[0], at, p_free * landing / landing.sum())
        z = min(free[t, s], length) / poses.cell_size
        x, y = np.floor(probe + z * np.array([np.cos(middle), np.sin(middle)])).astype(int)
        stands = 20 + row + y, 20 + col + x
        out[1][stands if index[stands] >= 0 else (20 + row, 20 + col)] += 1.0 - p_free
    assert not out[:, index < 0].any()
    return out[:, 20:-20, 20:-20] / (len(TURNS) * len(subs))


@pytest.mark.parametrize("level", [1, 5, 8])
@pytest.mark.parametrize(("world", "cell_size", "headings"), GRIDS[:3])
def test_rows_are_those_of_each_state_worked_out_alone(world, cell_size, headings, level):
    """But for ways that end on the edge of a cell, which is on either side of it."""
    poses = PoseGrid(Terrain(world(), 0.2), cell_size, headings)
    table = TravelTable(poses, MOTION.odometry)
    travel, rng, gaps = table.level(level), np.random.default_rng(level), []
    rows = travel.rows
    for k, c in rng.choice(np.argwhere(rows.row >= 0), 100, replace=False):
        of, got = (
            slice(*rows.first[rows.row[k, c] : rows.row[k, c] + 2]),
            np.zeros((2, poses.index.size)),
        )
        got[:, poses.cells[c] @ (poses.shape[1], 1) + rows.step[of]] = rows.weight[:, of]
        expected = row_of(table, level, k, c).reshape(2, -1)
        gaps.append(np.abs(got - expected).max())
    assert np.median(gaps) <= 1e-6
    assert max(gaps) <= 0.01


def test_contact_is_the_share_of_probes_with_a_wall_within_a_cell():
    poses = PoseGrid(Terrain(building(), 0.2), 0.2, 24)
    table = TravelTable(poses, MOTION.odometry)
    subs, rng = poses.sub_poses(), np.random.default_rng(1)
    for _ in range(200):
        c, k = rng.integers(len(poses.cells)), rng.integers(24)
        xy = subs[c][poses.is_open[c]]
        thetas = poses.thetas[k] + np.array([0.0, -1.0, 1.0]) / 3 * poses.bin_width
        start = np.column_stack([np.tile(xy, (3, 1)), np.repeat(thetas, len(xy))])
        done = move(poses.terrain, start, np.array([0.0, 0.2, 0.0]))[1][:, 1]
        near = (done < 0.2 - 1e-5).mean()
        assert table.p_contact[c, k] == pytest.approx(near, abs=1e-6)


def test_contact_is_near_the_share_of_all_poses_of_the_state():
    """The weights of a refused drive: where a state is partly against a wall, a few hundredths."""
    oracle = Oracle(fresh(), np.random.default_rng(5), 0)
    poses, p = oracle.belief.poses(0), oracle.belief._track(0).tables.travel.p_contact
    partly = np.argwhere((p > 0.01) & (p < 0.99))
    gaps = []
    for cell, heading in oracle.rng.permutation(partly)[:100]:
        start = oracle.starts(cell, heading, 4000)
        done = move(poses.terrain, start, np.array([0.0, 0.2, 0.0]))[1][:, 1]
        gaps.append(abs(p[cell, heading] - (done < 0.2 - 1e-6).mean()))
    assert np.mean(gaps) <= 0.05
    assert max(gaps) <= 0.16


# --- one step against the simulator --------------------------------------------------------------


def fresh(motion=MOTION):
    config = HistogramConfig(
        slip=0.0,
        leak=0.0,
        cell_size=0.2,
        headings=72,
        contact_floor=0.02,
        odometry_floor=0.05,
        least=0.0,
        precision="float64",
    )
    belief = HistogramBelief(1, config, BeamModel(), motion)
    belief.reset(0, building())
    return belief


@dataclass
class Oracle:
    """Samples of the simulator against the filter's prediction from one state."""

    belief: HistogramBelief
    rng: np.random.Generator
    n: int

    def starts(self, cell, heading, n):
        """Uniform over the open ground of a cell and over a heading bin, by rejection."""
        poses = self.belief.poses(0)
        corner = poses.cells[cell, ::-1] * poses.cell_size + poses.terrain.grid.origin
        kept = np.empty((0, 3))
        while len(kept) < n:
            xy = corner + self.rng.random((2 * n, 2)) * poses.cell_size
            theta = poses.thetas[heading] + (self.rng.random(2 * n) - 0.5) * poses.bin_width
            drawn = np.column_stack([xy, theta])
            kept = np.concatenate([kept, drawn[poses.terrain.contains(drawn)]])
        return kept[:n]

    def simulated(self, cell, heading, u, touched):
        poses, config = self.belief.poses(0), self.belief.config
        terrain, total = poses.terrain, np.zeros(len(poses.cells) * poses.headings)
        for _ in range(-(-self.n // 100_000)):
            start = self.starts(cell, heading, min(self.n, 100_000))
            normals = self.rng.standard_normal(start.shape)
            end, shortfall = self.belief.motion.sample(terrain, start, u, normals)
            weight = np.where(shortfall > poses.cell_size / 2, config.odometry_floor, 1.0)
            if touched:
                ahead = move(terrain, end, np.array([0.0, poses.cell_size, 0.0]))[1][:, 1]
                weight *= np.where(ahead < poses.cell_size - 1e-6, 1.0, config.contact_floor)
            at, bins = poses.states_of(end)
            total += np.bincount(at.astype(int) * poses.headings + bins, weight, len(total))
        return (total / total.sum()).reshape(-1, poses.headings)

    def predicted(self, cell, heading, u, touched):
        prior = np.zeros((len(self.belief.poses(0).cells), self.belief.poses(0).headings))
        prior[cell, heading] = 1.0
        self.belief.reset(0, building(), prior)
        self.belief.predict(0, u, touched)
        bel, track = self.belief.probabilities(0), self.belief._track(0)
        noise = np.sqrt(track.left_over[2])
        bel = GridBelief.of(track.tables, bel)
        bel.rotate(*turn_taps(0.0, noise, track.tables.poses.bin_width))
        return bel.by_cell

    def distance(self, cell, heading, u, touched=False):
        """Total variation over (cell, heading), over cells alone, over headings alone."""
        gap = self.predicted(cell, heading, u, touched) - self.simulated(cell, heading, u, touched)
        return [0.5 * np.abs(g).sum() for g in (gap, gap.sum(axis=1), gap.sum(axis=0))]

    def cases(self, wanted):
        """States and readings as they come up: the robot is told to drive half a metre.

        ``open`` is free ground with a stencil of its own, ``free`` any motion that no contact was
        felt in, ``partly`` and ``refused`` those that were stopped after and before 5 cm.
        """
        poses, motion = self.belief.poses(0), self.belief.motion
        plain = self.belief._track(0).tables.travel.level(5).rows.row < 0
        beside = poses.area < 1.0
        for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            row, col = (poses.cells + step).T
            beside |= (
                poses.index[row.clip(0, poses.shape[0] - 1), col.clip(0, poses.shape[1] - 1)] < 0
            )
        found = {kind: [] for kind in wanted}
        command = np.array([0.0, 0.5, 0.0])
        while any(len(found[kind]) < n for kind, n in wanted.items()):
            near = np.flatnonzero(beside) if self.rng.random() < 0.7 else np.arange(len(beside))
            cell, heading = int(self.rng.choice(near)), int(self.rng.integers(poses.headings))
            start = self.starts(cell, heading, 1)
            normals = self.rng.normal(size=(1, 2, 3))
            u = motion.execute(poses.terrain, start, command[None], normals)[1][0]
            touched = bool(motion.touched(command, u))
            u = np.array([0.0, round(u[1] / 0.1) * 0.1, 0.0])
            kind = "free" if not touched else "partly" if u[1] > 0.05 else "refused"
            if kind == "free" and plain[heading, cell]:
                kind, u = "open", np.array([0.0, 0.5, 0.0])
            if len(found[kind]) < wanted[kind]:
                found[kind].append((cell, heading, u, touched))
        return found


# Total variation accepted: mean, worst, and mean over cells alone. The aim is .04 and .08. Open
# ground is there: what is left is that a grid forgets how place and heading hang together. Beside
# obstacles a state is probed at 48 poses: where a robot grazes a wall, the few ways that stay open
# may still be missed (the worst cases); a contact is weighed by the average over the cell and bin
# in which the robot ends. A refused drive starts and ends in one state: nothing can differ there.
ACCEPTED = {
    "open": (0.039, 0.06, 0.005),
    "free": (0.072, 0.63, 0.043),
    "partly": (0.083, 0.2, 0.08),
    "refused": (1e-6, 1e-6, 1e-6),
}


def check_one_step(n_cells, n_samples):
    oracle = Oracle(fresh(), np.random.default_rng(1), n_samples)
    got = {}
    for kind, states in oracle.cases({kind: n_cells for kind in ACCEPTED}).items():
        gaps = np.array([oracle.distance(*state) for state in states])
        mean, worst = gaps.mean(axis=0), gaps.max(axis=0)
        print(
            f"{kind}: mean {mean[0]:.3f} (cells {mean[1]:.3f}, headings {mean[2]:.3f}), "
            f"median {np.median(gaps[:, 0]):.3f}, worst {worst[0]:.3f}, "
            f"{np.mean(gaps[:, 0] <= 0.08):.0%} of {len(gaps)} within .08"
        )
        got[kind] = (mean[0], worst[0], mean[1])
    for kind, accepted in ACCEPTED.items():
        assert (np.array(got[kind]) <= accepted).all(), (kind, got[kind], accepted)


def test_one_step_matches_the_simulator():
    check_one_step(10, 100_000)


@pytest.mark.slow
def test_one_step_matches_a_million_samples():
    check_one_step(50, 1_000_000)


@pytest.mark.parametrize("degrees", [30, -30, 7, 90, -177])
def test_a_turn_matches_the_simulator(degrees):
    oracle = Oracle(fresh(), np.random.default_rng(2), 100_000)
    for cell, heading in ((100, 10), (0, 71), (200, 0)):
        u = np.array([np.radians(degrees), 0.0, 0.0])
        assert oracle.distance(cell, heading, u)[0] <= 0.015


def test_a_drive_between_two_turns_matches_the_simulator():
    oracle = Oracle(fresh(), np.random.default_rng(3), 100_000)
    poses = oracle.belief.poses(0)
    cell = int(poses.states_of(np.array([[2.9, 4.4, 0.0]]))[0][0])
    for heading in (3, 40):
        u = np.array([np.radians(35), 0.3, np.radians(-80)])
        assert oracle.distance(cell, heading, u)[0] <= 0.06


@pytest.mark.parametrize("heading", [20, 50])
def test_a_drive_backwards_matches_the_simulator(heading):
    oracle = Oracle(fresh(), np.random.default_rng(4), 100_000)
    cell = int(oracle.belief.poses(0).states_of(np.array([[2.9, 4.4, 0.0]]))[0][0])
    assert oracle.distance(cell, heading, np.array([0.0, -0.5, 0.0]))[0] <= 0.1
