"""What a robot remembers by its odometry alone, against the map that it drives on."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from activeloc.agents.dead_reckoning import DeadReckoning
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel

SENSOR = BeamModel(beams=3, field_of_view=np.pi, z_max=2.0)


@dataclass
class Told:
    """As much of what a robot knows as dead reckoning asks for."""

    step: int
    u: tuple
    scan: tuple = (np.inf, np.nan, 2.0)
    touched: bool = False
    sensor: BeamModel = SENSOR
    motion: MotionModel = field(default_factory=MotionModel)

    def __post_init__(self):
        self.u, self.scan = np.array(self.u), np.array(self.scan)


def moved(x, y, theta, u):
    """The obvious way: rotate, drive, rotate."""
    theta += u[0]
    x, y = x + u[1] * np.cos(theta), y + u[1] * np.sin(theta)
    return x, y, theta + u[2]


def test_it_knows_where_it_was_and_what_it_read_there():
    rng, memory = np.random.default_rng(0), DeadReckoning(100, 100)
    pose, places, obstacles = (0.0, 0.0, 0.0), [], []
    for n in range(30):
        step = Told(n, rng.normal(0.0, 0.5, 3), rng.uniform(0.1, 1.9, 3), bool(rng.random() < 0.3))
        memory.follow(step)
        pose = moved(*pose, step.u)
        places.append(pose[:2])
        beams = [*zip(step.scan, SENSOR.bearings, strict=True)]
        beams += [(step.motion.radius, 0.0)] * step.touched
        obstacles += [moved(*pose, (bearing, z, 0.0))[:2] for z, bearing in beams]
    for remembered, real in ((memory.track(), places), (memory.obstacles(), obstacles)):
        there = [moved(*pose, (np.arctan2(y, x), np.hypot(x, y), 0.0))[:2] for x, y in remembered]
        np.testing.assert_allclose(there, real, atol=1e-9)


@pytest.mark.parametrize("scan", [(np.inf, np.nan, 2.0), (1.99, 2.0, np.inf)])
def test_a_beam_that_met_nothing_is_no_obstacle(scan):
    memory = DeadReckoning(10, 10)
    memory.follow(Told(0, (0.0, 0.0, 0.0), scan))
    assert memory.obstacles().shape == (0, 2)


def test_it_forgets():
    memory = DeadReckoning(5, 2)
    for n in range(9):
        memory.follow(Told(n, (0.0, 1.0, 0.0), (1.0, 1.0, 1.0)))
    np.testing.assert_allclose(memory.track(), [[x, 0.0] for x in (-4, -3, -2, -1, 0)])
    assert len(memory.obstacles()) == 6


def test_a_step_counts_once():
    memory = DeadReckoning(10, 10)
    for n in (0, 1, 1, 2, 2, 2):
        memory.follow(Told(n, (0.0, 1.0, 0.0), (1.0, 1.0, 1.0)))
    np.testing.assert_allclose(memory.track(), [[-2.0, 0.0], [-1.0, 0.0], [0.0, 0.0]])
    assert len(memory.obstacles()) == 9
