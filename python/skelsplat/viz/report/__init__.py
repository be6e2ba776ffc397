"""A run as one HTML page that opens from disk: numbers, tables, charts and the sequence in 3D."""

from skelsplat.viz.report._data import (
    CameraShapes,
    Column,
    KeyNumber,
    ProblemRow,
    ReportData,
    Sequence3D,
    Table,
    TimeLine,
)
from skelsplat.viz.report._page import write_report

__all__ = [
    "CameraShapes",
    "Column",
    "KeyNumber",
    "ProblemRow",
    "ReportData",
    "Sequence3D",
    "Table",
    "TimeLine",
    "write_report",
]
