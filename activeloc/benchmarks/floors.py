"""What no code on a machine can go under: memory's bandwidth, a look-up, a multiplication."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from activeloc.benchmarks.clock import alternate


def copying(n_bytes: int) -> Callable[[], object]:
    """A copy that moves ``n_bytes``, half of them read and half written."""
    source = np.ones(max(1, n_bytes // 8), dtype=np.float32)
    target = np.empty_like(source)
    return lambda: np.copyto(target, source)


def seconds_of_copy(n_bytes: float) -> float:
    """Median of a few copies that move so many bytes."""
    return float(np.median(alternate({"": copying(int(n_bytes))}, budget=0.02)[""]))


def seconds_of_look_up(coherent: bool) -> float:
    """Of one in a table that the last cache holds."""
    n = 100_000
    seconds = alternate({"": looking_up(2**23, n, coherent)}, budget=0.02)[""]
    return float(np.median(seconds)) / n


@njit(cache=True, nogil=True)
def _look_up(table: NDArray[np.uint8], at: NDArray[np.uint32]) -> int:
    """Sum of the table's entries at places ``(N,)``."""
    total = 0
    for i in at:
        total += table[i]
    return total


def looking_up(n_bytes: int, n: int, coherent: bool) -> Callable[[], object]:
    """``n`` look-ups in a table of bytes, one after the other or anywhere."""
    rng = np.random.default_rng(0)
    table = rng.integers(0, 255, n_bytes, dtype=np.uint8)
    at = np.arange(n) % n_bytes if coherent else rng.integers(0, n_bytes, n)
    places = at.astype(np.uint32)
    return lambda: _look_up(table, places)


@njit(cache=True, nogil=True)
def _multiply_add(x: NDArray[np.float32], times: int) -> None:
    """Halve and add one, many times over."""
    half, one = np.float32(0.5), np.float32(1.0)
    for _ in range(times):
        for i in range(x.shape[0]):
            x[i] = half * x[i] + one


def multiplying(times: int) -> tuple[Callable[[], object], int]:
    """A multiplication and an addition of numbers that fit the first cache; flops of a call."""
    x = np.ones(4096, dtype=np.float32)
    return lambda: _multiply_add(x, times), 2 * x.size * times
