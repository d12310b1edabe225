"""The running means of augmented Monte Carlo localization.

The heuristic of Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), table 8.3: a slow and a fast
running mean of the scans' likelihood; where the fast one falls below the slow, as large a share of
the particles as it has fallen is drawn anew, from the open ground or from the scan's own likelihood
(sensor resetting, Lenser and Veloso, ICRA 2000). The likelihood is the geometric mean over the
readings that count: a scan of one reading is a likelier scan than one of ten, and says nothing.
Bayes' rule does it without a heuristic: :mod:`activeloc.beliefs.carried_off`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class RunningMeans:
    """w_slow and w_fast of augmented MCL.

    Attributes:
        alpha_slow: Rate of the slow mean, in (0, 1].
        alpha_fast: Rate of the fast mean, at least ``alpha_slow``.
        slow: w_slow; zero before the first scan.
        fast: w_fast.
    """

    alpha_slow: float
    alpha_fast: float
    slow: float = 0.0
    fast: float = 0.0

    def add(self, likelihood: float) -> float:
        """Take in a scan's mean likelihood; returns the share of particles to draw anew.

        The first scan sets both means.
        """
        if self.slow == 0.0:
            self.slow = self.fast = likelihood
            return 0.0
        self.slow += self.alpha_slow * (likelihood - self.slow)
        self.fast += self.alpha_fast * (likelihood - self.fast)
        return max(0.0, 1.0 - self.fast / self.slow) if self.slow > 0.0 else 0.0
