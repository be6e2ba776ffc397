"""Reading files, with the package's errors."""

from __future__ import annotations

import csv
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skelsplat._budget import MOST_COLUMNS, check_json, opened, read_lines, read_text
from skelsplat._fields import FRAME_LIMIT, Field
from skelsplat.exceptions import DatasetError

_HEAD = 65_536  # bytes
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
SEMICOLONS = "fields separated by semicolons: save it with commas"
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".wmv")


@contextmanager
def parsing(path: Path, expected: str) -> Iterator[None]:
    """Raise `DatasetError` for whatever a library meets in this block: they raise nearly anything."""
    with opened(path):
        pass
    try:
        yield
    except DatasetError:
        raise
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise DatasetError(path, "file", expected, reason[-1]) from error


def head(path: Path) -> str:
    """Return the first characters of a file; none if it cannot be read."""
    try:
        with opened(path) as stream:
            return stream.read(_HEAD).decode("utf-8-sig", errors="replace").lstrip()
    except DatasetError:
        return ""


def csv_lines(path: Path) -> Iterator[list[str]]:
    """Yield the fields of every line; of a blank line there are none. All others have as many as the first.

    A quoted field may go on over several lines, so that a quote that is never closed swallows what follows:
    it is an error, of the line in which it opens.
    """
    reader = csv.reader(read_lines(path), strict=True)
    columns, first = None, 1
    try:
        for line in reader:
            if columns is None and has_semicolons(line):
                raise DatasetError(path, "line 1", "fields separated by commas", SEMICOLONS)
            columns = len(line) if columns is None else columns
            if (line and len(line) != columns) or columns > MOST_COLUMNS:
                expected = f"{min(columns, MOST_COLUMNS)} fields"
                raise DatasetError(path, f"line {first}", expected, f"{len(line)} fields")
            yield line
            first = reader.line_num + 1
    except csv.Error as error:
        is_open = reader.line_num > first or "unexpected end" in str(error)  # only a quote makes a line go on
        actual = "a quote that is not closed in this line" if is_open else str(error)
        expected = "comma-separated fields, every quote closed"
        raise DatasetError(path, f"line {first}", expected, actual) from error


def has_semicolons(header: Sequence[str]) -> bool:
    """Whether the only field of a first line is several, as spreadsheets separate them in some countries."""
    return len(header) == 1 and ";" in header[0]


def doubled(header: Sequence[str]) -> str | None:
    """Say which column of a first line is there more than once; None if none is."""
    name, times = Counter(header).most_common(1)[0] if header else ("", 0)
    return f"{name or 'a column without a name'} {times} times" if times > 1 else None


def csv_header(path: Path) -> list[str]:
    """Return the fields of the first line; none if it cannot be read."""
    try:
        return next(csv.reader(head(path).splitlines()[:1]), [])
    except csv.Error:
        return []


def _with_keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise ValueError(Counter(key for key, _ in pairs).most_common(1)[0][0][:40])
    return table


def load_json(path: Path, document: str, text: str | None = None) -> Any:
    """Return what a JSON file holds; a whole number beyond any float is infinite, as with an exponent.

    `document` is what it should hold, for messages, `text` its content if that was read before.
    """
    text = read_text(path) if text is None else text
    if not text.strip():
        raise DatasetError(path, "JSON", "a complete JSON document", "an empty file")
    check_json(path, document, text)
    try:
        value = json.loads(text, parse_int=whole_number, object_pairs_hook=_with_keys_once)
        if _SURROGATE.search(text):
            json.dumps(value, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        at = f"character {error.pos} of {len(text)}, at line {error.lineno}, column {error.colno}"
        actual = f"{error.msg.lower().removesuffix(' at')} at {at}"
        raise DatasetError(path, "JSON", "a complete JSON document", actual) from error
    except UnicodeEncodeError:
        raise DatasetError(path, "JSON", "texts in Unicode", "half a character (a lone surrogate)") from None
    except ValueError as error:
        raise DatasetError(path, "JSON", "every key once in an object", f"{error.args[0]!r} twice") from None
    return value


def json_document(path: Path, document: str, text: str | None = None) -> Field:
    """Return what `load_json` reads, to be checked as it is taken."""
    return Field(path, "", load_json(path, document, text))


def whole_number(text: str) -> int | float:
    """Return the whole number that digits say; infinity beyond any float."""
    return int(text) if len(text) < sys.float_info.max_10_exp else float(text)


def frame_number(path: Path, field: str, value: int | str) -> int:
    """Return a frame number, given as such or in digits, that can be counted on from in 64 bits."""
    number = whole_number(value) if isinstance(value, str) else value
    if not isinstance(number, int) or abs(number) >= FRAME_LIMIT:
        raise DatasetError(path, field, "a frame number below 2^62", str(value)[:40])
    return number


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Sort key that puts 2 before 10, with any number of digits."""
    parts = ((part, part.lstrip("0")) for part in re.split(r"(\d+)", name))
    return tuple((len(bare), bare) if part.isdecimal() else (-1, part) for part, bare in parts)


def listed(names: Sequence[str], most: int) -> str:
    """Return names for a message: the first `most`, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
