"""One robot's belief on a grid, and how it moves: the prediction of the histogram filter.

The belief is ``(1 - w) bel + w uniform`` (:mod:`activeloc.beliefs.background`). Turns and travels
too small for the grid are added up until they count; what happens is written down
(:mod:`activeloc.beliefs.past`) for the background, should it have to be laid out.
"""

from __future__ import annotations

from copy import copy
from math import erfc, exp, log, pi, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.beliefs.background import elsewhere_after
from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.past import Absorbed, Leaked, Past, Touched, Travelled, Turn
from activeloc.beliefs.place import PlaceMemory
from activeloc.beliefs.settings import HistogramConfig
from activeloc.motion import SLIP_ANGLE, SLIP_TRAVEL, MotionNoise

# A belief that lists more than this share of the cells is spared the mass that a slip brings.
SPARSE = 0.25


@njit(cache=True, nogil=True)
def turn_taps(turn: float, sigma: float, bin_width: float) -> tuple[int, NDArray[np.float64]]:
    """Where a rotation takes the mass of a heading bin: first shift [bin] and weights.

    Starting uniform in its bin, the heading turns by ``turn`` with a Gaussian error; the weights
    are exact integrals over both.
    """
    spread = 5.0 * sigma + bin_width
    first = int(np.floor((turn - spread) / bin_width))
    last = int(np.ceil((turn + spread) / bin_width))
    ramp = np.empty(last - first + 3)
    for i in range(ramp.shape[0]):
        edge = (first - 1 + i) * bin_width - turn
        if sigma > 0.0:
            density = exp(-0.5 * (edge / sigma) ** 2) / sqrt(2.0 * pi)
            ramp[i] = 0.5 * edge * erfc(-edge / (sigma * sqrt(2.0))) + sigma * density
        else:
            ramp[i] = max(edge, 0.0)
    taps = (ramp[2:] - 2.0 * ramp[1:-1] + ramp[:-2]) / bin_width
    kept = np.flatnonzero(taps > 1e-7)
    taps = taps[kept[0] : kept[-1] + 1]
    return first + kept[0], taps / taps.sum()


def _hops(levels: int, longest: int) -> list[int]:
    """A travel of ``levels`` half cells as few, nearly equal travels of at most ``longest``."""
    if levels == 0:
        return []
    n = -(-abs(levels) // longest)
    sign = 1 if levels > 0 else -1
    return [sign * (abs(levels) // n + (i < abs(levels) % n)) for i in range(n)]


class Track:
    """One robot's belief and what is carried over between its steps.

    Args:
        tables: Of the map.
        config: Of the filter.
        bel: The belief, taken over.

    Attributes:
        elsewhere: w; 0 if the background is not one number.
        noticed: How many times the belief has widened, and
        has_widened: whether it did at the last scan.
        has_news: Whether the last scan told anything. One that reads again what was read at this
            place does not, and would not tell either that the robot is still there: it does not
            leak while it waits.
        left_over: A turn [rad], a travel [m] and a heading variance too small to count yet.
        place: What the robot has read and touched where it stands.
        past: What happened to the belief.
    """

    def __init__(self, tables: GridTables, config: HistogramConfig, bel: GridBelief) -> None:
        self.tables = tables
        self.config = config
        self.bel = bel
        self.elsewhere = 0.0
        self.noticed = 0
        self.has_widened = False
        self.has_news = True
        self.left_over = [0.0, 0.0, 0.0]
        self.place = PlaceMemory(config.sectors, config.place_size, config.repetition)
        self.past = Past()

    @property
    def carries_background(self) -> bool:
        """Whether the chance of being elsewhere is one number, and not in every state."""
        return self.config.leak > 0.0 and self.config.least > 0.0

    def copy(self) -> Track:
        """An independent copy."""
        twin = copy(self)
        twin.bel, twin.place, twin.past = self.bel.copy(), self.place.copy(), self.past.copy()
        twin.left_over = list(self.left_over)
        return twin

    def live_share(self) -> float:
        """Share of the cells that hold any mass."""
        n = len(self.tables.layout.place)
        return self.bel.cells_held() / n

    def predict(self, u: NDArray[np.float64], noise: MotionNoise, touched: bool) -> None:
        """See :meth:`HistogramBelief.predict`."""
        self.past.begin(self.elsewhere)
        first, trans, last = float(u[0]), float(u[1]), float(u[2])
        slips, was = any((first, trans, last)) and self._is_slipping(), None
        if slips:
            self.bel.settle()
            was = self.bel.turned(*self._spread(first + last)) if trans != 0.0 else None
        bend = noise.rotation_from_translation * abs(trans)
        self._turn(first, (noise.rotation_from_rotation * first) ** 2)
        self._travel(trans)
        # The first rotation's share of the travel's heading noise is in the stencil's reach; its
        # share of the final heading is added here, in one convolution with the second's.
        self._turn(last, (noise.rotation_from_rotation * last) ** 2 + 2.0 * bend**2)
        if was is not None:
            self._slip(was, trans)
            was.drop()
        elif slips:
            self.bel.mix_turned(self.config.slip, *self._spread(first + last))
        self.place.move(u)
        if touched and self.place.refuse() and self.config.contact_floor < 1.0:
            self._touch(self.config.contact_floor)
        if self.config.leak > 0.0 and self.has_news:
            self._leak(self.config.leak)

    def _is_slipping(self) -> bool:
        """Whether some of the mass is not to take the odometry at its word.

        A belief that is all over the map has the mass that a slip would bring there already.
        """
        if self.config.slip == 0.0:
            return False
        most = SPARSE * len(self.tables.layout.place)
        return self.bel.cells_held() <= most

    def _spread(self, turn: float) -> tuple[int, int]:
        """Turns that a badly wrong reading may stand for, alike: first [bin], and how many.

        See :func:`activeloc.motion.slipped`.
        """
        width = self.tables.poses.bin_width
        reach = round(SLIP_ANGLE / width)
        return round(turn / width) - reach, 2 * reach + 1

    def _slip(self, was: GridBelief, trans: float) -> None:
        """Mix in what a badly wrong reading of a travel may stand for.

        Of its travels only two: none, and half a metre the way that was read.

        Args:
            was: The belief before, turned as it may have been; overwritten.
            trans: Read [m].
        """
        share = self.config.slip
        self.bel.divide(1.0 / (1.0 - share))
        self.bel.add(was, 0.5 * share)
        travel = self.tables.travel
        level = min(round(SLIP_TRAVEL / travel.step), travel.longest_level)
        was.travel(level if trans > 0.0 else -level, 1, 1.0)
        self.bel.add(was, 0.5 * share)

    def _turn(self, turn: float, variance: float) -> None:
        """Rotate; turns and noise too small for the grid are added up until they count."""
        self.left_over[0] += turn
        self.left_over[2] += variance
        width = self.tables.poses.bin_width
        counts = abs(self.left_over[0]) >= 0.5 * width
        sigma = self.left_over[2] ** 0.5
        if not counts and sigma < 0.2 * width:
            return
        self.left_over[2] = 0.0
        first, taps = turn_taps(self.left_over[0] if counts else 0.0, sigma, width)
        if counts:
            self.left_over[0] = 0.0
        self.bel.rotate(first, taps)
        if self.carries_background:
            self.past.add(Turn(first, taps))

    def _travel(self, trans: float) -> None:
        """Travel in half cells; the remainder is carried over."""
        travel, floor = self.tables.travel, self.config.odometry_floor
        self.left_over[1] += trans
        levels = round(self.left_over[1] / travel.step)
        self.left_over[1] -= levels * travel.step
        hops = _hops(levels, travel.longest_level)
        for level in hops:
            left = self.bel.travel(level, len(hops), floor)
            if self.carries_background:
                elsewhere = self.tables.background.travel(abs(level), len(hops), floor)
                self.elsewhere = elsewhere_after(self.elsewhere, log(elsewhere), log(left))
                self.past.add(Travelled(level, len(hops), floor, left))
            self.bel.divide(left)

    def _touch(self, floor: float) -> None:
        """Weigh by a contact."""
        left = self.bel.touch(floor)
        if self.carries_background:
            elsewhere = self.tables.background.contact(floor)
            self.elsewhere = elsewhere_after(self.elsewhere, log(elsewhere), log(left))
            self.past.add(Touched(floor, left))
        self.normalise(left)

    def _leak(self, leak: float) -> None:
        """Let the robot be carried off: in one number, or state by state if all are updated."""
        if self.carries_background:
            self.elsewhere += leak * (1.0 - self.elsewhere)
            self.past.add(Leaked(leak))
        else:
            self.bel.add_uniform(1.0 - leak, leak)

    def normalise(self, total: float) -> None:
        """Bring the belief, whose sum is ``total``, back to one; small states become background."""
        least = self.config.least
        if self.carries_background:
            # A state with less than a step's leak brings to it is background, and counts there.
            layout = self.tables.layout
            least = max(least, self.config.leak / (layout.headings * len(layout.place)))
        kept = self.bel.normalise(total, least)
        if self.carries_background:
            self.elsewhere += (1.0 - self.elsewhere) * (1.0 - kept)
            if kept < 1.0 and self.past.steps:
                self.past.add(Absorbed(kept))
