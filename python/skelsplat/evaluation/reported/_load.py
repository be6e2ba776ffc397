"""Reading the tables from their files, with errors that name file and field."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from skelsplat.evaluation.reported._model import ReportedRow, ReportedTable
from skelsplat.exceptions import DatasetError, InvalidInputError

FOLDER = Path(__file__).parent
_REFERENCES = "references.json"
_TEXTS = ("label", "title", "source", "dataset", "metric", "unit")
_OPTIONAL = ("detector", "training")


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
