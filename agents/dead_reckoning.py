"""What a robot remembers in the frame of its odometry: its track, and obstacles on it.

Odometry says how the robot has moved whatever its place on the map, so this needs no belief. It
drifts, and is trusted for some steps only.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from activeloc.envs.episodes import Knowledge

NOTHING_IN_RANGE = 0.99
"""Share of the longest range from which a reading is no obstacle's."""


class DeadReckoning:
    """One robot's memory of where it went and what it met.

    Args:
        track_steps: Steps for which places are remembered.
        obstacle_steps: Steps for which obstacles are.
    """

    def __init__(self, track_steps: int, obstacle_steps: int) -> None:
        self._step = -1
        self._pose = np.zeros(3)
        self._track: deque[NDArray[np.float64]] = deque(maxlen=track_steps)
        self._obstacles: deque[NDArray[np.float64]] = deque(maxlen=obstacle_steps)

    def follow(self, knowledge: Knowledge) -> None:
        """Take note of the last step, once: where it led, what was read and touched there."""
        if knowledge.step == self._step:
            return
        self._step = knowledge.step
        rot1, trans, rot2 = knowledge.u
        x, y, theta = self._pose
        x += trans * np.cos(theta + rot1)
        y += trans * np.sin(theta + rot1)
        theta += rot1 + rot2
        self._pose = np.array([x, y, theta])
        self._track.append(self._pose[:2])
        echo = knowledge.scan < NOTHING_IN_RANGE * knowledge.sensor.z_max
        z, bearing = knowledge.scan[echo], theta + knowledge.sensor.bearings[echo]
        if knowledge.touched:
            z, bearing = np.append(z, knowledge.motion.radius), np.append(bearing, theta)
        self._obstacles.append(np.column_stack([x + z * np.cos(bearing), y + z * np.sin(bearing)]))

    def track(self) -> NDArray[np.float64]:
        """Where the robot has been, relative to where it is: ``(K, 2)`` of x, y [m]."""
        return self._seen_from_here(np.array(self._track).reshape(-1, 2))

    def obstacles(self) -> NDArray[np.float64]:
        """What it has met, relative to where it is: ``(K, 2)`` of x, y [m]."""
        return self._seen_from_here(np.concatenate([np.empty((0, 2)), *self._obstacles]))

    def _seen_from_here(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        dx, dy = (places - self._pose[:2]).T
        cos, sin = np.cos(self._pose[2]), np.sin(self._pose[2])
        return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])
