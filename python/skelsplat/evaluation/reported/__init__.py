"""Figures that others published, as data: every table of the paper, and what its sources quote.

>>> from skelsplat.evaluation.reported import reported
>>> reported("tab:abl-views").rows[0].cells(["4", "5"])
(20.9, 17.7)

One JSON file per table, each row with its method, training data, detector and citation. Nothing here was
computed by this package.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.tables import Row
from skelsplat.exceptions import one_of

_FOLDER = Path(__file__).parent


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedRow:
    """One row of a published table; None where the table does not say."""

    method: str  #: as this package writes it: the same method has the same name in every table
    detector: str | None = (
        None  #: where the 2D keypoints come from: ``"metrabs"``, ``"cpn"``, ``"resnet152"``, …
    )
    citation: str  #: authors, title, venue and year
    truth_3d: bool | None = None  #: whether it was trained with 3D ground truth
    training: str | None = None  #: the data set it was trained on
    setting: Mapping[str, str] = field(
        default_factory=dict
    )  #: what else tells the row from others: ``{"init": "fusion"}``
    keys: tuple[str, ...]  #: names of the C columns
    values: tuple[float | None, ...]  #: C numbers in the table's unit; None where the table has none

    @property
    def name(self) -> str:
        """Method, with its detector."""
        return self.method if self.detector is None else f"{self.method} ({self.detector})"

    def cells(self, keys: Sequence[str | None]) -> tuple[float | None, ...]:
        """Return the numbers in some columns; None where the table has no number or no such column."""
        known = dict(zip(self.keys, self.values, strict=True))
        return tuple(None if key is None else known.get(key) for key in keys)


@dataclass(frozen=True, slots=True)
class ReportedTable:
    """A published table."""

    #: ``"tab:h36m"``: the paper's label; ``"text:…"``: said in its text; else ``"publication:data set"``.
    label: str
    title: str
    source: str
    dataset: str  #: as in the registry of `skelsplat.datasets`
    metric: str
    unit: str
    columns: tuple[str, ...]  #: C headers as printed
    #: The same columns by the names that this package uses: actions, numbers of views, settings.
    keys: tuple[str, ...]
    rows: tuple[ReportedRow, ...]
    notes: tuple[str, ...]  #: what to know before comparing


def reported(label: str) -> ReportedTable:
    """Return the published table with one of the `labels`: ``reported("tab:h36m")``.

    Raises `InvalidInputError` if there is none; the message lists them.
    """
    one_of("label", label, _tables())
    return _tables()[label]


def labels() -> tuple[str, ...]:
    """Return the labels of all tables, the paper's own first."""
    return tuple(_tables())


@cache
def _tables() -> Mapping[str, ReportedTable]:
    """Read every table, by label; the test suite checks the files."""
    files = {
        path.name: json.loads(path.read_text(encoding="utf-8")) for path in sorted(_FOLDER.glob("*.json"))
    }
    references = files.pop("references.json")
    tables = [_table(content, references) for content in files.values()]
    tables.sort(key=lambda table: (not table.label.startswith(("tab:", "text:")), table.label))
    return {table.label: table for table in tables}


def _table(content: dict[str, Any], references: Mapping[str, str]) -> ReportedTable:
    lists = {name: tuple(content[name]) for name in ("columns", "keys", "notes")}
    rows = []
    for row in content["rows"]:
        values = tuple(None if value is None else float(value) for value in row["values"])
        own = {"citation": references[row["citation"]], "keys": lists["keys"], "values": values}
        rows.append(ReportedRow(**{**row, **own}))
    return ReportedTable(**{**content, **lists, "rows": tuple(rows)})


@dataclass(frozen=True, slots=True)
class Published:
    """The table that was published of a data set, and its columns that can be compared."""

    table: ReportedTable
    absolute: str  #: key of the column with the average absolute error, mm
    pcp: str | None = None  #: of that with the PCP, %

    def rows(self, keys: Sequence[str | None]) -> list[Row]:
        """Return all rows with these of their columns; None is a column that the table does not have."""
        return [Row(row.name, row.cells(keys), "reported") for row in self.table.rows]

    def note(self, real: str = "") -> str:
        """Return what the rows are; `real` says of what they are, if not of the same data."""
        notes = " ".join(self.table.notes)
        return f"Reported (in italics), not measured here{real}: {self.table.source}. {notes}"


def published(dataset: Dataset, protocol: Protocol) -> Published | None:
    """Return the table that was published of this data set and number of views, if there is one."""
    n_views = protocol.n_views or len((dataset.takes or dataset.scenes)[0].rig)
    four = n_views == 4
    variant = re.search(r"occ-(2|3-hard|3)\b", f"{dataset.name} {dataset.source}".lower())
    found = {
        "human36m": ("tab:h36m", "average"),
        "human36m-hourglass": ("tab:h36m", "average"),
        "human36m-occ": ("tab:h36m-occ", variant[1]) if variant else None,
        "panoptic": ("tab:cmu", "average") if four else ("tab:abl-views", str(n_views)),
        "occlusion-person": ("tab:occ-pers", str(n_views)),
        "shelf": ("xrmocap:shelf", "mpjpe", "pcp"),
        "campus": ("xrmocap:campus", "mpjpe", "pcp"),
    }.get(protocol.name)
    return Published(reported(found[0]), *found[1:]) if found else None
