"""A scan, made ready to weigh many states: p(z | x) as look-ups and multiplications.

Beams that count alike share one table of likelihoods raised to the filter's power, made once per
map; then a state costs a look-up and a multiplication a beam, and no exponential. Where that could
leave the range of a float32 (many beams, impossible readings) or the beams count differently,
log-likelihoods are added up instead and the largest is taken out before the exponential.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs import grid_likelihood as kernels
from activeloc.beliefs.grid_layout import GridLayout, Sheet
from activeloc.beliefs.reading_table import ReadingTable

SPAN = 60.0  # Greatest log-range of a product: exp(-60) times the least state is a float32 still.


class PoweredTable:
    """P(z | row) to a power.

    Args:
        table: Of the sensor.
        power: Exponent on each reading's likelihood.
        precision: ``float32`` or ``float64``.
    """

    def __init__(self, table: ReadingTable, power: float, precision: str) -> None:
        self.power = power
        self.p = np.exp(power * table.log_p.astype(np.float64)).astype(precision)
        """``(Z, R)``."""
        self.low, self.high = power * table.log_p.min(axis=1), power * table.log_p.max(axis=1)
        """``(Z,)`` each; logarithms of the least and the largest likelihood of a reading."""


@dataclass(frozen=True, slots=True)
class ScanLikelihood:
    """p(z | x) of one scan.

    Attributes:
        table: Of the sensor.
        powered: The same to the filter's power.
        beams: ``(A,)``; the beams that count,
        readings: ``(A,)``; their bins and
        weights: ``(A,)``; how much each counts.
        as_product: Whether likelihoods are multiplied.
        highest: Logarithm of the largest product there can be, if they are.
    """

    table: ReadingTable
    powered: PoweredTable
    beams: NDArray[np.intp]
    readings: NDArray[np.int32]
    weights: NDArray[np.float64]
    as_product: bool
    highest: float

    @classmethod
    def of(
        cls,
        table: ReadingTable,
        powered: PoweredTable,
        readings: NDArray[np.int32],
        weights: NDArray[np.float64],
    ) -> ScanLikelihood:
        """From a scan's bins ``(B,)``, -1 for no reading, and how much each counts ``(B,)``."""
        beams, readings, weights, alike, lowest, highest = kernels.sort_out(
            readings, weights, powered.power, powered.low, powered.high
        )
        as_product = bool(alike and highest - lowest <= SPAN and abs(highest) <= SPAN)
        return cls(table, powered, beams, readings, weights, as_product, highest)

    def multiply(self, sheet: Sheet, layout: GridLayout, divisor: float) -> tuple[float, float]:
        """Weigh a belief as a product; see :func:`grid_likelihood.multiply`.

        Returns:
            The sum, and what its logarithm lacks: the log-evidence is ``log(sum) + shift``.
        """
        table, p, shift = self.table, self.powered.p, self.highest
        total = kernels.multiply(
            sheet.values, sheet.places, sheet.n, layout.headings, layout.width,
            table.rows, p.ravel(), p.shape[1], self.readings,
            table.offsets[self.beams], table.per_heading, exp(-shift) / divisor,
        )  # fmt: skip
        return float(total), shift

    def add_logarithms(self, sheet: Sheet, layout: GridLayout) -> tuple[float, float]:
        """Weigh a belief by sums of logarithms; see :func:`grid_likelihood.add_logarithms`."""
        table = self.table
        total, shift = kernels.add_logarithms(
            sheet.values, sheet.places, sheet.n, layout.headings, layout.width,
            table.rows, table.log_p, self.readings,
            table.offsets[self.beams], self.weights, table.per_heading,
        )  # fmt: skip
        return float(total), float(shift)

    def log_mean(self, rows: NDArray[np.unsignedinteger]) -> float:
        """Logarithm of the average likelihood over states given by all their rows ``(B, S)``."""
        if self.as_product:
            mean = kernels.mean_product(
                rows, self.beams, self.powered.p, self.readings, exp(-self.highest)
            )
            return log(mean) + self.highest
        return float(
            kernels.log_mean(rows, self.beams, self.table.log_p, self.readings, self.weights)
        )
