"""What is around a robot that does not know where it is: the map relative to it, expected.

The frame is the robot's: x ahead, y to its left [m]. A relative place is occupied, for one pose of
the belief, where the robot's centre could not be if that pose were true; its expected occupancy is
the probability of that under the belief. Burgard, Fox & Thrun, "Active mobile robot localization"
(IJCAI 1997), section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.motion import Terrain


@dataclass(frozen=True, slots=True)
class ExpectedOccupancy:
    """A square window of relative places around the robot, which is in its middle.

    Attributes:
        p: ``(S, S)``, S odd; row and column grow with y and x.
        pitch: Between two places [m].
    """

    p: NDArray[np.float64]
    pitch: float

    @classmethod
    def of(
        cls, terrain: Terrain, poses: NDArray[np.float64], radius: int, pitch: float
    ) -> ExpectedOccupancy:
        """As expected by equally likely poses ``(M, 3)``, ``radius`` places to all four sides."""
        grid, side = terrain.grid, 2 * radius + 1
        in_cells = np.column_stack([grid.to_cells(poses[:, :2]), poses[:, 2]])
        p = np.empty((side, side))
        count_blocked(terrain.blocked, in_cells, pitch / grid.resolution, p)
        return cls(p / len(poses), pitch)

    def with_obstacles(self, places: NDArray[np.float64], reach: float) -> ExpectedOccupancy:
        """The same, but occupied for certain within ``reach`` [m] of obstacles ``(K, 2)``."""
        radius = len(self.p) // 2
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1] * self.pitch
        p = self.p.copy()
        for place in places:
            p[np.hypot(x - place[0], y - place[1]) < reach] = 1.0
        return ExpectedOccupancy(p, self.pitch)


@njit(cache=True, nogil=True)
def count_blocked(
    blocked: NDArray[np.bool_], poses: NDArray[np.float64], pitch: float, out: NDArray[np.float64]
) -> None:
    """How many poses have an obstacle at each relative place. Lengths in cells.

    Args:
        blocked: ``(H, W)``; where the robot's centre cannot be. The outside is blocked.
        poses: ``(M, 3)`` of column, row, heading.
        pitch: Between two relative places.
        out: ``(S, S)``, overwritten; row and column grow with y and x.
    """
    height, width = blocked.shape
    side, radius = out.shape[0], out.shape[0] // 2
    out[:] = 0.0
    for m in range(poses.shape[0]):
        dx, dy = pitch * np.cos(poses[m, 2]), pitch * np.sin(poses[m, 2])
        for i in range(side):
            x = poses[m, 0] - radius * dx - (i - radius) * dy
            y = poses[m, 1] - radius * dy + (i - radius) * dx
            for j in range(side):
                inside = 0.0 <= x < width and 0.0 <= y < height
                if not inside or blocked[int(y), int(x)]:
                    out[i, j] += 1.0
                x, y = x + dx, y + dy
