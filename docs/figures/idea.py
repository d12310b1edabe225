"""Draw the pictures of ``docs/idea.md``: ``python docs/figures/idea.py``.

One episode in a generated office, as `activeloc watch --agent spin --agent active --map office:0
--episode 8` plays it: four moments of `active`, and how the entropy fell with either agent.
"""

from pathlib import Path

import numpy as np
from PIL import Image

from activeloc.agents.evaluation import Player, Sweep
from activeloc.envs.rendering import frames_of
from activeloc.maps import MapSource
from activeloc.plots import plot_entropy_curves

EPISODE = 8
MOMENTS = {"everywhere": 0, "beside-walls": 12, "like-places": 30, "declared": 48}
FOLDER = Path(__file__).resolve().parents[1] / "idea"


def main() -> None:
    """Play the episode and draw it."""
    agents: dict[str, dict[str, object]] = {"spin": {}, "active": {}}
    sweep = Sweep("activeloc/GlobalLocalization-v0", MapSource.parse("office:0"), agents, {})
    player = Player(sweep)
    played = {name: player.record(name, EPISODE) for name in sweep.agents}
    FOLDER.mkdir(exist_ok=True)
    frames = list(frames_of([played["active"][1]], 800))
    for name, step in MOMENTS.items():
        picture = Image.fromarray(frames[step]).quantize(256)
        picture.save(FOLDER / f"{name}.png", optimize=True)
    longest = max(record.played for record, _ in played.values())
    curves = {name: np.full((1, longest + 1), np.nan) for name in played}
    for name, (record, _) in played.items():
        curves[name][0, : record.played + 1] = record.entropy
    plot_entropy_curves(curves, FOLDER / "curves.png")
    for name, (record, _) in played.items():
        print(f"{name}: {record.played} steps, right: {record.success}")


if __name__ == "__main__":
    main()
