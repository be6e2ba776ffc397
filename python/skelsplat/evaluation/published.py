"""Which published table belongs to a data set, and its rows beside those measured here."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.reported import ReportedRow, ReportedTable, reported
from skelsplat.evaluation.tables import Row


@dataclass(frozen=True, slots=True)
class Published:
    """A published table and its columns that can be compared."""

    table: ReportedTable
    #: absolute, pcp: Keys of the columns with the average absolute error, mm, and the PCP, %.
    absolute: str | None
    pcp: str | None = None

    def name(self, row: ReportedRow) -> str:
        """Name of a row, with its detector."""
        return row.method if row.detector is None else f"{row.method} ({row.detector})"

    def value(self, row: ReportedRow, key: str | None) -> float | None:
        """Return a row's number in a column that may not be there."""
        return row.value(key) if key is not None and key in self.table.keys else None

    def rows(self, keys: Sequence[str | None]) -> list[Row]:
        """Return all rows with these of their columns; None is a column that the table does not have."""
        return [
            Row(self.name(row), tuple(self.value(row, key) for key in keys), "reported") for row in self.table
        ]

    def note(self, real: str = "") -> str:
        """Return what the rows are; `real` says of what they are, if not of the same data."""
        notes = " ".join(self.table.notes)
        return f"Reported (in italics), not measured here{real}: {self.table.source}. {notes}"


def occlusion_of(dataset: Dataset) -> str | None:
    """Return the variant of Human3.6M-Occ that a data set is; None if nothing says so."""
    variant = re.search(r"occ-(2|3-hard|3)\b", f"{dataset.name} {dataset.source}".lower())
    return variant[1] if variant else None


def published(dataset: Dataset, protocol: Protocol) -> Published | None:
    """Return the table that was published of this data set and number of views, if there is one."""
    n_views = len(dataset.takes[0].rig) if protocol.n_views is None else protocol.n_views
    four, variant = n_views == 4, occlusion_of(dataset)
    found = {
        "human36m": ("tab:h36m", "average"),
        "human36m-occ": ("tab:h36m-occ", variant) if variant else None,
        "panoptic": ("tab:cmu", "average") if four else ("tab:abl-views", str(n_views)),
        "occlusion-person": ("tab:occ-pers", str(n_views)),
        "shelf": ("xrmocap:shelf", "mpjpe", "pcp"),
        "campus": ("xrmocap:campus", "mpjpe", "pcp"),
    }.get(protocol.name)
    return Published(reported(found[0]), *found[1:]) if found else None
