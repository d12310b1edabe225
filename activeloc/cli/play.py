"""``activeloc play``: drive the robot yourself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from activeloc.cli import settings as options
from activeloc.cli.watch import FPS, check_film, write

HELP = """Drive the robot with the keyboard, and see what agents would do in your place.

You see what the robot sees: map, belief and scan, but not where it is. Turn and drive until the
belief is sure; T shows the truth. Needs activeloc[render].

\b
arrows, W A D   drive and turn          R   the same episode again
S               stay, where it can      N   the next episode
T               show the true pose      Esc leave

\b
In the office building with seed 3:
  activeloc play --map office:3
On your own map, with a particle filter and the advice of one agent:
  activeloc play --map home.yaml --belief particles --advice active
Then watch in a browser how you did:
  activeloc play --map office:3 --out mine.html
"""

METRIC_ADVICE = "spin,greedy,lookahead,active"
MAZE_ADVICE = "greedy,lookahead"
CONTINUOUS_ADVICE = "spin,active"


def play(
    env: options.Env = "activeloc/GlobalLocalization-v0",
    map_spec: options.MapIfGiven = None,
    belief: options.Belief = "histogram",
    advice: Annotated[
        str | None,
        typer.Option(
            "--advice",
            help="Agents whose choice is shown, with commas between. "
            f"[default: {METRIC_ADVICE}; in mazes {MAZE_ADVICE}; with continuous actions "
            f"{CONTINUOUS_ADVICE}]",
            metavar="NAMES",
        ),
    ] = None,
    seed: options.Seed = 0,
    episode: Annotated[
        int, typer.Option("--episode", help="Which episode of the seed comes first.", metavar="I")
    ] = 0,
    steps: options.Steps = None,
    settings: options.Settings = None,
    size: Annotated[
        int, typer.Option("--size", help="Longer side of the picture [px].", metavar="N")
    ] = 800,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Your last episode, as `activeloc watch` has it.", metavar="FILE"
        ),
    ] = None,
) -> None:
    """Open a window, and say at the end how it went."""
    from activeloc import checks
    from activeloc.cli.game import Game
    from activeloc.cli.window import demand_pygame, show

    checks.integer("episode", episode, 0, 1_000_000)
    checks.integer("size", size, 300, 4000)
    if out is not None:
        check_film(out)
    demand_pygame()
    is_maze = options.default_agents(env) == options.MAZE_AGENTS
    given = settings or []
    names = options.split_agents(advice or (MAZE_ADVICE if is_maze else METRIC_ADVICE))
    sweep = options.make_sweep(env, map_spec, belief, names, given, seed, steps)
    if advice is None and sweep.config().actions.kind == "continuous":
        names = options.split_agents(CONTINUOUS_ADVICE)
        sweep = options.make_sweep(env, map_spec, belief, names, given, seed, steps)
    game = Game(sweep, episode, size)
    show(game, f"activeloc: {sweep.where}")
    for result in game.results:
        print(result)
    if not game.results:
        print(f"no episode was played to its end; {game.steps} steps in the last one")
    if out is not None:
        about = f"{sweep.env}, {belief} belief, seed {seed}, episode {game.episode}, by hand"
        write([game.recording()], out, FPS, 600, about)
        print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")
