"""From episodes to scores with intervals.

Intervals are 95 % percentile bootstrap intervals over episodes (Efron & Tibshirani, *An
Introduction to the Bootstrap*, 1993, chapter 13), drawn from a fixed seed. Agents that played the
same episodes are resampled together, so a difference between two is one of pairs: the luck that
they share cancels.

Where every episode says the same, all right or none wrong, resampling has nothing to vary and would
claim certainty. A share of 0 or 1 gets the exact interval of the binomial instead (Clopper and
Pearson, 1934): none in n leaves up to ``1 - 0.025 ** (1 / n)`` open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.agents.evaluation.records import Record

COVERAGE = 0.95
RESAMPLES = 4000
SEED = 0

Columns = Mapping[str, NDArray[np.float64]]
Statistic = Callable[[Columns], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A score and its 95 % interval; NaN where there is none."""

    value: float
    low: float
    high: float


def _mean(name: str) -> Statistic:
    return lambda columns: columns[name].mean(axis=-1)


def _median(name: str) -> Statistic:
    return lambda columns: np.median(columns[name], axis=-1)


def _wrong_of_declared(columns: Columns) -> NDArray[np.float64]:
    wrong, right = columns["wrong"].sum(axis=-1), columns["success"].sum(axis=-1)
    nothing = np.full_like(wrong, np.nan)
    return np.divide(wrong, wrong + right, out=nothing, where=wrong + right > 0)


SCORES: dict[str, Statistic] = {
    "right": _mean("success"),
    "wrong": _mean("wrong"),
    "wrong_of_declared": _wrong_of_declared,
    "steps": _mean("steps"),
    "entropy_auc": _mean("entropy_auc"),
    "error_m": _median("error_m"),
    "error_rad": _median("error_rad"),
}
"""What is said of an agent: shares of right and of wrong-and-sure episodes, share of declarations
that were wrong, mean steps with failures at the limit, mean penalised area, median final errors."""

_SHARES = ("right", "wrong", "wrong_of_declared")
_COLUMNS = ("success", "wrong", "steps", "entropy_auc", "error_m", "error_rad")


def columns_of(records: Sequence[Record]) -> dict[str, NDArray[np.float64]]:
    """The records' numbers, each ``(n_episodes,)``, in order of the episodes."""
    ordered = sorted(records, key=lambda record: record.episode)
    return {name: np.array([float(getattr(r, name)) for r in ordered]) for name in _COLUMNS}


def estimates(columns: Columns) -> dict[str, Estimate]:
    """Each score of an agent.

    Args:
        columns: As :func:`columns_of` gives them, of at least one episode.
    """
    drawn = _resampled(columns)
    result = {}
    for name, score in SCORES.items():
        estimate = _estimate(float(score(columns)), drawn(score))
        n = len(columns["success"])
        if name == "wrong_of_declared":
            n = int(columns["success"].sum() + columns["wrong"].sum())
        result[name] = _opened(estimate, n) if name in _SHARES else estimate
    return result


def differences(columns: Columns, baseline: Columns) -> dict[str, Estimate]:
    """Each score less the baseline's, over the same episodes.

    But for ``wrong_of_declared``: no two agents declare in the same episodes.

    Args:
        columns: As :func:`columns_of` gives them.
        baseline: Of the other agent: the same episodes, in the same order.
    """
    drawn, drawn_baseline = _resampled(columns), _resampled(baseline)
    return {
        name: _estimate(
            float(score(columns)) - float(score(baseline)), drawn(score) - drawn_baseline(score)
        )
        for name, score in SCORES.items()
        if name != "wrong_of_declared"
    }


def _resampled(columns: Columns) -> Callable[[Statistic], NDArray[np.float64]]:
    """What a score is on each of the resamples: ``(RESAMPLES,)``, a few at a time."""
    n = len(columns["success"])
    block = max(1, 1_000_000 // n)

    def drawn(score: Statistic) -> NDArray[np.float64]:
        rng = np.random.default_rng(SEED)
        parts = []
        for first in range(0, RESAMPLES, block):
            chosen = rng.integers(n, size=(min(block, RESAMPLES - first), n))
            parts.append(score(_Chosen(columns, chosen)))
        return np.concatenate(parts)

    return drawn


class _Chosen(dict[str, NDArray[np.float64]]):
    """Columns of resampled episodes, each taken when it is asked for."""

    def __init__(self, columns: Columns, chosen: NDArray[np.int64]) -> None:
        super().__init__()
        self._columns, self._chosen = columns, chosen

    def __missing__(self, name: str) -> NDArray[np.float64]:
        return self._columns[name][self._chosen]


def _estimate(value: float, drawn: NDArray[np.float64]) -> Estimate:
    """The percentile interval, over the resamples in which the score exists."""
    exists = drawn[~np.isnan(drawn)]
    if np.isnan(value) or not len(exists):
        return Estimate(float("nan"), float("nan"), float("nan"))
    tail = 50.0 * (1.0 - COVERAGE)
    low, high = np.percentile(exists, [tail, 100.0 - tail])
    return Estimate(value, float(low), float(high))


def _opened(share: Estimate, n: int) -> Estimate:
    """A share of 0 or 1 among n, with the exact interval of the binomial."""
    reach = 1.0 - (0.5 * (1.0 - COVERAGE)) ** (1.0 / max(n, 1))
    if share.value == 0.0:
        return Estimate(0.0, 0.0, reach)
    if share.value == 1.0:
        return Estimate(1.0, 1.0 - reach, 1.0)
    return share
