"""Cost of films and replays: ``python -m benchmarks.pictures [--pictures DIR]``.

An episode of 300 steps that no declaration ends is recorded with each of two agents, with a sensor
that sees as far as by default and with one that sees 0.5 m, whose belief stays spread out: the
hardest to pack. Films are made of the first 100 steps. Pages are opened in a headless Chromium:
the time is from the navigation's start until the first moment is drawn, the median of five; the
rate is that of moments shown, at 60 steps a second. With a folder, the pictures in docs/seeing.md
are taken besides.

Seconds are those of the clock: what else the machine does is in them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table

from activeloc.agents.evaluation import Player, evaluate, write_gallery
from activeloc.cli.game import Game
from activeloc.cli.settings import make_sweep
from activeloc.envs.rendering import Recording, frames_of, write_gif, write_mp4, write_page

AGENTS = ("active", "spin")
ENDLESS = ["task.confidence=1", "task.hold=1000000"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PICTURES = ("replay.png", "replay-dark.png", "replay-phone.png", "play.png", "report.png")
SHOWN = """(seconds) => new Promise((done) => {
  let shown = 0;
  const count = new MutationObserver(() => { shown += 1; });
  count.observe(document.getElementById("at"), { childList: true });
  const begun = performance.now();
  document.getElementById("play").click();
  setTimeout(() => done(shown / ((performance.now() - begun) / 1000)), 1000 * seconds);
})"""
SEEK = """(step) => {
  const scrubber = document.getElementById("scrubber");
  scrubber.value = step;
  scrubber.dispatchEvent(new Event("input"));
}"""


def record(
    settings: Sequence[str], belief: str, map_spec: str, steps: int, endless: bool = True
) -> list[Recording]:
    """An episode with each agent."""
    settings = [*(ENDLESS if endless else []), *settings]
    sweep = make_sweep("GlobalLocalization-v0", map_spec, belief, AGENTS, settings, 0, steps)
    player = Player(sweep)
    return [player.record(name, 0)[1] for name in AGENTS]


def shortened(recording: Recording, steps: int) -> Recording:
    """The first steps of a recording."""
    kept: dict[str, Any] = {}
    for item in fields(recording):
        value = getattr(recording, item.name)
        if isinstance(value, np.ndarray | tuple) and len(value) == len(recording):
            kept[item.name] = value[: steps + 1]
    short = {"actions": recording.actions[:steps], "commands": recording.commands[:steps]}
    return replace(recording, **{**kept, **short})


def seconds(call: Callable[[], object]) -> float:
    """How long a call takes."""
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def films(one: Recording, both: Sequence[Recording], folder: Path) -> Table:
    """GIF and MP4 of 100 steps."""
    table = Table("film of 100 steps", "seconds", "MB", box=None)
    for what, recordings, size in (("one agent", [one], 600), ("two agents", both, 480)):
        cut = [shortened(recording, 100) for recording in recordings]
        gif, mp4 = folder / "film.gif", folder / "film.mp4"
        took = seconds(lambda: write_gif(list(frames_of(cut, size)), gif))  # noqa: B023
        table.add_row(f"GIF, {what}", f"{took:.1f}", f"{gif.stat().st_size / 1e6:.2f}")
        took = seconds(lambda: write_mp4(frames_of(cut, size), mp4))  # noqa: B023
        table.add_row(f"MP4, {what}", f"{took:.1f}", f"{mp4.stat().st_size / 1e6:.2f}")
    return table


def pages(cases: dict[str, Sequence[Recording]], folder: Path, browser: Any) -> Table:
    """Size of each page, time until it is open, moments a second while it plays."""
    table = Table("page", "steps", "MB", "opens in [ms]", "moments / s", box=None)
    for what, recordings in cases.items():
        path = folder / "page.html"
        write_page(recordings, path)
        opened = []
        for _ in range(5):
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.goto(path.as_uri())
            page.locator("html[data-ready]").wait_for()
            opened.append(float(page.locator("html").get_attribute("data-ready")))
            if len(opened) < 5:
                page.close()
        page.locator("#speed").select_option("60")
        rate = page.evaluate(SHOWN, 4)
        page.close()
        steps = max(map(len, recordings)) - 1
        megabytes = f"{path.stat().st_size / 1e6:.2f}"
        table.add_row(what, f"{steps}", megabytes, f"{np.median(opened):.0f}", f"{rate:.0f}")
    return table


def screenshots(recordings: Sequence[Recording], folder: Path, browser: Any) -> None:
    """The pictures in the docs: two agents in the light, one in the dark, one on a phone."""
    path = folder / "page.html"
    desk = {"width": 1280, "height": 860}
    phone = {"width": 390, "height": 780}
    for name, shown, step, settings in (
        ("replay.png", recordings, 14, {"viewport": desk}),
        ("replay-dark.png", recordings[:1], 14, {"viewport": desk, "color_scheme": "dark"}),
        ("replay-phone.png", recordings[:1], 14, {"viewport": phone, "is_mobile": True}),
    ):
        write_page(shown, path, "activeloc/GlobalLocalization-v0, histogram belief")
        context = browser.new_context(**settings)
        page = context.new_page()
        page.goto(path.as_uri())
        page.locator("html[data-ready]").wait_for()
        page.evaluate(SEEK, step)
        page.screenshot(path=folder / name)
        context.close()
    path.unlink()


def picture_of_a_game(map_spec: str, folder: Path) -> None:
    """What `activeloc play` shows after some keys."""
    advisers = ["spin", "greedy", "lookahead", "active"]
    game = Game(make_sweep("GlobalLocalization-v0", map_spec, "histogram", advisers, [], 0, None))
    for key in ("up", "up", "left", "up", "up", "right"):
        game.press(key)
    Image.fromarray(game.frame()).save(folder / "play.png", optimize=True)


def picture_of_a_report(folder: Path, browser: Any) -> None:
    """The page of a small evaluation."""
    sweep = make_sweep(
        "GlobalLocalization-v0", "rooms:0-3", "histogram", ["spin", "greedy"], [], 0, 100, 8
    )
    with tempfile.TemporaryDirectory() as name:
        write_gallery(evaluate(sweep, Path(name), command="activeloc evaluate ..."), Path(name))
        page = browser.new_page(viewport={"width": 1100, "height": 800})
        page.goto((Path(name) / "report.html").as_uri())
        page.screenshot(path=folder / "report.png", full_page=True)
        page.close()


def main() -> None:
    """Measure and print; with a folder, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", default="office:3")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--pictures", type=Path, help="folder for the pictures in the docs")
    given = parser.parse_args()
    from playwright.sync_api import sync_playwright

    usual = record([], "histogram", given.map, given.steps)
    hard = record(["sensor.z_max=0.5"], "histogram", given.map, given.steps)
    cloud = record([], "particles", given.map, given.steps)
    console = Console()
    with tempfile.TemporaryDirectory() as name, sync_playwright() as run:
        folder = Path(name)
        path = next(filter(None, map(shutil.which, BROWSERS)))
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = run.chromium.launch(executable_path=path, args=arguments)
        cases = {
            f"{AGENTS[1]}": usual[1:],
            f"{' and '.join(AGENTS)}": usual,
            f"{AGENTS[1]}, sees 0.5 m": hard[1:],
            f"{' and '.join(AGENTS)}, see 0.5 m": hard,
            f"{AGENTS[1]}, particles": cloud[1:],
        }
        console.print(f"{given.map}, Chromium {browser.version}, load {os.getloadavg()[0]:.1f}\n")
        console.print(pages(cases, folder, browser))
        if given.pictures is not None:
            declared = record([], "histogram", given.map, 150, endless=False)
            screenshots(declared, given.pictures, browser)
            picture_of_a_game(given.map, given.pictures)
            picture_of_a_report(given.pictures, browser)
            for picture in given.pictures.glob("*.png"):
                if picture.name in PICTURES:
                    Image.open(picture).convert("RGB").quantize(256).save(picture, optimize=True)
        browser.close()
        console.print()
        console.print(films(usual[1], usual, folder))


if __name__ == "__main__":
    main()
