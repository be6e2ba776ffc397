"""Figures and pages of refined poses and of measurements: arrays in, PNG, PDF and HTML files out.

A leaf of the package: it computes no pose and no rendering, and only runs, evaluations and commands import
it. Figures are drawn on matplotlib's Agg canvas through its object interface, so no display and no global
state is involved. matplotlib and plotly come with the extra ``viz``.
"""

from skelsplat._optional import require

require("matplotlib", "figures", "viz")  # before the modules below import it

from skelsplat.viz import report
from skelsplat.viz._cameras import CameraPanel
from skelsplat.viz._skeleton import Skeleton, body_axes
from skelsplat.viz._style import person_colour, write_pages
from skelsplat.viz._time import TimeAxis
from skelsplat.viz.angles import AngleCurve, AnglePanel, draw_angles
from skelsplat.viz.bones import Bone, BonePanel, draw_bones
from skelsplat.viz.charts import BarData, Line, Panel, write_bars, write_panels
from skelsplat.viz.error_map import ErrorMapData, draw_error_map
from skelsplat.viz.heatmaps import HeatmapRow, write_heatmaps
from skelsplat.viz.overview import OverviewData, write_overview
from skelsplat.viz.people import PeopleData, PersonTrack, write_people
from skelsplat.viz.trajectories import TrajectoryData, draw_trajectories
from skelsplat.viz.weights import WeightData, write_weights

__all__ = [
    "AngleCurve",
    "AnglePanel",
    "BarData",
    "Bone",
    "BonePanel",
    "CameraPanel",
    "ErrorMapData",
    "HeatmapRow",
    "Line",
    "OverviewData",
    "Panel",
    "PeopleData",
    "PersonTrack",
    "Skeleton",
    "TimeAxis",
    "TrajectoryData",
    "WeightData",
    "body_axes",
    "draw_angles",
    "draw_bones",
    "draw_error_map",
    "draw_trajectories",
    "person_colour",
    "report",
    "write_bars",
    "write_heatmaps",
    "write_overview",
    "write_pages",
    "write_panels",
    "write_people",
    "write_weights",
]
