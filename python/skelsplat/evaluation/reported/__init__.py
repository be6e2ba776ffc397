"""Figures that others published, as data: every table of the paper, and what its sources quote.

>>> from skelsplat.evaluation.reported import reported
>>> reported("tab:abl-views").rows[0].value("5")
17.7

One JSON file per table, each row with its method, training data, detector and citation. Nothing here was
computed by this package.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.tables import Row
from skelsplat.exceptions import one_of

__all__ = ["Published", "ReportedRow", "ReportedTable", "labels", "published", "reported"]

_FOLDER = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class ReportedRow:
    """One row of a published table; None where the table does not say."""

    method: str  #: as this package writes it: the same method has the same name in every table
    detector: str | None  #: where the 2D keypoints come from: ``"metrabs"``, ``"cpn"``, ``"resnet152"``, …
    citation: str  #: authors, title, venue and year
    truth_3d: bool | None  #: whether it was trained with 3D ground truth
    training: str | None  #: the data set it was trained on
    setting: Mapping[str, str]  #: what else tells the row from others: ``{"init": "fusion"}``
    keys: tuple[str, ...]  #: names of the C columns, for `value`
    values: tuple[float | None, ...]  #: C numbers in the table's unit; None where the table has none

    @property
    def name(self) -> str:
        """Method, with its detector."""
        return self.method if self.detector is None else f"{self.method} ({self.detector})"

    def value(self, key: str) -> float | None:
        """Return the number in the column `key`; None if the table leaves it out.

        Raises `InvalidInputError` if there is no such column.
        """
        one_of("key", key, self.keys)
        return self.values[self.keys.index(key)]

    def cells(self, keys: Sequence[str | None]) -> tuple[float | None, ...]:
        """Return the numbers in some columns; None also in those that the table does not have."""
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
    notes: tuple[str, ...] = field(default=())  #: what to know before comparing

    def __iter__(self) -> Iterator[ReportedRow]:
        return iter(self.rows)

    def select(
        self, method: str | None = None, *, detector: str | None = None, **setting: str
    ) -> tuple[ReportedRow, ...]:
        """Return the rows of a method, a detector, a setting: ``select("SkelSplat", init="dlt")``."""
        return tuple(
            row
            for row in self.rows
            if (method is None or row.method == method)
            and (detector is None or row.detector == detector)
            and all(row.setting.get(name) == value for name, value in setting.items())
        )


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
        optional: dict[str, Any] = {"detector": None, "training": None, "truth_3d": None, "setting": {}}
        own = {"citation": references[row["citation"]], "keys": lists["keys"], "values": values}
        rows.append(ReportedRow(**{**optional, **row, **own}))
    return ReportedTable(**{**content, **lists, "rows": tuple(rows)})


@dataclass(frozen=True, slots=True)
class Published:
    """The table that was published of a data set, and its columns that can be compared."""

    table: ReportedTable
    absolute: str  #: key of the column with the average absolute error, mm
    pcp: str | None = None  #: of that with the PCP, %

    def rows(self, keys: Sequence[str | None]) -> list[Row]:
        """Return all rows with these of their columns; None is a column that the table does not have."""
        return [Row(row.name, row.cells(keys), "reported") for row in self.table]

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
        "human36m-occ": ("tab:h36m-occ", variant[1]) if variant else None,
        "panoptic": ("tab:cmu", "average") if four else ("tab:abl-views", str(n_views)),
        "occlusion-person": ("tab:occ-pers", str(n_views)),
        "shelf": ("xrmocap:shelf", "mpjpe", "pcp"),
        "campus": ("xrmocap:campus", "mpjpe", "pcp"),
    }.get(protocol.name)
    return Published(reported(found[0]), *found[1:]) if found else None
