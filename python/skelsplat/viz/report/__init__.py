"""A run as one HTML page that opens from disk: numbers, tables, charts and the sequence in 3D."""

from skelsplat.viz.report._page import ReportData, Table, TimeLine, write_report
from skelsplat.viz.report._scene import CameraShapes, Sequence3D

__all__ = ["CameraShapes", "ReportData", "Sequence3D", "Table", "TimeLine", "write_report"]
