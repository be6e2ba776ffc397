"""Figures that others published, as data: every table of the paper, and what its sources quote.

>>> from skelsplat.evaluation.reported import reported
>>> reported("tab:abl-views").rows[0].value("5")
17.7

One JSON file per table, each row with its method, training data, detector and citation. Nothing here was
computed by this package.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from skelsplat.exceptions import one_of

__all__ = ["ReportedRow", "ReportedTable", "labels", "reported"]

_FOLDER = Path(__file__).parent
_REFERENCES = "references.json"


@dataclass(frozen=True, slots=True)
class ReportedRow:
    """One row of a published table."""

    method: str  #: as this package writes it: the same method has the same name in every table
    #: Where the 2D keypoints come from: ``"metrabs"``, ``"cpn"``, ``"resnet152"``, ``"resnet50"``; None: the
    #: table does not say.
    detector: str | None
    citation: str  #: authors, title, venue and year
    truth_3d: bool | None  #: whether it was trained with 3D ground truth; None: not known
    training: str | None  #: the data set it was trained on, where the table says
    setting: Mapping[str, str]  #: what else tells the row from others: ``{"init": "fusion"}``
    keys: tuple[str, ...]  #: names of the C columns, for `value`
    values: tuple[float | None, ...]  #: C numbers in the table's unit; None where the table has none

    def value(self, key: str) -> float | None:
        """Return the number in the column `key`; None if the table leaves it out.

        Raises `InvalidInputError` if there is no such column.
        """
        one_of("key", key, self.keys)
        return self.values[self.keys.index(key)]


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
    tables = _tables()
    one_of("label", label, tables)
    return tables[label]


def labels() -> tuple[str, ...]:
    """Return the labels of all tables, the paper's own first."""
    return tuple(_tables())


@cache
def _tables() -> Mapping[str, ReportedTable]:
    """Read every table, by label; the test suite checks the files."""
    paths = sorted(_FOLDER.glob("*.json"))
    files = {path.name: json.loads(path.read_text(encoding="utf-8")) for path in paths}
    references = files.pop(_REFERENCES)
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
