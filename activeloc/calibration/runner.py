"""Replicates in one process or in several; the results do not depend on how many."""

from __future__ import annotations

import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

import numpy as np

from activeloc import checks
from activeloc.calibration.experiment import STARTS, Bench, Experiment, Outcome
from activeloc.calibration.report import Report

CHUNK = 25
MAX_REPLICATES = 10_000_000
MAX_JOBS = 256

Task = tuple[str, int, int]
Done = tuple[list[Outcome], float]


def calibrate(
    experiment: Experiment,
    replicates: int,
    tracks: int,
    jobs: int = 1,
    on_done: Callable[[str, int], None] = lambda start, n: None,
) -> Report:
    """Run an experiment.

    Args:
        experiment: What is replicated.
        replicates: How many start anywhere.
        tracks: How many start where the filter nearly knows; of these comes the NEES.
        jobs: Processes.
        on_done: Called with the start and the number of replicates that have been finished.

    Raises:
        ActiveLocError: If a setting is refused.
        ChildProcessError: If a process dies.
    """
    checks.integer("replicates", replicates, 100, MAX_REPLICATES)
    if tracks != 0:
        checks.integer("tracks", tracks, 100, MAX_REPLICATES)
    checks.integer("jobs", jobs, 1, MAX_JOBS)
    bench = Bench(experiment)
    bench.run(STARTS[0], 0)  # Every file of compiled kernels is there before workers look for it.
    wanted = dict(zip(STARTS, (replicates, tracks), strict=True))
    tasks = [
        (start, first, min(first + CHUNK, n))
        for start, n in wanted.items()
        for first in range(0, n, CHUNK)
    ]
    parts: dict[Task, list[Outcome]] = {}
    seconds = 0.0
    for task, (outcomes, spent) in _run_all(bench, tasks, jobs):
        parts[task] = outcomes
        seconds += spent
        on_done(task[0], len(outcomes))
    stacked = {
        start: _stacked([o for task in tasks if task[0] == start for o in parts[task]])
        for start, n in wanted.items()
        if n > 0
    }
    return Report(experiment, stacked, seconds)


def _stacked(outcomes: list[Outcome]) -> Outcome:
    """Outcomes with a leading axis of replicates; impossible scans added up."""
    return Outcome(
        np.stack([one.ranks for one in outcomes]),
        np.stack([one.mass for one in outcomes]),
        np.stack([one.right for one in outcomes]),
        np.stack([one.nees for one in outcomes]),
        sum(one.impossible for one in outcomes),
    )


def _run_all(bench: Bench, tasks: list[Task], jobs: int) -> Iterator[tuple[Task, Done]]:
    """Every task with its outcomes, in no order."""
    if jobs == 1:
        for task in tasks:
            yield task, _timed(bench, task)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        min(jobs, len(tasks)), context, initializer=_set_up, initargs=(bench.experiment,)
    )
    try:
        futures: dict[Future[Done], Task] = {}
        with _undisturbed():
            for task in tasks:
                futures[pool.submit(_run, task)] = task
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool:
        raise ChildProcessError("a worker process died; out of memory?") from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Processes started in here never see Ctrl-C: their parent ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_bench: Bench | None = None


def _set_up(experiment: Experiment) -> None:
    """Make this process's bench once, and the tables that its first replicate would wait for."""
    global _bench
    _bench = Bench(experiment)
    _bench.run(STARTS[0], 0)


def _run(task: Task) -> Done:
    assert _bench is not None
    return _timed(_bench, task)


def _timed(bench: Bench, task: Task) -> Done:
    start, first, last = task
    began = time.perf_counter()
    outcomes = [bench.run(start, i) for i in range(first, last)]
    return outcomes, time.perf_counter() - began
