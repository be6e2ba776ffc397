"""Figures that others published, as data: every table of the paper, and what its sources quote.

>>> from skelsplat.evaluation.reported import reported
>>> reported("tab:abl-views").rows[0].value("5")
17.7

One JSON file per table, each row with its method, training data, detector and citation. Nothing here was
computed by this package.
"""

from skelsplat.evaluation.reported._load import ReportedRow, ReportedTable, labels, reported

__all__ = ["ReportedRow", "ReportedTable", "labels", "reported"]
