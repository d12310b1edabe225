"""From a sweep to a folder of results: resumable, in one process or in several."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from activeloc import checks
from activeloc.agents.evaluation.episodes import Player
from activeloc.agents.evaluation.lock import locked
from activeloc.agents.evaluation.page import REPLAYS
from activeloc.agents.evaluation.records import FILE_NAME, Record, RecordFile, read_records
from activeloc.agents.evaluation.report import RESULTS, Report, write_report
from activeloc.agents.evaluation.sweep import Sweep
from activeloc.agents.evaluation.workers import Unit, play_here, play_in_processes
from activeloc.errors import ConfigError

MAX_JOBS = 256


def evaluate(
    sweep: Sweep,
    folder: Path,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    command: str = "",
    on_start: Callable[[int], None] = lambda _: None,
    on_record: Callable[[Record], None] = lambda _: None,
) -> Report:
    """Play what the folder does not hold yet, and write the results.

    The results depend on the sweep alone: not on ``jobs``, nor on whether and where an earlier run
    was stopped. Episodes are kept one by one as they end.

    Args:
        sweep: What to play.
        folder: Where to; made if there is none.
        jobs: Processes that play.
        overwrite: Whether results that are there are thrown away.
        command: What was asked for, for the summary.
        on_start: Called once with the number of records that the folder holds already.
        on_record: Called with every record of the sweep, old ones first.

    Raises:
        ActiveLocError: If a setting is refused (before anything is written), the folder holds
            episodes of another configuration, or another run is writing there.
        OSError: If the folder cannot be written to.
        ChildProcessError: If a process that plays dies.
    """
    checks.integer("jobs", jobs, 1, MAX_JOBS)
    _check_folder(folder, overwrite)
    path = folder / FILE_NAME
    if not overwrite:
        stored = read_records(path)
        stored.demand(folder, sweep.identity())
    player = Player(sweep)
    if overwrite or _units(sweep, stored.records):
        player.rehearse(0)
    _make(folder)
    with locked(folder):
        if overwrite:
            for path_of_old in (folder / FILE_NAME, *_results_in(folder)):
                path_of_old.unlink(missing_ok=True)
        with closing(RecordFile(path, sweep.identity())) as file:
            _play_rest(player, file, jobs, on_start, on_record)
        report = Report(sweep, _wanted(sweep, file.records), command)
        write_report(report, folder)
    return report


def n_kept(sweep: Sweep, folder: Path) -> int:
    """How many of a sweep's episodes a folder keeps: what the next run there need not play.

    Raises:
        ConfigError: If the folder holds episodes of another configuration, or damaged ones.
        OSError: If they cannot be read.
    """
    stored = read_records(folder / FILE_NAME)
    stored.demand(folder, sweep.identity())
    return len(_wanted(sweep, stored.records))


def _check_folder(folder: Path, overwrite: bool) -> None:
    """Refuse what cannot be the results' folder, and results that nobody can resume."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file; the results need a folder")
    nearest = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise ConfigError(f"{folder}: {nearest} is no folder that can be written to")
    foreign = [name for name in RESULTS if (folder / name).exists()]
    if foreign and not overwrite and not (folder / FILE_NAME).exists():
        raise ConfigError(
            f"{folder} holds {foreign[0]} but not the episodes behind it; "
            "choose another folder or start with --overwrite"
        )


def _results_in(folder: Path) -> list[Path]:
    """The files of an earlier run; the folder of its replays stays, without them."""
    return [*(folder / name for name in RESULTS), *(folder / REPLAYS).glob("*.html")]


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot make the folder: {error.strerror}") from None


def _wanted(sweep: Sweep, records: Sequence[Record]) -> list[Record]:
    """The sweep's records, agents in its order and episodes in theirs; each once."""
    order = {name: place for place, name in enumerate(sweep.agents)}
    found = {r.key: r for r in records if r.agent in order and r.episode < sweep.episodes}
    return sorted(found.values(), key=lambda record: (order[record.agent], record.episode))


def _units(sweep: Sweep, records: Sequence[Record]) -> list[Unit]:
    """The sweep's episodes that are not among the records."""
    done = {record.key for record in records}
    units = []
    for episode in range(sweep.episodes):
        missing = tuple(name for name in sweep.agents if (name, episode) not in done)
        if missing:
            units.append(Unit(sweep.map_number(episode), episode, missing))
    return units


def _play_rest(
    player: Player,
    file: RecordFile,
    jobs: int,
    on_start: Callable[[int], None],
    on_record: Callable[[Record], None],
) -> None:
    """Play the sweep's episodes that are not in the file."""
    sweep = player.sweep
    there = _wanted(sweep, file.records)
    on_start(len(there))
    for record in there:
        on_record(record)
    units = _units(sweep, there)
    parallel = jobs > 1 and len(units) > 1
    played = play_in_processes(sweep, units, jobs) if parallel else play_here(player, units)
    with closing(played):
        for record in played:
            file.append(record)
            on_record(record)
