"""Processes that play episodes, and what they are given next.

A unit of work is one episode with all its agents. What is computed once for a map (tables that take
longer than an episode) stays with the process that computed it: a free worker goes on with its own
map while that has episodes left, then takes the map that the fewest others are at.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from activeloc.agents.evaluation.episodes import Player
from activeloc.agents.evaluation.records import Record
from activeloc.agents.evaluation.sweep import Sweep


@dataclass(frozen=True, slots=True)
class Unit:
    """An episode that some agents have still to play."""

    map_number: int
    episode: int
    agents: tuple[str, ...]


@dataclass(slots=True)
class _Worker:
    process: BaseProcess
    connection: Connection
    map_number: int | None = None


def play_here(player: Player, units: Sequence[Unit]) -> Generator[Record, None, None]:
    """Play in this process; map after map."""
    for unit in sorted(units, key=lambda unit: (unit.map_number, unit.episode)):
        for agent in unit.agents:
            yield player.play(agent, unit.episode)


def play_in_processes(
    sweep: Sweep, units: Sequence[Unit], jobs: int
) -> Generator[Record, None, None]:
    """Play in ``jobs`` new processes; records come as episodes end, in no order.

    Raises:
        ChildProcessError: If a process dies.
        Exception: What an episode raised, in whichever process.
    """
    waiting: dict[int, deque[Unit]] = {}
    for unit in sorted(units, key=lambda unit: unit.episode):
        waiting.setdefault(unit.map_number, deque()).append(unit)
    workers: list[_Worker] = []
    try:
        with _undisturbed():
            workers.extend(_start(sweep) for _ in range(min(jobs, len(units))))
        busy = {worker.connection: worker for worker in workers}
        for worker in workers:
            worker.connection.send(_next(waiting, worker, workers))
        while busy:
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                answer = _answer(worker)
                if isinstance(answer, Exception):
                    raise answer
                if isinstance(answer, Record):
                    yield answer
                elif waiting:
                    worker.connection.send(_next(waiting, worker, workers))
                else:
                    del busy[worker.connection]
    finally:
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join()
            worker.connection.close()


def _start(sweep: Sweep) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, sweep), daemon=True)
    process.start()
    theirs.close()
    return _Worker(process, ours)


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


def _next(waiting: dict[int, deque[Unit]], worker: _Worker, workers: Sequence[_Worker]) -> Unit:
    """Take the unit that a free worker should play."""
    if worker.map_number not in waiting:
        others = [other.map_number for other in workers if other is not worker]
        worker.map_number = min(waiting, key=lambda number: (others.count(number), number))
    assert worker.map_number is not None
    units = waiting[worker.map_number]
    unit = units.popleft()
    if not units:
        del waiting[worker.map_number]
    return unit


def _answer(worker: _Worker) -> Record | Exception | None:
    try:
        answer: Record | Exception | None = worker.connection.recv()
    except (EOFError, ConnectionError):
        worker.process.join()
        raise ChildProcessError(
            f"a worker process died (exit code {worker.process.exitcode}); out of memory? "
            "Finished episodes are kept"
        ) from None
    return answer


def _work(connection: Connection, sweep: Sweep) -> None:
    """A worker's life until its parent is gone: units in; records out, and None after each unit."""
    player = Player(sweep)
    with suppress(EOFError, ConnectionError):
        while True:
            unit = connection.recv()
            for agent in unit.agents:
                connection.send(_played(player, agent, unit.episode))
            connection.send(None)


def _played(player: Player, agent: str, episode: int) -> Record | Exception:
    try:
        return player.play(agent, episode)
    except Exception as error:
        return error
