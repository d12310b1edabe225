"""Timing in turns: ours, theirs, ours, theirs.

One thread's work is counted in CPU time of the calling thread, which other processes do not
lengthen; threads' in seconds of the wall. A call too short for the clock is repeated until it is
not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Call = Callable[[], Any]
SHORTEST = 2e-3
"""Least time of what the clock is read around [s]."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A call that finds things as another call, which is not timed, has left them.

    Attributes:
        prepare: Not timed.
        call: Timed.
    """

    prepare: Call
    call: Call


def seconds_of(
    call: Call | Prepared, clock: Callable[[], float] = time.thread_time, times: int = 1
) -> float:
    """Seconds of one call, the mean of ``times``."""
    if isinstance(call, Prepared):
        spent = 0.0
        for _ in range(times):
            call.prepare()
            spent += seconds_of(call.call, clock)
        return spent / times
    begun = clock()
    for _ in range(times):
        call()
    return (clock() - begun) / times


def alternate(
    calls: Mapping[str, Call | Prepared],
    *,
    budget: float,
    rounds: tuple[int, int] = (5, 41),
    clock: Callable[[], float] = time.thread_time,
    warm_up: bool = True,
) -> dict[str, NDArray[np.float64]]:
    """Seconds of each call, round by round; each round has them all, in turns.

    A first call of each is not counted: it compiles, and warms the caches.

    Args:
        calls: By name.
        budget: About how long all of it may take [s of the clock].
        rounds: Fewest and most rounds.
        clock: CPU time of the calling thread, or ``time.perf_counter`` for threads.
        warm_up: Whether each is called once before.

    Returns:
        By name, ``(rounds,)``.
    """
    first = {}
    for name, call in calls.items():
        if warm_up:
            seconds_of(call, clock)
        first[name] = max(seconds_of(call, clock), 1e-8)
    times = {name: max(1, int(np.ceil(SHORTEST / once))) for name, once in first.items()}
    a_round = sum(first[name] * times[name] for name in calls)
    n = int(np.clip(budget / a_round, *rounds))
    # A round of calls that are long enough as they are has been made already.
    seconds = {name: [once] if max(times.values()) == 1 else [] for name, once in first.items()}
    while min(map(len, seconds.values())) < n:
        for name, call in calls.items():
            seconds[name].append(seconds_of(call, clock, times[name]))
    return {name: np.array(values) for name, values in seconds.items()}
