"""A run as one HTML page that opens from disk: numbers, tables, charts and the sequence in 3D."""

from skelsplat._words import Table
from skelsplat.viz.report._page import Heat, HeatMap, ReportData, TimeLines, write_report
from skelsplat.viz.report._scene import CameraShapes, Sequence3D, person_class

__all__ = [
    "CameraShapes",
    "Heat",
    "HeatMap",
    "ReportData",
    "Sequence3D",
    "Table",
    "TimeLines",
    "person_class",
    "write_report",
]
