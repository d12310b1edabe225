"""The chance that the robot is somewhere else: a uniform background behind a local belief.

A filter that updates only the cells where its belief lives cannot see mass appear elsewhere. So the
belief is kept as ``(1 - w) local + w uniform``: ``local`` is the listed cells; w, one number, is
the probability that the robot has been carried off. At each step w takes its share of the leak;
every piece of evidence multiplies its odds by how well the uniform explains it over how well the
local part does. That ratio is what a selective update must watch to notice that it is lost (Burgard
& Stachniss, "Bayes filter: discrete filters"; Thrun, Burgard & Fox, *Probabilistic Robotics*
(2005), section 8.3.5, do so with particles).

What is approximated: the mass that leaked in at earlier steps counts as uniform again at every
step, though the scans since have given it a shape, and a scan's average likelihood under the
uniform comes from a fixed sample of states. Scans from one place support each other, so w is too
small for a robot that is lost. Therefore it is kept small: once it passes ``belief.widen``, the
background of the last steps is gone through again over all cells (:mod:`activeloc.beliefs.past`),
and from then on it is an ordinary belief that keeps its shape. States that hold less than the leak
brings in a step are put back into w.
"""

from __future__ import annotations

from functools import cached_property
from math import exp, inf

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import grid_poses as kernels
from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.reading_table import ReadingTable
from activeloc.beliefs.scan_likelihood import ScanLikelihood
from activeloc.beliefs.travel_table import TravelTable

SAMPLES = 4096  # States that stand for the uniform when a scan is weighed.
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def elsewhere_after(w: float, log_elsewhere: float, log_local: float) -> float:
    """Probability of being elsewhere after evidence.

    Args:
        w: Before, in [0, 1].
        log_elsewhere: Logarithm of the evidence's probability under the uniform.
        log_local: And where the belief lives. Both -inf leaves w as it is.
    """
    if w in (0.0, 1.0) or log_elsewhere == log_local:
        return w
    if log_local == -inf:
        return 1.0
    # Beyond exp(700) the answer is 0 to the last bit.
    return w / (w + (1.0 - w) * exp(min(log_local - log_elsewhere, 700.0)))


class Background:
    """What the uniform belief over a map's open ground expects.

    Args:
        poses: The states.
        readings: How probable each reading is in them.
        travels: Where obstacles are.
    """

    def __init__(self, poses: PoseGrid, readings: ReadingTable, travels: TravelTable) -> None:
        self.poses = poses
        self.travels = travels
        self.share = poses.area / poses.area.sum()
        """``(C,)``; share of the open ground in each cell."""
        self._cumulative = self.share.cumsum()
        self._frame = np.array([*poses.terrain.grid.origin, 1.0 / poses.cell_size])
        self._rows = self._sample_rows(readings)
        self._travels: dict[tuple[int, int, float], float] = {}
        self._views: dict[CoarseBins, NDArray[np.float64]] = {}

    def _sample_rows(self, readings: ReadingTable) -> NDArray[np.unsignedinteger]:
        """``(B, SAMPLES)`` of rows: cells evenly over the area, headings by the golden ratio."""
        i = np.arange(SAMPLES)
        cell = self.cells_at((i + 0.5) / SAMPLES)
        heading = (i * _GOLDEN % 1.0 * self.poses.headings).astype(np.intp)
        return np.ascontiguousarray(readings.rows_of(cell, heading).T)

    @cached_property
    def _p_contact(self) -> float:
        return float(self.share @ self.travels.p_contact.mean(axis=1, dtype=np.float64))

    def cells_at(self, pointers: NDArray[np.float64]) -> NDArray[np.int32]:
        """Cells at shares ``(N,)`` in [0, 1) of the open ground, counted cell by cell."""
        rank = np.searchsorted(self._cumulative, pointers * self._cumulative[-1], side="right")
        return rank.clip(max=len(self.share) - 1).astype(np.int32)

    def log_evidence(self, scan: ScanLikelihood) -> float:
        """Logarithm of a scan's average likelihood; -inf if no sampled state explains it."""
        return scan.log_mean(self._rows)

    def contact(self, floor: float) -> float:
        """Probability of a contact that is felt with probability ``floor`` without an obstacle."""
        return floor + (1.0 - floor) * self._p_contact

    def travel(self, level: int, hops: int, floor: float) -> float:
        """Probability that the odometry reads a travel, ways cut short counting ``floor``.

        Args:
            level: Length, and
            hops: number of parts; see :meth:`TravelTable.level`.
            floor: Weight of ways that an obstacle would have cut short.
        """
        key = (level, hops, floor)
        if key not in self._travels:
            self._travels[key] = self.travels.level(level, hops).rows.left(floor)
        return self._travels[key]

    def masses(self, bins: CoarseBins) -> NDArray[np.float64]:
        """The uniform in coarser bins ``(Y * X, H)``."""
        by_cell = np.zeros(self.poses.shape)
        by_cell[self.poses.cells[:, 0], self.poses.cells[:, 1]] = self.share
        by_col = np.zeros((by_cell.shape[0], bins.shape[1]))
        for m in range(bins.col_bins.shape[1]):
            np.add.at(by_col.T, bins.col_bins[:, m], (by_cell * bins.col_shares[:, m]).T)
        row = bins.row_first[:, None] + np.arange(bins.row_shares.shape[1])
        under = by_col[row.clip(max=len(by_col) - 1)]
        by_place = (under * bins.row_shares[:, :, None]).sum(axis=1).ravel()
        return np.outer(by_place, bins.headings.mean(axis=1))

    def view(self, bins: CoarseBins) -> NDArray[np.float64]:
        """The same ``(H, Y * X)``, kept for the next time."""
        if bins not in self._views:
            self._views[bins] = np.ascontiguousarray(self.masses(bins).T)
        return self._views[bins]

    def mass_near(self, pose: NDArray[np.float64], radius: float, angle: float) -> float:
        """The uniform's mass within ``radius`` [m] and ``angle`` [rad] of a pose ``(3,)``.

        Cells and heading bins count by their centres, as in :func:`kernels.near`.
        """
        poses = self.poses
        return float(
            kernels.share_near(
                self.share,
                poses.index,
                poses.centres,
                poses.thetas,
                self._frame,
                pose,
                radius,
                angle,
            )
        )
