"""PyPI ``amcl``: Nav2's particle filter with its beam model, as a Python module (GPL, not ours)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from activeloc.benchmarks.worlds import SPREAD, Z_MAX
from activeloc.grid import OccupancyGrid

NAME = "amcl"
STEP = 0.3
"""Travel between two updates, there and back [m]; a robot that stands still is not updated."""


def update_of(
    grid: OccupancyGrid,
    pose: NDArray[np.float64],
    bearings: NDArray[np.float64],
    scan: NDArray[np.float64],
    n: int,
) -> Callable[[], tuple[float, float, float]]:
    """One whole update (motion, beam model, resampling) of a localized cloud; it says its mean.

    Args:
        grid: The map.
        pose: ``(3,)``; what the cloud is around.
        bearings: ``(B,)`` [rad].
        scan: ``(B,)`` [m].
        n: Particles, the fewest and the most.
    """
    import amcl

    codes = np.array([0, 100, -1])[grid.cells]
    motion = amcl.MotionParameters(0.05, 0.05, 0.05, 0.05, 0.05)
    # Weights of hit, short, max, random; sigma_hit, lambda_short, chi_outlier; beams.
    laser = amcl.LaserParameters(0.9, 0.05, 0.03, 0.02, 0.2, 1.0, 0.05, len(bearings))
    robot = amcl.AMCL(n, n, 0.0, 0.0, motion, laser, "differential")
    robot.set_map(
        amcl.create_occupancy_grid_from_list(codes.tolist(), grid.resolution, *grid.origin)
    )
    robot.set_initial_pose(
        amcl.Vector3D(*pose.tolist()), amcl.create_diagonal_covariance(*(SPREAD**2).tolist())
    )
    robot.set_laser_pose(amcl.Vector3D(0.0, 0.0, 0.0))
    read = amcl.create_laser_scan_from_list(np.column_stack([scan, bearings]).tolist(), Z_MAX)
    places = [amcl.Vector3D(0.0, 0.0, 0.0), amcl.Vector3D(STEP, 0.0, 0.0)]

    def update() -> tuple[float, float, float]:
        places.reverse()
        robot.update(read, places[0])
        mean = robot.get_pose_mean()
        return mean.x, mean.y, mean.theta

    return update
