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
from typing import Any

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
    return _ratio(wrong, wrong + right)


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

MAZE_SCORES: dict[str, Statistic] = {
    "right": _mean("success"),
    "likeliest": _mean("likeliest"),
    "wrong": _mean("wrong"),
    "return": _mean("total_reward"),
    "steps": _mean("steps"),
    "entropy_auc": _mean("entropy_auc"),
}
"""What is said of an agent in mazes: shares of episodes in which the belief was certain and right,
had its peak at the truth, and was sure and wrong; mean returns, steps and areas."""


def _of_kidnapped(has: str) -> Statistic:
    """Share of the episodes with a kidnapping in which a time is not -1."""

    def share(columns: Columns) -> NDArray[np.float64]:
        return _ratio((columns[has] >= 0).sum(axis=-1), columns["kidnapped"].sum(axis=-1))

    return share


def _mean_time(name: str) -> Statistic:
    """Mean of a time over the episodes that have it."""

    def mean(columns: Columns) -> NDArray[np.float64]:
        has = columns[name] >= 0
        return _ratio(np.where(has, columns[name], 0.0).sum(axis=-1), has.sum(axis=-1))

    return mean


def _ratio(above: NDArray[Any], below: NDArray[Any]) -> NDArray[np.float64]:
    """Quotients; NaN where there is nothing to divide by."""
    nothing = np.full(np.shape(below), np.nan)
    return np.divide(above, below, out=nothing, where=np.asarray(below) > 0)


KIDNAP_SCORES: dict[str, Statistic] = {
    "noticed": _of_kidnapped("notice_steps"),
    "recovered": _of_kidnapped("recover_steps"),
    "notice_steps": _mean_time("notice_steps"),
    "recover_steps": _mean_time("recover_steps"),
    "false_alarm": _mean("false_alarm"),
}
"""What is said besides of a kidnapped robot: shares of the kidnappings that it noticed and that it
recovered from, mean steps until then over those, share of all episodes with a false alarm before
any kidnapping."""

_SHARES = (
    *("right", "likeliest", "wrong", "wrong_of_declared"),
    *("noticed", "recovered", "false_alarm"),
)
_COLUMNS = (
    *("success", "wrong", "steps", "entropy_auc", "error_m", "error_rad"),
    *("kidnapped", "notice_steps", "recover_steps", "false_alarm"),
    *("likeliest", "total_reward"),
)


def gain_columns(records: Sequence[Record]) -> dict[str, NDArray[np.float64]]:
    """Gains summed over each episode, ``(n_episodes,)``: how many, expected and realised [nat]."""
    sums = [
        (len(r.gains), sum(e for e, _ in r.gains), sum(g for _, g in r.gains))
        for r in sorted(records, key=lambda record: record.episode)
    ]
    names = ("walks", "expected", "realised")
    return dict(zip(names, np.array(sums, dtype=np.float64).T, strict=True))


def _per_walk(name: str) -> Statistic:
    return lambda columns: _ratio(columns[name].sum(axis=-1), columns["walks"].sum(axis=-1))


GAIN_SCORES: dict[str, Statistic] = {
    "expected_gain": _per_walk("expected"),
    "realised_gain": _per_walk("realised"),
    "earned": lambda c: _ratio(c["realised"].sum(axis=-1), c["expected"].sum(axis=-1)),
}
"""What is said of a planner's expectations: means over all walks [nat] and what it earned of what
it expected, resampled by whole episodes."""


def columns_of(records: Sequence[Record]) -> dict[str, NDArray[np.float64]]:
    """The records' numbers, each ``(n_episodes,)``, in order of the episodes."""
    ordered = sorted(records, key=lambda record: record.episode)
    return {name: np.array([float(getattr(r, name)) for r in ordered]) for name in _COLUMNS}


def estimates(columns: Columns, scores: Mapping[str, Statistic] = SCORES) -> dict[str, Estimate]:
    """Each score of an agent.

    Args:
        columns: As :func:`columns_of` gives them, of at least one episode.
        scores: Which.
    """
    drawn = _resampled(columns)
    result = {}
    for name, score in scores.items():
        estimate = _estimate(float(score(columns)), drawn(score))
        result[name] = _opened(estimate, _among(name, columns)) if name in _SHARES else estimate
    return result


def _among(share: str, columns: Columns) -> int:
    """How many episodes a share is of."""
    if share == "wrong_of_declared":
        return int(columns["success"].sum() + columns["wrong"].sum())
    if share in ("noticed", "recovered"):
        return int(columns["kidnapped"].sum())
    return len(columns["success"])


def differences(
    columns: Columns, baseline: Columns, scores: Mapping[str, Statistic] = SCORES
) -> dict[str, Estimate]:
    """Each score less the baseline's, over the same episodes.

    But for ``wrong_of_declared``: no two agents declare in the same episodes.

    Args:
        columns: As :func:`columns_of` gives them.
        baseline: Of the other agent: the same episodes, in the same order.
        scores: Which.
    """
    drawn, drawn_baseline = _resampled(columns), _resampled(baseline)
    return {
        name: _estimate(
            float(score(columns)) - float(score(baseline)), drawn(score) - drawn_baseline(score)
        )
        for name, score in scores.items()
        if name != "wrong_of_declared"
    }


def _resampled(columns: Columns) -> Callable[[Statistic], NDArray[np.float64]]:
    """What a score is on each of the resamples: ``(RESAMPLES,)``, a few at a time."""
    n = len(next(iter(columns.values())))
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
