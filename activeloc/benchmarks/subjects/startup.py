"""Seconds of the clock until a new process has done its work.

What is kept between processes is kept: Python's bytecode, as installers write it, and the kernels.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

from activeloc.benchmarks.clock import Call, alternate
from activeloc.benchmarks.report import Row, at_most
from activeloc.benchmarks.settings import Settings

NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"
HELP = [sys.executable, "-m", "activeloc.cli", "--help"]
STEP = """
import gymnasium, activeloc
env = gymnasium.make("activeloc/GlobalLocalization-v0", map={map!r})
env.reset(seed=0)
env.step(2)
"""


def measure(settings: Settings) -> Iterator[Row]:
    """The command's help; make, reset and step."""
    office = "rooms(width=6,height=6):0" if settings.quick else "office"
    rounds = (1, 1) if settings.quick else (3, 9)
    for name, command, limit in (
        ("activeloc --help", HELP, 0.5),
        ("make, reset, step", [sys.executable, "-c", STEP.format(map=office)], 2.0),
    ):
        spent: list[float] = []
        seconds = alternate(
            {"": _run_of(command, spent)}, budget=5.0, rounds=rounds, clock=time.perf_counter,
            warm_up=not settings.quick,
        )[""]  # fmt: skip
        note = f"of which {np.median(spent):.2f} s of processor time"
        yield Row.of("startup", name, "s", seconds, target=at_most(limit), note=note)


def _run_of(command: list[str], spent: list[float]) -> Call:
    """Run a command to its end; its processor time goes to ``spent``."""
    environment = {key: value for key, value in os.environ.items() if key != NO_BYTECODE}

    def run() -> None:
        before = os.times()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        after = os.times()
        children = after.children_user - before.children_user
        spent.append(children + after.children_system - before.children_system)

    return run
