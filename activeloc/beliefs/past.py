"""The last few steps of a belief, to be gone through again for the background.

While the chance of being elsewhere is one number, nobody asks where that would be; but scans from
one place support each other, and a belief widened by the last of them alone would have forgotten
the others. So what was done to the listed cells is written down, and how well they explained it.
When the belief widens, the background alone goes through the same steps over all cells: the
uniform it was at the first, and what leaked in at each. That is the leak laid out in every state,
done late, for as many steps as are remembered.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp, inf, log

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_tables import GridTables
from activeloc.beliefs.scan_likelihood import ScanLikelihood

REMEMBERED = 20  # Steps.


@dataclass(frozen=True, slots=True)
class Turn:
    """A rotation: :meth:`GridBelief.rotate`'s arguments."""

    first: int
    taps: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Travelled:
    """A travel of ``level`` half cells, one of ``hops``; the local part kept ``left`` of one."""

    level: int
    hops: int
    floor: float
    left: float


@dataclass(frozen=True, slots=True)
class Touched:
    """A contact, felt with probability ``floor`` without an obstacle; ``left`` as above."""

    floor: float
    left: float


@dataclass(frozen=True, slots=True)
class Leaked:
    """The robot may have been carried off, with probability ``leak``."""

    leak: float


@dataclass(frozen=True, slots=True)
class Absorbed:
    """The list of cells dropped all but ``kept`` of its mass, which is background since."""

    kept: float


@dataclass(frozen=True, slots=True)
class Read:
    """A scan and its log-evidence in the local part."""

    likelihood: ScanLikelihood
    log_local: float


Event = Turn | Travelled | Touched | Leaked | Absorbed | Read


@dataclass(slots=True)
class Past:
    """What happened to a belief since it was last laid out, at most ``REMEMBERED`` steps back.

    Attributes:
        steps: Of each step, the weight of the background at its start, and what happened.
    """

    steps: list[tuple[float, list[Event]]] = field(default_factory=list)

    def begin(self, w: float) -> None:
        """A step begins."""
        self.steps.append((w, []))
        del self.steps[:-REMEMBERED]

    def add(self, event: Event) -> None:
        """Write something down."""
        self.steps[-1][1].append(event)

    def copy(self) -> Past:
        """An independent copy."""
        return Past([(w, list(events)) for w, events in self.steps])

    def relive(self, tables: GridTables) -> tuple[GridBelief, float, float]:
        """The background after all of it.

        Args:
            tables: Of the map.

        Returns:
            The background, the local part's mass, and the last event's log-evidence in both
            together; the masses sum to one. If nothing explains a scan, nothing, 0 and -inf.
        """
        replay = _Replay(tables, self.steps[0][0])
        evidence = 0.0
        for _, events in self.steps:
            for event in events:
                evidence = replay.apply(event)
                if evidence == -inf:
                    replay.bel.drop()
                    return GridBelief(tables), 0.0, -inf
        return replay.bel, replay.here, evidence


class _Replay:
    """The background, laid out, and what the local part weighs against it."""

    def __init__(self, tables: GridTables, w: float) -> None:
        self.bel = GridBelief(tables, tables.everywhere)
        self.bel.scale(w)
        self.here = 1.0 - w

    def apply(self, event: Event) -> float:
        """Carry out one event; returns its log-evidence in both parts."""
        bel = self.bel
        match event:
            case Turn(first, taps):
                bel.rotate(first, taps)
            case Leaked(leak):
                bel.add_uniform(1.0 - leak, leak)
                self.here *= 1.0 - leak
            case Absorbed(kept):
                bel.add_uniform(1.0, self.here * (1.0 - kept))
                self.here *= kept
            case Travelled(level, hops, floor, left):
                return self._weigh(bel.travel(level, hops, floor), left)
            case Touched(floor, left):
                return self._weigh(bel.touch(floor), left)
            case Read(likelihood, log_local):
                total, shift = bel.read(likelihood)
                if total == 0.0:
                    bel.scale(0.0)
                    shift = log_local
                if shift == -inf:
                    return -inf
                # What some state of the background explains best, the local part's mean cannot
                # surpass: this exponential does not overflow.
                return shift + self._weigh(total, exp(log_local - shift))
        return 0.0

    def _weigh(self, there: float, local: float) -> float:
        """Bring both parts back to one; returns the logarithm of what they were.

        Args:
            there: The background's mass.
            local: Probability of the evidence in the local part.
        """
        here = self.here * local
        if there + here == 0.0:
            return -inf
        self.bel.scale(1.0 / (there + here))
        self.here = here / (there + here)
        return log(there + here)
