"""The bins on which every belief's entropy is defined: 0.5 m x 0.5 m x 30 degrees by default.

Entropy depends on the bins it is taken over, and the logarithm of an effective sample size is no
entropy at all. So each belief, whatever it is made of, is first summed into the same bins; then a
grid and a cloud of particles that believe the same thing say the same number of nats.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.grid import OccupancyGrid


def entropy(p: NDArray[np.floating]) -> float:
    """Shannon entropy of probabilities of any shape [nat]; 0 log 0 is 0."""
    positive = p[p > 0.0].astype(np.float64)
    return float(-(positive * np.log(positive)).sum())


@njit(cache=True, nogil=True)
def _index(
    poses: NDArray[np.float64],
    origin: NDArray[np.float64],
    size: float,
    angle: float,
    shape: tuple[int, int, int],
    out: NDArray[np.int64],
) -> None:
    """Fill ``out (N,)`` with the bins of poses ``(N, 3)``; see :meth:`CommonBins.index`."""
    for i in range(poses.shape[0]):
        col = int(min(max(np.floor((poses[i, 0] - origin[0]) / size), 0.0), shape[1] - 1.0))
        row = int(min(max(np.floor((poses[i, 1] - origin[1]) / size), 0.0), shape[0] - 1.0))
        heading = int(np.floor((poses[i, 2] + np.pi) / angle)) % shape[2]
        out[i] = (row * shape[1] + col) * shape[2] + heading


class CommonBins:
    """Square bins and heading bins over a map, from its lower left corner and from -pi.

    Args:
        grid: The map.
        size: Side of a bin [m].
        angle: Width of a heading bin [rad]; must divide the circle.

    Raises:
        ConfigError: If a size is out of its range.
    """

    def __init__(self, grid: OccupancyGrid, size: float = 0.5, angle: float = np.pi / 6.0) -> None:
        checks.number("entropy bin size", size, 0.01, 1e3)
        checks.number("entropy bin angle", angle, 1e-3, 2.0 * np.pi)
        self.size = size
        self.n_headings = round(2.0 * np.pi / angle)
        self.angle = 2.0 * np.pi / self.n_headings
        x0, x1, y0, y1 = grid.extent
        self.origin = np.array([x0, y0])
        self.shape = (int(np.ceil((y1 - y0) / size - 1e-9)), int(np.ceil((x1 - x0) / size - 1e-9)))

    def __len__(self) -> int:
        return self.shape[0] * self.shape[1] * self.n_headings

    def index(self, poses: NDArray[np.float64]) -> NDArray[np.int64]:
        """Flat index of the bin of each pose ``(N, 3)``; poses off the map count at its edge."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        out = np.empty(len(poses), dtype=np.int64)
        _index(poses, self.origin, self.size, self.angle, (*self.shape, self.n_headings), out)
        return out

    def centre(self, index: int) -> NDArray[np.float64]:
        """Pose ``(3,)`` in the middle of the bin with this flat index."""
        place, heading = divmod(int(index), self.n_headings)
        row, col = divmod(place, self.shape[1])
        x, y = self.origin[0] + (col + 0.5) * self.size, self.origin[1] + (row + 0.5) * self.size
        return np.array([x, y, -np.pi + (heading + 0.5) * self.angle])
