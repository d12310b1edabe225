"""The bins on which every belief's entropy is defined: 0.5 m x 0.5 m x 30 degrees by default.

Entropy depends on the bins it is taken over, and the logarithm of an effective sample size is no
entropy at all. So each belief, whatever it is made of, is first summed into the same bins; then a
grid and a cloud of particles that believe the same thing say the same number of nats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.grid import OccupancyGrid


def entropy(p: NDArray[np.floating]) -> float:
    """Shannon entropy of probabilities of any shape [nat]; 0 log 0 is 0."""
    positive = p[p > 0.0].astype(np.float64)
    return float(-(positive * np.log(positive)).sum())


def overlap(
    start: NDArray[np.float64], width: float, bin_width: float
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Bins that intervals ``[start, start + width]`` lie in, and the share in each: ``(N, W)``."""
    n_bins = int(np.ceil(width / bin_width - 1e-9)) + 1
    first = np.floor(start / bin_width + 1e-9).astype(np.int32)
    bins = np.asarray(first[:, None] + np.arange(n_bins), dtype=np.int32)
    low = np.maximum(bins * bin_width, start[:, None])
    high = np.minimum((bins + 1) * bin_width, start[:, None] + width)
    return bins, (np.maximum(high - low, 0.0) / width).astype(np.float32)


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
        column_row = np.floor((poses[:, :2] - self.origin) / self.size).astype(np.int64)
        col = np.clip(column_row[:, 0], 0, self.shape[1] - 1)
        row = np.clip(column_row[:, 1], 0, self.shape[0] - 1)
        heading = np.floor((poses[:, 2] + np.pi) / self.angle).astype(np.int64) % self.n_headings
        return np.asarray((row * self.shape[1] + col) * self.n_headings + heading)

    def centres(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centre pose ``(N, 3)`` of bins given by flat index."""
        place, heading = np.divmod(index, self.n_headings)
        row, col = np.divmod(place, self.shape[1])
        xy = (np.column_stack([col, row]) + 0.5) * self.size + self.origin
        return np.column_stack([xy, -np.pi + (heading + 0.5) * self.angle])

    def places_of(self, grid: PoseGrid) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Places (bins without their heading) under each cell, and their shares of it.

        Returns:
            Place ``(C, P)`` and share ``(C, P)``; shares sum to one.
        """
        start = grid.cells[:, ::-1].astype(np.float64) * grid.cell_size
        cols, col_share = overlap(start[:, 0], grid.cell_size, self.size)
        rows, row_share = overlap(start[:, 1], grid.cell_size, self.size)
        rows, cols = rows.clip(0, self.shape[0] - 1), cols.clip(0, self.shape[1] - 1)
        place = rows[:, :, None] * self.shape[1] + cols[:, None, :]
        share = row_share[:, :, None] * col_share[:, None, :]
        n = len(start)
        share = share.reshape(n, -1)
        return place.reshape(n, -1).astype(np.int32), share / share.sum(axis=1, keepdims=True)

    def headings_of(self, grid: PoseGrid) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Heading bins under each of the grid's, and their shares: ``(K, P)`` each."""
        start = grid.thetas - 0.5 * grid.bin_width + np.pi
        bins, share = overlap(start, grid.bin_width, self.angle)
        return bins % self.n_headings, share / share.sum(axis=1, keepdims=True)
