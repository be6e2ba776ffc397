"""JSON files, with the package's errors: the document, and numbers in it."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number, parse_json, read_text

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

_HEAD = 65_536


def load_json(path: Path, document: str) -> Any:
    """Return what a JSON file holds; `document` says what it should be, for messages."""
    text = read_text(path)
    try:
        return parse_json(text)
    except json.JSONDecodeError as error:
        at = f"{error.msg.lower()} at character {error.pos} of {len(text)}"
        raise DatasetError(path, "JSON", "a complete JSON document", at) from error
    except RecursionError:
        raise DatasetError(path, "JSON", document, "lists nested too deeply") from None


def json_head(path: Path) -> str:
    """Return the first characters of a file, to tell its format; empty if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD).decode("utf-8-sig", errors="replace").lstrip()
    except OSError:
        return ""


def member(path: Path, field: str, value: object, key: str, expected: str) -> Any:
    """Return ``value[key]`` of an object; `field` is where the object stands, empty at the top."""
    name = f"{field}.{key}" if field else key
    if not isinstance(value, dict):
        raise DatasetError(path, field or key, f"an object with {key}", type(value).__name__)
    if key not in value:
        raise DatasetError(path, name, expected, "nothing (the key is missing)")
    return value[key]


def as_list(path: Path, field: str, value: object, expected: str = "a list") -> list[Any]:
    """Return `value` if it is a list."""
    if not isinstance(value, list):
        raise DatasetError(path, field, expected, type(value).__name__)
    return value


def as_index(path: Path, field: str, value: object) -> int:
    """Return `value` if it is a frame number that is not negative."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise DatasetError(path, field, "a whole number from 0", repr(value)[:40])
    return frame_number(path, field, value)


def flat_numbers(path: Path, field: str, value: object) -> npt.NDArray[np.float64]:
    """Return a list of numbers (n,); NaN is a number here, infinity and text are not."""
    values = as_list(path, field, value, "a list of numbers")
    for place, entry in enumerate(values):
        if isinstance(entry, bool) or not isinstance(entry, int | float) or math.isinf(entry):
            raise DatasetError(path, f"{field}[{place}]", "a number", repr(entry)[:40])
    return np.array(values, dtype=np.float64)


def rows(path: Path, field: str, value: object, width: int) -> npt.NDArray[np.float64]:
    """Return a list of lists of `width` numbers each, (n, width)."""
    lines = as_list(path, field, value, f"a list of lists of {width} numbers")
    parts = [flat_numbers(path, f"{field}[{place}]", line) for place, line in enumerate(lines)]
    for place, part in enumerate(parts):
        if len(part) != width:
            raise DatasetError(path, f"{field}[{place}]", f"{width} numbers", f"{len(part)} numbers")
    return np.array(parts, dtype=np.float64).reshape(-1, width)
