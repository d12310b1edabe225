"""The last few steps of a cloud of particles, to be gone through again.

See :mod:`activeloc.beliefs.carried_off`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

REMEMBERED = 20
"""Scans."""
MOST_MOTIONS = 200
"""Between two scans that count; after more of them the past is forgotten."""


@dataclass(frozen=True, slots=True)
class Counted:
    """A scan, and how much it counts.

    Attributes:
        readings: ``(B,)``; bins, -1 for no reading.
        weights: ``(B,)`` in [0, 1].
    """

    readings: NDArray[np.int32]
    weights: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """What happened up to a scan, and with it.

    Attributes:
        w: Probability of having been carried off before.
        motions: Odometry readings ``(3,)``, and whether a contact that is news came with each.
        scan: What was read.
        log_kept: Log-evidence of all that for the particles that are kept.
    """

    w: float
    motions: tuple[tuple[NDArray[np.float64], bool], ...]
    scan: Counted
    log_kept: float


@dataclass(slots=True)
class Past:
    """The last steps of a cloud, since it was last one.

    Attributes:
        steps: At most ``REMEMBERED``, in which some reading counted.
        motions: Since then.
        w: Probability of having been carried off after them.
        log_kept: Logarithm of the kept particles' weight after them, as the cloud has it.
    """

    steps: list[Step] = field(default_factory=list)
    motions: list[tuple[NDArray[np.float64], bool]] = field(default_factory=list)
    w: float = 0.0
    log_kept: float = 0.0

    def moved(self, u: NDArray[np.float64], contact: bool) -> None:
        """Write down a motion."""
        self.motions.append((u, contact))
        if len(self.motions) > MOST_MOTIONS:
            self.steps, self.motions = [], []

    def read(self, scan: Counted, log_kept: float) -> None:
        """Write down a scan, and what the kept particles weigh after it."""
        if scan.weights.any():
            self.steps.append(Step(self.w, tuple(self.motions), scan, log_kept - self.log_kept))
            self.motions = []
            del self.steps[:-REMEMBERED]

    def copy(self) -> Past:
        """An independent copy."""
        return Past(list(self.steps), list(self.motions), self.w, self.log_kept)
