"""The selective update against the full one, and the background against the leak laid out."""

from dataclasses import replace
from itertools import pairwise, product
from math import inf, log, pi

import numpy as np
import pytest

from activeloc.beliefs import NEAR_ANGLE, NEAR_RADIUS
from activeloc.beliefs.background import elsewhere_after
from activeloc.beliefs.common_bins import entropy
from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.past import REMEMBERED
from activeloc.beliefs.scan_likelihood import PoweredTable, ScanLikelihood
from activeloc.beliefs.view import view_frame
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, MotionNoise, wrap
from activeloc.sensors import BeamModel
from activeloc.sensors.readings import rays_of
from activeloc.simulator import Simulator

SENSOR = BeamModel(beams=5, field_of_view=pi / 2, z_max=2.0)
MOTION = MotionModel(odometry=MotionNoise(0.1, 0.03, 0.05), radius=0.15)
POWER = HistogramConfig().likelihood_power
TURN, DRIVE = np.array([pi / 6, 0.0, 0.0]), np.array([0.0, 0.4, 0.0])


@pytest.fixture(scope="module")
def flat():
    """Three unlike rooms along a corridor: 6 m x 4.4 m."""
    cells = np.zeros((44, 60), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[18, :] = cells[18:, [19, 37]] = 1
    cells[18, [8, 9, 10, 11, 28, 29, 30, 31, 47, 48, 49, 50]] = 0
    cells[30:34, 4:9] = cells[24:27, 27:29] = cells[40:, 44:52] = cells[6:10, 52:56] = 1
    return OccupancyGrid(cells, 0.1, (-1.0, 2.0))


def belief_on(grid, **settings):
    plain = {"cell_size": 0.2, "headings": 24, "precision": "float64", "slip": 0.0}
    given = plain | settings
    belief = HistogramBelief(1, HistogramConfig(**given), SENSOR, MOTION)
    belief.reset(0, grid)
    return belief


def near(belief, grid, pose=(0.0, 3.0, 0.3), w=0.0):
    """A belief around a pose, with some of it elsewhere."""
    belief.reset_near(0, grid, np.array(pose), (0.2, 0.2))
    belief._track(0).elsewhere = w
    return belief


def weighed(belief, scan_likelihood, p):
    """``(C, K)`` after a scan, its sum, and what its logarithm lacks."""
    bel = GridBelief.of(belief._track(0).tables, p)
    total, shift = bel.read(scan_likelihood)
    return bel.by_cell, total, shift


def parts_of(starts, width, n, size):
    """``(n, N)``; how much of each stretch lies in each bin, of which the outermost have no end."""
    edges = np.r_[-np.inf, np.arange(1, n) * size, np.inf]
    low, high = np.maximum(edges[:-1, None], starts), np.minimum(edges[1:, None], starts + width)
    return np.maximum(high - low, 0.0) / width


def turns_of(starts, width, n):
    """The same around the circle, in n bins from -pi."""
    edges = -pi + np.arange(n + 1) * 2.0 * pi / n
    parts = np.zeros((n, len(starts)))
    for turn in (-2.0 * pi, 0.0, 2.0 * pi):
        low = np.maximum(edges[:-1, None], starts + turn)
        high = np.minimum(edges[1:, None], starts + turn + width)
        parts += np.maximum(high - low, 0.0) / width
    return parts


def summed(p, poses, corner, size, shape, headings):
    """``(places, headings)``; a belief ``(C, K)`` in coarser bins from a corner on."""
    start = poses.cells * poses.cell_size + np.array(poses.terrain.grid.origin[::-1]) - corner[::-1]
    rows = parts_of(start[:, 0], poses.cell_size, shape[0], size)
    cols = parts_of(start[:, 1], poses.cell_size, shape[1], size)
    turns = turns_of(poses.thetas - 0.5 * poses.bin_width, poses.bin_width, headings)
    masses = np.einsum("yc,xc,ck,hk->yxh", rows, cols, p, turns, optimize=True)
    return masses.reshape(-1, headings)


def walk(grid, steps, seed, kidnap=-1):
    """Start, and (u, touched, scan, pose) of each step of a robot that turns away at walls."""
    rng, robot = np.random.default_rng(seed), Simulator(1, SENSOR, MOTION)
    robot.place(0, grid, rng)
    start, first, scan, turns, log_book = robot.poses[0].copy(), None, None, 6, []
    first = scan = robot.scan(0, rng)
    for step in range(steps):
        if turns == 0 and scan[2] < 0.5:
            turns = int(rng.integers(2, 6))
        command, turns = (TURN, turns - 1) if turns else (DRIVE, 0)
        u = robot.step(0, command, rng)
        if step == kidnap:
            robot.poses[0] = [4.4, 5.2, 2.0]
        scan = robot.scan(0, rng)
        touched = bool(MOTION.touched(command, u))
        log_book.append((u, touched, scan, robot.poses[0].copy()))
    return start, first, log_book


def total_variation(one, other):
    return 0.5 * np.abs(one.probabilities(0) - other.probabilities(0)).sum()


def scans_of(seed, n):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        scan = rng.uniform(0.1, 2.0, 5)
        scan[rng.random(5) < 0.2] = SENSOR.z_max
        yield scan


def likelihood_of(belief, scan, weights):
    """``(C, K)`` of p(z | x), beam by beam from the table."""
    table = belief._track(0).tables.readings
    bins, shape = table.bins.index(scan), belief.probabilities(0).shape
    p = np.ones(shape)
    for b, k in product(range(5), range(shape[1])):
        if bins[b] >= 0:
            direction = (k * table.per_heading + table.offsets[b]) % table.row.shape[1]
            p[:, k] *= np.exp(weights[b] * table.log_p[bins[b], table.row[:, direction]])
    return p


# --- the selective update ------------------------------------------------------------------------


@pytest.mark.parametrize("known", [False, True])
def test_the_selective_update_follows_the_full_one(flat, known):
    start, first, steps = walk(flat, 60, seed=3)
    pair = [belief_on(flat, leak=0.0, least=least) for least in (1e-10, 0.0)]
    for belief in pair:
        if known:
            near(belief, flat, start)
        belief.correct(0, first)
    touched, apart = [], []
    for u, bumped, scan, _ in steps:
        for belief in pair:
            belief.predict(0, u, bumped)
            belief.correct(0, scan)
        apart.append(total_variation(*pair))
        touched.append(pair[0].live_share(0))
    assert max(apart) <= 1e-5
    assert min(touched) < 0.2
    assert pair[1].live_share(0) == 1.0 or known


def test_products_of_likelihoods_are_sums_of_their_logarithms(flat):
    belief = belief_on(flat)
    tables, p = belief._track(0).tables, belief.probabilities(0)
    for scan in scans_of(0, 4):
        scan[3] = np.nan
        readings = tables.readings.bins.index(scan)
        for weights in (np.full(5, POWER), POWER * np.array([1.0, 0.0, 1.0, 0.0, 1.0])):
            fast = ScanLikelihood.of(tables.readings, tables.powered, readings, weights)
            slow = replace(fast, as_product=False)
            assert fast.as_product
            expected = p * likelihood_of(belief, np.where(weights > 0, scan, np.nan), weights)
            for one in (fast, slow):
                bel, total, shift = weighed(belief, one, p)
                np.testing.assert_allclose(bel / total, expected / expected.sum(), rtol=1e-9)
                assert log(total) + shift == pytest.approx(log(expected.sum()), abs=1e-9)
                assert bel.sum() == pytest.approx(total, rel=1e-12)
            rows = tables.background._rows
            assert fast.log_mean(rows) == pytest.approx(slow.log_mean(rows), abs=1e-9)


def test_likelihoods_are_added_as_logarithms_where_a_product_could_vanish(flat):
    table = belief_on(flat)._track(0).tables.readings
    powered = PoweredTable(table, 20.0, "float64")
    readings = np.zeros(5, dtype=np.int32)
    assert not ScanLikelihood.of(table, powered, readings, np.full(5, 20.0)).as_product
    powered = PoweredTable(table, 1.0, "float64")
    unlike = np.array([1.0, 0.5, 1.0, 1.0, 1.0])
    assert not ScanLikelihood.of(table, powered, readings, unlike).as_product
    assert ScanLikelihood.of(table, powered, readings, np.ones(5)).as_product


# --- what the uniform expects --------------------------------------------------------------------


@pytest.mark.parametrize(
    "u", [TURN, -2.0 * TURN, DRIVE, -DRIVE, np.array([0.2, 0.6, -0.1]), np.array([0.01, 0.0, 0.0])]
)
def test_a_slip_is_a_mixture_with_what_a_wrong_reading_may_stand_for(flat, u):
    """All turns within 45 degrees of the one read, alike; of travels, none and half a metre."""
    sure, slips = (near(belief_on(flat, leak=0.0, slip=slip), flat) for slip in (0.0, 0.2))
    before = sure.probabilities(0)
    turn, width = u[0] + u[2], pi / 12.0
    others = [np.roll(before, round(turn / width) + j, axis=1) for j in range(-3, 4)]
    expected = 0.2 * sum(others) / len(others)
    if u[1] != 0.0:
        there = GridBelief.of(sure._track(0).tables, expected)
        there.travel(5 if u[1] > 0.0 else -5, 1, 1.0)
        expected = 0.5 * (expected + there.by_cell)
    for belief in (sure, slips):
        belief.predict(0, u)
    expected += 0.8 * sure.probabilities(0)
    assert expected.sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(slips.probabilities(0), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("w", [0.0, 1e-4, 0.3, 1.0])
def test_the_chance_of_being_elsewhere_follows_bayes(w):
    for there, here in product((1e-9, 0.2, 0.9), repeat=2):
        expected = w * there / (w * there + (1.0 - w) * here)
        assert elsewhere_after(w, log(there), log(here)) == pytest.approx(expected, rel=1e-12)
    assert elsewhere_after(w, -2000.0, -1.0) == pytest.approx(float(w == 1.0), abs=1e-300)
    assert elsewhere_after(w, -1.0, -inf) == float(w > 0.0)
    assert elsewhere_after(w, -inf, -inf) == w


def test_a_sample_of_states_says_what_a_scan_is_worth_elsewhere(flat):
    belief = belief_on(flat)
    tables, p = belief._track(0).tables, belief.probabilities(0)
    errors = []
    for scan in scans_of(1, 40):
        readings = tables.readings.bins.index(scan)
        scan_likelihood = ScanLikelihood.of(
            tables.readings, tables.powered, readings, np.full(5, POWER)
        )
        exact = (p * likelihood_of(belief, scan, np.full(5, POWER))).sum()
        errors.append(tables.background.log_evidence(scan_likelihood) - log(exact))
    assert np.abs(errors).max() < 0.25
    assert np.sqrt(np.square(errors).mean()) < 0.08


def test_travels_and_contacts_elsewhere_are_averages_over_the_uniform(flat):
    belief = belief_on(flat)
    track = belief._track(0)
    tables, p = track.tables, belief.probabilities(0)
    floor = 0.05
    expected = (p * (floor + (1.0 - floor) * tables.travel.p_contact)).sum()
    assert tables.background.contact(floor) == pytest.approx(expected, rel=1e-6)
    for level in (1, 4):
        left = GridBelief.of(tables, p).travel(level, 1, floor)
        assert left < 0.99
        assert tables.background.travel(level, 1, floor) == pytest.approx(left, rel=1e-6)


# --- one number against the leak in every state --------------------------------------------------


def test_the_leak_in_every_state_is_the_mixture(flat):
    belief = near(belief_on(flat, leak=0.01, least=0.0), flat)
    before, uniform = belief.probabilities(0), belief._track(0).tables.uniform
    belief.predict(0, np.zeros(3))
    np.testing.assert_allclose(
        belief.probabilities(0), 0.99 * before + 0.01 * uniform, rtol=1e-12, atol=0
    )
    assert belief.elsewhere(0) == 0.0


@pytest.mark.parametrize("leak", [1e-4, 1e-3])
def test_one_number_stands_for_the_leak_in_every_state(flat, leak):
    """While nobody carries the robot off: the same belief up to ten times a step's leak."""
    start, first, steps = walk(flat, 60, seed=5)
    pair = [near(belief_on(flat, leak=leak, least=x), flat, start) for x in (1e-10, 0.0)]
    apart = []
    for belief in pair:
        belief.correct(0, first)
    for u, bumped, scan, _ in steps:
        for belief in pair:
            belief.predict(0, u, bumped)
            belief.correct(0, scan)
        apart.append(total_variation(*pair))
        assert belief.probabilities(0).sum() == pytest.approx(1.0, abs=1e-9)
    assert max(apart) < 10.0 * leak
    assert np.median(apart) < leak
    assert pair[0].live_share(0) < 0.2


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_kidnapped_robot_is_found_as_soon_as_by_the_leak_in_every_state(flat, seed):
    start, first, steps = walk(flat, 60, seed, kidnap=14)
    let_go, found, masses = [], [], []
    for least in (1e-10, 0.0):
        belief = near(belief_on(flat, leak=1e-3, least=least), flat, start)
        belief.correct(0, first)
        held, true = [], []
        old = steps[12][3]
        for u, bumped, scan, pose in steps:
            belief.predict(0, u, bumped)
            belief.correct(0, scan)
            true.append(belief.mass_near(0, pose) > 0.5)
            if len(true) > 14:  # The old place, followed by odometry.
                turn = np.array([np.cos(old[2] + u[0]), np.sin(old[2] + u[0])])
                old = np.array([*(old[:2] + u[1] * turn), old[2] + u[0] + u[2]])
            held.append(len(true) <= 14 or belief.mass_near(0, old) > 0.5)
        assert all(true[10:13])
        assert not true[14]
        let_go.append(held.index(False))
        found.append(true.index(True, 14))
        masses.append(belief.mass_near(0, pose))
    assert abs(let_go[0] - let_go[1]) <= 2
    assert abs(found[0] - found[1]) <= 2
    assert masses[0] == pytest.approx(masses[1], abs=0.02)
    assert min(masses) > 0.75


def test_without_a_leak_a_kidnapped_robot_stays_lost(flat):
    start, first, steps = walk(flat, 60, 2, kidnap=14)
    belief = near(belief_on(flat, leak=0.0), flat, start)
    belief.correct(0, first)
    for u, bumped, scan, _ in steps:
        belief.predict(0, u, bumped)
        belief.correct(0, scan)
    assert belief.mass_near(0, steps[-1][3]) < 1e-3
    assert belief.noticed(0) == 0


def test_a_robot_that_reads_again_what_it_has_read_does_not_drift_elsewhere(flat):
    belief = near(belief_on(flat, leak=1e-4, widen=1.0, repetition=0.0), flat)
    pose, elsewhere = np.array([0.0, 3.0, 0.3]), []
    for _ in range(40):
        belief.correct(0, SENSOR.expected(flat, rays_of(pose, SENSOR.bearings)))
        belief.predict(0, TURN)
        pose += [0.0, 0.0, TURN[0]]
        elsewhere.append(belief.elsewhere(0))
    assert elsewhere[15] > 0.0
    assert elsewhere[-1] == pytest.approx(elsewhere[15], rel=0.1)
    assert belief.mass_near(0, pose, 1.0, pi) > 0.9


# --- widening ------------------------------------------------------------------------------------


def test_a_belief_that_widens_is_the_mixture_weighed_by_the_scan(flat):
    belief = near(belief_on(flat, leak=1e-3, widen=0.05), flat, w=0.04)
    scan = np.array([0.2, 1.9, 0.3, 1.9, 0.2])
    expected = belief.probabilities(0) * likelihood_of(belief, scan, np.full(5, POWER))
    evidence = belief.correct(0, scan)
    assert belief.noticed(0) == 1
    assert belief.elsewhere(0) < 1e-3
    assert evidence == pytest.approx(log(expected.sum()), abs=1e-9)
    np.testing.assert_allclose(
        belief.probabilities(0), expected / expected.sum(), rtol=0, atol=1e-3 / expected.size
    )
    assert belief.place(0).readings.sum() == 5
    belief.correct(0, np.full(5, 1.0))
    assert belief.noticed(0) == 1


def test_a_scan_that_is_impossible_here_is_evidence_of_being_elsewhere(flat):
    sure = BeamModel(
        5, pi / 2, 2.0, sigma_hit=0.0005, w_hit=1.0, w_short=0.0, w_max=0.0, w_rand=0.0
    )
    config = HistogramConfig(cell_size=0.2, headings=24, precision="float64", leak=1e-3)
    belief = HistogramBelief(1, config, sure, MOTION)
    robot = Simulator(1, sure, MOTION)
    robot.place(0, flat, np.random.default_rng(0), np.array([4.2, 4.1, 1.0]))
    scan = robot.scan(0, np.random.default_rng(1))
    for w, answer in ((0.0, -inf), (1e-6, 0.0)):
        belief.reset_near(0, flat, np.array([-0.6, 2.4, -2.0]), (0.05, 0.05))
        belief._track(0).elsewhere = w
        before = belief.probabilities(0)
        evidence = belief.correct(0, scan)
        if answer == -inf:
            assert evidence == -inf
            np.testing.assert_array_equal(belief.probabilities(0), before)
            continue
        uniform = belief._track(0).tables.uniform
        expected = uniform * likelihood_of(belief, scan, np.full(5, POWER))
        np.testing.assert_allclose(
            belief.probabilities(0), expected / expected.sum(), rtol=0, atol=1e-7
        )
        assert evidence == pytest.approx(log(w * expected.sum()), abs=1e-9)
    nowhere = np.array([0.01, 2.0, 0.01, 2.0, 0.01])
    before = belief.probabilities(0)
    belief._track(0).elsewhere = 0.01
    belief.place(0).clear()
    assert belief.correct(0, nowhere) == -inf
    assert belief.elsewhere(0) == 0.01
    belief._track(0).elsewhere = 0.0
    np.testing.assert_array_equal(belief.probabilities(0), before)


def test_a_scan_without_a_reading_leaves_the_background_as_it_was(flat):
    belief = near(belief_on(flat), flat, w=0.004)
    before = belief.probabilities(0)
    assert belief.correct(0, np.full(5, np.nan)) == 0.0
    np.testing.assert_array_equal(belief.probabilities(0), before)
    assert belief.elsewhere(0) == 0.004


def test_a_scan_that_tells_nothing_leaves_the_belief_as_it_was_and_does_not_leak(flat):
    """What is read again at one place neither weighs, nor widens, nor is reckoned with."""
    belief = near(belief_on(flat, leak=1e-3), flat, w=0.004)
    scan = SENSOR.expected(flat, rays_of(np.array([0.0, 3.0, 0.3]), SENSOR.bearings))
    belief.correct(0, scan)
    before, w = belief.probabilities(0), belief.elsewhere(0)
    assert belief.correct(0, np.full(5, 0.1)) == 0.0
    np.testing.assert_allclose(belief.probabilities(0), before, rtol=1e-12, atol=1e-9)
    belief.predict(0, np.zeros(3))
    assert belief.elsewhere(0) == pytest.approx(w, rel=1e-6)
    belief.predict(0, DRIVE)
    assert belief.correct(0, scan) != 0.0
    belief.predict(0, np.zeros(3))
    assert belief.elsewhere(0) > w


def test_states_that_tell_nothing_go_back_into_the_background(flat):
    """No mass is lost: what the list of cells drops, the background holds."""
    belief = near(belief_on(flat, leak=1e-3), flat)
    p = belief.probabilities(0)
    faint = 0.5e-3 / p.size
    p[p == 0.0] = faint
    lost = faint * (p == faint).sum()
    belief.reset(0, flat, p / p.sum())
    belief._track(0).normalise(1.0)
    assert belief.live_share(0) < 0.5
    assert belief.elsewhere(0) == pytest.approx(lost / (1.0 + lost), rel=0.01)
    assert belief.probabilities(0).sum() == pytest.approx(1.0, abs=1e-12)


def test_a_belief_that_widens_knows_what_the_last_steps_said_of_elsewhere(flat):
    """Turns, travels, contacts, leaks and scans are gone through as if the leak were laid out."""
    start, first, steps = walk(flat, 9, seed=2, kidnap=4)
    leak, said = {"leak": 3e-2, "contact_floor": 0.02}, []
    late = near(belief_on(flat, **leak, widen=1.0), flat, start)
    exact = near(belief_on(flat, **leak, least=0.0), flat, start)
    for belief in (late, exact):
        belief.correct(0, first)
        for i, (u, bumped, scan, _) in enumerate(steps):
            belief.predict(0, u, bumped or i == 5)
            if i == len(steps) - 1 and belief is late:
                local = late._track(0).bel.by_cell
                belief.config = replace(belief.config, widen=1e-9)
            evidence = belief.correct(0, scan)
        said.append(evidence)
    assert late.noticed(0) == 1
    p, q = late.probabilities(0), exact.probabilities(0)
    away = local == 0.0
    assert 0.03 < q[away].sum() < 0.9
    assert np.abs(p - q)[away].sum() < 0.04 * q[away].sum()
    assert np.abs(p - q)[~away].sum() < 0.001
    assert said[0] == pytest.approx(said[1], abs=1e-3)


def test_only_the_last_steps_are_remembered_and_none_once_the_belief_is_laid_out(flat):
    belief = near(belief_on(flat, leak=1e-4), flat)
    for _ in range(REMEMBERED + 5):
        belief.predict(0, np.zeros(3))
    steps = belief._track(0).past.steps
    assert len(steps) == REMEMBERED
    weights = [w for w, _ in steps]
    assert weights == sorted(weights)
    assert weights[0] == pytest.approx(5e-4, rel=1e-3)
    belief.config = replace(belief.config, widen=1e-9)
    belief.correct(0, np.array([0.2, 1.9, 0.3, 1.9, 0.2]))
    assert steps == []
    assert belief.noticed(0) == 1


# --- what the belief says of itself --------------------------------------------------------------


@pytest.mark.parametrize("w", [0.0, 1e-4, 0.3, 1.0])
def test_every_answer_counts_what_is_elsewhere(flat, w):
    belief = near(belief_on(flat), flat, w=w)
    p, poses = belief.probabilities(0), belief.poses(0)
    bins = belief.bins(0)
    masses = summed(p, poses, bins.origin, bins.size, bins.shape, bins.n_headings)
    assert p.sum() == pytest.approx(1.0, abs=1e-12)
    for _ in range(2):  # Its workspace is left as it was found.
        summary = belief.summarise(0)
        assert summary.entropy == pytest.approx(entropy(masses), abs=1e-5)
    for pose in ([*summary.estimate], [4.2, 5.1, 1.0], [-0.9, 2.1, -3.1], [70.0, -50.0, 0.0]):
        pose = np.array(pose)
        away = np.hypot(*(poses.centres - pose[:2]).T)
        turn = np.abs(wrap(poses.thetas - pose[2]))
        expected = p[np.ix_(away <= NEAR_RADIUS, turn <= NEAR_ANGLE)].sum()
        assert belief.mass_near(0, pose) == pytest.approx(expected, abs=1e-9)
        expected = p[away <= 2.1].sum()
        assert belief.mass_near(0, pose, 2.1, np.pi) == pytest.approx(expected, abs=1e-9)
    assert summary.mass == pytest.approx(belief.mass_near(0, summary.estimate), abs=1e-12)
    left, bottom, pixel = view_frame(poses.terrain.grid, 6, 8)
    out = summed(p, poses, np.array([left, bottom]), pixel, (6, 8), 12)
    view = belief.view(0, 12, 6, 8)
    np.testing.assert_allclose(view, out.T.reshape(12, 6, 8), atol=1e-8)
    assert view.sum() == pytest.approx(1.0, abs=1e-6)


def test_samples_are_drawn_from_elsewhere_too(flat):
    belief = near(belief_on(flat), flat, w=0.4)
    n, shape = 200_000, belief.probabilities(0).shape
    cell, heading = belief.poses(0).states_of(belief.sample(0, n, np.random.default_rng(0)))
    counts, expected = np.zeros(shape), n * belief.probabilities(0)
    np.add.at(counts, (cell, heading), 1.0)
    assert (np.abs(counts - expected) <= 5 * np.sqrt(expected) + 5).all()
    np.testing.assert_allclose(counts.sum(axis=0), expected.sum(axis=0), rtol=0.06)


def test_a_copy_carries_the_background_on(flat):
    scans = list(scans_of(3, 6))
    belief = near(belief_on(flat, leak=1e-3, widen=1.0), flat)
    for scan in scans[:2]:
        belief.predict(0, DRIVE)
        belief.correct(0, scan)
    belief._track(0).elsewhere = 0.003
    belief.config = replace(belief.config, widen=0.01)
    twin, scans = belief.copy(), scans[2:]
    for scan in scans:
        twin.predict(0, DRIVE)
        twin.correct(0, scan)
    assert belief.elsewhere(0) == 0.003
    assert belief.noticed(0) == 0 < twin.noticed(0)
    for scan in scans:
        belief.predict(0, DRIVE)
        belief.correct(0, scan)
    np.testing.assert_array_equal(belief.probabilities(0), twin.probabilities(0))
    assert belief.noticed(0) == twin.noticed(0)
    assert belief.elsewhere(0) == twin.elsewhere(0)
    belief.reset(0, flat)
    assert belief.noticed(0) == 0 == belief.elsewhere(0)


def test_filters_that_differ_in_their_rules_share_tables(flat):
    one, other = belief_on(flat), belief_on(flat, leak=0.3, least=0.0, widen=1.0, sectors=3)
    assert one._track(0).tables is other._track(0).tables
    settings = [{}, {"cell_size": 0.3}, {"headings": 12}, {"likelihood_power": 1.0}]
    settings += [{"reading_bin": 0.2}, {"precision": "float32"}]
    tables = [belief_on(flat, **given)._track(0).tables for given in settings]
    assert all(a is not b for a, b in pairwise(tables))


@pytest.mark.parametrize("widen", [0.0, -0.1, 1.5, inf, "much"])
def test_a_threshold_that_is_no_probability_is_refused(widen):
    with pytest.raises(ConfigError, match=r"belief\.widen"):
        HistogramConfig(widen=widen)
