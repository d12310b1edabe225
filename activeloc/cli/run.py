"""``activeloc run``: one episode of one agent."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from activeloc.cli import settings as options
from activeloc.cli import watch

HELP = """Play one episode and say how it ended. What it shows is written as `activeloc watch` does,
which shows several agents beside each other.

\b
An agent that seeks information, in the office building with seed 3:
  activeloc run --agent active --map office:3 --out active.gif
A particle filter on your own map, with a sensor that sees 3 m:
  activeloc run --agent spin --map home.yaml --belief particles \\
      --set sensor.z_max=3 --out spin.gif
Episode 17 of `activeloc evaluate --seed 0`, as it was played there:
  activeloc run --agent greedy --map office:0-3 --seed 0 --episode 17 \\
      --out greedy-17.gif
"""


def run(
    env: options.Env = "activeloc/GlobalLocalization-v0",
    agent: Annotated[
        str | None,
        typer.Option(
            "--agent", help="Its name. [default: active; in mazes greedy]", metavar="NAME"
        ),
    ] = None,
    map_spec: options.MapIfGiven = None,
    belief: options.Belief = "histogram",
    seed: options.Seed = 0,
    episode: options.Episode = 0,
    steps: options.Steps = None,
    settings: options.Settings = None,
    out: Annotated[
        Path | None, typer.Option("--out", help=".gif, .mp4 or .html.", metavar="FILE")
    ] = None,
) -> None:
    """Play an episode."""
    names = [] if agent is None else [agent]
    watch.show(names, out, env, map_spec, belief, seed, episode, steps, settings)
