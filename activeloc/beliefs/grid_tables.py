"""What a histogram filter computes once per map and shares between robots."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import histogram_kernels as kernels
from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.reading_table import build_reading_table
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
        self.travel = TravelTable(self.poses, motion.odometry)
        self.bins = CommonBins(grid)
        self.places = self.bins.places_of(self.poses)
        self.bin_headings = self.bins.headings_of(self.poses)
        self.uniform = np.repeat(
            self.poses.area[:, None] / (self.poses.area.sum() * config.headings),
            config.headings,
            axis=1,
        )
        self.uniform_entropy = entropy(self.masses(self.uniform, np.arange(len(self.poses.cells))))

    def masses(self, bel: NDArray[np.floating], live: NDArray[np.integer]) -> NDArray[np.float64]:
        """The belief on the common bins: ``(places, headings)``."""
        out = np.zeros((self.bins.shape[0] * self.bins.shape[1], self.bins.n_headings))
        kernels.bin_masses(bel, live.astype(np.int32), *self.places, *self.bin_headings, out)
        return out


@lru_cache(maxsize=16)
def tables_of(
    grid: OccupancyGrid, config: HistogramConfig, sensor: RangeSensor, motion: MotionModel
) -> GridTables:
    """The tables of a map, kept for the 16 maps used last."""
    return GridTables(grid, config, sensor, motion)
