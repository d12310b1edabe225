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
        row_first: ``(Y,)``; first row under each coarse row.
        row_shares: ``(Y, L)``; share in it of each of the rows from there.
        col_bins: ``(cols, M)``; coarse columns under each column, and
        col_shares: ``(cols, M)`` of it in each.
        headings: ``(H, K)``; share of each heading bin in each coarse one.
        heading_start: ``(H + 1,)``; those that are in each coarse one begin so far in
        heading_bin: ``(N,)``, with
        heading_share: ``(N,)`` of them there.
        even: How many whole heading bins there are in each coarse one, one after the other; 0 if
            any is cut.
        shape: Coarse rows and columns, Y and X.
    """

    row_first: NDArray[np.int32]
    row_shares: NDArray[np.float64]
    col_bins: NDArray[np.int32]
    col_shares: NDArray[np.float64]
    headings: NDArray[np.float64]
    heading_start: NDArray[np.int64]
    heading_bin: NDArray[np.int32]
    heading_share: NDArray[np.float64]
    even: int
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
        rows, shares = _along(poses.shape[0], poses, origin[1] - corner[1], size, shape[0])
        cols, col_shares = _along(poses.shape[1], poses, origin[0] - corner[0], size, shape[1])
        # A bin beyond the map, which no row lies under, starts where nothing is any more.
        first = np.full(shape[0], poses.shape[0], dtype=np.int32)
        row = np.repeat(np.arange(len(rows), dtype=np.int32), rows.shape[1])
        counts = shares.ravel() > 0.0
        np.minimum.at(first, rows.ravel()[counts], row[counts])
        last = np.zeros(shape[0], dtype=np.int32)
        np.maximum.at(last, rows.ravel()[counts], row[counts] + 1)
        row_shares = np.zeros((shape[0], max(1, int((last - first).max()))))
        at = rows.ravel()[counts]
        np.add.at(row_shares, (at, row[counts] - first[at]), shares.ravel()[counts])
        start = poses.thetas - 0.5 * poses.bin_width + np.pi
        bins, heading_shares = overlap(start, poses.bin_width, 2.0 * np.pi / n_headings)
        headings = np.zeros((n_headings, poses.headings))
        of = np.repeat(np.arange(poses.headings), bins.shape[1])
        np.add.at(headings, (bins.ravel() % n_headings, of), heading_shares.ravel())
        headings[headings < 1e-6] = 0.0  # What rounding cut off.
        headings /= headings.sum(axis=0)
        coarse, fine = np.nonzero(headings)
        starts = np.searchsorted(coarse, np.arange(n_headings + 1))
        even = poses.headings // n_headings
        whole = np.array_equal(headings, np.repeat(np.eye(n_headings), max(1, even), axis=1))
        return cls(
            first, row_shares, cols, col_shares,
            headings, starts, fine.astype(np.int32), headings[coarse, fine], even if whole else 0,
            shape,
        )  # fmt: skip


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
