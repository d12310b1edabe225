"""The belief on a grid against arrays ``(C, K)``: what waits, what is listed, bins, shares."""

from itertools import product
from math import pi

import numpy as np
import pytest

from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_layout import GridLayout
from activeloc.beliefs.grid_tables import tables_of
from activeloc.beliefs.lanes import N_LANES
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.scan_likelihood import ScanLikelihood
from activeloc.beliefs.settings import HistogramConfig
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain
from activeloc.sensors import BeamModel

SENSOR = BeamModel(beams=5, field_of_view=pi / 2, z_max=2.0)


def flat():
    """9 m x 6.2 m, for cells of 0.2 m."""
    cells = np.zeros((62, 90), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[24, :] = cells[24:, [33, 61]] = 1
    cells[24, [8, 9, 10, 11, 40, 41, 42, 43, 70, 71, 72, 73]] = 0
    cells[40:46, 10:19] = cells[30:33, 50:52] = 1
    return OccupancyGrid(cells, 0.1, (-1.0, 2.0))


@pytest.fixture(scope="module")
def tables():
    config = HistogramConfig(cell_size=0.2, headings=24, precision="float64")
    return tables_of(flat(), config, SENSOR, MotionModel(radius=0.15))


def shape_of(tables):
    return len(tables.layout.place), tables.layout.headings


def spots(tables, n, seed=0, spread=3):
    """A belief in a few places, each a patch of states; sums to one."""
    rng, shape = np.random.default_rng(seed), shape_of(tables)
    p = np.zeros(shape)
    for _ in range(n):
        at = tables.poses.centres[rng.integers(shape[0])]
        near = np.flatnonzero(np.abs(tables.poses.centres - at).max(axis=1) < 0.1 * spread)
        p[near[:, None], rng.integers(shape[1], size=spread)] += rng.random((len(near), spread))
    return p / p.sum()


BELIEFS = [lambda t: spots(t, 1), lambda t: spots(t, 5, 1), lambda t: spots(t, 80, 2, 6),
           lambda t: np.random.default_rng(3).dirichlet(np.ones(shape_of(t)).ravel()).reshape(
               shape_of(t))]  # fmt: skip


def turned(p, first, taps):
    return sum(tap * np.roll(p, first + j, axis=1) for j, tap in enumerate(taps))


def check_sheet(bel):
    """The list ascends; nothing is outside of it, or beyond a cell's headings."""
    sheet, layout = bel.sheet, bel.tables.layout
    places = sheet.places[: sheet.n].astype(int)
    assert (np.diff(places) > 0).all()
    assert set(places) <= set(layout.place)
    values = sheet.values.reshape(layout.size, layout.width)
    assert not values[:, layout.headings :].any()
    assert not np.delete(values, places, axis=0).any()
    assert not sheet.flags.any()


# --- layout --------------------------------------------------------------------------------------


@pytest.mark.parametrize("belief", BELIEFS)
def test_what_is_laid_out_comes_back(tables, belief):
    p = belief(tables)
    bel = GridBelief.of(tables, p)
    np.testing.assert_array_equal(bel.by_cell, p)
    check_sheet(bel)
    twin = bel.copy()
    bel.scale(0.5)
    np.testing.assert_array_equal(twin.by_cell, p)
    assert twin.mass() == pytest.approx(1.0, abs=1e-12)
    assert twin.cells_held() == p.any(axis=1).sum()


def test_a_cell_is_a_place_of_the_rectangle():
    poses = PoseGrid(Terrain(flat(), 0.15), 0.2, 12)
    layout = GridLayout(poses)
    np.testing.assert_array_equal(poses.index.ravel()[layout.place], np.arange(len(poses.cells)))
    assert layout.size > poses.shape[0] * poses.shape[1]  # Beyond the last cell may be read.
    assert layout.headings <= layout.width < layout.headings + N_LANES
    assert layout.width % N_LANES == 0


# --- what waits ----------------------------------------------------------------------------------


@pytest.mark.parametrize("belief", BELIEFS)
def test_turns_that_wait_are_one_turn(tables, belief):
    p, rng = belief(tables), np.random.default_rng(0)
    bel, expected = GridBelief.of(tables, p), p
    for first, n in ((3, 5), (-7, 2), (30, 1)):
        taps = rng.dirichlet(np.ones(n))
        bel.rotate(first, taps)
        expected = turned(expected, first, taps)
    bel.divide(4.0)
    np.testing.assert_allclose(bel.by_cell, expected / 4.0, rtol=0, atol=1e-15)
    check_sheet(bel)


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize(
    ("first", "n_flat"), [(-2, 5), (3, 1), (-9, 19), (20, 23), (4, 24), (0, 31)]
)
@pytest.mark.parametrize("n_taps", [1, 3, 6, 13])
def test_a_turn_may_have_a_flat_part(tables, belief, first, n_flat, n_taps):
    """As wide as the circle and wider; alone, before another turn, and after one."""
    p, taps = belief(tables), np.random.default_rng(0).dirichlet(np.ones(n_taps)) * 0.8
    flat = 0.2 / n_flat
    expected = turned(p, -1, taps) + turned(p, first, np.full(n_flat, flat))
    bel = GridBelief.of(tables, p)
    bel.rotate(-1, taps, first, n_flat, flat)
    np.testing.assert_allclose(bel.by_cell, expected, rtol=0, atol=1e-15)
    check_sheet(bel)
    assert ((bel.by_cell > 0.0) == (expected > 0.0)).all()
    more = np.array([0.5, 0.5])
    for twice in (False, True):
        bel = GridBelief.of(tables, p)
        if twice:
            bel.rotate(5, more)
        bel.rotate(-1, taps, first, n_flat, flat)
        if not twice:
            bel.rotate(5, more)
        np.testing.assert_allclose(bel.by_cell, turned(expected, 5, more), rtol=0, atol=1e-15)


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("level", [4, -3])
@pytest.mark.parametrize("turns", [False, True])
def test_a_turn_may_wait_for_a_travel(tables, belief, level, turns):
    """And so may a division; the belief is that of one after the other."""
    waits, first, taps = GridBelief.of(tables, belief(tables)), 2, np.array([0.2, 0.5, 0.3])
    if turns:
        waits.rotate(first, taps)
    waits.divide(0.5)
    done = turned(belief(tables), first, taps) if turns else belief(tables)
    told = GridBelief.of(tables, done / 0.5)
    left = [bel.travel(level, 1, 0.05) for bel in (waits, told)]
    assert left[0] == pytest.approx(left[1], rel=1e-12)
    assert left[0] == pytest.approx(waits.mass(), rel=1e-12)
    np.testing.assert_allclose(waits.by_cell, told.by_cell, rtol=0, atol=1e-14)
    check_sheet(waits)


def likelihood(tables, scan):
    """``(C, K)`` of p(z | x) to the filter's power, state by state."""
    table, power = tables.readings, tables.powered.power
    bins, p = table.bins.index(scan), np.ones(shape_of(tables))
    for b, k in product(np.flatnonzero(bins >= 0), range(p.shape[1])):
        direction = (k * table.per_heading + table.offsets[b]) % table.n_directions
        p[:, k] *= np.exp(power * table.log_p[bins[b], table.row[:, direction]].astype(float))
    return p


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("n_beams", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("turns", [False, True])
def test_a_turn_may_wait_for_a_scan(tables, belief, n_beams, turns):
    """Any number of beams; few lane groups of a cell and all of them."""
    p, scan = belief(tables), np.array([0.4, 1.1, 2.0, 0.7, 1.6])
    scan[n_beams:] = np.nan
    bins = tables.readings.bins.index(scan)
    weights = np.full(5, tables.powered.power)
    said = ScanLikelihood.of(tables.readings, tables.powered, bins, weights)
    assert said.as_product
    bel, taps = GridBelief.of(tables, p), np.array([0.2, 0.5, 0.3])
    if turns:
        bel.rotate(-2, taps)
        p = turned(p, -2, taps)
    bel.divide(3.0)
    total, shift = bel.read(said)
    expected = likelihood(tables, scan) * p / 3.0
    assert total * np.exp(shift) == pytest.approx(expected.sum(), rel=1e-10)
    np.testing.assert_allclose(bel.by_cell / total, expected / expected.sum(), rtol=1e-9)
    check_sheet(bel)


@pytest.mark.parametrize("belief", BELIEFS)
def test_small_states_are_dropped_and_the_rest_is_one(tables, belief):
    p = belief(tables)
    bel, least = GridBelief.of(tables, p), float(np.quantile(p[p > 0], 0.4))
    bel.rotate(1, np.ones(1))
    bel.divide(7.0)
    kept = np.where(p >= least, p, 0.0)
    assert bel.normalise(1.0 / 7.0, least) == pytest.approx(kept.sum(), abs=1e-12)
    np.testing.assert_allclose(bel.by_cell, np.roll(kept, 1, axis=1) / kept.sum(), atol=1e-15)
    check_sheet(bel)
    assert bel.normalise(1.0, 1.1) == 1.0  # All are that small: none is dropped.


def matrices(tables, level, floor):
    """``(K, C, C)`` of p(x' | x) for each heading, written out from the shared rows."""
    travel, layout, poses = tables.travel.level(abs(level)), tables.layout, tables.poses
    index, (n, k_all) = poses.index.ravel(), shape_of(tables)
    out, rows = np.zeros((k_all, n, n)), travel.rows
    for k, c in product(range(k_all), range(n)):
        way = (k + (k_all // 2 if level < 0 else 0)) % k_all
        if rows.row[way, c] < 0:
            of = slice(*travel.stencil_start[way : way + 2])
            steps = travel.stencil_step[of] @ (layout.cols, 1)
            weights = travel.stencil_weight[of].astype(float)
        else:
            of = slice(*rows.first[rows.row[way, c] :][:2])
            free, clipped = rows.weight[:, of].astype(float)
            steps, weights = rows.step[of], free + floor * clipped
        np.add.at(out[k, c], index[layout.place[c] + steps], weights)
    return out


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("headings", "radius"), [(4, 0.0), (10, 0.0), (8, 0.05), (16, 0.0)])
def test_what_is_done_to_a_belief_is_what_is_done_to_an_array(headings, radius, seed):
    """Twenty things at random, on ground that is open up to the map's border if the robot is none.

    Each is done to ``(C, K)`` numbers too, one after the other: nothing waits there.
    """
    cells = np.zeros((13, 16), dtype=np.uint8)
    cells[5:, 7] = 1
    config = HistogramConfig(cell_size=0.2, headings=headings, precision="float64")
    world = OccupancyGrid(cells, 0.1, (0.3, -0.2))
    tables = tables_of(world, config, BeamModel(beams=3, z_max=1.0), MotionModel(radius=radius))
    rng, power = np.random.default_rng(seed), tables.powered.power
    p = rng.random(shape_of(tables)) * (rng.random(shape_of(tables)) < 0.3)
    bel = GridBelief.of(tables, p)
    moves = {level: matrices(tables, level, 0.1) for level in (2, -3)}
    for _ in range(20):
        what = rng.choice(["turn", "slip", "travel", "touch", "scan", "less", "copy", "mix"])
        first, taps = int(rng.integers(-9, 9)), rng.random(rng.integers(1, 4))
        if what == "turn":
            bel.rotate(first, taps)
            p = turned(p, first, taps)
        elif what == "slip":
            bel.rotate(1, taps, first, 3, 0.2)
            p = turned(p, 1, taps) + turned(p, first, np.full(3, 0.2))
        elif what == "travel":
            level = int(rng.choice(list(moves)))
            left = bel.travel(level, 1, 0.1)
            p = np.einsum("kcd,ck->dk", moves[level], p)
            assert left == pytest.approx(p.sum(), rel=1e-6)
        elif what == "touch":
            left = bel.touch(0.2)
            p = p * (0.2 + 0.8 * tables.travel.p_contact)
            assert left == pytest.approx(p.sum(), rel=1e-6)
        elif what == "scan":
            readings = rng.integers(0, len(tables.readings.bins), 3).astype(np.int32)
            readings[rng.integers(3)] = readings[0]  # Two beams, or all, may read alike.
            weights = np.full(3, power if rng.random() < 0.7 else 0.3)
            said = ScanLikelihood.of(tables.readings, tables.powered, readings, weights)
            total, shift = bel.read(said)
            for b in range(3):
                direction = np.arange(headings) * tables.readings.per_heading
                direction = (direction + tables.readings.offsets[b]) % tables.readings.n_directions
                log_p = tables.readings.log_p[readings[b]].astype(float)
                p = p * np.exp(weights[b] * log_p[tables.readings.row[:, direction]])
            assert np.log(total) + shift == pytest.approx(np.log(p.sum()), abs=1e-5)
            p = p / np.exp(shift)
        elif what == "less":
            mass, least = p.sum(), 0.2 * p.max() / p.sum()
            kept = np.where(p >= least * mass, p, 0.0)
            if np.isclose(p[p > 0], least * mass, rtol=1e-4).any():
                continue
            assert bel.normalise(bel.mass(), least) == pytest.approx(kept.sum() / mass, rel=1e-5)
            p = kept / kept.sum()
        elif what == "copy":
            bel = bel.copy()
        else:
            other = bel.turned(first, 3)
            bel.add(other, 0.5)
            bel.divide(0.5)
            p = 2.0 * (p + 0.5 * turned(p, first, np.full(3, 1.0 / 3.0)))
            other.drop()
        if rng.random() < 0.4:  # Otherwise a turn may wait for what comes next.
            assert bel.cells_held() == bel.by_cell.any(axis=1).sum()
            np.testing.assert_allclose(bel.by_cell, p, rtol=1e-5, atol=1e-9 * p.max())
            check_bins(bel, p)
    check_sheet(bel)
    np.testing.assert_allclose(bel.by_cell, p, rtol=1e-5, atol=1e-9 * p.max())


def check_bins(bel, p):
    """Sums in bins of two cells and half of the headings, and the estimate."""
    tables = bel.tables
    corner = tables.poses.terrain.grid.origin
    shape = (tables.poses.shape[0] // 2 + 1, tables.poses.shape[1] // 2 + 1)
    bins = CoarseBins.over(tables.poses, corner, 0.4, shape, p.shape[1] // 2)
    got = bel.masses(bins).reshape(-1, *shape)
    expected, half = np.zeros_like(got), tables.poses.cells // 2
    for k in range(p.shape[1]):
        np.add.at(expected[k // 2], (half[:, 0], half[:, 1]), p[:, k])
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-9 * p.max())


# --- what it says --------------------------------------------------------------------------------


def shares_of(n, start, width, size, n_bins):
    """``(bins, n)``; share of n intervals in equal bins, those beyond at the edge."""
    shares = np.zeros((n_bins, n))
    for i, j in product(range(n), range(-50, n_bins + 50)):
        low, high = max(start + i * width, j * size), min(start + (i + 1) * width, (j + 1) * size)
        if high > low:
            shares[min(max(j, 0), n_bins - 1), i] += (high - low) / width
    return shares


# Bins coarser and finer than the cells, from another corner, some beyond the map.
BINS = [((-1.0, 2.0), 0.5, (13, 18), 12), ((-1.3, 1.2), 0.37, (30, 40), 8),
        ((-1.0, 2.0), 0.13, (40, 60), 24), ((0.5, 3.0), 1.1, (2, 3), 9),
        ((-6.0, -3.0), 1.0, (20, 22), 6)]  # fmt: skip


@pytest.mark.parametrize(("corner", "size", "shape", "headings"), BINS)
def test_coarser_bins_hold_their_shares(tables, corner, size, shape, headings):
    poses = tables.poses
    bins = CoarseBins.over(poses, corner, size, shape, headings)
    rows, cols = poses.shape
    by_row = shares_of(rows, 2.0 - corner[1], 0.2, size, shape[0])
    by_col = shares_of(cols, -1.0 - corner[0], 0.2, size, shape[1])
    by_heading = shares_of(24, 0.0, 2 * pi / 24, 2 * pi / headings, headings)
    np.testing.assert_allclose(bins.headings, by_heading, atol=1e-6)
    for belief in BELIEFS:
        p = belief(tables)
        planes = np.zeros((24, rows, cols))
        planes[:, poses.cells[:, 0], poses.cells[:, 1]] = p.T
        expected = np.einsum("hk,krc,yr,xc->hyx", by_heading, planes, by_row, by_col, optimize=True)
        bel = GridBelief.of(tables, p)
        got = bel.masses(bins)
        np.testing.assert_allclose(got, expected.reshape(got.shape), atol=1e-6)
        assert got.sum() == pytest.approx(1.0, abs=1e-6)
        onto = np.arange(got.size, dtype=np.float64).reshape(got.shape)
        more = bel.masses(bins, 0.25, onto.copy())
        np.testing.assert_allclose(more, onto + 0.25 * got, rtol=0, atol=1e-12 * onto.max())


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("every", [1, 7, 100])
def test_states_at_shares_are_those_of_the_cumulative_sum(tables, belief, every):
    """Each state, or some far apart, at the middle of what it has of the mass; the last one too."""
    p = belief(tables)
    cumulative = p.ravel().cumsum()
    held = np.flatnonzero(p.ravel() > 1e-6)[::-1][::every][::-1]
    middle = cumulative[held] - 0.5 * p.ravel()[held]
    cell, heading = GridBelief.of(tables, p).at_shares(middle / cumulative[-1])
    np.testing.assert_array_equal(cell.astype(int) * p.shape[1] + heading, held)


def test_the_likeliest_of_equals_is_the_first(tables):
    p = np.zeros(shape_of(tables))
    p[300, [5, 17]] = p[40, [3, 4, 15]] = p[700, 1] = 0.1
    p[20, 2] = 0.05
    bel = GridBelief.of(tables, p)
    for least, share in ((None, 0.1), (0.08, 0.1 / 0.6)):  # As it is; found when it is normalised.
        if least is not None:
            bel.normalise(bel.mass(), least)
        estimate, mass = bel.estimate(0.3, 0.2)
        np.testing.assert_allclose(estimate[:2], tables.poses.centres[40], atol=1e-9)
        assert estimate[2] == pytest.approx(tables.poses.thetas[3], abs=1e-9)
        assert mass == pytest.approx(share)


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("n", [1, 7, 128])
def test_the_thinned_belief_is_poses_at_even_shares(tables, belief, n):
    bel = GridBelief.of(tables, belief(tables))
    cell, heading = bel.at_shares((np.arange(n) + 0.5) / n)
    expected = np.column_stack([tables.poses.centres[cell], tables.poses.thetas[heading]])
    poses, counts = bel.thinned(n)
    assert counts.sum() == n
    np.testing.assert_array_equal(np.repeat(poses, counts, axis=0), expected)
    assert len(np.unique(poses, axis=0)) == len(poses)


CHANGES = {
    "turn": lambda b, t: b.rotate(1, np.array([0.2, 0.5, 0.3])),
    "travel": lambda b, t: b.travel(3, 1, 0.0),
    "contact": lambda b, t: b.touch(0.1),
    "scan": lambda b, t: b.read(scan_at(t, t.powered.power)),
    "scan, by logarithms": lambda b, t: b.read(scan_at(t, 1.0)),
    "less": lambda b, t: b.normalise(b.mass(), float(b.by_cell.max()) / 3.0),
    "factor": lambda b, t: b.scale(0.5),
    "another": lambda b, t: b.add(GridBelief.of(t, spots(t, 3, 9)), 2.0),
    "uniform": lambda b, t: b.add_uniform(0.5, 0.5),
}


def scan_at(tables, weight):
    readings = np.array([3, 7, 2, 5, 9], dtype=np.int32)
    said = ScanLikelihood.of(tables.readings, tables.powered, readings, np.full(5, weight))
    assert said.as_product == (weight == tables.powered.power)
    return said


@pytest.mark.parametrize("change", CHANGES)
def test_what_was_found_is_looked_for_again_after_a_change(tables, change):
    bel = GridBelief.of(tables, spots(tables, 80, 2, 6))
    bel.estimate(0.5, 0.4)
    bel.thinned(50)
    CHANGES[change](bel, tables)
    anew = GridBelief.of(tables, bel.by_cell)
    for one, other in zip(bel.thinned(50), anew.thinned(50), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(bel.estimate(0.5, 0.4)[0], anew.estimate(0.5, 0.4)[0], atol=1e-9)


@pytest.mark.parametrize("belief", BELIEFS)
def test_the_estimate_is_the_mean_around_the_largest(tables, belief):
    p, poses = belief(tables), tables.poses
    estimate, mass = GridBelief.of(tables, p).estimate(0.5, 0.4)
    cell, heading = np.unravel_index(p.argmax(), p.shape)
    pose = np.append(poses.centres[cell], poses.thetas[heading])
    for _ in range(2):
        turn = (poses.thetas - pose[2] + pi) % (2 * pi) - pi
        near = np.hypot(*(poses.centres - pose[:2]).T) <= 0.5
        there = p * near[:, None] * (np.abs(turn) <= 0.4)
        pose[:2] = there.sum(axis=1) @ poses.centres / there.sum()
        pose[2] += (there.sum(axis=0) @ turn) / there.sum()
    pose[2] = (pose[2] + pi) % (2 * pi) - pi
    np.testing.assert_allclose(estimate, pose, atol=1e-9)
    assert mass == pytest.approx(GridBelief.of(tables, p).near(pose, 0.5, 0.4), abs=1e-9)
