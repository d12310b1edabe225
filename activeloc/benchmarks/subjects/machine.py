"""Bandwidth, look-ups and arithmetic of one thread: the floors that costs are held against."""

from __future__ import annotations

from collections.abc import Iterator

from activeloc.benchmarks.clock import alternate
from activeloc.benchmarks.floors import copying, looking_up, multiplying
from activeloc.benchmarks.report import Curve, Row
from activeloc.benchmarks.settings import Settings


def measure(settings: Settings) -> Iterator[Row | Curve]:
    """Of a copy by its size; of look-ups in tables; of float32 arithmetic."""
    budget, rounds = settings.budget / 4, settings.rounds
    sizes = (2e6, 16e6, 128e6, 512e6)[: settings.size(4, 2)]
    rates = []
    for size in sizes:
        seconds = alternate({"": copying(int(size))}, budget=budget, rounds=rounds)[""]
        row = Row.of("machine", f"copy of {size / 2e6:.0f} MB", "GB/s", 1e-9 * size / seconds)
        rates.append(row.ours.median)
        yield row
    moved = tuple(1e-6 * size for size in sizes)
    yield Curve("bandwidth", "moved [MB]", "bandwidth [GB/s]", "one thread", moved, tuple(rates))
    n = settings.size(1_000_000, 10_000)
    for size, what in ((2**18, "256 kB"), (2**25, "32 MB")):
        for coherent in (True, False):
            call = looking_up(size, n, coherent)
            seconds = alternate({"": call}, budget=budget, rounds=rounds)[""]
            how = "one after the other" if coherent else "anywhere"
            yield Row.of("machine", f"look-ups in {what}, {how}", "ns", 1e9 * seconds / n)
    call, flops = multiplying(settings.size(200, 20))
    seconds = alternate({"": call}, budget=budget, rounds=rounds)[""]
    yield Row.of("machine", "multiply and add", "Gflop/s", 1e-9 * flops / seconds, note="float32")
