"""Arrays from npy and npz files, with the package's errors; pickled ones through the restricted unpickler."""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import DAMAGED_NPZ
from skelsplat.io._unpickle import read_array

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path


def load_npz(path: Path, keys: Collection[str] | None = None) -> dict[str, Any]:
    """Return the arrays of an npz file by name; with `keys` only those of them that are there.

    Raises
    ------
    DatasetError
        If the file cannot be read, is damaged, or holds what the restricted unpickler refuses.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            wanted = [name for name in names if keys is None or name in keys]
            return {name: _member(archive, path, name) for name in wanted}
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(path, "file", "a readable npz file", reason) from error
    except DAMAGED_NPZ as error:
        raise DatasetError(path, "file", "a complete npz file", str(error) or type(error).__name__) from error


def _member(archive: zipfile.ZipFile, path: Path, name: str) -> Any:
    with archive.open(f"{name}.npy") as stream:
        return read_array(stream, path, name)


def load_npy(path: Path) -> Any:
    """Return the array of an npy file.

    Raises
    ------
    DatasetError
        If the file cannot be read, is damaged, or holds what the restricted unpickler refuses.
    """
    try:
        with path.open("rb") as stream:
            return read_array(stream, path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(path, "file", "a readable npy file", reason) from error
    except (MemoryError, OverflowError) as error:
        raise DatasetError(path, "array", "an array that fits into memory", "a larger one") from error


def npz_keys(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz file, to tell its format; none if it is no such file."""
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(name.removesuffix(".npy") for name in archive.namelist())
    except (OSError, *DAMAGED_NPZ):
        return frozenset()


def npy_shape(path: Path) -> tuple[int, ...]:
    """Return the shape that an npy file announces, to tell its format; () if it is no such file."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        with path.open("rb") as stream:
            shape, _, _ = readers[np.lib.format.read_magic(stream)](stream)
    except (OSError, ValueError, EOFError, KeyError, SyntaxError, RecursionError):
        return ()
    return tuple(shape)
