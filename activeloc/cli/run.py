"""``activeloc run``: one episode, watched."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from activeloc.cli import settings as options

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from activeloc.agents.evaluation import Record
    from activeloc.envs.localization import LocalizationEnv

HELP = """Play one episode, say how it ended, and write it as an animated picture.

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
    agent: Annotated[str, typer.Option("--agent", help="Its name.", metavar="NAME")] = "active",
    map_spec: options.MapIfGiven = None,
    belief: options.Belief = "histogram",
    seed: options.Seed = 0,
    episode: Annotated[
        int, typer.Option("--episode", help="Which episode of the seed.", metavar="I")
    ] = 0,
    steps: options.Steps = None,
    settings: options.Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Animated picture, .gif; 5 steps a second.", metavar="FILE"),
    ] = None,
) -> None:
    """Play an episode."""
    from activeloc import checks
    from activeloc.agents.evaluation import Player
    from activeloc.cli.outputs import check_output

    checks.integer("episode", episode, 0, 1_000_000)
    if out is not None:
        check_output(out, (".gif",))
    sweep = options.make_sweep(env, map_spec, belief, [agent], settings or [], seed, steps)
    player = Player(sweep, render_mode=None if out is None else "rgb_array")
    frames: list[NDArray[np.uint8]] = []
    record = _watch(player, agent, episode, frames)
    if out is not None:
        from activeloc.envs.rendering import write_gif

        write_gif(frames, out)
    print(result_line(record) + (f"; {out}" if out is not None else ""))


def _watch(player: Any, agent: str, episode: int, frames: list[NDArray[np.uint8]]) -> Record:
    """Play with a line of progress on standard error; frames are added if there is a picture."""
    from rich.console import Console

    console = Console(stderr=True)

    with console.status(f"{agent}: starting") as status:

        def watch(env: LocalizationEnv, step: int, info: dict[str, Any]) -> None:
            status.update(
                f"{agent}: step {step}, entropy {info['entropy']:.2f} nat, "
                f"{info['mass']:.0%} near the estimate"
            )
            frame = env.render() if env.render_mode is not None else None
            if frame is not None:
                frames.append(frame)

        record: Record = player.play(agent, episode, watch)
    return record


def result_line(record: Record) -> str:
    """How an episode ended, in one line."""
    end = "wrong and sure" if record.wrong else "not localized"
    if record.success:
        end = "localized"
    return (
        f"{record.agent} on {record.map}: {end} after {record.played} steps, entropy "
        f"{record.final_entropy:.2f} nat, error {record.error_m:.2f} m and "
        f"{degrees(record.error_rad):.0f} deg"
    )
