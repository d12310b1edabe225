"""Filters on a recorded run, from many scans and seeds: ``python -m benchmarks.recorded LOG MAP``.

From each start the filter runs to the log's end, knowing nothing at first; it is right by
``activeloc.replay.RULE``. Kidnapped: it runs from 60 scans before a cut, is carried at least 10 m
(a cut leaves out as many scans as that takes), and must be localized again within 50 scans; with
the filter's recovery as it is by default, and without. The deadline matters: a cloud that is lost
spreads, and without any recovery chances on the robot some hundred scans later.

Times are processor times of one process, so that what else the machine does is left out. Each
process makes the tables of the map once: "seconds" are those of a run with the tables there,
"tables" what a first run takes beyond a second one, compilation included. Times faster counts both,
as if each run were the only one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from math import degrees
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import activeloc
from activeloc.beliefs.settings import ParticleConfig
from activeloc.cli.settings import parse_settings
from activeloc.errors import ActiveLocError
from activeloc.files import write_atomically
from activeloc.logs import Recording, read_log
from activeloc.maps import MapSource
from activeloc.replay import RULE, Clock, Replay, ReplayConfig, after, score

LEAD = 60  # Scans before a cut, in which the filter finds itself.
LEAST_CUT = 10
CARRIED_M = 10.0
DEADLINE = 50  # Scans after the cut.


@dataclass(frozen=True)
class Task:
    """One run."""

    belief: str
    kind: str  # start, kidnapped, no recovery
    first: int
    cut: tuple[int, int] | None
    seed: int


@dataclass(frozen=True)
class Result:
    """How one run went; ``to_localize`` counts from the start, or from the end of the cut."""

    task: Task
    right: bool
    right_before: bool
    median_m: float
    median_deg: float
    to_localize: int | None
    scans: int
    recorded: float
    seconds: float
    wall: float
    tables: float

    @property
    def recovered(self) -> bool:
        """Whether it was localized again in time."""
        return self.to_localize is not None and self.to_localize <= DEADLINE


class _Worker:
    """What a process keeps between runs."""

    def __init__(self, log: str, map_spec: str, settings: Sequence[str]) -> None:
        self.recording = read_log(log)
        self.grid = MapSource.parse(map_spec).number(0)
        self.settings = list(settings)
        self.tables: dict[str, float] = {}

    def config(self, task: Task) -> ReplayConfig:
        config = ReplayConfig.of(task.belief, parse_settings(self.settings))
        if task.kind != "no recovery":
            return config
        if isinstance(config.belief, ParticleConfig):
            return replace(config, belief=replace(config.belief, leak=0.0, recovery="none"))
        return replace(config, belief=replace(config.belief, leak=0.0))

    def run(self, task: Task) -> Result:
        recording = self.recording if task.cut is None else self.recording.cut(*task.cut)
        recording = recording.from_scan(task.first)
        prepared = Replay(recording, self.grid, self.config(task))
        key = f"{task.belief} {prepared.config}"
        if key not in self.tables:
            self.tables[key] = self._warm(prepared, task)
        clock = Clock()
        rows = list(prepared.rows(task.seed))
        wall, processor = clock.read()
        judged = rows if task.cut is None else after(rows, task.cut[1])
        before = rows[: len(rows) - len(judged)]
        verdict = score(judged)
        return Result(
            task=task,
            right=verdict.right,
            right_before=not before or score(before).right,
            median_m=verdict.median_m,
            median_deg=degrees(verdict.median_rad),
            to_localize=verdict.localized_at,
            scans=len(rows),
            recorded=recording.seconds,
            seconds=processor,
            wall=wall,
            tables=self.tables[key],
        )

    def _warm(self, prepared: Replay, task: Task) -> float:
        """Processor time that a first run takes beyond a second one [s]: tables and compilation."""
        times = []
        for _ in range(2):
            clock = Clock()
            list(prepared.rows(task.seed))
            times.append(clock.read()[1])
        return max(0.0, times[0] - times[1])


_worker: _Worker | None = None


def _start(log: str, map_spec: str, settings: Sequence[str]) -> None:
    global _worker
    _worker = _Worker(log, map_spec, settings)


def _run(task: Task) -> Result:
    assert _worker is not None
    return _worker.run(task)


def cuts_of(recording: Recording, n: int) -> list[tuple[int, int]]:
    """Up to n cuts, spread over the log; each carries the robot at least 10 m."""
    place = recording.reference[:, :2]
    latest = int(0.7 * len(recording))
    cuts = []
    for first in np.linspace(LEAD, latest, n).astype(int).tolist():
        distance = np.hypot(*(place[first + LEAST_CUT : -2 * DEADLINE] - place[first - 1]).T)
        far = np.flatnonzero(distance >= CARRIED_M)
        if len(far):
            cuts.append((first, first + LEAST_CUT + int(far[0])))
    return cuts


def tasks_of(recording: Recording, beliefs: Sequence[str], options: Any) -> list[Task]:
    """Every run that was asked for."""
    spread = min(options.within, len(recording)) - 1
    starts = np.linspace(0, spread, options.starts).astype(int).tolist()
    tasks = []
    for belief in beliefs:
        tasks += [
            Task(belief, "start", first, None, seed)
            for first in starts
            for seed in range(options.seeds)
        ]
        tasks += [
            Task(belief, kind, cut[0] - LEAD, cut, 0)
            for kind in ("kidnapped", "no recovery")
            for cut in cuts_of(recording, options.cuts)
        ]
    return tasks


def play(tasks: Sequence[Task], options: Any) -> Iterator[Result]:
    """Every task's result, in order; ``--jobs`` processes at a time."""
    given = (str(options.log), options.map, options.set)
    # One thread a process: what the table says is the cost on one core.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(
        options.jobs, mp_context=get_context("spawn"), initializer=_start, initargs=given
    ) as pool:
        yield from pool.map(_run, tasks)


def share(results: Sequence[Result]) -> str:
    """How many came out well, of how many."""
    well = sum(r.right if r.task.cut is None else r.recovered for r in results)
    return f"{well} of {len(results)}" if results else "-"


def row_of(belief: str, results: Sequence[Result]) -> list[str]:
    """A line of the table."""
    by_kind = {
        kind: [r for r in results if r.task.kind == kind]
        for kind in ("start", "kidnapped", "no recovery")
    }
    runs = by_kind["start"]
    if not runs:
        return [belief, *["-"] * 7, share(by_kind["kidnapped"]), share(by_kind["no recovery"])]
    to = np.array([np.inf if r.to_localize is None else r.to_localize for r in runs])
    faster = np.array([r.recorded / (r.seconds + r.tables) for r in runs])
    cells = [
        belief,
        share(runs),
        f"{np.median([r.median_m for r in runs]):.3f}",
        f"{np.median([r.median_deg for r in runs]):.1f}",
        " / ".join(f"{np.quantile(to, q, method='higher'):.0f}" for q in (0.5, 0.9)),
        f"{np.median([r.seconds for r in runs]):.1f} + {np.median([r.tables for r in runs]):.1f}",
        f"{1e3 * np.median([r.seconds / r.scans for r in runs]):.1f}",
        f"{np.median(faster):.0f} ({faster.min():.0f})",
        share(by_kind["kidnapped"]),
        share(by_kind["no recovery"]),
    ]
    return cells


HEADS = (
    "belief",
    "runs right",
    "median error [m]",
    "[deg]",
    "scans to localize, median / 90 %",
    "seconds + tables",
    "ms a scan",
    "times faster, median (least)",
    "kidnapped: recovered",
    "without recovery",
)


def table(rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    lines = [HEADS, ["---"] * len(HEADS), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m benchmarks.recorded", description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("map")
    parser.add_argument("--belief", choices=("histogram", "particles", "both"), default="both")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--within", type=int, default=500, help="starts are among so many scans")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, help="JSON of every run")
    options = parser.parse_args(arguments)
    for name, least in {"starts": 0, "within": 1, "seeds": 0, "cuts": 0, "jobs": 1}.items():
        if getattr(options, name) < least:
            parser.error(f"--{name} must be at least {least}")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sweep; print the table."""
    options = parse(arguments)
    beliefs = ["histogram", "particles"] if options.belief == "both" else [options.belief]
    try:
        for belief in beliefs:
            ReplayConfig.of(belief, parse_settings(options.set))
        recording = read_log(options.log)
        MapSource.parse(options.map).number(0)
        tasks = tasks_of(recording, beliefs, options)
    except ActiveLocError as error:
        print(f"recorded: {error}", file=sys.stderr)
        return 2
    results = []
    for result in play(tasks, options):
        results.append(result)
        if sys.stderr.isatty():
            print(f"\r{len(results)} of {len(tasks)}", end="", file=sys.stderr)
    print(table([row_of(b, [r for r in results if r.task.belief == b]) for b in beliefs]))
    print(f"\n{RULE}. Recording: {recording.seconds:.0f} s for {len(recording)} scans.")
    if options.out is not None:
        document = {
            "rule": RULE,
            "options": {k: str(v) if isinstance(v, Path) else v for k, v in vars(options).items()},
            "activeloc": activeloc.__version__,
            "python": platform.python_version(),
            "machine": f"{platform.machine()}, {os.cpu_count()} processors",
            "runs": [asdict(result) for result in results],
        }
        write_atomically(options.out, (json.dumps(document, indent=1) + "\n").encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
