"""Figures and pages of refined poses and of measurements: arrays in, PNG, PDF and HTML files out.

A leaf of the package: it computes no pose and no rendering, and only runs, evaluations and commands import
it. Figures are drawn on matplotlib's Agg canvas through its object interface, so no display is involved;
matplotlib's settings are changed while one is drawn, and no longer. matplotlib and plotly come with the extra
``viz``.
"""

from skelsplat._optional import require

require("matplotlib", "figures", "viz")  # before the modules below import it

from skelsplat.viz import report
from skelsplat.viz._body import Skeleton
from skelsplat.viz._style import person_colour, write_pages
from skelsplat.viz.curves import Curve, CurvePanel, TimeAxis, bone_panel, draw_curves
from skelsplat.viz.matrices import ErrorMapData, WeightData, draw_error_map, write_weights
from skelsplat.viz.overview import CameraPanel, OverviewData, write_overview
from skelsplat.viz.people import PeopleData, PersonTrack, write_people

__all__ = [
    "CameraPanel",
    "Curve",
    "CurvePanel",
    "ErrorMapData",
    "OverviewData",
    "PeopleData",
    "PersonTrack",
    "Skeleton",
    "TimeAxis",
    "WeightData",
    "bone_panel",
    "draw_curves",
    "draw_error_map",
    "person_colour",
    "report",
    "write_overview",
    "write_pages",
    "write_people",
    "write_weights",
]
