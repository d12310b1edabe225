"""The simulator: the luck of a seed, the readings of the model, the discrete world."""

from math import pi

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, norm

from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.errors import MapError
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, MotionNoise, Terrain
from activeloc.sensors import BeamModel, LikelihoodField, ReadingBins
from activeloc.simulator import Simulator

MOTION = MotionModel(MotionNoise(0.1, 0.05, 0.02), MotionNoise(0.2, 0.05, 0.05), radius=0.1)
COMMANDS = {"left": (0.5, 0.0, 0.0), "ahead": (0.0, 0.5, 0.0), "stay": (0.0, 0.0, 0.0)}


def hall():
    """Asymmetric, 2 m x 2.8 m, origin off zero."""
    cells = np.zeros((40, 56), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[10:14, 30:34] = 1
    cells[30:, 8] = 1
    return OccupancyGrid(cells, 0.05, (0.4, -1.0))


def placed(pose=None, sensor=None, redraw=None, seed=0):
    simulator = Simulator(1, sensor or BeamModel(), MOTION, redraw)
    simulator.place(0, hall(), np.random.default_rng(seed), pose)
    return simulator


@pytest.mark.parametrize("redraw", [None, (0.2, 24)])
def test_one_seed_brings_the_same_luck_whatever_is_commanded(redraw):
    """After a step and a scan the generator is where it is after any other step and scan."""
    states = []
    for command in COMMANDS.values():
        simulator, rng = placed(redraw=redraw), np.random.default_rng(3)
        for _ in range(3):
            simulator.step(0, np.array(command), rng)
            simulator.scan(0, rng)
        states.append(rng.bit_generator.state)
    assert states[0] == states[1] == states[2]


@pytest.mark.parametrize("redraw", [None, (0.2, 24)])
def test_one_seed_one_episode(redraw):
    def episode():
        simulator, rng = placed(redraw=redraw), np.random.default_rng(3)
        lived = [simulator.poses[0].copy()]
        for command in COMMANDS.values():
            lived.append(simulator.step(0, np.array(command), rng))
            lived.append(simulator.scan(0, rng))
            lived.append(simulator.poses[0].copy())
        return np.concatenate(lived)

    np.testing.assert_array_equal(episode(), episode())


def test_robots_of_a_batch_live_as_they_would_alone():
    both = Simulator(2, BeamModel(), MOTION)
    rngs = [np.random.default_rng(seed) for seed in (5, 6)]
    for robot in (0, 1):
        both.place(robot, hall(), rngs[robot])
    alone, rng = Simulator(1, BeamModel(), MOTION), np.random.default_rng(6)
    alone.place(0, hall(), rng)
    for command in COMMANDS.values():
        both.step(0, np.array(command), rngs[0])
        u = both.step(1, np.array(command), rngs[1])
        np.testing.assert_array_equal(u, alone.step(0, np.array(command), rng))
        np.testing.assert_array_equal(both.scan(1, rngs[1]), alone.scan(0, rng))
    np.testing.assert_array_equal(both.poses[1], alone.poses[0])


def test_motion_and_odometry_have_noise_of_their_own():
    simulator, rng, n = placed(), np.random.default_rng(0), 4000
    start, command = np.array([1.8, 0.3, 3.0]), np.array([0.6, 0.3, 0.0])
    turned, read = np.empty(n), np.empty((n, 3))
    for i in range(n):
        simulator.poses[0] = start
        read[i] = simulator.step(0, command, rng)
        turned[i] = (simulator.poses[0, 2] - start[2] - 0.6 + pi) % (2 * pi) - pi
    actuation, odometry = MOTION.actuation.sigma(command), MOTION.odometry.sigma(command)
    sigma = np.hypot(actuation[0], actuation[2])
    assert kstest(turned, norm(0.0, sigma).cdf).pvalue > 1e-6
    np.testing.assert_allclose(read.mean(axis=0), command, atol=5 * 0.2 / np.sqrt(n))
    np.testing.assert_allclose(read.std(axis=0), np.hypot(actuation, odometry), rtol=0.05)


def test_odometry_reads_what_was_carried_out_not_what_was_commanded():
    simulator = placed(np.array([1.0, 0.1, pi]))
    for _ in range(4):
        u = simulator.step(0, np.array([0.0, 0.5, 0.0]), np.random.default_rng(1))
    assert abs(u[1]) < 0.01
    assert MOTION.touched(np.array([0.0, 0.5, 0.0]), u)
    assert simulator.terrain(0).contains(simulator.poses[0])


@pytest.mark.parametrize("sensor", [BeamModel(beams=5), LikelihoodField(beams=5)])
def test_readings_follow_the_model(sensor):
    pose = np.array([1.7, 0.1, 1.2])
    simulator, rng = placed(pose, sensor), np.random.default_rng(0)
    scans = np.array([simulator.scan(0, rng) for _ in range(3000)])
    bins = ReadingBins(sensor.z_max, 0.05)
    for b, bearing in enumerate(sensor.bearings):
        ray = np.array([[*pose[:2], pose[2] + bearing]])
        p = sensor.bin_probabilities(hall(), ray, bins)[0]
        counts = np.bincount(bins.index(scans[:, b]), minlength=len(bins))
        # Rare bins are put together.
        order = np.argsort(p)[::-1]
        p, counts = p[order], counts[order]
        often = max(1, int((3000 * p > 20).sum()))
        p, counts = (
            np.append(p[:often], p[often:].sum()),
            np.append(counts[:often], counts[often:].sum()),
        )
        kept = p > 0
        assert chisquare(counts[kept], 3000 * p[kept] / p[kept].sum()).pvalue > 1e-6
    correlation = np.corrcoef(scans.T) - np.eye(5)
    assert np.abs(correlation).max() < 5 / np.sqrt(3000)


# --- the discrete world --------------------------------------------------------------------------


def test_the_discrete_world_redraws_within_the_state():
    simulator, rng = placed(redraw=(0.2, 24)), np.random.default_rng(0)
    grid = PoseGrid(Terrain(hall(), 0.1), 0.2, 24)
    for _ in range(50):
        simulator.step(0, np.array([0.4, 0.2, 0.0]), rng)
        state = grid.states_of(simulator.poses)
        before = simulator.poses.copy()
        redrawn = simulator._redrawn(np.array([0]), rng.random((500, 4))[None])[0]
        cell, heading = grid.states_of(redrawn)
        np.testing.assert_array_equal(cell, state[0][0])
        np.testing.assert_array_equal(heading, state[1][0])
        assert grid.terrain.contains(redrawn).all()
        assert len(np.unique(redrawn, axis=0)) > 100
        np.testing.assert_array_equal(simulator.poses, before)


def test_standing_still_stays_in_the_state():
    simulator, rng = placed(redraw=(0.2, 24)), np.random.default_rng(0)
    grid = PoseGrid(Terrain(hall(), 0.1), 0.2, 24)
    cell, heading = grid.states_of(simulator.poses)
    poses = set()
    for _ in range(200):
        u = simulator.step(0, np.zeros(3), rng)
        np.testing.assert_array_equal(u, 0.0)
        simulator.scan(0, rng)
        assert grid.states_of(simulator.poses) == (cell, heading)
        poses.add(tuple(simulator.poses[0]))
    assert len(poses) > 100


def test_beams_of_the_discrete_world_see_from_different_places():
    sure = BeamModel(
        beams=2, field_of_view=0.0, sigma_hit=1e-6, w_hit=1.0, w_short=0, w_max=0, w_rand=0
    )
    scans = {}
    for redraw in (None, (0.2, 24)):
        simulator = placed(np.array([1.1, 0.1, pi - pi / 48]), sure, redraw)
        scans[redraw] = np.array(
            [simulator.scan(0, np.random.default_rng(seed)) for seed in range(200)]
        )
    np.testing.assert_allclose(np.ptp(scans[None], axis=0), 0.0, atol=1e-4)
    assert (np.ptp(scans[0.2, 24], axis=0) > 0.1).all()
    assert abs(np.corrcoef(scans[0.2, 24].T)[0, 1]) < 5 / np.sqrt(200)


# --- placing -------------------------------------------------------------------------------------


def test_robots_start_uniformly_over_the_open_ground():
    simulator, rng = Simulator(1, BeamModel(), MOTION), np.random.default_rng(0)
    xy = []
    for _ in range(2000):
        simulator.place(0, hall(), rng)
        xy.append(simulator.poses[0].copy())
    xy = np.array(xy)
    terrain = simulator.terrain(0)
    assert terrain.contains(xy).all()
    everywhere = terrain.uniform_poses(np.random.default_rng(1).random((200_000, 4)))
    np.testing.assert_allclose(
        xy.mean(axis=0), everywhere.mean(axis=0), atol=5 * 1.9 / np.sqrt(2000)
    )


def test_a_given_pose_draws_the_same_noise_and_wraps_its_heading():
    rngs = np.random.default_rng(0), np.random.default_rng(0)
    simulator = Simulator(1, BeamModel(), MOTION)
    simulator.place(0, hall(), rngs[0])
    simulator.place(0, hall(), rngs[1], np.array([1.0, 0.1, 7.0]))
    np.testing.assert_allclose(simulator.poses[0], [1.0, 0.1, 7.0 - 2 * pi])
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ([1.0, 0.1, np.nan], "three finite numbers"),
        ([1.0, 0.1], "three finite numbers"),
        ([0.45, 0.1, 0.0], r"\(0\.45, 0\.1\) m on map is in or too near an obstacle"),
        ([99.0, 0.1, 0.0], "or cut off"),
    ],
)
def test_poses_where_no_robot_can_be_are_refused(pose, message):
    simulator = placed(np.array([1.0, 0.1, 0.0]))
    with pytest.raises(MapError, match=message):
        simulator.place(0, hall(), np.random.default_rng(0), np.array(pose))
    np.testing.assert_array_equal(simulator.poses[0], [1.0, 0.1, 0.0])


def test_a_robot_without_a_map_is_refused():
    with pytest.raises(MapError, match="robot 0 has not been placed"):
        Simulator(1, BeamModel(), MOTION).scan(0, np.random.default_rng(0))
