"""Reading files, with the package's errors."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skelsplat._atomic import opening
from skelsplat.exceptions import DatasetError, InvalidInputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# frame numbers and offsets are below it, so that their sum fits into 64 bits
FRAME_LIMIT = 2**62
_HEAD = 65_536  # bytes
_FIELDS = "comma-separated fields, every quote closed"
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".wmv")


@contextmanager
def parsing(path: Path, expected: str) -> Iterator[None]:
    """Raise `DatasetError` for whatever a library meets in this block: they raise nearly anything."""
    with opening(path):
        path.open("rb").close()
    try:
        yield
    except DatasetError:
        raise
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise DatasetError(path, "file", expected, reason[-1]) from error


def of_file(path: Path, error: InvalidInputError) -> DatasetError:
    """Return the error for a file whose content was refused as an argument."""
    expected, _, actual = error.reason.removeprefix("expected ").partition(", got ")
    return DatasetError(path, error.argument, expected, actual)


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file (a byte-order mark is dropped), or raise `DatasetError`."""
    try:
        with opening(path):
            return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(path, "file", "text in UTF-8", f"byte {error.start} that is not") from error


def head(path: Path) -> str:
    """Return the first characters of a file; none if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD).decode("utf-8-sig", errors="replace").lstrip()
    except OSError:
        return ""


def csv_lines(path: Path) -> list[list[str]]:
    """Return the fields of every line; of a blank line there are none. All others have as many as the first.

    A quoted field may go on over several lines, so that a quote that is never closed swallows what follows:
    it is an error, of the line in which it opens.
    """
    reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    lines: list[list[str]] = []
    first = 1
    try:
        for line in reader:
            lines.append(line)
            if line and len(line) != len(lines[0]):
                expected, actual = f"{len(lines[0])} fields", f"{len(line)} fields"
                raise DatasetError(path, f"line {first}", expected, actual)
            first = reader.line_num + 1
    except csv.Error as error:
        expected, actual = _csv_fault(error, reader.line_num - first)
        raise DatasetError(path, f"line {first}", expected, actual) from error
    return lines


def csv_header(path: Path) -> list[str]:
    """Return the fields of the first line; none if it cannot be read."""
    try:
        return next(csv.reader(head(path).splitlines()[:1]), [])
    except csv.Error:
        return []


def _csv_fault(error: csv.Error, further_lines: int) -> tuple[str, str]:
    """Return what is expected of a line and what is there; only an open quote makes a line go on."""
    if further_lines or "unexpected end" in str(error):
        return _FIELDS, "a quote that is not closed in this line"
    if "limit" in str(error):
        return f"fields of at most {csv.field_size_limit()} characters", "a longer one"
    return _FIELDS, str(error)


def load_json(path: Path, document: str, text: str | None = None) -> Any:
    """Return what a JSON file holds; a whole number beyond any float is infinite, as with an exponent.

    `document` is what it should hold, for messages, `text` its content if that was read before.
    """
    text = read_text(path) if text is None else text
    try:
        return json.loads(text, parse_int=whole_number)
    except json.JSONDecodeError as error:
        at = f"character {error.pos} of {len(text)}, at line {error.lineno}, column {error.colno}"
        actual = f"{error.msg.lower()} at {at}"
        raise DatasetError(path, "JSON", "a complete JSON document", actual) from error
    except RecursionError:
        raise DatasetError(path, "JSON", document, "lists nested too deeply") from None


def whole_number(text: str) -> int | float:
    """Return the whole number that digits say; infinity beyond any float."""
    return int(text) if len(text) < sys.float_info.max_10_exp else float(text)


def frame_number(path: Path, field: str, value: int | str) -> int:
    """Return a frame number, given as such or in digits, that can be counted on from in 64 bits."""
    number = whole_number(value) if isinstance(value, str) else value
    if not isinstance(number, int) or abs(number) >= FRAME_LIMIT:
        raise DatasetError(path, field, "a frame number below 2^62", str(value)[:40])
    return number


def parse_toml(path: Path, text: str) -> dict[str, Any]:
    """Return the TOML document that ``path`` holds as ``text``, or raise `DatasetError`."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is no TOMLDecodeError
        reason = str(error).partition(";")[0]
        raise DatasetError(path, "TOML", "valid TOML", reason) from error


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Sort key that puts 2 before 10."""
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name))


def listed(names: Sequence[str], most: int) -> str:
    """Return names for a message: the first `most`, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
