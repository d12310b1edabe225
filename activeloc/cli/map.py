"""``activeloc map``: look at maps, draw them, make them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from activeloc.cli.outputs import check_output
from activeloc.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from activeloc.grid import OccupancyGrid
    from activeloc.maps import MapSource

RADIUS = 0.2
"""Of the robot whose room to move is reported [m]."""

MOST = 16
"""No more maps than this are reported of one source."""

app = typer.Typer(
    help="Look at maps, draw them, make them.", no_args_is_help=False, rich_markup_mode=None
)

Spec = Annotated[
    str,
    typer.Argument(help="A map file, or a generator: office:7, cave, maze:0-3.", metavar="SPEC"),
]

INFO_HELP = """Say a map's size, its cells, and the room a robot of radius 0.2 m has on it.

\b
  activeloc map info home.yaml
  activeloc map info office:0-3
"""

SHOW_HELP = """Draw a map: to the terminal (# occupied, ? unknown), or to a PNG file.

\b
  activeloc map show cave:5
  activeloc map show home.yaml --out home.png
"""

MAKE_HELP = """Write a generated map as a file: .yaml (ROS map_server, with a .pgm) or .txt.

\b
  activeloc map make office:7 --out office-7.yaml
  activeloc map make "office(rooms=6):2" --out small.yaml
"""


@app.command("info", help=INFO_HELP)
def info(spec: Spec) -> None:
    """Print some lines for each map."""
    source = _source(spec)
    n_maps = MOST if source.n_maps is None else min(MOST, source.n_maps)
    for number in range(n_maps):
        print(_description(source.number(number)))
    if source.n_maps is None or source.n_maps > MOST:
        print(f"... the first {MOST} of {source.n_maps or 'endless'} maps")


@app.command("show", help=SHOW_HELP)
def show(
    spec: Spec,
    out: Annotated[
        Path | None, typer.Option("--out", help="Picture, .png.", metavar="FILE")
    ] = None,
) -> None:
    """Draw one map."""
    if out is None:
        print(_text(_one(spec), max(20, shutil.get_terminal_size().columns - 1)))
        return
    check_output(out, (".png",))
    grid = _one(spec)
    from io import BytesIO

    from PIL import Image

    from activeloc.files import write_atomically

    picture = Image.fromarray(_picture(grid))
    encoded = BytesIO()
    enlarged = max(1, round(800 / max(picture.size)))
    picture.resize((picture.width * enlarged, picture.height * enlarged), 0).save(encoded, "PNG")
    write_atomically(out, encoded.getvalue())
    print(f"{grid.name}: {out}")


@app.command("make", help=MAKE_HELP)
def make(
    spec: Spec,
    out: Annotated[Path, typer.Option("--out", help=".yaml, .yml or .txt.", metavar="FILE")],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a map that is there.")
    ] = False,
) -> None:
    """Write one map."""
    from activeloc.maps import save_map

    check_output(out, (".yaml", ".yml", ".txt"))
    image = out.with_suffix(".pgm")
    for path in [out] if out.suffix == ".txt" else [out, image]:
        if path.exists() and not overwrite:
            raise ConfigError(f"--out {out}: {path} is there already; replace it with --overwrite")
    grid = _one(spec)
    save_map(grid, out)
    print(f"{grid.name}: {out}")


def _source(spec: str) -> MapSource:
    from activeloc.maps import MapSource

    return MapSource.parse(spec)


def _one(spec: str) -> OccupancyGrid:
    source = _source(spec)
    if not source.is_fixed:
        raise ConfigError(f"map {spec!r} names several maps; name one, such as office:7")
    return source.number(0)


def _description(grid: OccupancyGrid) -> str:
    """Size, cells, and where a robot can go."""
    from scipy import ndimage

    height, width = grid.shape
    side, n_cells = grid.resolution, grid.cells.size
    counts = ", ".join(f"{n} {kind} ({n / n_cells:.1%})" for kind, n in grid.count().items())
    labels, n_parts = ndimage.label(grid.free & (grid.clearance >= RADIUS))
    roomy = int((labels > 0).sum())
    area = f"none: a robot of radius {RADIUS} m fits nowhere"
    if n_parts:
        reached = int(grid.passable(RADIUS).sum())
        area = (
            f"{reached * side**2:.1f} m2 for a robot of radius {RADIUS} m, the largest of "
            f"{n_parts} connected parts ({reached / roomy:.1%} of their area)"
        )
    return (
        f"{grid.name}\n"
        f"  size      {width * side:.2f} x {height * side:.2f} m\n"
        f"  cells     {width} x {height} of {side:g} m\n"
        f"  origin    ({grid.origin[0]:g}, {grid.origin[1]:g}) m\n"
        f"  counts    {counts}\n"
        f"  passable  {area}"
    )


def _picture(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """White free space, black obstacles, grey where nothing is known; the map's top row first."""
    import numpy as np

    return np.array([255, 0, 160], dtype=np.uint8)[grid.cells[::-1]]


def _text(grid: OccupancyGrid, columns: int) -> str:
    """The map in characters, half as many rows as columns to the metre: a character is tall.

    A character shows an obstacle if there is one under it, else unknown ground if there is any.
    """
    import numpy as np

    height, width = grid.shape
    pool = max(1, -(-width // columns))
    tall = 2 * pool
    padded = np.pad(grid.cells, ((0, -height % tall), (0, -width % pool)), mode="edge")
    blocks = padded.reshape(padded.shape[0] // tall, tall, -1, pool)
    occupied, unknown = ((blocks == kind).any(axis=(1, 3)) for kind in (1, 2))
    kinds = np.where(occupied, 1, np.where(unknown, 2, 0))
    return "\n".join("".join(row).rstrip() for row in np.array([" ", "#", "?"])[kinds[::-1]])
