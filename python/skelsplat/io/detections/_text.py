"""JSON and csv files of detections: the whole content, or a look at the beginning that tells the format."""

from __future__ import annotations

import csv
from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io._files import head, load_json, read_text

_FIELDS = "comma-separated fields, every quote closed"


def json_document(path: Path, document: str) -> Field:
    """Return what a JSON file holds; `document` says what it should be, for messages."""
    return Field(path, "", load_json(path, read_text(path), document))


def csv_lines(path: Path) -> list[list[str]]:
    """Return the fields of every line; of a blank line there are none.

    A quoted field may go on over several lines, so that a quote that is never closed swallows what follows:
    it is an error, of the line in which it opens.
    """
    reader = csv.reader(read_text(path).splitlines(), strict=True)
    lines: list[list[str]] = []
    first = 1
    try:
        for line in reader:
            lines.append(line)
            first = reader.line_num + 1
    except csv.Error as error:
        expected, actual = _told(error, reader.line_num - first)
        raise DatasetError(path, f"line {first}", expected, actual) from error
    return lines


def csv_header(path: Path) -> list[str]:
    """Return the fields of the first line; none if it cannot be read."""
    try:
        return next(csv.reader(head(path).splitlines()[:1]), [])
    except csv.Error:
        return []


def _told(error: csv.Error, further_lines: int) -> tuple[str, str]:
    """Return what is expected of a line and what is there; only an open quote makes a line go on."""
    if further_lines or "unexpected end" in str(error):
        return _FIELDS, "a quote that is not closed in this line"
    if "limit" in str(error):
        return f"fields of at most {csv.field_size_limit()} characters", "a longer one"
    return _FIELDS, str(error)
