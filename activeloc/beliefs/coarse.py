"""Coarser bins over the states of a pose grid: heading bins times rows times columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.pose_grid import PoseGrid


@dataclass(frozen=True, eq=False)
class CoarseBins:
    """Shares of a pose grid's rows, columns and heading bins in coarser ones.

    Attributes:
        headings: ``(H, K)``; share of each heading bin in each coarse one.
        row_bins: ``(rows, W)``; coarse rows under each row, and
        row_shares: ``(rows, W)`` of it in each.
        col_first: ``(X,)``; first column under each coarse column.
        col_shares: ``(X, M)``; share in it of each of the columns from there.
        shape: Coarse rows and columns, Y and X.
    """

    headings: NDArray[np.float64]
    row_bins: NDArray[np.int32]
    row_shares: NDArray[np.float64]
    col_first: NDArray[np.int32]
    col_shares: NDArray[np.float64]
    shape: tuple[int, int]

    @classmethod
    def over(
        cls,
        poses: PoseGrid,
        corner: tuple[float, float],
        size: float,
        shape: tuple[int, int],
        n_headings: int,
    ) -> CoarseBins:
        """Square bins from a corner on; what lies outside counts at the edge.

        Args:
            poses: The states.
            corner: x and y of the lower left one [m].
            size: Side of a bin [m].
            shape: Rows and columns of bins.
            n_headings: Equal heading bins from -pi.
        """
        origin = poses.terrain.grid.origin
        rows, row_shares = _along(poses.shape[0], poses, origin[1] - corner[1], size, shape[0])
        cols, shares = _along(poses.shape[1], poses, origin[0] - corner[0], size, shape[1])
        # A bin beyond the map, which no column lies under, starts where nothing is any more.
        first = np.full(shape[1], poses.shape[1], dtype=np.int32)
        column = np.repeat(np.arange(len(cols), dtype=np.int32), cols.shape[1])
        counts = shares.ravel() > 0.0
        np.minimum.at(first, cols.ravel()[counts], column[counts])
        last = np.zeros(shape[1], dtype=np.int32)
        np.maximum.at(last, cols.ravel()[counts], column[counts] + 1)
        col_shares = np.zeros((shape[1], max(1, int((last - first).max()))))
        at = cols.ravel()[counts]
        np.add.at(col_shares, (at, column[counts] - first[at]), shares.ravel()[counts])
        start = poses.thetas - 0.5 * poses.bin_width + np.pi
        bins, heading_shares = overlap(start, poses.bin_width, 2.0 * np.pi / n_headings)
        headings = np.zeros((n_headings, poses.headings))
        of = np.repeat(np.arange(poses.headings), bins.shape[1])
        np.add.at(headings, (bins.ravel() % n_headings, of), heading_shares.ravel())
        return cls(headings / headings.sum(axis=0), rows, row_shares, first, col_shares, shape)


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


def _along(
    n: int, poses: PoseGrid, offset: float, size: float, n_bins: int
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Bins ``(n, W)`` under n rows or columns of cells, and their shares, summing to one."""
    bins, share = overlap(
        np.arange(n, dtype=np.float64) * poses.cell_size + offset, poses.cell_size, size
    )
    exact = share.astype(np.float64)
    return bins.clip(0, n_bins - 1), exact / exact.sum(axis=1, keepdims=True)
