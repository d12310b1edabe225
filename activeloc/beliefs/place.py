"""What a grid filter must remember of the place where the robot stands.

A grid forgets where in its cell the robot is, so two facts that it would count as news are not:

*Repetition.* A direction read again from one place shares the first reading's sub-cell error. Its
n-th reading counts ``W_n - W_(n-1)``, ``W_n = (1 + r) n / (n + r)``: the information of n readings
with independent noise and one shared offset, r being the ratio of their variances. With r = 1 the
readings count 1, 1/3, 1/6, ... and never more than 2 in all.

*Contact.* An obstacle that refused a motion is evidence once per direction; pushing on is not.

A place ends once the robot has travelled ``place_size``. Directions are sectors of the circle,
followed by odometry from the heading at which the place was entered.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def _sectors(
    heading: float, bearings: NDArray[np.float64], sectors: int, out: NDArray[np.intp]
) -> None:
    """Fill ``out (B,)`` with the sector of each bearing."""
    for b in range(bearings.shape[0]):
        turns = (heading + bearings[b]) / (2.0 * np.pi)
        out[b] = int(np.rint(turns * sectors)) % sectors


@njit(cache=True, nogil=True)
def _weigh(
    heading: float,
    bearings: NDArray[np.float64],
    valid: NDArray[np.bool_],
    readings: NDArray[np.int64],
    r: float,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (B,)`` with what one more reading in each beam's sector counts, 0 if invalid."""
    sector = np.empty(bearings.shape[0], dtype=np.intp)
    _sectors(heading, bearings, readings.shape[0], sector)
    for b in range(sector.shape[0]):
        nth = float(readings[sector[b]])
        for before in range(b):
            nth += valid[before] and sector[before] == sector[b]
        if not valid[b]:
            out[b] = 0.0
        elif np.isinf(r):
            out[b] = 1.0
        elif r == 0.0:
            out[b] = 1.0 if nth == 0.0 else 0.0
        else:
            out[b] = (1.0 + r) * r / ((nth + r) * (nth + 1.0 + r))


@njit(cache=True, nogil=True)
def _count(
    heading: float,
    bearings: NDArray[np.float64],
    valid: NDArray[np.bool_],
    readings: NDArray[np.int64],
) -> None:
    """Add a reading to the sector of each valid beam."""
    sector = np.empty(bearings.shape[0], dtype=np.intp)
    _sectors(heading, bearings, readings.shape[0], sector)
    for b in range(sector.shape[0]):
        readings[sector[b]] += valid[b]


class PlaceMemory:
    """What one robot has read and touched since it came to where it is.

    Args:
        sectors: Directions told apart.
        place_size: Travel after which the robot is elsewhere [m].
        repetition: r above; ``inf`` counts every reading in full.
    """

    def __init__(self, sectors: int, place_size: float, repetition: float) -> None:
        self.sectors = sectors
        self.place_size = place_size
        self.repetition = repetition
        self.clear()

    def clear(self) -> None:
        """Forget everything: the robot is somewhere else."""
        self.heading = 0.0
        self.travelled = 0.0
        self.readings = np.zeros(self.sectors, dtype=np.int64)
        self.refused = np.zeros(self.sectors, dtype=np.bool_)

    def copy(self) -> PlaceMemory:
        """An independent copy, to be advanced in imagination."""
        twin = copy(self)
        twin.readings, twin.refused = self.readings.copy(), self.refused.copy()
        return twin

    def move(self, u: NDArray[np.float64]) -> None:
        """Follow an odometry reading ``(3,)``: rotation, translation, rotation."""
        self.heading += float(u[0])
        self.travelled += abs(float(u[1]))
        if self.travelled >= self.place_size:
            self.clear()
        self.heading += float(u[2])

    def sector(self, bearings: NDArray[np.float64]) -> NDArray[np.intp]:
        """Sector that each bearing, relative to the robot's heading, falls into."""
        out = np.empty(len(bearings), dtype=np.intp)
        _sectors(self.heading, np.asarray(bearings, dtype=np.float64), self.sectors, out)
        return out

    def weigh(
        self, bearings: NDArray[np.float64], valid: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float64]:
        """How much a reading in each direction ``(B,)`` counts now: in [0, 1].

        Several beams in one sector are successive readings of it. Changes nothing.

        Args:
            bearings: Relative to the robot's heading [rad].
            valid: ``(B,)``; which of them have a reading, all if None. Others count 0.
        """
        bearings, valid = _directions(bearings, valid)
        result = np.empty(len(bearings))
        _weigh(self.heading, bearings, valid, self.readings, self.repetition, result)
        return result

    def read(self, bearings: NDArray[np.float64], valid: NDArray[np.bool_] | None = None) -> None:
        """Remember a reading in each of the directions ``(B,)`` that has one; see :meth:`weigh`."""
        _count(self.heading, *_directions(bearings, valid), self.readings)

    def refuse(self) -> bool:
        """Remember that the way ahead is blocked; true if that is news."""
        ahead = int(self.sector(np.zeros(1))[0])
        news = not bool(self.refused[ahead])
        self.refused[ahead] = True
        return news

    @property
    def is_refused(self) -> bool:
        """Whether the way ahead is known to be blocked."""
        return bool(self.refused[self.sector(np.zeros(1))[0]])


def _directions(
    bearings: NDArray[np.float64], valid: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """As kernels take them."""
    bearings = np.asarray(bearings, dtype=np.float64)
    return bearings, np.ones(len(bearings), dtype=np.bool_) if valid is None else valid
