"""Predict and correct by a likelihood that is at hand: the histogram filter's kernels alone.

The filter's public methods reckon a scan's likelihood anew, sort out what is background, remember
what was read where. Held against a blur of the same array there is no such thing: this is the one
place of the benchmarks that reaches under :class:`~activeloc.beliefs.histogram.HistogramBelief`.
"""

from __future__ import annotations

import numpy as np

from activeloc.beliefs.grid_belief import GridBelief
from activeloc.beliefs.grid_tables import GridTables


class DenseStep:
    """A turn, a travel and a correction of a belief that is everywhere.

    Args:
        tables: Of the map.
        taps: Of the turn, over headings.
        level: Travel [half cells].
        seed: Of the likelihood.
    """

    def __init__(self, tables: GridTables, taps: int, level: int, seed: int = 0) -> None:
        self.tables, self.level = tables, level
        weights = np.exp(-0.5 * np.linspace(-2.0, 2.0, taps) ** 2)
        self.taps, self.first = weights / weights.sum(), -(taps // 2)
        self.bel = GridBelief(tables, tables.everywhere)
        rng = np.random.default_rng(seed)
        likelihood = rng.uniform(0.5, 1.0, (tables.layout.size, tables.layout.width))
        self.likelihood = likelihood.astype(np.float32).ravel()

    @property
    def n_states(self) -> int:
        """States of the belief."""
        return self.tables.layout.headings * len(self.tables.layout.place)

    @property
    def n_taps(self) -> float:
        """Entries of a heading's travel stencil, on average."""
        start = self.tables.travel.level(self.level).stencil_start
        return float(np.diff(start).mean())

    def __call__(self) -> None:
        """bel(x) = eta p(z | x) sum over x' of p(x | u, x') bel(x')."""
        self.bel.rotate(self.first, self.taps)
        self.bel.travel(self.level, 1, 1.0)
        self.bel.normalise(self.bel.weigh(self.likelihood, 0.0), 0.0)
