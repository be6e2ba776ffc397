"""Finding and opening the files of data sets, with errors that name the file and the field."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import parse_json
from skelsplat.io._unpickle import read_array, unpickle

FloatArray = NDArray[np.float64]


@dataclass
class Survey:
    """Files of a data set.

    Attributes
    ----------
    there : list of Path
    missing : list of (Path, str)
        Where a file or folder was expected, and what it would hold.
    format : str
        The layout on disk that was chosen or found; "" if the data set has one only.
    """

    there: list[Path] = field(default_factory=list)
    missing: list[tuple[Path, str]] = field(default_factory=list)
    format: str = ""

    def look(self, candidates: Sequence[Path], what: str) -> None:
        """Note whether one of `candidates` exists."""
        found = next((path for path in candidates if path.exists()), None)
        if found is None:
            self.missing.append((candidates[0], what))
        else:
            self.there.append(found)


def find(candidates: Sequence[Path], what: str) -> Path:
    """Return the first of `candidates` that exists.

    Raises
    ------
    DatasetError
        If none does; names all of them.
    """
    for path in candidates:
        if path.exists():
            return path
    others = ", ".join(str(path) for path in candidates[1:])
    raise DatasetError(candidates[0], "file", what, f"nothing there{', nor at ' if others else ''}{others}")


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file for reading.

    Raises
    ------
    DatasetError
        If it cannot be opened or read.
    """
    try:
        with path.open("rb") as stream:
            yield stream
    except FileNotFoundError as error:
        raise DatasetError(path, "file", "a file in this place", "none") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(path, "file", "a readable file", reason) from error


def load_json(path: Path) -> Any:
    """Return the value in a JSON file."""
    with opened(path) as stream:
        data = stream.read()
    try:
        return parse_json(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise DatasetError(path, "file", "text in UTF-8", f"byte {error.start} that is not") from error
    except json.JSONDecodeError as error:
        at = f"{error.msg.lower()} at character {error.pos}"
        raise DatasetError(path, "JSON", "a complete JSON document", at) from error
    except RecursionError:
        raise DatasetError(path, "JSON", "values of moderate depth", "lists nested too deeply") from None


def load_pickle(path: Path) -> Any:
    """Return the object in a pickle; only data, never code (`unpickle`)."""
    with opened(path) as stream:
        return unpickle(stream, path)


def load_npy(path: Path) -> Any:
    """Return the array of an npy file, or the object that is pickled in it alone."""
    with opened(path) as stream:
        return _content(read_array(stream, path))


def load_npz(path: Path, keys: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Return the arrays of an npz file by key; a pickled object in place of an array is unpickled safely.

    With `keys`, those alone are read, as far as they are there.
    """
    try:
        with opened(path) as stream, zipfile.ZipFile(stream) as archive:
            found = {name.removesuffix(".npy"): name for name in archive.namelist()}
            wanted = found if keys is None else [key for key in keys if key in found]
            return {key: _member(archive, path, found[key], key) for key in wanted}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise DatasetError(path, "file", "a complete npz file", error) from error


def _member(archive: zipfile.ZipFile, path: Path, name: str, key: str) -> Any:
    with archive.open(name) as stream:
        return _content(read_array(stream, path, key))


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


def a_table(path: Path, field: str, value: Any) -> dict[Any, Any]:
    """Return `value` if it is a dict."""
    if not isinstance(value, dict):
        raise DatasetError(path, field, "a table", type(value).__name__)
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


def as_numbers(path: Path, field: str, value: Any) -> FloatArray:
    """Return `value` as a new array of float64, C order; None is NaN.

    Raises
    ------
    DatasetError
        If there is something else than numbers, or rows have different lengths.
    """
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise DatasetError(path, field, "numbers in rows of the same length", error) from error


def numbers(path: Path, field: str, value: Any, shape: tuple[int | str, ...]) -> FloatArray:
    """Return `value` as an array of float64 with the given shape.

    `shape` has an integer where the length is fixed and a letter where any is good; the same letter is the
    same length.

    Raises
    ------
    DatasetError
        If the values are no numbers or the shape is another.
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
