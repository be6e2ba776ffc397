"""A run as one HTML page that opens from disk: numbers, tables, charts and the sequence in 3D."""

from skelsplat.viz.report._page import ReportData, write_report
from skelsplat.viz.report._parts import Table, TimeLine, TimeLines
from skelsplat.viz.report._people import PeopleReportData, write_people_report
from skelsplat.viz.report._scene import CameraShapes, Sequence3D, person_class

__all__ = [
    "CameraShapes",
    "PeopleReportData",
    "ReportData",
    "Sequence3D",
    "Table",
    "TimeLine",
    "TimeLines",
    "person_class",
    "write_people_report",
    "write_report",
]
