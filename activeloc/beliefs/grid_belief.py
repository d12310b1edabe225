"""One robot's belief on a grid, and what a step does to it.

A belief of a whole map is gone through in milliseconds, so what can wait does: a turn waits for
others, which become one convolution with it, until a travel, a scan or a question comes; a division
by a sum waits for the next pass that multiplies. A belief need not sum to one in between: each
method says what is left, and :meth:`~GridBelief.normalise` or :meth:`~GridBelief.divide` brings
it back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import grid_poses as found
from activeloc.beliefs import grid_summary as summary
from activeloc.beliefs import grid_sums as sums
from activeloc.beliefs import grid_travels as travels
from activeloc.beliefs import grid_turns as turns
from activeloc.beliefs.coarse import CoarseBins
from activeloc.beliefs.grid_layout import Sheet, held
from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.scan_likelihood import ScanLikelihood
from activeloc.errors import ConfigError

_NOTHING = np.empty((0, 0))
EVERYWHERE = 0.7
"""Share of the cells above which a travel may reach them all, and nobody asks which."""


class GridBelief:
    """A belief over the states of a map.

    Args:
        tables: Of the map.
        values: ``(P * W,)``, copied; nothing anywhere if None.
    """

    __slots__ = ("_added_up", "_divisor", "_is_loose", "_mode", "_sheet", "_turning", "tables")

    def __init__(self, tables: GridTables, values: NDArray[np.floating] | None = None) -> None:
        self.tables = tables
        self._sheet = tables.take()
        self._divisor = 1.0
        self._turning: turns.Turning | None = None
        self._is_loose = False  # Whether cells may be listed that hold nothing any more.
        # The likeliest state, and what places sum to, where they are known.
        self._mode: int | None = None
        self._added_up: NDArray[np.float64] | None = None
        if values is None:
            self._sheet.clear(tables.layout)
        else:
            self._sheet.put(values, tables.layout)

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        """What was found out is no state: it can be found out again."""
        state = {name: getattr(self, name) for name in self.__slots__}
        return None, state | {"_mode": None, "_added_up": None}

    @classmethod
    def of(cls, tables: GridTables, bel: NDArray[np.floating]) -> GridBelief:
        """From ``(C, K)``."""
        return cls(tables, tables.layout.laid_out(bel, tables.precision))

    def copy(self) -> GridBelief:
        """An independent copy."""
        twin = GridBelief(self.tables)
        self._sheet.copy_to(twin._sheet, self.tables.layout)
        twin._divisor, twin._turning = self._divisor, self._turning
        twin._is_loose = self._is_loose
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
        self._forget()
        if self._turning is not None:
            self._turn(self._turning)
        elif self._divisor != 1.0:
            sheet, layout = self._sheet, self.tables.layout
            sums.scale(sheet.values, sheet.places, sheet.n, layout.width, 1.0 / self._divisor)
            self._divisor = 1.0
        return self._sheet

    @property
    def _told(self) -> Sheet:
        """What the belief is, but for the division that waits."""
        if self._turning is not None:
            self._turn(self._turning)
        return self._sheet

    def _turn(self, turning: turns.Turning) -> None:
        """Carry out the turn that waits, and the division."""
        self._turn_onto(turning, self._sheet.values)
        self._turning, self._divisor = None, 1.0
        self._forget()

    def _turn_onto(self, turning: turns.Turning, out: NDArray[np.floating]) -> None:
        """Write what there is to ``(P * W,)`` at its places, turned and divided."""
        of, layout, by = self._sheet, self.tables.layout, 1.0 / self._divisor
        how = turns.Convolution.of(turning, layout.headings, self.tables.precision, by)
        turns.rotate(of.values, of.places, of.n, layout.headings, layout.width, how, out)

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
        if self._turning is not None:
            one, two = _as_taps(self._turning), _as_taps(turning)
            turning = one._replace(
                first=one.first + two.first, taps=np.convolve(one.taps, two.taps)
            )
        if turning.n_flat >= headings:
            turning = _as_taps(turning)
        if len(turning.taps) > headings:
            shift = np.arange(len(turning.taps)) % headings
            taps = np.bincount(shift, turning.taps, headings).astype(np.float64)
            turning = turning._replace(taps=taps)
        self._turning = turning

    def settle(self) -> None:
        """Turn now if a turn waits."""
        _ = self._told

    def turned(self, first: int, n: int) -> GridBelief:
        """A copy of what there is, turned by n shifts [bin] alike; nothing waits on it."""
        self.settle()
        twin, of = GridBelief(self.tables), self._sheet
        twin._sheet.n = of.n
        twin._sheet.places[: of.n] = of.places[: of.n]
        self._turn_onto(turns.Turning(0, np.zeros(1), first, n, 1.0 / n), twin._sheet.values)
        twin._is_loose = self._is_loose
        return twin

    def mix_turned(self, share: float, first: int, n: int) -> None:
        """Of the turn that waits, let a share be n shifts [bin] alike instead."""
        waits, self._turning = self._turning, None
        turning = turns.Turning(0, np.ones(1), 0, 0, 0.0) if waits is None else _as_taps(waits)
        self.rotate(turning.first, np.asarray((1.0 - share) * turning.taps), first, n, share / n)

    def travel(self, level: int, hops: int, floor: float) -> float:
        """Travel ``level`` half cells, back if negative; returns the mass that is left.

        Args:
            level: Length of the travel,
            hops: one of as many equal parts.
            floor: Weight of ways that an obstacle cuts short, in [0, 1].
        """
        tables, layout, precision = self.tables, self.tables.layout, self.tables.precision
        lists = tables.travel.level(abs(level), hops).lists(backward=level < 0)
        of, to = self._told, tables.take()
        few = of.n <= EVERYWHERE * len(layout.place)
        self._forget()
        to.n, mass = travels.translate(
            of.values, of.places, of.n, layout.width,
            lists.which, lists.first, lists.step, *lists.mixed(floor, precision),
            to.values, to.places, to.n, to.flags, few,
        )  # fmt: skip
        if not few:
            to.list_all(layout)
        tables.give(of)
        self._sheet, self._is_loose = to, True
        return float(mass) / self._divisor

    def weigh(self, factor: NDArray[np.floating], floor: float) -> float:
        """Multiply by ``floor + (1 - floor) factor`` ``(P * W,)``; returns what is left."""
        sheet, layout = self._told, self.tables.layout
        self._forget()
        divisor, self._divisor, self._is_loose = self._divisor, 1.0, True
        return sums.weigh(
            sheet.values, sheet.places, sheet.n, layout.width, factor, floor, divisor,
        )  # fmt: skip

    def touch(self, floor: float) -> float:
        """Weigh by a contact, felt with probability ``floor`` without an obstacle."""
        return self.weigh(self.tables.contact, floor)

    def read(self, scan: ScanLikelihood) -> tuple[float, float]:
        """Weigh by a scan; kept if it is impossible.

        Returns:
            The sum, 0 if no state explains the scan, and what its logarithm lacks: the log-evidence
            is ``log(sum) + shift``.
        """
        layout, self._is_loose = self.tables.layout, True
        if not scan.as_product:
            return scan.add_logarithms(self.sheet, layout)
        sheet = self._told
        self._forget()
        divisor, self._divisor = self._divisor, 1.0
        return scan.multiply(sheet, layout, divisor)

    def mass(self) -> float:
        """Sum of it all."""
        sheet, width = self._told, self.tables.layout.width
        return float(sums.mass(sheet.values, sheet.places, sheet.n, width)) / self._divisor

    def divide(self, mass: float) -> None:
        """Divide by ``mass``."""
        self._divisor *= mass

    def scale(self, factor: float) -> None:
        """Multiply by a factor."""
        sheet, self._is_loose = self.sheet, True
        sums.scale(sheet.values, sheet.places, sheet.n, self.tables.layout.width, factor)

    def add(self, other: GridBelief, share: float) -> None:
        """Add a share of another belief."""
        of, to, merged = other._told, self._told, np.empty_like(self._sheet.places)
        to.n = sums.mix(
            to.values, to.places, to.n, of.values, of.places, of.n,
            share * self._divisor / other._divisor, self.tables.layout.width, merged,
        )  # fmt: skip
        to.places = merged
        self._forget()
        self._is_loose |= other._is_loose

    def add_uniform(self, keep: float, mass: float) -> None:
        """Keep a share of what there is, and add a mass spread over the open ground."""
        sheet = self.sheet
        sheet.values *= keep
        sheet.values += self.tables.everywhere * mass
        sheet.find(self.tables.layout)

    def normalise(self, mass: float, least: float) -> float:
        """Divide by ``mass``, its sum, without states under ``least``; returns what was kept."""
        if least == 0.0:
            self.divide(mass)
            return 1.0
        sheet, layout = self._told, self.tables.layout
        self._forget()
        sheet.n, kept, self._mode = sums.normalise(
            sheet.values, sheet.places, sheet.n, layout.headings, layout.width,
            mass * self._divisor, least,
        )  # fmt: skip
        self._divisor, self._is_loose = float(kept), False
        return float(kept)

    def cells_held(self) -> int:
        """How many cells hold any mass."""
        sheet = self._sheet
        if self._is_loose:
            sheet.n = held(sheet.values, sheet.places, sheet.n, self.tables.layout.width)
            self._is_loose, self._added_up = False, None
        return sheet.n

    def entropy(self, w: float) -> float:
        """On the common bins, mixed with so much of the uniform [nat]."""
        tables = self.tables
        uniform = tables.uniform_masses, tables.uniform_nats
        return self._fold(tables.coarse, w, uniform, _NOTHING)

    def masses(
        self, bins: CoarseBins, share: float = 1.0, onto: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """``(H, Y * X)``; a share of what there is, summed in coarser bins.

        Args:
            bins: The bins.
            share: Of the belief.
            onto: What it is added to, in place; nothing if None.
        """
        if onto is None:
            onto = np.zeros((len(bins.headings), bins.shape[0] * bins.shape[1]))
        self._fold(bins, 0.0, (_NOTHING, _NOTHING), onto, share)
        return onto

    def _fold(
        self,
        bins: CoarseBins,
        w: float,
        uniform: tuple[NDArray[np.float64], NDArray[np.float64]],
        out: NDArray[np.float64],
        share: float = 1.0,
    ) -> float:
        sheet, layout = self._told, self.tables.layout
        nats: float = summary.fold(
            sheet.values, sheet.places, sheet.n, layout.cols, layout.width, bins.shape[1],
            share / self._divisor, bins.row_first, bins.row_shares, bins.col_bins, bins.col_shares,
            bins.heading_start, bins.heading_bin, bins.heading_share, bins.even,
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
        poses, width = tables.poses, tables.layout.width
        if self._mode is None:
            self._mode = int(sums.likeliest(sheet.values, sheet.places, sheet.n, width))
        found.estimate(
            sheet.values, width, poses.index, poses.centres, poses.thetas,
            tables.frame, self._mode, radius, angle, out,
        )  # fmt: skip
        return out[:3], float(out[3]) / self._divisor

    def _forget(self) -> None:
        """What was found out is not so any more."""
        self._mode = self._added_up = None

    def _sums(self) -> NDArray[np.float64]:
        """What comes before each place, and all of it."""
        sheet = self._told
        if self._added_up is None:
            self._added_up = np.empty(sheet.n + 1)
            width = self.tables.layout.width
            found.add_up(sheet.values, sheet.places, sheet.n, width, self._added_up)
        return self._added_up

    def near(self, pose: NDArray[np.float64], radius: float, angle: float) -> float:
        """Mass around a pose ``(3,)``."""
        poses, out = self.tables.poses, np.empty(4)
        sheet = self._told
        found.near(
            sheet.values, self.tables.layout.width, poses.index, poses.centres, poses.thetas,
            self.tables.frame, pose, radius, angle, out,
        )  # fmt: skip
        return float(out[0]) / self._divisor

    def at_shares(self, shares: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Cells and heading bins at ascending shares ``(N,)`` in [0, 1) of the mass."""
        place, heading = np.divmod(self._states_at(shares), self.tables.layout.width)
        return self.tables.poses.index.ravel()[place], heading

    def thinned(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Poses ``(m, 3)`` at n like shares of the mass, and how many of the n are at each."""
        states, grid = self._states_at((np.arange(n) + 0.5) / n), self.tables.poses
        poses, counts = np.empty((n, 3)), np.empty(n, dtype=np.int64)
        m = found.gather(
            states, self.tables.layout.width, grid.index.ravel(), grid.centres, grid.thetas,
            poses, counts,
        )  # fmt: skip
        return poses[:m], counts[:m]

    def _states_at(self, shares: NDArray[np.float64]) -> NDArray[np.int64]:
        """States at ascending shares ``(N,)`` in [0, 1) of the mass."""
        sheet, each = self._told, self._sums()
        if sheet.n == 0:
            raise ConfigError("a belief that holds nothing has no poses")
        states = np.empty(len(shares), dtype=np.int64)
        width = self.tables.layout.width
        found.at_shares(sheet.values, sheet.places, sheet.n, width, each, shares, states)
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
