"""What a robot on a metric map knows: all that an agent may look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Belief, Summary
from activeloc.envs.actions import Actions
from activeloc.motion import MotionModel
from activeloc.sensors import RangeSensor


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What a robot knows: all that an agent may look at. The truth is not in it.

    Attributes:
        belief: The filters of the batch.
        robot: Which of them is this robot's.
        actions: What it can be told.
        motion: The motion model that the filter assumes.
        sensor: The sensor that the filter assumes.
        summary: What the belief says in short.
        scan: ``(B,)`` last scan [m].
        u: ``(3,)`` last odometry reading; zeros at the start.
        touched: Whether the last motion was stopped by an obstacle.
        step: Steps taken.
    """

    belief: Belief
    robot: int
    actions: Actions
    motion: MotionModel
    sensor: RangeSensor
    summary: Summary
    scan: NDArray[np.float64]
    u: NDArray[np.float64]
    touched: bool
    step: int
