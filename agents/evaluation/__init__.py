"""Evaluation: agents play the same episodes, and what can be said of them afterwards.

A :class:`Sweep` says what is played, :func:`evaluate` plays it into a folder and returns the
:class:`Report`. Scores count every failure: an episode that ends without a right declaration has
taken the limit's steps, and its entropy counts as 1 from a wrong declaration on.

>>> from pathlib import Path
>>> from activeloc.agents.evaluation import Sweep, evaluate
>>> from activeloc.maps import MapSource
>>> sweep = Sweep(
...     env="activeloc/GlobalLocalization-v0",
...     map=MapSource.parse("office:0-3"),
...     agents={"random": {}, "greedy": {"samples": 400}},
...     settings={"belief": "histogram"},
... )
>>> evaluate(sweep, Path("results"), jobs=2).scores["greedy"]["right"]  # doctest: +SKIP
"""

from activeloc.agents.evaluation.episodes import Player
from activeloc.agents.evaluation.gallery import write_gallery
from activeloc.agents.evaluation.records import Record, penalised_area
from activeloc.agents.evaluation.report import Report
from activeloc.agents.evaluation.runner import evaluate, n_kept
from activeloc.agents.evaluation.starts import Starts
from activeloc.agents.evaluation.statistics import Estimate
from activeloc.agents.evaluation.sweep import Sweep

__all__ = [
    "Estimate",
    "Player",
    "Record",
    "Report",
    "Starts",
    "Sweep",
    "evaluate",
    "n_kept",
    "penalised_area",
    "write_gallery",
]
