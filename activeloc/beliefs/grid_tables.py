"""What a histogram filter computes once per map and shares between robots."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import xlogy

from activeloc.beliefs.background import Background
from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.common_bins import CommonBins
from activeloc.beliefs.grid_layout import GridLayout, Sheet
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.beliefs.reading_table import build_reading_table
from activeloc.beliefs.scan_likelihood import PoweredTable
from activeloc.beliefs.settings import HistogramConfig
from activeloc.beliefs.travel_table import TravelTable
from activeloc.beliefs.view import view_frame
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
        self.precision = config.precision
        self.terrain = Terrain(grid, motion.radius)
        self.poses = PoseGrid(self.terrain, config.cell_size, config.headings)
        self.layout = GridLayout(self.poses)
        self.readings = build_reading_table(self.poses, sensor, config.reading_bin)
        self.powered = PoweredTable(self.readings, config.likelihood_power, config.precision)
        self.travel = TravelTable(self.poses, motion.odometry)
        self.background = Background(self.poses, self.readings, self.travel)
        self.bins = CommonBins(grid)
        corner = (float(self.bins.origin[0]), float(self.bins.origin[1]))
        self.coarse = CoarseBins.over(
            self.poses, corner, self.bins.size, self.bins.shape, self.bins.n_headings
        )
        self.uniform_masses = self.background.masses(self.coarse)
        self.uniform_nats = xlogy(self.uniform_masses, self.uniform_masses)
        self.uniform_entropy = -float(self.uniform_nats.sum())
        self.frame = np.array([*grid.origin, 1.0 / self.poses.cell_size])
        self._views: dict[tuple[int, int, int], CoarseBins] = {}
        self._spare: list[Sheet] = []
        self.everywhere = self.layout.laid_out(self.uniform, config.precision)
        """``(P * W,)``; the uniform belief over the open ground, laid out."""

    @property
    def uniform(self) -> NDArray[np.float64]:
        """``(C, K)``; the uniform belief over the open ground."""
        headings = self.poses.headings
        return np.repeat(self.background.share[:, None] / headings, headings, axis=1)

    @cached_property
    def contact(self) -> NDArray[np.floating]:
        """``(P * W,)``; :attr:`TravelTable.near` in the belief's precision."""
        return self.travel.near.astype(self.precision, copy=False)

    def view_bins(self, headings: int, rows: int, cols: int) -> CoarseBins:
        """The bins of a view of the belief; see :mod:`activeloc.beliefs.view`."""
        key = (headings, rows, cols)
        if key not in self._views:
            left, bottom, pixel = view_frame(self.terrain.grid, rows, cols)
            self._views[key] = CoarseBins.over(
                self.poses, (left, bottom), pixel, (rows, cols), headings
            )
        return self._views[key]

    def take(self) -> Sheet:
        """A sheet to write on; what it still holds is at its listed places."""
        try:
            return self._spare.pop()
        except IndexError:
            return Sheet(self.layout, self.precision)

    def give(self, sheet: Sheet) -> None:
        """A sheet that is not needed any more."""
        self._spare.append(sheet)


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
