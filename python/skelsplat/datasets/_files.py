"""Finding and opening the files of data sets, with errors that name the file and the field."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import read_bytes
from skelsplat.exceptions import DatasetError
from skelsplat.io import _arrays
from skelsplat.io._files import load_json as parse_json_file
from skelsplat.io._unpickle import unpickle


@dataclass
class Survey:
    """Files of a data set."""

    there: list[Path] = field(default_factory=list)
    # list of (Path, str): Where a file or folder was expected, and what it would hold.
    missing: list[tuple[Path, str]] = field(default_factory=list)
    format: str = ""  # the layout on disk that was chosen or found; "" if the data set has one only

    def look(self, candidates: Sequence[Path], what: str) -> None:
        """Note whether one of `candidates` exists."""
        found = next((path for path in candidates if path.exists()), None)
        if found is None:
            self.missing.append((candidates[0], what))
        else:
            self.there.append(found)

    def look_for_detections(
        self, root: Path, detector: str | None, given: Path | str | None, usual: str
    ) -> None:
        """Note whether there are detections of the only subject, S0, or those `given`."""
        if given is not None:
            self.look([Path(given)], "detections")
        else:
            there = [path / "S0" for path in sorted(root.glob(f"2d_{detector or '*'}"))]
            self.look(there or [root / f"2d_{detector or usual}" / "S0"], "detections")


def find(candidates: Sequence[Path], what: str) -> Path:
    """Return the first of `candidates` that exists."""
    for path in candidates:
        if path.exists():
            return path
    others = ", ".join(str(path) for path in candidates[1:])
    raise DatasetError(candidates[0], "file", what, f"nothing there{', nor at ' if others else ''}{others}")


def load_json(path: Path) -> Any:
    """Return the value in a JSON file."""
    return parse_json_file(path, "values of moderate depth")


def load_pickle(path: Path) -> Any:
    """Return the object in a pickle; only data, never code (`unpickle`)."""
    return unpickle(io.BytesIO(read_bytes(path)), path)


def load_records(path: Path, expected: str) -> list[Any]:
    """Return the list in a pickle, which must have entries."""
    records = load_pickle(path)
    if not isinstance(records, list) or not records:
        raise DatasetError(path, "pickle", expected, type(records).__name__)
    return records


def load_npy(path: Path) -> Any:
    """Return the array of an npy file, or the object that is pickled in it alone."""
    return _content(_arrays.load_npy(path))


def load_npz(path: Path, keys: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Return the arrays of an npz file by key; a pickled object in place of an array is unpickled safely.

    With `keys`, those alone are read, as far as they are there.
    """
    found = _arrays.load_npz(path, _arrays.npz_keys(path) if keys is None else keys).found
    return {key: _content(value) for key, value in found.items()}


def _content(array: Any) -> Any:
    """Return the object of a pickled array of shape (), as ``np.save`` writes a dict."""
    return array.item() if array.dtype == object and array.ndim == 0 else array


def require(path: Path, field: str, container: Any, key: Any) -> Any:
    """Return ``container[key]``, where `container` should be a dict or structured array.

    `field` names the container (``""`` is the file itself).
    """
    names = container.dtype.names if isinstance(container, np.ndarray | np.void) else None
    if isinstance(container, dict) or names:
        if key in (names or container):
            return container[key]
        there = ", ".join(map(str, list(names or container)[:8])) or "nothing"
        raise DatasetError(path, within(field, key), "a value under this key", f"none (there are {there})")
    raise DatasetError(path, field or "file", f"a table with the key {key!r}", type(container).__name__)


def whole_number(path: Path, field: str, container: Any, key: Any) -> int:
    """Return ``container[key]`` as an integer."""
    value = require(path, field, container, key)
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError):
        raise DatasetError(path, within(field, key), "a whole number", repr(value)[:40]) from None


def a_table(path: Path, field: str, value: Any, expected: str = "a table") -> dict[Any, Any]:
    """Return `value` if it is a dict."""
    if not isinstance(value, dict):
        raise DatasetError(path, field, expected, type(value).__name__)
    return value


def a_list(path: Path, field: str, value: Any) -> list[Any]:
    """Return the entries of a list, tuple or array."""
    if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and not value.ndim):
        raise DatasetError(path, field, "a list", type(value).__name__)
    return list(value)


def shape_of(value: Any) -> tuple[int, ...] | str:
    """Return the shape of what may be an array, or words if it has none."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return "rows of different lengths"


def within(field: str, key: Any) -> str:
    """Name the part `key` of `field`."""
    return f"{field}.{key}" if field else str(key)


def as_numbers(path: Path, field: str, value: Any) -> Array:
    """Return `value` as a new array of float64, C order; None is NaN."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "c":
        raise DatasetError(path, field, "real numbers", f"an array of {value.dtype}")
    try:
        with np.errstate(invalid="ignore"):  # of a NaN that signals
            return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise DatasetError(path, field, "numbers in rows of the same length", error) from error


def numbers(path: Path, field: str, value: Any, shape: tuple[int | str, ...]) -> Array:
    """Return `value` as an array of float64 with the given shape.

    `shape` has an integer where the length is fixed and a letter where any is good; the same letter is the
    same length.
    """
    array = as_numbers(path, field, value)
    lengths: dict[str, int] = {}
    fits = array.ndim == len(shape) and all(
        (lengths.setdefault(want, got) if isinstance(want, str) else want) == got
        for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise DatasetError(path, field, f"shape {_shown(shape)}", array.shape)
    return array


def _shown(shape: tuple[int | str, ...]) -> str:
    return f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
