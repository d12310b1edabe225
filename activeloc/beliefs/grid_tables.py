"""What a histogram filter computes once per map and shares between robots."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import histogram_kernels as kernels
from activeloc.beliefs.background import Background
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.reading_table import build_reading_table
from activeloc.beliefs.scan_likelihood import PoweredTable
from activeloc.beliefs.settings import HistogramConfig
from activeloc.beliefs.travel_table import TravelTable
from activeloc.grid import OccupancyGrid
from activeloc.motion import MotionModel, Terrain
from activeloc.sensors import RangeSensor


class GridTables:
    """What a histogram filter computes once per map and shares between robots.

    Args:
        grid: The map.
        config: Of the filter.
        sensor: The sensor that the filter assumes.
        motion: The motion model that the filter assumes.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        config: HistogramConfig,
        sensor: RangeSensor,
        motion: MotionModel,
    ) -> None:
        self.terrain = Terrain(grid, motion.radius)
        self.poses = PoseGrid(self.terrain, config.cell_size, config.headings)
        self.readings = build_reading_table(self.poses, sensor, config.reading_bin)
        self.powered = PoweredTable(self.readings, config.likelihood_power, config.precision)
        self.travel = TravelTable(self.poses, motion.odometry)
        self.background = Background(self.poses, self.readings, self.travel.p_contact)
        self.bins = CommonBins(grid)
        self.places = self.bins.places_of(self.poses)
        self.bin_headings = self.bins.headings_of(self.poses)
        self.uniform = np.repeat(
            self.poses.area[:, None] / (self.poses.area.sum() * config.headings),
            config.headings,
            axis=1,
        )
        self.uniform_masses = self.masses(self.uniform, np.arange(len(self.poses.cells)))
        self.uniform_entropy = entropy(self.uniform_masses)

    def carry(
        self,
        bel: NDArray[np.floating],
        live: NDArray[np.int32],
        out: NDArray[np.floating],
        out_live: NDArray[np.int32],
        level: int,
        hops: int,
        floor: float,
    ) -> int:
        """Travel ``level`` half cells, back if negative; see :func:`kernels.translate`.

        Args:
            bel: ``(C, K)``, overwritten with zeros.
            live: ``(n,)`` of cells.
            out: ``(C, K)``, zeros, overwritten.
            out_live: ``(C,)``, overwritten with the cells that mass has come to.
            level: Length of the travel,
            hops: one of as many equal parts.
            floor: Weight of ways that an obstacle cuts short, in [0, 1].

        Returns:
            How many cells that is.
        """
        travel, poses = self.travel.level(abs(level), hops), self.poses
        n: int = kernels.translate(
            bel, live, out, out_live,
            0 if level > 0 else poses.headings // 2, poses.cells, poses.index,
            travel.stencil_start, travel.stencil_step, travel.stencil_weight,
            travel.row_start, travel.target, travel.weight, floor,
        )  # fmt: skip
        return n

    def masses(self, bel: NDArray[np.floating], live: NDArray[np.integer]) -> NDArray[np.float64]:
        """The belief on the common bins: ``(places, headings)``."""
        out = np.zeros((self.bins.shape[0] * self.bins.shape[1], self.bins.n_headings))
        kernels.bin_masses(bel, live.astype(np.int32), *self.places, *self.bin_headings, out)
        return out


def tables_of(
    grid: OccupancyGrid, config: HistogramConfig, sensor: RangeSensor, motion: MotionModel
) -> GridTables:
    """The tables of a map, kept for the 16 maps used last.

    Filters whose settings differ only in what is no matter of tables share them.
    """
    matters = HistogramConfig(
        cell_size=config.cell_size,
        headings=config.headings,
        reading_bin=config.reading_bin,
        likelihood_power=config.likelihood_power,
        precision=config.precision,
    )
    return _tables_of(grid, matters, sensor, motion)


@lru_cache(maxsize=16)
def _tables_of(
    grid: OccupancyGrid, config: HistogramConfig, sensor: RangeSensor, motion: MotionModel
) -> GridTables:
    return GridTables(grid, config, sensor, motion)
