"""``activeloc export``: a trained policy as a file that runs without torch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

HELP = """Write the policy of a checkpoint as ONNX, found equal to the trained one.

Needs the extra `train`; what it writes runs with the extra `onnx` alone.

\b
The best policy of a run, and how well it does:
  activeloc export runs/ppo --out maze.onnx
  activeloc evaluate --env Maze15-v0 --agents greedy,onnx:maze.onnx --out results
"""


def export(
    checkpoint: Annotated[
        Path, typer.Argument(help="Folder of a checkpoint or of a run.", metavar="CHECKPOINT")
    ],
    out: Annotated[Path, typer.Option("--out", help="File to write, .onnx.", metavar="FILE")],
) -> None:
    """Export a policy."""
    from activeloc.cli.outputs import check_output
    from activeloc.errors import ConfigError

    check_output(out, (".onnx",))
    try:
        from activeloc.agents.sb3.export import export_checkpoint
    except ModuleNotFoundError as error:
        raise ConfigError(f"export needs {error.name}: pip install 'activeloc[train]'") from None
    size = export_checkpoint(checkpoint, out)
    print(f"{out}: {size / 1e6:.2f} MB")
