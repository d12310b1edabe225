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
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs import Belief
from activeloc.beliefs.pose_grid import PoseGrid
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.raycast import cast_ray
from activeloc.sensors import RangeSensor

PLANES = 5
PIXEL = 0.5  # [m]
BEARINGS = 12
DISTANCES = 9  # 0, 0.5, ... 4 m.
WAYS = (2, BEARINGS, DISTANCES)
PLACE = (2 * BEARINGS,)
HYPOTHESES = 128  # At most 255: they are counted in bytes.
CLASSES = 8  # Of an expected range: seven up to the longest, one for nothing in range.
CELL = 0.2  # Of the look-up [m].
DIRECTIONS = 36
STEP = 0.25  # At which a way is probed [m]; walls are thicker to the centre of a robot.
SHARES = 16  # Open shares of a cell are told apart this finely,
OPEN = 4  # and with fewer of them it stops a way.


class Lookup:
    """What can be seen from everywhere on a map; computed once and shared.

    Attributes:
        frame: x and y of the map's corner [m], and cells per metre.
        area: ``(rows, cols)``; open share of each cell, in sixteenths.
        seen: ``(DIRECTIONS, rows, cols)``; class of the range from the cell along each direction,
            counter-clockwise from +x.
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
        self._beams = np.round(some * DIRECTIONS / (2.0 * np.pi)).astype(np.int64) % DIRECTIONS

    def draw(self, robot: int) -> dict[str, NDArray[np.float32]]:
        """``view`` ``(5, 2 radius + 1, 2 radius + 1)``, ``ways`` and ``place``: new, in [0, 1]."""
        terrain = self.belief.terrain(robot)
        table = lookup_of(terrain.grid, terrain.radius, self.sensor.z_max)
        poses, counts = self.belief.thinned(robot, HYPOTHESES)
        side = 2 * self.radius + 1
        view = np.empty((PLANES, side, side), dtype=np.float32)
        ways = np.empty(WAYS, dtype=np.float32)
        draw_window(poses, counts, table.frame, table.area, table.seen, view)
        bins = self.belief.bins(robot).index(poses)
        order = np.argsort(bins, kind="stable")
        poses, counts, bins = poses[order], counts[order], bins[order]
        draw_ways(poses, counts, bins, table.frame, table.area, table.seen, self._beams, ways)
        memory = self.belief.place(robot)
        sector = memory.sector(2.0 * np.pi * np.arange(BEARINGS) / BEARINGS)
        place = np.concatenate(
            [np.minimum(0.5 * memory.readings, 1.0)[sector], memory.refused[sector]]
        )
        return {"view": view, "ways": ways, "place": place.astype(np.float32)}


@njit(cache=True, nogil=True)
def classify(
    squares: NDArray[np.uint8],
    places: NDArray[np.float64],
    reach: float,
    classes: NDArray[np.uint8],
) -> None:
    """Class of the range from each place in each direction.

    Args:
        squares: ``(4, H + 2, W + 2)``; see :func:`cast_ray`.
        places: ``(C, 2)`` of column and row [cell].
        reach: Longest range [cell].
        classes: ``(D, C)``, overwritten.
    """
    for d in range(classes.shape[0]):
        angle = 2.0 * np.pi * d / classes.shape[0]
        dx, dy = np.cos(angle), np.sin(angle)
        for c in range(places.shape[0]):
            z = cast_ray(squares, places[c, 0], places[c, 1], dx, dy, reach)
            # A range on the edge of a class goes up in every like room.
            classes[d, c] = min(int(z / reach * (CLASSES - 1) + 1e-9), CLASSES - 1)


@njit(cache=True, nogil=True)
def direction_of(theta: float) -> int:
    """The nearest of the look-up's directions."""
    return int(np.floor(theta / (2.0 * np.pi) * DIRECTIONS + 0.5)) % DIRECTIONS


@njit(cache=True, nogil=True)
def draw_window(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    frame: NDArray[np.float64],
    area: NDArray[np.uint8],
    seen: NDArray[np.uint8],
    view: NDArray[np.float32],
) -> None:
    """Average the turned map, and find the spread of the expected ranges.

    Classes are counted in the eight bytes of a word, for all hypotheses at each place.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``; hypotheses at each pose, 255 at most in all.
        frame: See :class:`Lookup`.
        area: ``(rows, cols)``.
        seen: ``(D, rows, cols)``.
        view: ``(5, S, S)``, overwritten.
    """
    height, width = area.shape
    side, radius, quarter = view.shape[1], view.shape[1] // 2, DIRECTIONS // 4
    words = np.zeros((side * side, 4), np.uint64)
    free = np.zeros(side * side, np.int64)
    total = counts.sum()
    for i in range(poses.shape[0]):
        n, word = counts[i], np.uint64(counts[i])
        dx, dy = np.cos(poses[i, 2]) * PIXEL * frame[2], np.sin(poses[i, 2]) * PIXEL * frame[2]
        ahead = direction_of(poses[i, 2])
        planes = (
            seen[ahead], seen[(ahead + quarter) % DIRECTIONS],
            seen[(ahead + 2 * quarter) % DIRECTIONS], seen[(ahead + 3 * quarter) % DIRECTIONS],
        )  # fmt: skip
        at = 0
        for u in range(-radius, radius + 1):
            col = (poses[i, 0] - frame[0]) * frame[2] + u * dx - radius * dy
            row = (poses[i, 1] - frame[1]) * frame[2] + u * dy + radius * dx
            for _ in range(side):
                if 0.0 <= col < width and 0.0 <= row < height:
                    r, c = int(row), int(col)
                    if area[r, c] > 0:
                        free[at] += n * area[r, c]
                        for q in range(4):
                            words[at, q] += word << np.uint64(8 * planes[q][r, c])
                at += 1
                col, row = col + dy, row - dx
    logs = np.log(np.maximum(np.arange(256), 1).astype(np.float64))
    for at in range(side * side):
        row, col = at // side, at % side
        view[0, row, col] = free[at] / (SHARES * total)
        for q in range(4):
            there, spread = 0, 0.0
            for lane in range(CLASSES):
                held = int((words[at, q] >> np.uint64(8 * lane)) & np.uint64(255))
                there += held
                spread -= held * logs[held]
            view[1 + q, row, col] = 0.0
            if there > 0:
                view[1 + q, row, col] = max(0.0, logs[there] + spread / there) / logs[CLASSES]


@njit(cache=True, nogil=True)
def draw_ways(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    bins: NDArray[np.int64],
    frame: NDArray[np.float64],
    area: NDArray[np.uint8],
    seen: NDArray[np.uint8],
    beams: NDArray[np.int64],
    ways: NDArray[np.float32],
) -> None:
    """Follow the straight ways from every pose.

    Args:
        poses: ``(M, 3)``.
        counts: ``(M,)``.
        bins: ``(M,)``, ascending; of the poses.
        frame: See :class:`Lookup`.
        area: ``(rows, cols)``.
        seen: ``(D, rows, cols)``.
        beams: ``(B,)``, B at most 3; bearings as directions.
        ways: ``(2, bearings, distances)``, overwritten.
    """
    height, width = area.shape
    m, total, probes = poses.shape[0], counts.sum(), round(PIXEL / STEP)
    stopped, most = CLASSES ** beams.shape[0], np.log(float(HYPOTHESES))
    codes = np.empty((ways.shape[2], m), np.int64)
    held = np.zeros(stopped + 1, np.int64)
    logs = np.log(np.maximum(np.arange(total + 1), 1).astype(np.float64))
    for b in range(ways.shape[1]):
        turn = 2.0 * np.pi * b / ways.shape[1]
        for i in range(m):
            theta = poses[i, 2] + turn
            dx, dy = np.cos(theta) * STEP * frame[2], np.sin(theta) * STEP * frame[2]
            ahead, is_open = direction_of(theta), True
            col = (poses[i, 0] - frame[0]) * frame[2]
            row = (poses[i, 1] - frame[1]) * frame[2]
            for k in range(ways.shape[2]):
                for _ in range(probes if k > 0 else 0):
                    col, row = col + dx, row + dy
                    is_open = is_open and 0.0 <= col < width and 0.0 <= row < height
                    is_open = is_open and area[int(row), int(col)] >= OPEN
                if not is_open or not (0.0 <= col < width and 0.0 <= row < height):
                    for j in range(k, ways.shape[2]):
                        codes[j, i] = stopped
                    break
                code = 0
                for beam in beams:
                    code = code * CLASSES + seen[(ahead + beam) % DIRECTIONS, int(row), int(col)]
                codes[k, i] = code
        for k in range(ways.shape[2]):
            for i in range(m):
                held[codes[k, i]] += counts[i]
            ways[0, b, k] = 1.0 - held[stopped] / total
            told = logs[total] * total - _take(codes[k], held, logs, 0, m)
            # Less what poses of one bin differ by among themselves.
            first = 0
            while first < m:
                end, n = first, 0
                while end < m and bins[end] == bins[first]:
                    held[codes[k, end]] += counts[end]
                    n += counts[end]
                    end += 1
                told -= n * logs[n] - _take(codes[k], held, logs, first, end)
                first = end
            ways[1, b, k] = min(max(0.0, told) / total / most, 1.0)


@njit(cache=True, nogil=True)
def _take(
    codes: NDArray[np.int64],
    held: NDArray[np.int64],
    logs: NDArray[np.float64],
    first: int,
    end: int,
) -> float:
    """Sum of n log n over what is held for ``codes[first:end]``, which is set to zero."""
    total = 0.0
    for i in range(first, end):
        n = held[codes[i]]
        held[codes[i]] = 0
        total += n * logs[n]
    return total
