"""Noticing that the robot is not where the belief says.

*Background.* The belief is a mixture: with probability ``1 - w`` what the filter keeps, with
probability w a uniform over the open ground, for a robot that has been carried off, or was lost by
the filter. Each step carries the robot off with probability ``leak``; each scan weighs the two by
their evidence. That is Bayes' rule for the mixture, with one approximation: what earlier scans said
of the background is kept as a number and not place by place. Once w is large enough, the
background is drawn as particles (or cells) weighed by the scan, and w begins again at zero.

*Augmented MCL.* The heuristic of *Probabilistic Robotics* (2005), table 8.3: a slow and a fast
running mean of the scans' likelihood; where the fast one falls below the slow, as large a share of
the particles as it has fallen is drawn anew, from the open ground or from the scan's own likelihood
(sensor resetting, Lenser and Veloso, ICRA 2000). The likelihood is the geometric mean over the
readings that count: a scan of one reading is a likelier scan than one of ten, and says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def background_after(w: float, leak: float, log_uniform: float, log_local: float) -> float:
    """Weight of the background after a step and a scan.

    Args:
        w: Before.
        leak: Probability of being carried off in the step.
        log_uniform: Log-evidence of the scan under the uniform belief.
        log_local: Under what the filter keeps; -inf where it cannot explain the scan.

    Returns:
        In [0, 1]; unchanged if neither explains the scan.
    """
    w = w + leak * (1.0 - w)
    if w == 0.0 or log_uniform == -np.inf:
        return 0.0 if log_local > -np.inf else w
    if log_local == -np.inf or w == 1.0:
        return 1.0
    log_odds = np.log1p(-w) - np.log(w) + (log_local - log_uniform)
    return float(1.0 / (1.0 + np.exp(np.clip(log_odds, -700.0, 700.0))))


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
