"""A published table and its rows, read from files with errors that name file and field."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from skelsplat.exceptions import DatasetError, InvalidInputError

FOLDER = Path(__file__).parent
_REFERENCES = "references.json"
_TEXTS = ("label", "title", "source", "dataset", "metric", "unit")
_OPTIONAL = ("detector", "training")


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

        Raises
        ------
        InvalidInputError
            If there is no such column.
        """
        if key not in self.keys:
            raise InvalidInputError(f"key: expected one of {', '.join(self.keys)}, got {key!r}")
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

    def one(self, method: str | None = None, *, detector: str | None = None, **setting: str) -> ReportedRow:
        """Return the only row that `select` finds.

        Raises
        ------
        InvalidInputError
            If there is none or more than one.
        """
        found = self.select(method, detector=detector, **setting)
        if len(found) != 1:
            asked = {"method": method, "detector": detector, **setting}
            raise InvalidInputError(f"{self.label}: expected one row with {asked}, got {len(found)}")
        return found[0]


def reported(label: str) -> ReportedTable:
    """Return a published table: ``reported("tab:h36m")``.

    Parameters
    ----------
    label : str
        One of `labels`.

    Raises
    ------
    InvalidInputError
        If there is no such table; the message lists them.
    DatasetError
        If its file is not what it should be.
    """
    tables = read_all(FOLDER)
    if label not in tables:
        raise InvalidInputError(f"label: expected one of {', '.join(tables)}, got {label!r}")
    return tables[label]


def labels() -> tuple[str, ...]:
    """Return the labels of all tables, the paper's own first."""
    return tuple(read_all(FOLDER))


@cache
def read_all(folder: Path) -> Mapping[str, ReportedTable]:
    """Read every table in a folder, by label."""
    references = {key: str(value) for key, value in _object(folder / _REFERENCES).items()}
    files = sorted(path for path in folder.glob("*.json") if path.name != _REFERENCES)
    tables = [read_table(path, references) for path in files]
    tables.sort(key=lambda table: (not table.label.startswith(("tab:", "text:")), table.label))
    out: dict[str, ReportedTable] = {}
    for table in tables:
        if table.label in out:
            raise DatasetError(folder, "label", "different labels", f"{table.label} twice")
        out[table.label] = table
    return out


def read_table(path: Path, references: Mapping[str, str]) -> ReportedTable:
    """Read one file; `references` gives the text of each citation."""
    content = _object(path)
    label, title, source, dataset, metric, unit = (_text(path, content, name) for name in _TEXTS)
    columns, keys, notes = (_texts(path, content, name) for name in ("columns", "keys", "notes"))
    if len(keys) != len(columns):
        raise DatasetError(path, "keys", f"{len(columns)} as columns", len(keys))
    rows = content.get("rows")
    if not isinstance(rows, list) or not rows:
        raise DatasetError(path, "rows", "a list of at least one row", rows)
    read = tuple(_row(path, f"rows[{k}]", row, keys, references) for k, row in enumerate(rows))
    return ReportedTable(label, title, source, dataset, metric, unit, columns, keys, read, notes)


def _row(
    path: Path, field: str, row: Any, keys: tuple[str, ...], references: Mapping[str, str]
) -> ReportedRow:
    if not isinstance(row, dict):
        raise DatasetError(path, field, "an object", row)
    values = row.get("values")
    if not isinstance(values, list) or len(values) != len(keys):
        raise DatasetError(path, f"{field}.values", f"{len(keys)} numbers", values)
    for k, value in enumerate(values):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise DatasetError(path, f"{field}.values[{k}]", "a number or null", repr(value))
    citation = _text(path, row, "citation", field)
    if citation not in references:
        raise DatasetError(path, f"{field}.citation", f"a key of {_REFERENCES}", repr(citation))
    truth = row.get("truth_3d")
    if truth is not None and not isinstance(truth, bool):
        raise DatasetError(path, f"{field}.truth_3d", "true, false or null", repr(truth))
    optional = {k: _text(path, row, k, field) if row.get(k) is not None else None for k in _OPTIONAL}
    setting = row.get("setting", {})
    if not isinstance(setting, dict) or not all(isinstance(value, str) for value in setting.values()):
        raise DatasetError(path, f"{field}.setting", "an object of texts", setting)
    numbers = tuple(None if value is None else float(value) for value in values)
    method = _text(path, row, "method", field)
    return ReportedRow(
        method,
        citation=references[citation],
        truth_3d=truth,
        setting=setting,
        keys=keys,
        values=numbers,
        **optional,
    )


def _object(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise DatasetError(path, "file", "a JSON file", "nothing there")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DatasetError(path, "file", "JSON", str(error)) from error
    if not isinstance(content, dict):
        raise DatasetError(path, "file", "a JSON object", type(content).__name__)
    return content


def _text(path: Path, content: Mapping[str, Any], name: str, field: str = "") -> str:
    value = content.get(name)
    if not isinstance(value, str):
        raise DatasetError(path, f"{field}.{name}" if field else name, "a text", repr(value))
    return value


def _texts(path: Path, content: Mapping[str, Any], name: str) -> tuple[str, ...]:
    value = content.get(name)
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise DatasetError(path, name, "a list of texts", repr(value))
    return tuple(value)
