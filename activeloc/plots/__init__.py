"""Figures from plain arrays, as PNG files.

matplotlib is imported when a figure is drawn, never before, and no figure touches pyplot's global
state: nothing here needs a display or leaves a setting changed. Files appear whole or not at all.
"""

from activeloc.plots.canvas import OKABE_ITO
from activeloc.plots.curves import mean_with_band, plot_entropy_curves
from activeloc.plots.ranks import plot_rank_histograms, plot_reliability
from activeloc.plots.runs import plot_errors, plot_paths
from activeloc.plots.views import plot_egocentric, plot_surroundings

__all__ = [
    "OKABE_ITO",
    "mean_with_band",
    "plot_egocentric",
    "plot_entropy_curves",
    "plot_errors",
    "plot_paths",
    "plot_rank_histograms",
    "plot_reliability",
    "plot_surroundings",
]
