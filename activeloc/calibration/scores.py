"""From replicates to p-values, shares and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

BINS = 20
LEVELS = (0.5, 0.8, 0.95, 0.99)
THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
LEAST_P = 1e-4  # Under this a filter counts as not calibrated; four quantities, two tests each.
CONFIDENCE = 0.999  # Of the interval for the NEES.


@dataclass(frozen=True, slots=True)
class Uniformity:
    """Whether ranks are uniform.

    Attributes:
        counts: ``(20,)``; ranks in each twentieth.
        chi2_p: Of Pearson's chi-square on the counts.
        ks_p: Of Kolmogorov and Smirnov's test.
        mean: Of the ranks; .5 if they are uniform.
    """

    counts: NDArray[np.int64]
    chi2_p: float
    ks_p: float
    mean: float

    @property
    def p(self) -> float:
        """The smaller of the two."""
        return min(self.chi2_p, self.ks_p)


def uniformity(ranks: NDArray[np.float64]) -> Uniformity:
    """Test ranks ``(R,)`` in [0, 1]."""
    counts = np.histogram(ranks, bins=BINS, range=(0.0, 1.0))[0].astype(np.int64)
    return Uniformity(
        counts,
        float(stats.chisquare(counts).pvalue),
        float(stats.kstest(ranks, "uniform").pvalue),
        float(ranks.mean()),
    )


@dataclass(frozen=True, slots=True)
class Share:
    """A share among n, what was promised, and the exact 95 % interval (Clopper & Pearson, 1934)."""

    promised: float
    n: int
    k: int

    @property
    def value(self) -> float:
        """The share, k of n; NaN of none."""
        return self.k / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end; all there is, of none."""
        if self.n == 0:
            return 0.0, 1.0
        low, high = stats.binomtest(self.k, self.n).proportion_ci(0.95, "exact")
        return float(low), float(high)


def coverage(ranks: NDArray[np.float64]) -> list[Share]:
    """Share of truths in the set of highest probability, for each of the levels.

    The rank u of the truth's own probability is one less the size of the smallest set that holds
    it (its edge randomised, so that the promise is exact for states as well).

    Args:
        ranks: ``(R,)``; of the posterior probability.
    """
    return [Share(p, len(ranks), int((1.0 - ranks <= p).sum())) for p in LEVELS]


def declarations(
    mass: NDArray[np.float64], right: NDArray[np.bool_], thresholds: Sequence[float] = THRESHOLDS
) -> list[Share]:
    """Share wrong among those who declare when first so sure, for each threshold.

    What is promised is the mean of one less the belief at that moment.

    Args:
        mass: ``(R, T + 1)``; belief near the estimate.
        right: ``(R, T + 1)``; whether the truth was there.
        thresholds: At which to declare.
    """
    result = []
    for threshold in thresholds:
        sure = mass >= threshold
        runs = np.flatnonzero(sure.any(axis=1))
        first = sure[runs].argmax(axis=1)
        promised = 1.0 - mass[runs, first].mean() if len(runs) else float("nan")
        wrong = int((~right[runs, first]).sum())
        result.append(Share(float(promised), len(runs), wrong))
    return result


@dataclass(frozen=True, slots=True)
class Nees:
    """Mean of the normalised squared errors, and the interval that holds 99.9 % of such means.

    Attributes:
        mean: Over the runs.
        low: Lower end for errors that are Gaussian: chi-square with 3 n degrees of freedom.
        high: Upper end.
        reach: How far from 3 the mean may lie by the scatter that the beliefs themselves expect;
            farther than ``high`` where they have tails.
    """

    mean: float
    low: float
    high: float
    reach: float

    @property
    def holds(self) -> bool:
        """Whether the mean is one that the beliefs allow."""
        return self.low <= self.mean <= self.high or abs(self.mean - 3.0) <= self.reach


def nees(values: NDArray[np.float64], variances: NDArray[np.float64]) -> Nees:
    """The mean of ``(R,)`` errors of three dimensions, from their variances under the beliefs."""
    n, tail = len(values), 0.5 * (1.0 - CONFIDENCE)
    low, high = stats.chi2.ppf([tail, 1.0 - tail], 3 * n) / n
    reach = -stats.norm.ppf(tail) * np.sqrt(variances.mean() / n)
    return Nees(float(values.mean()), float(low), float(high), float(reach))
