"""``activeloc watch``: an episode as a film, or as a page to be replayed in a browser."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from activeloc.cli import settings as options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from activeloc.agents.evaluation import Player, Record
    from activeloc.envs.localization import LocalizationEnv
    from activeloc.envs.rendering import Recording

HELP = """Play an episode and show it; with several agents, each plays it from the same start.

\b
.html  A page to be replayed in a browser: play, step, scrub, switch layers, look at
       the belief by heading. One file, no server, nothing fetched.
.gif   An animated picture.
.mp4   A film; needs activeloc[video].

\b
An agent that seeks information, on your own map:
  activeloc watch --agent active --map home.yaml --out active.html
Two agents from the same start, in the office building with seed 3:
  activeloc watch --agent active --agent spin --map office:3 --out both.html
Episode 17 of `activeloc evaluate --map office:0-3 --seed 0`, as it was played there:
  activeloc watch --agent greedy --map office:0-3 --seed 0 --episode 17 --out greedy-17.gif
"""

SUFFIXES = (".gif", ".mp4", ".html")
FPS = 5.0


def watch(
    out: Annotated[Path, typer.Option("--out", help=".html, .gif or .mp4.", metavar="FILE")],
    agent: Annotated[
        list[str] | None,
        typer.Option(
            "--agent",
            help="Its name; several play side by side. [default: active; in mazes greedy]",
            metavar="NAME",
        ),
    ] = None,
    env: options.Env = "activeloc/GlobalLocalization-v0",
    map_spec: options.MapIfGiven = None,
    belief: options.Belief = "histogram",
    seed: options.Seed = 0,
    episode: options.Episode = 0,
    steps: options.Steps = None,
    settings: options.Settings = None,
    fps: Annotated[
        float, typer.Option("--fps", help="Steps a second, of a film.", metavar="N")
    ] = FPS,
    size: Annotated[
        int | None,
        typer.Option(
            "--size",
            help="Longer side of an agent's picture [px], of a film, even. "
            "[default: 600, of several 480]",
        ),
    ] = None,
) -> None:
    """Play an episode with each agent, and write what happened."""
    show(agent or [], out, env, map_spec, belief, seed, episode, steps, settings, fps, size)


def show(
    agents: Sequence[str],
    out: Path | None,
    env: str,
    map_spec: str | None,
    belief: str,
    seed: int,
    episode: int,
    steps: int | None,
    settings: Sequence[str] | None,
    fps: float = FPS,
    size: int | None = None,
) -> None:
    """Play an episode with each agent, say how it ended and, if there is a file, write it there.

    Raises:
        ActiveLocError: If one of the options is refused; before anything is played.
        OSError: If the file cannot be written.
    """
    from activeloc import checks
    from activeloc.agents.evaluation import Player

    names = _names(agents or [options.default_agents(env).split(",")[-1]])
    size = (600 if len(names) == 1 else 480) if size is None else size
    checks.integer("episode", episode, 0, 1_000_000)
    checks.number("fps", fps, 0.0, 50.0, above_low=True)
    checks.integer("size", size, 300, 4000)
    if out is not None:
        check_film(out)
    sweep = options.make_sweep(env, map_spec, belief, names, settings or [], seed, steps)
    records, recordings = _play(Player(sweep), names, episode, out is not None)
    if out is not None:
        about = f"{sweep.env}, {belief} belief, seed {seed}, episode {episode}"
        write(recordings, out, fps, size, about)
    for record in records:
        print(result_line(record))
    if out is not None:
        print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


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


def check_film(out: Path) -> None:
    """Refuse a film or page that could not be written.

    Raises:
        ConfigError: If its place or its suffix will not do, or there is no encoder for it.
    """
    from activeloc.cli.outputs import check_output
    from activeloc.envs.rendering import demand_encoder

    check_output(out, SUFFIXES)
    if out.suffix.lower() == ".mp4":
        demand_encoder()


def write(recordings: Sequence[Recording], out: Path, fps: float, size: int, about: str) -> None:
    """Write recordings as what the file's suffix says.

    Raises:
        OSError: If it cannot be written.
    """
    from activeloc.envs.rendering import frames_of, write_gif, write_mp4, write_page

    suffix = out.suffix.lower()
    if suffix == ".html":
        write_page(recordings, out, about)
    elif suffix == ".mp4":
        write_mp4(frames_of(recordings, size), out, fps)
    else:
        write_gif(list(frames_of(recordings, size)), out, fps)


def _names(agents: Sequence[str]) -> list[str]:
    """The agents' names.

    Raises:
        ConfigError: If one comes twice.
    """
    from activeloc.errors import ConfigError

    for name in agents:
        if agents.count(name) > 1:
            raise ConfigError(f"--agent: {name} is given twice")
    return list(agents)


def _play(
    player: Player, agents: Sequence[str], episode: int, keep: bool
) -> tuple[list[Record], list[Recording]]:
    """Play with a line of progress on standard error; recordings only if they are to be kept."""
    from rich.console import Console

    console = Console(stderr=True)
    records, recordings = [], []
    with console.status("starting") as status:
        for name in agents:

            def tell(
                env: LocalizationEnv, step: int, info: dict[str, Any], who: str = name
            ) -> None:
                status.update(
                    f"{who}: step {step}, entropy {info['entropy']:.2f} nat, "
                    f"{info['mass']:.0%} near the estimate"
                )

            if keep:
                record, recording = player.record(name, episode, tell)
                recordings.append(recording)
            else:
                record = player.play(name, episode, tell)
            records.append(record)
        status.update("writing")
    return records, recordings
