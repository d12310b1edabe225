"""One robot's particles, and what they share with others on the same map."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import log

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.common_bins import CommonBins, entropy
from activeloc.beliefs.field_weighing import FieldWeigher
from activeloc.beliefs.particle_bins import empty_slots, sum_bins
from activeloc.beliefs.particle_motion import spread
from activeloc.beliefs.particle_past import Past
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.recovery import RunningMeans
from activeloc.grid import OccupancyGrid
from activeloc.motion import Terrain
from activeloc.range_table import RangeTable


def spread_poses(terrain: Terrain, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Poses ``(n, 3)`` spread evenly over the open ground and all headings, in map order.

    Each is uniform by itself; together they cover the ground as a lattice does: places by equal
    strata of the open area, headings by the golden section.
    """
    poses = np.empty((n, 3))
    spread(terrain.open_cells, terrain.frame, rng.random((n, 3)), rng.random(), poses)
    return poses


class Ground:
    """What is computed once per map and shared between robots.

    Args:
        grid: The map.
        radius: Of the robot [m].
        kld: Size [m] and angle [rad] of the bins that KLD sampling counts.
    """

    def __init__(self, grid: OccupancyGrid, radius: float, kld: tuple[float, float]) -> None:
        self.grid = grid
        self.terrain = Terrain(grid, radius)
        self.bins = CommonBins(grid)
        self.kld_bins = CommonBins(grid, *kld)
        self.frame = np.array([*grid.origin, 1.0 / grid.resolution])
        self.shape = (*self.bins.shape, self.bins.n_headings)
        self.corner = np.array([*self.bins.origin, 1.0 / self.bins.size])
        middle = grid.to_metres(self.terrain.open_cells[:, ::-1].astype(np.float64) + 0.5)
        poses = np.column_stack([middle, np.zeros(len(middle))])
        n_places = self.bins.shape[0] * self.bins.shape[1]
        place = np.bincount(self.bins.index(poses) // self.bins.n_headings, minlength=n_places)
        uniform = np.repeat(place / place.sum() / self.bins.n_headings, self.bins.n_headings)
        self.uniform_entropy = entropy(uniform)


@lru_cache(maxsize=16)
def ground_of(grid: OccupancyGrid, radius: float, kld: tuple[float, float]) -> Ground:
    """The ground of a map, kept for the 16 used last."""
    return Ground(grid, radius, kld)


@dataclass(slots=True)
class Cloud:
    """One robot's particles.

    Attributes:
        ground: Of its map.
        table: What the sensor is looked up in there; None where it is asked.
        poses: ``(N, 3)``.
        log_w: ``(N,)``.
        place: Where it stands.
        rng: Source of the filter's noise.
        means: Of augmented MCL.
        n_kept: How many of them, the first, follow the robot from where it was; the others have
            come since, for a robot that has been carried off.
        searching: Whether the others are looking for the robot everywhere.
        noticed: How often they have begun to.
        weights: ``(N,)`` summing to one; None where they must be computed from ``log_w``.
        log_total: Logarithm of their sum before they are normalised, where they are known.
        masses: What the last scan left on the common bins, see :meth:`binned`; None once it has
            moved.
    """

    ground: Ground
    table: RangeTable | FieldWeigher | None
    poses: NDArray[np.float64]
    log_w: NDArray[np.float64]
    place: PlaceMemory
    rng: np.random.Generator
    means: RunningMeans
    n_kept: int
    searching: bool = False
    noticed: int = 0
    weights: NDArray[np.float64] | None = None
    log_total: float = 0.0
    masses: tuple[NDArray[np.int32], NDArray[np.float64]] | None = None
    past: Past = field(default_factory=Past)

    def normalised(self) -> NDArray[np.float64]:
        """``(N,)``; weights that sum to one."""
        if self.weights is None:
            top = float(self.log_w.max())
            w = np.exp(self.log_w - top)
            total = float(w.sum())
            w /= total
            self.weights, self.log_total = w, top + float(np.log(total))
        return self.weights

    @property
    def parts(self) -> list[slice]:
        """The particles that are kept, and the others, if there are any."""
        parts = [slice(0, self.n_kept), slice(self.n_kept, len(self.poses))]
        return [part for part in parts if part.start < part.stop]

    @property
    def elsewhere(self) -> float:
        """Probability that the robot has been carried off."""
        return min(1.0, float(self.normalised()[self.n_kept :].sum()))

    def join(
        self, poses: NDArray[np.float64], log_w: NDArray[np.float64], first: int | None = None
    ) -> None:
        """Take in others, behind the ``first`` particles or behind all.

        Args:
            poses: ``(n, 3)`` of the others.
            log_w: ``(first + n,)``; new weights of everyone.
            first: How many stay.
        """
        if len(poses) or first is not None:
            self.poses = np.concatenate([self.poses[:first], poses])
        self.log_w, self.weights, self.masses = log_w, None, None

    def weigh(self, log_w: NDArray[np.float64], weights: NDArray[np.float64], top: float) -> None:
        """Take in new weights of everyone.

        Args:
            log_w: ``(N,)``.
            weights: ``(N,)`` of exp(log_w - top); normalised in place.
            top: Taken out of the logarithms.
        """
        total = float(weights.sum())
        weights *= 1.0 / total
        self.log_w, self.weights, self.masses = log_w, weights, None
        self.log_total = top + log(total)

    def follow(self, first: int, poses: NDArray[np.float64], weights: NDArray[np.float64]) -> None:
        """Let others follow the ``first`` particles, which stay as they are, in place of the rest.

        Args:
            first: How many stay.
            poses: ``(n, 3)`` of the others.
            weights: ``(n,)``; as much, together, as the rest that they stand for.
        """
        with np.errstate(divide="ignore"):
            log_w = np.log(weights)
        if first == 0:
            self.poses, self.weights, self.log_w, self.log_total = poses, weights, log_w, 0.0
            return
        self.weights = np.concatenate([self.normalised()[:first], weights])
        self.log_w = np.concatenate([self.log_w[:first], log_w + self.log_total])
        n = first + len(poses)
        if n > len(self.poses):
            self.poses = np.concatenate([self.poses[:first], poses])
            return
        self.poses[first:n] = poses
        self.poses = self.poses[:n]

    def of(self, poses: NDArray[np.float64], log_w: NDArray[np.float64]) -> Cloud:
        """Other particles on the same map, with the same source of noise."""
        return replace(
            self, poses=poses, log_w=log_w, n_kept=len(poses), searching=False,
            weights=None, masses=None,
            past=Past(),
        )  # fmt: skip

    def settle(self) -> None:
        """Note what the particles that are kept weigh before the next step."""
        self.past.w = self.elsewhere
        with np.errstate(divide="ignore"):
            self.past.log_kept = self.log_total + float(np.log1p(-self.past.w))

    def binned(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """``(n,)`` of the common bins that hold particles, and what they weigh there."""
        if self.masses is None:
            held, masses, _ = self.bin(slice(None))
            self.masses = held, masses
        return self.masses

    def bin(self, part: slice) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int32]]:
        """:meth:`binned` of a part of the cloud, and each particle's place ``(N,)`` among them."""
        ground, poses = self.ground, self.poses[part]
        index, held = np.empty(len(poses), np.int32), np.empty(len(poses), np.int32)
        masses = np.empty(len(poses))
        n = sum_bins(
            poses, self.normalised()[part], ground.corner, ground.shape,
            empty_slots(len(ground.bins)), index, held, masses,
        )  # fmt: skip
        return held[:n], masses[:n], index

    def copy(self) -> Cloud:
        """An independent cloud with the same future noise."""
        twin = copy(self)
        twin.poses, twin.log_w, twin.place = self.poses.copy(), self.log_w.copy(), self.place.copy()
        twin.means, twin.past = copy(self.means), self.past.copy()
        twin.rng = np.random.Generator(type(self.rng.bit_generator)())
        twin.rng.bit_generator.state = self.rng.bit_generator.state
        return twin
