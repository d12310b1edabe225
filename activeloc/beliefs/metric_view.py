"""What the belief says of the robot's surroundings on a metric map: the egocentric view.

As :mod:`activeloc.beliefs.egocentric` does for mazes: for every pose that the belief holds, the map
is turned so that the robot's heading points up (to higher rows, the right hand along +col) and laid
over a window around it. Averaged over the belief this gives the ``view``, pixels of 0.5 m:

- plane 0: probability that the robot's centre can be at each relative place;
- planes 1 to 4: how much a reading would tell there, with the robot turned by 0, 90, 180 and 270
  degrees (counter-clockwise) from its heading: how far the expected range is spread over the poses
  that can be there, as the entropy of its eight classes over ``log(8)``.

Beside it stand the ``ways``: what lies straight ahead after a turn by each of twelve bearings,
every 0.5 m up to 4 m.

- plane 0: probability that the way there is open;
- plane 1: how much a scan at its end would tell: the information that what up to three of the beams
  are expected to read, and whether an obstacle stopped the robot before, hold about the pose it
  started from (on the common bins), over ``log(128)``.

The ``place`` is what the robot remembers of where it stands (:mod:`activeloc.beliefs.place`) in the
same bearings: how often each has been read, 1 for twice or more, and whether it refused a motion.

Neither depends on the map's size or on where north is. The belief is stood for by 128 hypotheses
(:mod:`activeloc.beliefs.thinning`); places are looked up in cells of 0.2 m, expected ranges in
directions of 10 degrees.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import Belief
from activeloc.beliefs.metric_view_kernels import (
    CLASSES,
    CLOSED,
    DIRECTIONS,
    RING,
    SHARES,
    classify,
    draw_window,
    record,
)
from activeloc.beliefs.metric_ways_kernels import code, draw_ways
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.sensors import RangeSensor

PLANES = 5
PIXEL = 0.5  # [m]
BEARINGS = 12
DISTANCES = 9  # 0, 0.5, ... 4 m.
WAYS = (2, BEARINGS, DISTANCES)
PLACE = (2 * BEARINGS,)
HYPOTHESES = 128  # At most 255: they are counted in bytes.
CELL = 0.2  # Of the look-up [m].
MOST = float(np.log(HYPOTHESES))  # What is told at most [nat].
ANGLES = 2.0 * np.pi * np.arange(BEARINGS) / BEARINGS
STEP = 0.25  # At which a way is probed [m]; walls are thicker to the centre of a robot.


class Lookup:
    """What can be seen from everywhere on a map; computed once and shared.

    Attributes:
        frame: x and y of the map's corner [m], and cells per metre.
        area: ``(rows, cols)``; open share of each cell, in sixteenths.
        seen: ``(DIRECTIONS, rows, cols)``; class of the range from the cell along each direction,
            counter-clockwise from +x.
        records: ``(9, rows, cols)``; both: see :mod:`activeloc.beliefs.metric_view_kernels`; with
            the ring of closed cells.
        shares: ``(rows, cols)``; ``area``, with the ring.
    """

    def __init__(self, grid: OccupancyGrid, radius: float, z_max: float) -> None:
        terrain = Terrain(grid, radius)
        poses = PoseGrid(terrain, CELL, DIRECTIONS)
        self.frame = np.array([*grid.origin, 1.0 / CELL])
        row, col = poses.cells.T
        self.area = np.zeros(poses.shape, dtype=np.uint8)
        self.area[row, col] = np.round(SHARES * poses.area)
        places = poses.centres.copy()
        # The middle of the open ground may be a wall: then from the open sub-pose nearest to it.
        closed = np.flatnonzero(~terrain.contains(places))
        others = poses.sub_poses()[closed]
        apart = ((others - places[closed, None]) ** 2).sum(axis=-1)
        nearest = np.where(poses.is_open[closed], apart, np.inf).argmin(axis=1)
        places[closed] = others[np.arange(len(closed)), nearest]
        classes = np.empty((DIRECTIONS, len(places)), dtype=np.uint8)
        classify(grid.squares, grid.to_cells(places), z_max / grid.resolution, classes)
        self.seen = np.zeros((DIRECTIONS, *poses.shape), dtype=np.uint8)
        self.seen[:, row, col] = classes
        ring = (RING, RING)
        self.shares = np.pad(self.area, ring)
        self.records = np.pad(
            record(self.seen, self.area), ((0, 0), ring, ring), constant_values=CLOSED
        )
        self._codes: dict[tuple[int, ...], NDArray[np.uint16]] = {}

    def codes(self, beams: tuple[int, ...]) -> NDArray[np.uint16]:
        """``(DIRECTIONS, rows, cols)``, with the ring: what beams at some directions are to read.

        See :func:`activeloc.beliefs.metric_ways_kernels.code`.
        """
        if beams not in self._codes:
            around = ((0, 0), (RING, RING), (RING, RING))
            self._codes[beams] = np.pad(code(self.seen, beams), around)
        return self._codes[beams]


@lru_cache(maxsize=64)
def lookup_of(grid: OccupancyGrid, radius: float, z_max: float) -> Lookup:
    """The look-up of a map, kept for the 64 used last."""
    return Lookup(grid, radius, z_max)


class MetricView:
    """Draws the view of the robots of a batch.

    Args:
        belief: Of the robots.
        sensor: Whose readings are expected.
        radius: The window is ``2 radius + 1`` pixels wide.
    """

    def __init__(self, belief: Belief, sensor: RangeSensor, radius: int) -> None:
        self.belief = belief
        self.sensor = sensor
        self.radius = radius
        bearings = np.sort(sensor.bearings)
        some = bearings[np.unique([0, len(bearings) // 2, len(bearings) - 1])]
        beams = np.round(some * DIRECTIONS / (2.0 * np.pi)).astype(np.int64) % DIRECTIONS
        self._beams = tuple(beams.tolist())
        # To the window's corner or to the end of a way, and a cell to spare.
        reach = max(2.0**0.5 * radius, DISTANCES - 1.0) * PIXEL / CELL
        self._margin = int(np.ceil(reach)) + 2

    def draw(self, robot: int) -> dict[str, NDArray[np.float32]]:
        """``view`` ``(5, 2 radius + 1, 2 radius + 1)``, ``ways`` and ``place``: new, in [0, 1]."""
        terrain, margin = self.belief.terrain(robot), self._margin
        table = lookup_of(terrain.grid, terrain.radius, self.sensor.z_max)
        poses, counts = self.belief.thinned(robot, HYPOTHESES)
        side = 2 * self.radius + 1
        view = np.empty((PLANES, side, side), dtype=np.float32)
        ways = np.empty(WAYS, dtype=np.float32)
        draw_window(poses, counts, table.frame, table.records, margin, PIXEL / CELL, view)
        draw_ways(
            poses, counts, self.belief.bins(robot).index(poses), table.frame,
            table.codes(self._beams), table.shares, margin, STEP / CELL, round(PIXEL / STEP),
            CLASSES ** len(self._beams), MOST, ways,
        )  # fmt: skip
        memory = self.belief.place(robot)
        sector = memory.sector(ANGLES)
        place = np.empty(PLACE, dtype=np.float32)
        place[:BEARINGS] = np.minimum(0.5 * memory.readings[sector], 1.0)
        place[BEARINGS:] = memory.refused[sector]
        return {"view": view, "ways": ways, "place": place}
