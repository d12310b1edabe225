"""Recordings that are made up, for what shows them."""

import numpy as np
import pytest

from activeloc.envs.rendering import Scene, Tape
from activeloc.grid import OccupancyGrid

# 20 m x 12 m with its lower left corner at (-3, 2): neither square nor at the origin.
ORIGIN, RESOLUTION, ROWS, COLS = (-3.0, 2.0), 0.5, 24, 40
BEARINGS = np.array([-0.5, 0.0, 0.5])


def made_up(agent="left", steps=5, headings=8, name="hall", seed=0, particles=False, carried=None):
    """A recording of a belief that sits in one cell, one cell further right at each step.

    At step s all of it is in row 4, column 30 + s, heading bin s; from the tenth on from the start.
    """
    cells = np.zeros((ROWS, COLS), np.uint8)
    cells[20:22, 5:9], cells[10, 20:30] = 1, 2
    grid = OccupancyGrid(cells, RESOLUTION, ORIGIN, name)
    rng, tape = np.random.default_rng(seed), Tape()
    for s in range(steps + 1):
        belief = np.zeros((headings, ROWS, COLS))
        belief[s % headings, 4, 30 + s % 10] = 1.0
        scene = Scene(
            grid,
            belief,
            RESOLUTION,
            ORIGIN,
            pose=np.array([1.0 + 0.5 * s, 4.0, 0.1 * s]),
            estimate=np.array([12.25 + 0.5 * s, 4.25, 0.0]),
            scan=np.array([1.0, np.nan, np.inf]),
            bearings=BEARINGS,
            z_max=2.0,
            caption="somewhere",
            particles=rng.random((40 + s, 3)) if particles else None,
        )
        info = {
            "entropy": 5.0 - 0.37 * s + seed,
            "entropy_fraction": 0.9 - 0.1 * s,
            "mass": 0.1 * s,
            "error_m": 11.25,
            "error_rad": 0.1 * s,
            "is_success": s == steps,
            "wrong": False,
            "kidnapped": carried is not None and s >= carried,
        }
        if s == 0:
            tape.start(scene, info)
        else:
            tape.step(scene, info, 2, f"drive {s}")
    return tape.recording(agent)


@pytest.fixture
def recording_of():
    """:func:`made_up`."""
    return made_up
