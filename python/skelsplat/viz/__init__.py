"""Figures of a refined pose and of an evaluation: arrays in, PNG files out.

A leaf of the package: it computes no pose and no rendering, and only the command line imports it. Figures are
drawn on matplotlib's Agg canvas through its object interface, so no display and no global state is involved.
"""

from skelsplat.viz._skeleton import Skeleton, body_axes
from skelsplat.viz.bars import BarData, write_bars
from skelsplat.viz.heatmaps import HeatmapRow, write_heatmaps
from skelsplat.viz.overview import OverviewData, write_overview

__all__ = [
    "BarData",
    "HeatmapRow",
    "OverviewData",
    "Skeleton",
    "body_axes",
    "write_bars",
    "write_heatmaps",
    "write_overview",
]
