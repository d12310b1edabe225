"""One robot's belief in planes, and what a step does to it.

A belief of a whole map is gone through in milliseconds, most of them spent on fetching it. So what
can wait is done on the way of the next pass: a turn waits for the travel, scan or question that
comes after it, and so does a division by a sum. A belief need not sum to one in between: each
method says what is left, and :meth:`~PlaneBelief.normalise` or :meth:`~PlaneBelief.divide` brings
it back.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import plane_kernels as kernels
from activeloc.beliefs import plane_motion as motion
from activeloc.beliefs import plane_poses as found
from activeloc.beliefs import plane_summary as summary
from activeloc.beliefs import plane_turns as turns
from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.plane_layout import Sheet, clear_runs, find_runs
from activeloc.beliefs.scan_likelihood import ScanLikelihood

_NOTHING, _NO_TURN = np.empty((0, 0)), turns.Turning(0, np.empty(0), 0, 0, 0.0)


class PlaneBelief:
    """A belief over the states of a map.

    Args:
        tables: Of the map.
        values: ``(K * P,)``, copied; nothing anywhere if None.
    """

    __slots__ = ("_divisor", "_sheet", "_surveyed", "_turning", "tables")

    def __init__(self, tables: GridTables, values: NDArray[np.floating] | None = None) -> None:
        self.tables = tables
        self._sheet = tables.take()
        self._divisor, self._turning = 1.0, _NO_TURN
        self._surveyed: tuple[int, NDArray[np.float64]] | None = None
        if values is None:
            clear_runs(self._sheet.values, self._sheet.runs, self._sheet.n)
            self._sheet.n = 0
        else:
            self._sheet.values[:] = values
            self._find()

    @classmethod
    def of(cls, tables: GridTables, bel: NDArray[np.floating]) -> PlaneBelief:
        """From ``(C, K)``."""
        return cls(tables, tables.layout.laid_out(bel, tables.precision))

    def copy(self) -> PlaneBelief:
        """An independent copy."""
        twin = PlaneBelief(self.tables)
        self._sheet.copy_to(twin._sheet)
        twin._divisor, twin._turning = self._divisor, self._turning
        return twin

    def drop(self) -> None:
        """Give the memory back; the belief is not to be used any more."""
        self.tables.give(self._sheet)

    @property
    def by_cell(self) -> NDArray[np.floating]:
        """``(C, K)``, a copy."""
        values = self.tables.layout.by_cell(self._told.values)
        return values if self._divisor == 1.0 else values * values.dtype.type(1.0 / self._divisor)

    @property
    def sheet(self) -> Sheet:
        """What the belief is, nothing waiting; to be read or written on."""
        self._surveyed = None
        if self._turns:
            self._replace(self._turned(self._waiting))
        elif self._divisor != 1.0:
            sheet = self._sheet
            kernels.scale(sheet.values, sheet.runs, sheet.n, 1.0 / self._divisor)
            self._divisor = 1.0
        return self._sheet

    @property
    def _told(self) -> Sheet:
        """What the belief is, but for the division that waits."""
        self.settle()
        return self._sheet

    @property
    def _turns(self) -> bool:
        """Whether a turn waits."""
        return len(self._turning.taps) > 0

    @property
    def _waiting(self) -> turns.Turning:
        """The turn that waits, divided; its taps filled up to fours, unless one is left over."""
        turning, by = self._turning, 1.0 / self._divisor
        n = len(turning.taps)
        taps = np.zeros(n if n % 4 < 2 else n + 4 - n % 4, dtype=self.tables.precision)
        taps[:n] = turning.taps * by
        return turning._replace(taps=taps, flat=turning.flat * by)

    def _turned(self, turning: turns.Turning) -> Sheet:
        """Another sheet with this one turned."""
        of, to = self._sheet, self.tables.take()
        to.n = turns.rotate(
            of.values, of.runs, of.n, self.tables.layout.size, turning,
            to.values, to.runs, to.n, to.flags,
        )  # fmt: skip
        return to

    def _replace(self, sheet: Sheet) -> None:
        """Go over to another sheet, on which nothing waits."""
        self.tables.give(self._sheet)
        self._sheet, self._turning, self._divisor = sheet, _NO_TURN, 1.0
        self._surveyed = None

    def _find(self) -> None:
        """Look where the mass is."""
        sheet = self._sheet
        sheet.n = find_runs(sheet.values, sheet.flags, self.tables.layout.size, sheet.runs)

    def rotate(
        self,
        first: int,
        taps: NDArray[np.float64],
        flat_first: int = 0,
        n_flat: int = 0,
        flat: float = 0.0,
    ) -> None:
        """Turn by so many bins with each of the weights ``(J,)``; see :class:`Turning`."""
        turning = turns.Turning(first, np.asarray(taps, dtype=np.float64), flat_first, n_flat, flat)
        headings = self.tables.layout.headings
        if self._turns:
            one, two = _as_taps(self._turning), _as_taps(turning)
            turning = one._replace(
                first=one.first + two.first, taps=np.convolve(one.taps, two.taps)
            )
        if turning.n_flat >= headings:
            turning = _as_taps(turning)
        if len(turning.taps) > headings:
            taps = np.zeros(headings)
            np.add.at(taps, np.arange(len(turning.taps)) % headings, turning.taps)
            turning = turning._replace(taps=taps)
        self._turning = turning

    def settle(self) -> None:
        """Turn now if a turn waits."""
        if self._turns:
            _ = self.sheet

    def turned(self, first: int, n: int) -> PlaneBelief:
        """A copy of what there is, turned by n shifts [bin] alike; nothing waits on it."""
        self.settle()
        twin = copy(self)
        twin.rotate(0, np.zeros(1), first, n, 1.0 / n)
        twin._sheet, twin._turning, twin._divisor = self._turned(twin._waiting), _NO_TURN, 1.0
        twin._surveyed = None
        return twin

    def mix_turned(self, share: float, first: int, n: int) -> None:
        """Of the turn that waits, let a share be n shifts [bin] alike instead."""
        turning = self._turning
        taps = turning.taps if self._turns else np.ones(1)
        self._turning = _NO_TURN
        self.rotate(turning.first, np.asarray((1.0 - share) * taps), first, n, share / n)

    def travel(self, level: int, hops: int, floor: float) -> float:
        """Travel ``level`` half cells, back if negative; returns the mass that is left.

        Args:
            level: Length of the travel,
            hops: one of as many equal parts.
            floor: Weight of ways that an obstacle cuts short, in [0, 1].
        """
        tables, layout, precision = self.tables, self.tables.layout, self.tables.precision
        self.settle()
        travel = tables.travel.level(abs(level), hops)
        of, to, divisor = self._sheet, tables.take(), self._divisor
        start, shift, weight = travel.fours(precision)
        to.n, mass = motion.translate(
            of.values, of.runs, of.n, layout.size,
            0 if level > 0 else layout.headings // 2, layout.cols,
            start, shift, weight, travel.box, travel.plain, travel.edge_start,
            travel.source, travel.target, travel.mixed(floor, precision),
            to.values, to.runs, to.n, to.flags,
        )  # fmt: skip
        self._replace(to)
        self._divisor = divisor
        return float(mass) / divisor

    def weigh(self, factor: NDArray[np.floating], floor: float) -> float:
        """Multiply by ``floor + (1 - floor) factor`` ``(K * P,)``; returns what is left."""
        sheet = self.sheet
        return float(kernels.weigh(sheet.values, sheet.runs, sheet.n, factor, floor))

    def touch(self, floor: float) -> float:
        """Weigh by a contact, felt with probability ``floor`` without an obstacle."""
        return self.weigh(self.tables.travel.near, floor)

    def read(self, scan: ScanLikelihood) -> tuple[float, float]:
        """Weigh by a scan; kept if it is impossible.

        Returns:
            The sum, 0 if no state explains the scan, and what its logarithm lacks: the log-evidence
            is ``log(sum) + shift``.
        """
        size = self.tables.layout.size
        if not scan.as_product:
            sheet = self.sheet
            return scan.add_logarithms(sheet.values, sheet.runs, sheet.n, size)
        of, self._surveyed = self._sheet, None
        to, divisor = (self.tables.take(), 1.0) if self._turns else (of, self._divisor)
        to.n, total, shift = scan.multiply(
            of.values, of.runs, of.n, size, self._waiting, divisor,
            to.values, to.runs, to.n, to.flags,
        )  # fmt: skip
        if to is not of:
            self._replace(to)
        self._divisor = 1.0
        return total, shift

    def mass(self) -> float:
        """Sum of it all."""
        sheet = self._told
        return float(kernels.total(sheet.values, sheet.runs, sheet.n)) / self._divisor

    def divide(self, mass: float) -> None:
        """Divide by ``mass``."""
        self._divisor *= mass

    def scale(self, factor: float) -> None:
        """Multiply by a factor."""
        kernels.scale(self.sheet.values, self.sheet.runs, self.sheet.n, factor)

    def add(self, other: PlaneBelief, share: float) -> None:
        """Add a share of another belief."""
        of, to = other.sheet, self.sheet
        to.n = kernels.add(
            to.values, to.runs, to.n, of.values, of.runs, of.n, share,
            self.tables.layout.size, to.flags,
        )  # fmt: skip

    def add_uniform(self, keep: float, mass: float) -> None:
        """Keep a share of what there is, and add a mass spread over the open ground."""
        values = self.sheet.values
        values *= keep
        values += self.tables.uniform_planes * mass
        self._find()

    def normalise(self, mass: float, least: float) -> float:
        """Divide by ``mass``, its sum, without states under ``least``; returns what was kept."""
        if least == 0.0:
            self.divide(mass)
            return 1.0
        sheet, self._surveyed = (self.sheet if self._turns else self._sheet), None
        sheet.n, kept = kernels.normalise(
            sheet.values, sheet.runs, sheet.n, self.tables.layout.size, mass * self._divisor,
            least, sheet.flags,
        )  # fmt: skip
        self._divisor = float(kept)
        return float(kept)

    def cells_held(self, enough: int) -> int:
        """How many cells hold any mass; counts no further than a little over ``enough``."""
        sheet, size = self._sheet, self.tables.layout.size
        return int(kernels.places_held(sheet.values, sheet.runs, sheet.n, size, enough))

    def entropy(self, w: float) -> float:
        """On the common bins, mixed with so much of the uniform [nat]."""
        tables = self.tables
        uniform = tables.uniform_masses, tables.uniform_nats
        return self._fold(tables.coarse, w, uniform, _NOTHING)

    def masses(self, bins: CoarseBins) -> NDArray[np.float64]:
        """``(Y * X, H)``; summed in coarser bins."""
        out = np.empty((bins.shape[0] * bins.shape[1], len(bins.headings)))
        self._fold(bins, 0.0, (_NOTHING, _NOTHING), out)
        return out

    def _fold(
        self,
        bins: CoarseBins,
        w: float,
        uniform: tuple[NDArray[np.float64], NDArray[np.float64]],
        out: NDArray[np.float64],
    ) -> float:
        sheet, layout = self._told, self.tables.layout
        nats: float = summary.fold(
            sheet.values, sheet.runs, sheet.n, layout.size, layout.cols,
            bins.headings, 1.0 / self._divisor,
            bins.row_bins, bins.row_shares, bins.col_first, bins.col_shares,
            w, *uniform, self.tables.uniform_entropy, out,
        )  # fmt: skip
        return nats

    def estimate(self, radius: float, angle: float) -> tuple[NDArray[np.float64], float]:
        """The mean of the mass around the mode ``(3,)``, and the mass around that.

        Args:
            radius: How far around [m], and
            angle: [rad].
        """
        sheet, tables, out = self._told, self.tables, np.empty(4)
        (mode, _), poses = self._survey(), tables.poses
        found.estimate(
            sheet.values, tables.layout.size, poses.index, poses.centres, poses.thetas,
            tables.frame, mode, radius, angle, out,
        )  # fmt: skip
        return out[:3], float(out[3]) / self._divisor

    def _survey(self) -> tuple[int, NDArray[np.float64]]:
        """The likeliest state, and what each run sums to: kept until the belief changes."""
        sheet = self._told
        if self._surveyed is None:
            bits: NDArray[Any] = sheet.values.view(f"i{sheet.values.itemsize}")
            sums = np.empty(sheet.n)
            mode = found.survey(sheet.values, bits, sheet.runs, sheet.n, sums)
            self._surveyed = mode, sums
        return self._surveyed

    def near(self, pose: NDArray[np.float64], radius: float, angle: float) -> float:
        """Mass around a pose ``(3,)``."""
        poses, out = self.tables.poses, np.empty(4)
        sheet = self._told
        found.near(
            sheet.values, self.tables.layout.size, poses.index, poses.centres, poses.thetas,
            self.tables.frame, pose, radius, angle, out,
        )  # fmt: skip
        return float(out[0]) / self._divisor

    def at_shares(self, shares: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Cells and heading bins at ascending shares ``(N,)`` in [0, 1) of the mass."""
        heading, place = np.divmod(self._states_at(shares), self.tables.layout.size)
        return self.tables.poses.index.ravel()[place], heading

    def thinned(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Poses ``(m, 3)`` at n like shares of the mass, and how many of the n are at each."""
        states, grid = self._states_at((np.arange(n) + 0.5) / n), self.tables.poses
        poses, counts = np.empty((n, 3)), np.empty(n, dtype=np.int64)
        m = found.gather(
            states, self.tables.layout.size, grid.index.ravel(), grid.centres, grid.thetas,
            poses, counts,
        )  # fmt: skip
        return poses[:m], counts[:m]

    def _states_at(self, shares: NDArray[np.float64]) -> NDArray[np.int64]:
        """States at ascending shares ``(N,)`` in [0, 1) of the mass."""
        sheet, (_, sums) = self._told, self._survey()
        states = np.empty(len(shares), dtype=np.int64)
        found.at_shares(sheet.values, sheet.runs, sheet.n, sums, shares, states)
        return states


def _as_taps(turning: turns.Turning) -> turns.Turning:
    """The same turn, its flat part among the taps."""
    if turning.n_flat == 0:
        return turning
    first = min(turning.first, turning.flat_first)
    last = max(turning.first + len(turning.taps), turning.flat_first + turning.n_flat)
    taps = np.zeros(last - first)
    taps[turning.first - first :][: len(turning.taps)] = turning.taps
    taps[turning.flat_first - first :][: turning.n_flat] += turning.flat
    return turns.Turning(first, taps, 0, 0, 0.0)
