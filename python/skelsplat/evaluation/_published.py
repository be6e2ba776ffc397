"""Which published table belongs beside an evaluation, and which of its columns."""

from __future__ import annotations

import re
from dataclasses import dataclass

from skelsplat.datasets import Dataset
from skelsplat.evaluation._protocol import Protocol
from skelsplat.evaluation.reported import ReportedRow, ReportedTable, reported


@dataclass(frozen=True, slots=True)
class Published:
    """A published table and its columns that can be compared.

    Attributes
    ----------
    table : ReportedTable
    absolute, pcp : str or None
        Keys of the columns with the average absolute error, mm, and the PCP, %.
    """

    table: ReportedTable
    absolute: str | None
    pcp: str | None = None

    def name(self, row: ReportedRow) -> str:
        """Name of a row, with its detector."""
        return row.method if row.detector is None else f"{row.method} ({row.detector})"

    def value(self, row: ReportedRow, key: str | None) -> float | None:
        """Return a row's number in a column that may not be there."""
        return row.value(key) if key is not None and key in self.table.keys else None


def published(dataset: Dataset, protocol: Protocol) -> Published | None:
    """Return the table that was published of this data set and number of views, if there is one."""
    n_views = len(dataset.takes[0].rig) if protocol.n_views is None else protocol.n_views
    if protocol.name == "human36m":
        return Published(reported("tab:h36m"), "average")
    if protocol.name == "human36m-occ":
        variant = re.search(r"occ-(2|3-hard|3)\b", f"{dataset.name} {dataset.source}".lower())
        return Published(reported("tab:h36m-occ"), variant.group(1)) if variant else None
    if protocol.name == "panoptic":
        if n_views == 4:
            return Published(reported("tab:cmu"), "average")
        return Published(reported("tab:abl-views"), str(n_views))
    if protocol.name == "occlusion-person":
        return Published(reported("tab:occ-pers"), str(n_views))
    if protocol.name in ("shelf", "campus"):
        return Published(reported(f"xrmocap:{protocol.name}"), "mpjpe", "pcp")
    return None
