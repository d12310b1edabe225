"""``activeloc calibrate``: is the filter as sure as it is right?"""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager
from math import inf, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from activeloc.cli import settings as options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from activeloc.calibration import Experiment, Report

HELP = """Say whether a filter is as sure as it is right, by drawing the truth from its prior.

\b
--model exact    The filter's own model made true: rules, widening and tempering
                 off, the command as control. Ranks must be uniform, the NEES 3,
                 credible sets and declarations as good as promised; a small
                 p-value is a defect.
--model default  The filter as it is shipped, in the world it is used in (the
                 odometry as control). It is wide on purpose: ranks need not be
                 uniform, the NEES is under 3, promises are more than kept.

--defect NAME plants a fault, to show that it is found: sigma (the sensor taken for a fifth
better), cubed (sum of cubed likelihoods), kept-weights (weights survive resampling), half-cell
(cells half a cell off), flipped (turns the wrong way).

\b
The histogram filter in its own world, 20,000 replicates on 4 processes:
  activeloc calibrate --replicates 20000 --jobs 4 --out calibration
The particle filter; a defect; the filter as shipped:
  activeloc calibrate --belief particles --out calibration-particles
  activeloc calibrate --defect flipped --out calibration-flipped
  activeloc calibrate --model default --world continuous --out calibration-default

\b
Into DIR: summary.json     p-values, counts, coverage, NEES, declarations, configuration
          ranks.png        rank histograms
          reliability.png  shares kept against shares promised
"""

MODELS = ("exact", "default")
# A cloud without roughening thins out with every scan.
STEPS = {"histogram": 8, "particles": 4}
SETTINGS = ("belief", "sensor", "motion", "filter_sensor", "filter_motion", "actions")
SMALL = "rooms(width=4,height=3,smallest=1.5):0"

# Sensor and odometry at their word, every reading in full, nobody carried off.
PLAIN: dict[str, Any] = {
    "sigma_factor": 1.0,
    "likelihood_power": 1.0,
    "repetition": inf,
    "contact_floor": 1.0,
    "odometry_floor": 1.0,
    "leak": 0.0,
    "novelty": 0.0,
    "slip": 0.0,
}
# A weak sensor keeps the posterior wide: ranks say little of a belief in one state.
_WEAK = {"beams": 3, "field_of_view": pi / 3, "sigma_hit": 0.3, "w_hit": 0.82, "w_rand": 0.1}
_EXACT: dict[str, dict[str, dict[str, Any]]] = {
    # Drives of whole half cells and no heading noise of theirs: what its transition represents.
    "histogram": {
        "belief": {**PLAIN, "headings": 24, "least": 0.0, "precision": "float64"},
        "sensor": _WEAK,
        "motion": {
            "odometry": {"rotation_from_rotation": 4 / 30, "translation_from_translation": 0.05}
        },
        "actions": {"forward": 0.4},
    },
    "particles": {
        "belief": {**PLAIN, "n_min": 10_000, "n_max": 10_000, "n_start": 10_000,
                   "roughening_xy": 0.0, "roughening_theta": 0.0, "recovery": "none",
                   "directions": 0},
        "sensor": {**_WEAK, "beams": 6, "field_of_view": 3.0},
        "motion": {
            "odometry": {
                "rotation_from_rotation": 4 / 30,
                "rotation_from_translation": 0.05,
                "translation_from_translation": 0.1,
                "translation_from_rotation": 0.05,
            }
        },
        "actions": {"forward": 0.4},
    },
}  # fmt: skip


def calibrate(
    out: Annotated[Path, typer.Option("--out", help="Folder of the results.", metavar="DIR")],
    belief: options.Belief = "histogram",
    model: Annotated[str, typer.Option("--model", help="exact or default.")] = "exact",
    world: Annotated[
        str | None,
        typer.Option(
            "--world",
            help="continuous, or the histogram filter's discrete one (its default here).",
        ),
    ] = None,
    map_spec: options.Map = SMALL,
    replicates: Annotated[
        int, typer.Option("--replicates", help="Runs from anywhere.", metavar="N")
    ] = 2000,
    tracks: Annotated[
        int, typer.Option("--tracks", help="Runs from a known start, for the NEES; 0 for none.")
    ] = 1000,
    steps: Annotated[
        int | None,
        typer.Option("--steps", help="Commands in a run; 8, 4 with particles.", metavar="T"),
    ] = None,
    seed: options.Seed = 0,
    jobs: Annotated[int, typer.Option("--jobs", help="Processes.", metavar="J")] = 1,
    defect: Annotated[
        str | None, typer.Option("--defect", help="Fault to plant.", metavar="NAME")
    ] = None,
    settings: options.Settings = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what DIR holds of an earlier run.")
    ] = False,
) -> None:
    """Run an experiment, write its files and print its tables."""
    from activeloc import calibration
    from activeloc.cli.outputs import check_folder

    check_folder(out, FILES, overwrite)
    experiment = make_experiment(
        belief, model, world, map_spec, steps, seed, defect, settings or []
    )
    with _progress(replicates, tracks) as on_done:
        report = calibration.calibrate(experiment, replicates, tracks, jobs, on_done)
    remarks = _write(report, out, shlex.join(["activeloc", *sys.argv[1:]]))
    _print(report, model, out)
    for remark in remarks:
        print(f"activeloc: {remark}", file=sys.stderr)


FILES = ("summary.json", "ranks.png", "reliability.png")


def make_experiment(
    belief: str,
    model: str,
    world: str | None,
    map_spec: str,
    steps: int | None,
    seed: int,
    defect: str | None,
    settings: Sequence[str],
) -> Experiment:
    """An experiment from the options.

    Raises:
        ActiveLocError: If one of them is refused.
    """
    import numpy as np

    from activeloc import checks
    from activeloc.calibration import Experiment
    from activeloc.configuration import unknown
    from activeloc.envs.episodes import BELIEFS, EpisodeConfig
    from activeloc.errors import ConfigError
    from activeloc.maps import MapSource

    checks.choice("model", model, MODELS)
    if belief not in BELIEFS:
        raise unknown("--belief", belief, BELIEFS)
    source = MapSource.parse(map_spec)
    if not source.is_fixed:
        raise ConfigError(f"--map {map_spec}: names several maps; calibrate takes one")
    tree = options.parse_settings(settings)
    for name in tree:
        if name not in SETTINGS:
            raise unknown("--set", name, SETTINGS)
    base: dict[str, Any] = {"belief": {"kind": belief}}
    if model == "exact":
        base = _laid_over(base, _EXACT[belief])
    given = _laid_over(base, tree)
    for name in ("sensor", "motion"):
        if isinstance(given.get(f"filter_{name}"), dict):  # Of what is not given, the true one's.
            given[f"filter_{name}"] = _laid_over(given.get(name, {}), given[f"filter_{name}"])
    config = EpisodeConfig.build(given)
    if config.actions.kind != "discrete":
        raise ConfigError("actions.kind must be discrete: replicates draw from a table of commands")
    return Experiment(
        grid=source.draw(np.random.default_rng(0)),
        belief=config.belief,
        sensor=config.sensor,
        motion=config.motion,
        filter_sensor=config.filter_sensor or config.sensor,
        filter_motion=config.filter_motion or config.motion,
        commands=tuple((float(a), float(b), float(c)) for a, b, c in config.actions.commands),
        world=world or ("discrete" if belief == "histogram" else "continuous"),
        control="command" if model == "exact" else "odometry",
        steps=STEPS[belief] if steps is None else steps,
        seed=seed,
        defect=defect,
    )


def _laid_over(base: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Settings over settings, group by group; beside fields, a bare word is a kind."""
    merged = dict(base)
    for name, value in given.items():
        old = merged.get(name)
        if isinstance(value, dict) and isinstance(old, dict):
            merged[name] = _laid_over(old, value)
        else:
            merged[name] = value
    return merged


@contextmanager
def _progress(replicates: int, tracks: int) -> Iterator[Callable[[str, int], None]]:
    """A bar for each start on standard error."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal) as bars:
        totals = {"global": replicates, "tracking": tracks}
        tasks = {start: bars.add_task(start, total=n) for start, n in totals.items() if n > 0}
        yield lambda start, n: bars.advance(tasks[start], n)


def _write(report: Report, folder: Path, command: str) -> list[str]:
    """Write the files, each whole or not at all; remarks on what could not be drawn."""
    import json

    from activeloc import plots
    from activeloc.files import write_atomically

    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(report.summary(command), indent=2, allow_nan=False) + "\n"
    write_atomically(folder / "summary.json", text.encode())
    counts = {name: one.counts for name, one in report.ranks.items()}
    try:
        plots.plot_rank_histograms(counts, folder / "ranks.png")
        plots.plot_reliability(
            {
                "credible sets": [(s.promised, s.value, *s.interval)
                                  for s in report.coverage.values()],
                "declarations": [(1.0 - s.promised, 1.0 - s.value, 1.0 - s.interval[1],
                                  1.0 - s.interval[0])
                                 for s in report.declarations.values() if s.n > 0],
            },
            folder / "reliability.png",
        )  # fmt: skip
    except ImportError:
        return ["no pictures: matplotlib is not installed (activeloc[plot])"]
    return []


def _print(report: Report, model: str, folder: Path) -> None:
    """The tables, a verdict, and what is in the folder."""
    from rich.console import Console

    from activeloc.calibration.scores import LEAST_P
    from activeloc.cli.calibration_tables import calibration_tables

    console, given = Console(highlight=False, markup=False), report.experiment
    kind = "histogram" if given.world == "discrete" or hasattr(given.belief, "headings") else ""
    planted = f", with {given.defect} planted" if given.defect else ""
    print(
        f"{kind or 'particles'} belief, {model} model, {given.world} world on {given.grid.name}"
        f"{planted}: {report.replicates} runs\nof {given.steps} steps, "
        f"{report.ms_per_replicate:.1f} ms each"
    )
    for title, table in calibration_tables(report):
        print(f"\n{title}\n")
        console.print(table)
    verdict = "uniform" if report.uniform else "NOT uniform"
    print(f"\nranks are {verdict}: smallest p-value {report.least_p:.2g}, limit {LEAST_P:g}")
    if report.impossible:
        print(f"{report.impossible} scans that no hypothesis explained")
    print(f"{folder}: {', '.join(name for name in FILES if (folder / name).exists())}")
