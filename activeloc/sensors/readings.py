"""What every range sensor shares: its beams, its bins, the seam to filters and simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import ConfigError, ScanError
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_scan


@njit(cache=True, nogil=True)
def _index(scan: NDArray[np.float64], z_max: float, n_bins: int, out: NDArray[np.int32]) -> None:
    """Fill ``out`` with :meth:`ReadingBins.index` of each reading."""
    step = z_max / (n_bins - 1)
    for i in range(scan.shape[0]):
        if np.isnan(scan[i]):
            out[i] = -1
        elif scan[i] >= z_max:
            out[i] = n_bins - 1
        else:
            out[i] = min(int(scan[i] / step), n_bins - 2)


@njit(cache=True, nogil=True)
def _clean(scan: NDArray[np.float64], z_max: float) -> int:
    """Replace +inf by ``z_max``; returns where the first reading is out of range, or -1."""
    for i in range(scan.shape[0]):
        if scan[i] == np.inf:
            scan[i] = z_max
        elif scan[i] < 0.0 or scan[i] > z_max:  # NaN is neither.
            return i
    return -1


@dataclass(frozen=True, slots=True)
class ReadingBins:
    """Equal bins over ``[0, z_max)`` and a last one that holds maximum-range readings alone.

    Attributes:
        z_max: Longest range the sensor reports [m].
        width: Greatest width of a bin [m]; the bins divide ``z_max`` evenly.

    Raises:
        ConfigError: If the width is not in (0, z_max], or gives more than 4096 bins.
    """

    z_max: float
    width: float

    def __post_init__(self) -> None:
        checks.number("reading_bin", self.width, 0.0, self.z_max, above_low=True)
        if self.z_max / self.width > 4096:
            raise ConfigError(
                f"reading_bin {self.width:g} m gives {self.z_max / self.width:.0f} bins up to "
                f"z_max {self.z_max:g} m; at most 4096 are allowed"
            )

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the bins below ``z_max``: ``(Z,)`` from 0 to ``z_max`` [m]."""
        return np.linspace(0.0, self.z_max, len(self))

    def __len__(self) -> int:
        return ceil(self.z_max / self.width - 1e-9) + 1

    def index(self, scan: NDArray[np.float64]) -> NDArray[np.int32]:
        """Bin of each reading, -1 for "no reading" (NaN): an array like ``scan``."""
        z = np.ascontiguousarray(scan, dtype=np.float64)
        out = np.empty(z.shape, dtype=np.int32)
        _index(z.reshape(-1), self.z_max, len(self), out.reshape(-1))
        return out

    def shares(self, others: ReadingBins) -> NDArray[np.float64]:
        """``(Z - 1, Z' - 1)``; share of each bin below ``z_max`` that lies in each of the others.

        Rows sum to one.
        """
        own, edges = self.edges, others.edges
        high = np.minimum(own[1:, None], edges[1:])
        share = np.maximum(high - np.maximum(own[:-1, None], edges[:-1]), 0.0)
        result: NDArray[np.float64] = share / share.sum(axis=1, keepdims=True)
        return result


@runtime_checkable
class RangeSensor(Protocol):
    """What filters, simulator and planners need of a range sensor."""

    def __hash__(self) -> int: ...

    @property
    def z_max(self) -> float:
        """Longest range reported [m]."""
        ...

    @property
    def bearings(self) -> NDArray[np.float64]:
        """``(B,)``; beam angles relative to the robot's heading [rad]."""
        ...

    def read(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], uniforms: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Draw a reading ``(...)`` [m] for each ray ``(..., 3)`` from ``(..., 2)`` uniforms."""
        ...

    def bin_probabilities(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], bins: ReadingBins
    ) -> NDArray[np.float64]:
        """P(reading in bin | ray, map): ``(..., Z)`` for rays ``(..., 3)``; rows sum to one."""
        ...


@runtime_checkable
class ExpectedRangeSensor(RangeSensor, Protocol):
    """A sensor whose readings depend on pose and map through the expected range z* alone.

    z* is the nearest of the exact ranges in the directions of :attr:`cone`. Filters cast or look up
    z*, and tabulate :meth:`masses` once over z* instead of asking for each ray.

    A class that inherits from this one needs ``z_max``, ``bearings``, :meth:`masses` and
    :meth:`read`; its beams are thin unless it says otherwise.
    """

    @property
    def cone(self) -> NDArray[np.float64]:
        """``(R,)``; directions about a beam's axis that it hears [rad]; one zero if it is thin."""
        return np.zeros(1)

    def expected(self, grid: OccupancyGrid, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """z*: nearest exact range of each ray's cone, ``(...)`` for ``(..., 3)`` [m].

        At most ``z_max``, and exactly that where nothing is in range.
        """
        return nearest_range(grid, rays, self.cone, self.z_max)

    def bin_probabilities(
        self, grid: OccupancyGrid, rays: NDArray[np.float64], bins: ReadingBins
    ) -> NDArray[np.float64]:
        """See :meth:`RangeSensor.bin_probabilities`."""
        return self.masses(self.expected(grid, rays), bins)

    def masses(self, z_expected: NDArray[np.float64], bins: ReadingBins) -> NDArray[np.float64]:
        """P(reading in bin | z*): ``(..., Z)`` for ``(...)``; each row sums to one."""
        ...


def nearest_range(
    grid: OccupancyGrid, rays: NDArray[np.float64], cone: NDArray[np.float64], z_max: float
) -> NDArray[np.float64]:
    """Nearest exact range in a cone about each ray ``(..., 3)``, at most ``z_max``: ``(...)`` [m].

    Args:
        grid: The map.
        rays: x, y [m] and direction [rad] of the cones' axes.
        cone: ``(R,)`` of directions about the axis [rad].
        z_max: Longest range reported [m].
    """
    ranges = cast_scan(grid, rays, cone, z_max)
    result: NDArray[np.float64] = ranges[..., 0] if len(cone) == 1 else ranges.min(axis=-1)
    return result


def expected_range(
    sensor: RangeSensor, grid: OccupancyGrid, rays: NDArray[np.float64]
) -> NDArray[np.float64]:
    """z* of each ray ``(..., 3)``: the sensor's own, or the exact range along it: ``(...)`` [m]."""
    if isinstance(sensor, ExpectedRangeSensor):
        return sensor.expected(grid, rays)
    return nearest_range(grid, rays, np.zeros(1), sensor.z_max)


def rays_of(poses: NDArray[np.float64], bearings: NDArray[np.float64]) -> NDArray[np.float64]:
    """The beams of poses ``(..., 3)`` as rays ``(..., B, 3)`` of x, y [m] and direction [rad]."""
    rays = np.repeat(np.asarray(poses, dtype=np.float64)[..., None, :], len(bearings), axis=-2)
    rays[..., 2] += bearings
    return rays


@lru_cache(maxsize=256)
def spread_bearings(beams: int, field_of_view: float) -> NDArray[np.float64]:
    """``beams`` angles evenly over the field of view, its two ends included [rad].

    Over a full turn the ends are one direction, and the beams divide the circle.
    """
    full_turn = field_of_view >= 2.0 * np.pi - 1e-9
    steps = beams if full_turn else max(1, beams - 1)
    result = (np.arange(beams) / steps - (0.5 if beams > 1 else 0.0)) * field_of_view
    result.flags.writeable = False  # It is kept and shared.
    return result


def check_scan(scan: NDArray[np.float64], sensor: RangeSensor) -> NDArray[np.float64]:
    """The scan as float64, +inf replaced by ``z_max``.

    Args:
        scan: ``(..., B)`` of ranges [m]; NaN is "no reading", +inf a maximum-range reading.
        sensor: Whose scan it is.

    Raises:
        ScanError: If the last axis is not the sensor's beams, or a reading is outside its range.
    """
    z = np.array(scan, dtype=np.float64, order="C")
    n_beams = len(sensor.bearings)
    if z.ndim == 0 or z.shape[-1] != n_beams:
        raise ScanError(f"scan must have {n_beams} readings, got shape {z.shape}")
    bad = _clean(z.reshape(-1), sensor.z_max)
    if bad >= 0:
        where = tuple(int(i) for i in np.unravel_index(bad, z.shape))
        raise ScanError(
            f"scan reading {where} is {z[where]:g} m; allowed are [0, {sensor.z_max:g}], NaN, +inf"
        )
    return z


def check_one_scan(scan: NDArray[np.float64], sensor: RangeSensor) -> NDArray[np.float64]:
    """:func:`check_scan` of a scan ``(B,)``.

    Raises:
        ScanError: Also if it is not one scan.
    """
    z = check_scan(scan, sensor)
    if z.ndim != 1:
        raise ScanError(f"one scan of {z.shape[-1]} readings is wanted, got shape {z.shape}")
    return z


def widened(sensor: RangeSensor, factor: float) -> RangeSensor:
    """The sensor with ``factor`` times its ``sigma_hit``; as it is, if it has none."""
    given: Any = sensor
    if factor == 1.0 or not hasattr(given, "sigma_hit"):
        return sensor
    result: RangeSensor = replace(given, sigma_hit=factor * given.sigma_hit)
    return result
