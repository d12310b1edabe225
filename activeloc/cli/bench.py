"""``activeloc bench``: what the parts cost, beside what others take for the same."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from activeloc.benchmarks import Row, Settings
    from activeloc.benchmarks.report import Report

HELP = """Measure what the parts cost, beside what others take for the same.

Each row: the median, between what the middle four fifths lie, the same of a yardstick, how ours
compares, and the target. Ours and the yardstick are timed in turns, in one run. Rays, filters and
decisions count CPU time of the calling thread; rows about threads count seconds of the clock. The
yardsticks of other projects come with activeloc[bench].

\b
Everything, in some minutes, and files of it:
  activeloc bench --out bench
Two subjects, with small sizes, to see that they work:
  activeloc bench rays particles --quick
On a folder with basement_hallways.png, the map of the ray casting rows; else one is generated:
  activeloc bench rays --maps maps

\b
Into DIR: bench.json  machine, versions, rows, curves
          bench.md    the tables, as a page
          *.png       cost against size, where matplotlib is installed
"""

NAMES = ("bench.json", "bench.md")


def bench(
    subjects: Annotated[
        list[str] | None,
        typer.Argument(
            help="machine, rays, ranges, histogram, likelihood, particles, field, environments, "
            "views, maps, planners, training, startup, memory. [default: all]",
            metavar="[SUBJECT]...",
            show_default=False,
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small sizes, few rounds: does it work?")
    ] = False,
    threads: Annotated[
        int, typer.Option("--threads", help="Most threads in rows about threads.", metavar="N")
    ] = 2,
    maps: Annotated[
        Path | None,
        typer.Option(
            "--maps",
            help="Folder with basement_hallways.png. [default: ACTIVELOC_MAPS, if it is set]",
            metavar="DIR",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the results.", metavar="DIR")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what DIR holds of earlier runs.")
    ] = False,
) -> None:
    """Measure, print as it goes, and write."""
    from rich.console import Console

    from activeloc.benchmarks import Settings, check_subjects, maps_from_environment
    from activeloc.benchmarks.machine import describe
    from activeloc.benchmarks.markdown import machine_line, verdict
    from activeloc.benchmarks.report import Report
    from activeloc.cli.outputs import check_folder

    names = check_subjects(subjects or [])
    settings = Settings(quick, threads, maps_from_environment() if maps is None else maps)
    if out is not None:
        check_folder(out, NAMES, overwrite)
    console = Console(highlight=False, markup=False)
    console = Console(highlight=False, markup=False, width=max(console.width, 116))
    report = Report(describe(), settings.plain())
    console.print(machine_line(report.machine))
    console.print(f"threads: {threads}; {'quick' if quick else 'full'} sizes")
    for name in names:
        _measure(name, settings, report, console)
        if out is not None:
            _write(report, out)
    console.print(f"\n{verdict(report)}")
    if out is not None:
        print(f"\n{out}: {', '.join([*NAMES, *_draw(report, out)])}")


def _measure(name: str, settings: Settings, report: Report, console: Console) -> None:
    """One subject: its table, and its part of the report."""
    import time

    from rich.console import Console as Screen

    from activeloc.benchmarks import Curve, Row, measure

    begun, rows = time.perf_counter(), len(report.rows)
    with Screen(stderr=True).status(name) as status:
        for item in measure(name, settings):
            if isinstance(item, Row):
                report.rows.append(item)
                status.update(f"{name}: {item.name}")
            elif isinstance(item, Curve):
                report.curves.append(item)
            else:
                report.absent.append(item)
                console.print(f"\n{name}, {item.name}: {item.reason}")
    report.seconds[name] = round(time.perf_counter() - begun, 2)
    _print(name, report.rows[rows:], report.seconds[name], console)


def _print(name: str, rows: Sequence[Row], seconds: float, console: Console) -> None:
    from rich.table import Table

    from activeloc.benchmarks.markdown import HEADINGS, cells

    if not rows:
        return
    table = Table(title=f"{name} ({seconds:.0f} s)", title_justify="left", box=None)
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading in ("", "yardstick") else "right")
    for row in rows:
        table.add_row(*cells(row))
    console.print()
    console.print(table)
    for note in dict.fromkeys(f"{row.name}: {row.note}" for row in rows if row.note):
        console.print(note, style="dim")


def _write(report: Report, out: Path) -> None:
    """What is known so far: a run that is stopped leaves what it has measured."""
    import shlex
    import sys

    from activeloc.benchmarks.markdown import to_markdown
    from activeloc.files import write_atomically

    command = shlex.join(["activeloc", *sys.argv[1:]])
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / NAMES[0], report.to_json())
    write_atomically(out / NAMES[1], to_markdown(report, command).encode())


def _draw(report: Report, out: Path) -> list[str]:
    """The pictures' names; without matplotlib there are none."""
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        return []
    from activeloc.benchmarks.figures import write_figures

    return [path.name for path in write_figures(report.curves, out)]
