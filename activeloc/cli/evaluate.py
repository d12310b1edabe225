"""``activeloc evaluate``: agents play the same episodes."""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from activeloc.cli import settings as options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from activeloc.agents.evaluation import Record, Report, Sweep

HELP = """Let agents play the same episodes and say how well they do, with 95 % intervals.

Episode i has the same map, start and noise for every agent; the results do not depend on --jobs.
A run that is stopped goes on where it was when the same command is given again.

\b
Four agents, 64 episodes each in four office buildings, on 4 processes:
  activeloc evaluate --map office:0-3 --episodes 64 --jobs 4 --out results
Two agents on your own map, with a sensor that sees 3 m:
  activeloc evaluate --agents greedy,active --map home.yaml \\
      --set sensor.z_max=3 --out results-home
The same with a page to look at, and replays of each agent's best and worst episodes:
  activeloc evaluate --map office:0-3 --episodes 64 --jobs 4 --out results --report
The particle filter, tracking, with 75 steps an episode:
  activeloc evaluate --env PositionTracking-v0 --belief particles \\
      --steps 75 --out results-tracking
The kidnapped robot, and the same with nobody to carry it off:
  activeloc evaluate --env KidnappedRobot-v0 --agents spin,active --out results-kidnapped
  activeloc evaluate --env KidnappedRobot-v0 --agents spin,active \\
      --set task.kidnap=never --out results-left-alone
Mazes, and mazes that others have played:
  activeloc evaluate --env Maze15-v0 --agents random,greedy --episodes 100 --out results-maze
  activeloc evaluate --env Maze15-v0 --starts test-mazes.npz --out results-test

\b
Into DIR: episodes.csv  a row for each episode (entropy [nat], errors [m], [rad])
          curves.csv    entropy by step, as a fraction of the uniform belief's
          summary.json  scores, intervals, differences, configuration, timings
          entropy.png   the curves, where matplotlib is installed
          report.html   with --report: all of it, and links to replays/
"""


def evaluate(
    out: Annotated[Path, typer.Option("--out", help="Folder of the results.", metavar="DIR")],
    env: options.Env = "activeloc/GlobalLocalization-v0",
    agents: Annotated[
        str | None,
        typer.Option(
            "--agents",
            help="Names, with commas between; differences are taken against the first. "
            "[default: random,spin,greedy,active; in mazes random,greedy]",
            metavar="NAMES",
        ),
    ] = None,
    map_spec: options.MapIfGiven = None,
    belief: options.Belief = "histogram",
    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            help="How many each agent plays. [default: 16, or all of --starts]",
            metavar="N",
        ),
    ] = None,
    seed: options.Seed = 0,
    jobs: Annotated[int, typer.Option("--jobs", help="Processes that play.", metavar="J")] = 1,
    steps: options.Steps = None,
    settings: options.Settings = None,
    gains: Annotated[
        bool,
        typer.Option("--gains", help="Measure what planners expect of scans, and get."),
    ] = False,
    starts: Annotated[
        Path | None,
        typer.Option(
            "--starts",
            help="Mazes to play, .npz: grids (N, m, m) of bool, poses (N, 3) of row, column, "
            "heading 0 to 3.",
            metavar="FILE",
        ),
    ] = None,
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Write report.html: tables, curves, and replays of each agent's best, median "
            "and worst episode, which are played again.",
        ),
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Throw away what DIR holds of earlier runs.")
    ] = False,
) -> None:
    """Play a sweep into a folder and print its table."""
    from activeloc.agents import evaluation

    given = None if starts is None else evaluation.Starts.load(starts)
    if episodes is None:
        episodes = 16 if given is None else len(given)
    names = options.split_agents(options.default_agents(env) if agents is None else agents)
    sweep = options.make_sweep(
        env, map_spec, belief, names, settings or [], seed, steps, episodes, "office:0-3"
    )
    sweep = replace(sweep, gains=gains, starts=given)
    with _progress(sweep) as progress:
        try:
            results = evaluation.evaluate(
                sweep,
                out,
                jobs=jobs,
                overwrite=overwrite,
                command=shlex.join(["activeloc", *sys.argv[1:]]),
                on_record=progress.add,
            )
        except KeyboardInterrupt as interrupt:
            interrupt.add_note(_how_to_go_on(sweep, out, overwrite))
            raise
    if report:
        _illustrate(results, out)
    _print(results, out)


def _how_to_go_on(sweep: Sweep, folder: Path, overwrite: bool) -> str:
    """What an interrupted sweep leaves: what its file holds, whatever the bar had counted."""
    from activeloc.agents.evaluation import n_kept
    from activeloc.errors import ConfigError

    try:
        kept = n_kept(sweep, folder)
    except ConfigError:  # Results of an earlier run that were to be thrown away.
        kept = 0
    if not kept:
        return "no episode was finished"
    command = "the same command without --overwrite" if overwrite else "the same command"
    total = len(sweep.agents) * sweep.episodes
    return f"{kept} of {total} episodes are kept in {folder}; {command} goes on"


def _illustrate(results: Report, folder: Path) -> None:
    """Write the page, with a line of progress on standard error."""
    from rich.console import Console

    from activeloc.agents.evaluation import write_gallery

    with Console(stderr=True).status("replays") as status:
        write_gallery(
            results,
            folder,
            lambda choice: status.update(f"replay: {choice.record.agent}, {choice.rank}"),
        )


class _Progress:
    """A bar for each agent on standard error: episodes played, share right so far."""

    def __init__(self, sweep: Sweep) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeRemainingColumn,
        )

        console = Console(stderr=True)
        self.bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[right]}"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.tasks = {
            name: self.bars.add_task(name, total=sweep.episodes, right="") for name in sweep.agents
        }
        self.right = dict.fromkeys(sweep.agents, 0)
        self.done = dict.fromkeys(sweep.agents, 0)

    def add(self, record: Record) -> None:
        """Count an episode."""
        self.done[record.agent] += 1
        self.right[record.agent] += record.success
        share = self.right[record.agent] / self.done[record.agent]
        self.bars.update(self.tasks[record.agent], advance=1, right=f"{share:.0%} right")


@contextmanager
def _progress(sweep: Sweep) -> Iterator[_Progress]:
    progress = _Progress(sweep)
    with progress.bars:
        yield progress


def _print(report: Report, folder: Path) -> None:
    """The tables, what is in the folder, and remarks."""
    from rich.console import Console

    from activeloc.cli.tables import differences_table, gains_table, kidnap_table, scores_table

    console, sweep = Console(highlight=False, markup=False), report.sweep
    print(
        f"{sweep.env} on {sweep.where}, {sweep.episodes} episodes of at most {sweep.limit} "
        "steps;\nunder each score its 95 % interval\n"
    )
    console.print(scores_table(report))
    if report.kidnap_scores:
        print("\ncarried off and not told (steps since then; false alarms before it):\n")
        console.print(kidnap_table(report))
    if report.gains:
        print("\nwhat a planner's scan was expected to tell, and what it told:\n")
        console.print(gains_table(report))
    if report.differences:
        print(f"\nless {next(iter(sweep.agents))}'s, on the same episodes:\n")
        console.print(differences_table(report))
    written = ", ".join(sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))
    print(f"\n{folder}: {written}")
    for remark in report.remarks:
        print(f"activeloc: {remark}", file=sys.stderr)
