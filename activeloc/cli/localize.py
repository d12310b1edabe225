"""``activeloc localize``: a filter over a recorded run."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from importlib.util import find_spec
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from activeloc.cli import settings as options
from activeloc.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from activeloc.logs import Recording
    from activeloc.replay import Row, Run, Score

HELP = """Run a filter over a recorded run (a CARMEN log) on a map, from knowing nothing.

The filter sees the scans and the raw odometry; the corrected poses of the log are only what its
estimates are compared with. It is right if, over the last quarter of the scans, its median error
is at most 0.5 m and at most 10 degrees; localized at the first scan from which 10 running are
within both.

\b
  activeloc localize intel.log --map intel.yaml --out results
From scan 300; carried from scan 400 to 450 without being told; the first 300 scans of that:
  activeloc localize intel.log --map intel.yaml --belief particles \\
      --start 300 --kidnap 400:450 --scans 300 --out results-kidnapped
More beams, a longer range, a smaller robot:
  activeloc localize intel.log --map intel.yaml --set beams=35 \\
      --set sensor.z_max=10 --set radius=0.05 --out results-more

\b
Settings: beams, radius, odometry.*, sensor.* (sensor=beam or field), belief.*
Into DIR: trajectory.csv  a row for each scan (entropy [nat], errors [m], [rad])
          summary.json    settings, versions, score, timings
          path.png, error.png  where matplotlib is installed
"""


def localize(
    log: Annotated[Path, typer.Argument(help="A CARMEN log.", metavar="LOG")],
    map_spec: Annotated[
        str, typer.Option("--map", help="A map file; or one generated map.", metavar="SPEC")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder of the results.", metavar="DIR")],
    belief: options.Belief = "histogram",
    seed: options.Seed = 0,
    start: Annotated[
        int, typer.Option("--start", help="First scan of the log to use, from 0.", metavar="K")
    ] = 0,
    kidnap: Annotated[
        str | None,
        typer.Option(
            "--kidnap",
            help="Scans I up to J of the log are left out, and the odometry with them.",
            metavar="I:J",
        ),
    ] = None,
    scans: Annotated[
        int | None, typer.Option("--scans", help="How many to use; all if not given.", metavar="N")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="A setting, as often as needed: beams=35, sensor.z_max=10, belief.leak=0.",
            metavar="KEY=VALUE",
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what DIR holds of an earlier run.")
    ] = False,
) -> None:
    """Filter a log into a folder and say how it went."""
    from activeloc import checks, replay
    from activeloc.cli.outputs import check_folder
    from activeloc.cli.replay_files import FILES, write_files
    from activeloc.logs import read_log
    from activeloc.maps import MapSource

    checks.integer("seed", seed, 0, 2**63 - 1)
    config = replay.ReplayConfig.of(belief, options.parse_settings(settings or []))
    check_folder(out, FILES, overwrite)
    source = MapSource.parse(map_spec)
    if not source.is_fixed:
        raise ConfigError(f"--map {map_spec!r} names several maps; name one, such as office:7")
    recording, carried_to = select(read_log(log), start, kidnap, scans)
    clock = replay.Clock()
    prepared = replay.Replay(recording, source.number(0), config)
    rows = []
    with _progress(len(recording)) as show:
        for row in prepared.rows(seed):
            rows.append(row)
            show(row)
    run = replay.Run(prepared, rows, seed, clock.read(), carried_to)
    write_files(run, out, [sys.argv[0].rsplit("/", 1)[-1], *sys.argv[1:]])
    print(_result(run.score, recording, run.times_faster))
    if run.recovery is not None:
        print(_recovery(run, run.recovery))
    there = [name for name in FILES if (out / name).exists()]
    print(f"{out}: {', '.join(there)}")
    open_share = prepared.on_open_ground()
    if open_share < 0.99:
        print(
            f"activeloc: {1.0 - open_share:.1%} of the reference poses are in or too near an "
            f"obstacle of the map for a radius of {config.radius:g} m",
            file=sys.stderr,
        )
    if find_spec("matplotlib") is None:
        print(
            "activeloc: no pictures: matplotlib is not installed (activeloc[plot])",
            file=sys.stderr,
        )


def select(
    recording: Recording, start: int, kidnap: str | None, scans: int | None
) -> tuple[Recording, int | None]:
    """The part of a log that was asked for, and the scan at which the robot is set down.

    Raises:
        ConfigError: If the log does not hold it, or the kidnapping lies outside it.
    """
    from activeloc import checks

    n = len(recording)
    checks.integer("--start", start, 0, n - 1)
    if scans is not None:
        checks.integer("--scans", scans, 1, 10**9)
    end: int | None = None
    if kidnap is not None:
        first_text, colon, end_text = kidnap.partition(":")
        if not (colon and _is_count(first_text) and _is_count(end_text)):
            raise ConfigError(f"--kidnap {kidnap!r}: expected I:J, two scan numbers, I before J")
        first, end = int(first_text), int(end_text)
        last = n if scans is None else min(n, start + scans + end - first)
        if not start < first < end < last:
            raise ConfigError(
                f"--kidnap {kidnap}: expected {start} < I < J < {last}, among the scans used"
            )
        recording = recording.cut(first, end)
    chosen = recording.from_scan(start)
    return (chosen if scans is None else chosen.until(scans)), end


def _is_count(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 10


@contextmanager
def _progress(n_scans: int) -> Iterator[Callable[[Row], None]]:
    """A bar on standard error: scans filtered, entropy, error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    bars = Progress(
        TextColumn("scans"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        console=console,
        disable=not console.is_terminal,
    )
    with bars:
        task = bars.add_task("preparing the map", total=n_scans)

        def show(row: Row) -> None:
            bars.update(
                task,
                advance=1,
                description=f"entropy {row.entropy:.2f} nat, error {row.error_m:.2f} m, "
                f"{degrees(row.error_rad):.0f} deg",
            )

        yield show


def _result(score: Score, recording: Recording, times_faster: float) -> str:
    """How a run ended, in one line."""
    when = "never localized"
    if score.localized_at is not None:
        when = f"first localized after {score.localized_at + 1} scans"
    return (
        f"{recording.name}, {len(recording)} scans: {'right' if score.right else 'wrong'}, median "
        f"error {score.median_m:.2f} m and {degrees(score.median_rad):.1f} deg over the last "
        f"quarter; {when}; {times_faster:.0f} times faster than recorded"
    )


def _recovery(run: Run, score: Score) -> str:
    carried = f"kidnapped: carried {run.carried_m:.1f} m"
    if score.localized_at is None:
        return f"{carried}, not localized again"
    return f"{carried}, localized again after {score.localized_at + 1} scans"
