"""Odometry that is badly wrong: its law, and that nothing else of an episode changes with it."""

import numpy as np
import pytest
from scipy.stats import kstest

from activeloc.envs.episodes import EpisodeConfig, Episodes
from activeloc.maps import from_text
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel
from activeloc.simulator import Simulator

HALL = from_text(
    """
##########
#...#....#
#........#
###.##...#
##########
""",
    name="hall",
)

COMMAND = np.array([0.4, 0.5, -0.2])
U = np.array([0.38, 0.51, -0.19])


def misread(blunder, n=4000, seed=0):
    """``(n, 3)`` readings of one command."""
    uniforms = np.random.default_rng(seed).random((n, 5))
    return MotionModel(blunder=blunder).misread(np.tile(U, (n, 1)), COMMAND, uniforms)


@pytest.mark.parametrize("blunder", [0.0, 0.05, 0.5, 1.0])
def test_as_many_readings_are_wrong_as_is_said(blunder):
    wrong = (misread(blunder) != U).any(axis=1)
    assert wrong.mean() == pytest.approx(blunder, abs=4 * np.sqrt(0.25 / 4000) * (0 < blunder < 1))


def test_wrong_translations_are_uniform_up_to_twice_the_command():
    u = misread(1.0)
    assert kstest(u[:, 1], "uniform", (0.0, 1.0)).pvalue > 1e-3
    assert kstest(u[:, 2], "uniform", (-0.4, 0.4)).pvalue > 1e-3


def test_wrong_turns_stray_by_thirty_degrees_besides():
    """The sum of two independent uniforms, by its range and its variance."""
    error = misread(1.0, 20_000)[:, 0] - 0.4
    most = 0.4 + np.pi / 6
    assert most - 0.05 < np.abs(error).max() < most
    assert error.var() == pytest.approx((0.4**2 + (np.pi / 6) ** 2) / 3, rel=0.05)
    assert np.abs(np.corrcoef(misread(1.0, 20_000).T) - np.eye(3)).max() < 0.03


def test_right_readings_are_those_there_would_have_been():
    u = misread(0.3)
    right = (u == U).all(axis=1)
    assert 0 < right.sum() < len(u)


def odometry(motion, steps, seed=3):
    """Readings and poses of a robot that pushes on, and its generator afterwards."""
    simulator, rng = Simulator(1, BeamModel(), motion), np.random.default_rng(seed)
    simulator.place(0, HALL, rng)
    u, poses = [], []
    for _ in range(steps):
        u.append(simulator.step(0, np.array([0.0, 0.5, 0.0]), rng))
        poses.append(simulator.poses[0].copy())
    return np.array(u), np.array(poses), rng


def test_without_blunders_the_luck_is_as_if_there_were_none_to_draw():
    """The generator ends where the step's own draws leave it."""
    _, _, rng = odometry(MotionModel(blunder=0.0), 7)
    same = np.random.default_rng(3)
    same.random((1, 4))
    for _ in range(7):
        same.standard_normal((2, 1, 3))
        same.random((1, 4))
    assert rng.random() == same.random()


def test_a_robot_at_a_wall_may_read_a_drive():
    u, poses, _ = odometry(MotionModel(blunder=0.5), 400)
    still = np.hypot(*np.diff(poses[:, :2], axis=0).T) < 1e-3
    reads = u[1:][still, 1]
    assert still.sum() > 100
    assert 0.3 < np.mean(reads > 0.25) < 0.45
    honest, _, _ = odometry(MotionModel(), 400)
    assert np.mean(honest[1:, 1] > 0.25) < 0.05


def episodes(motion):
    settings = {"map": HALL, "belief": {"kind": "histogram", "headings": 12}, "motion": motion}
    return Episodes(EpisodeConfig.build(settings), 1)


def test_nobody_tells_the_filter_or_the_planner():
    told = episodes({"blunder": 0.05})
    told.reset(0, np.random.default_rng(0))
    assert told.simulator.motion.blunder == 0.05
    assert told.knowledge(0).motion == told.belief.motion == MotionModel()
