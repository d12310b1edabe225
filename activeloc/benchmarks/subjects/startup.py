"""Seconds of the clock until a new process has done its work, its kernels compiled before."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

from activeloc.benchmarks.clock import Call, alternate
from activeloc.benchmarks.report import Row, at_most
from activeloc.benchmarks.settings import Settings

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
    rounds = (1, 1) if settings.quick else (5, 9)
    for name, command, limit in (
        ("activeloc --help", HELP, 0.5),
        ("make, reset, step", [sys.executable, "-c", STEP.format(map=office)], 2.0),
    ):
        run = _run_of(command)
        calls = {"": run}
        warm = not settings.quick
        seconds = alternate(
            calls, budget=5.0, rounds=rounds, clock=time.perf_counter, warm_up=warm
        )[""]
        yield Row.of("startup", name, "s", seconds, target=at_most(limit))


def _run_of(command: list[str]) -> Call:
    return lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
