"""Arrays from npy, npz and HDF5 files, checked with the package's errors.

What is pickled goes through the restricted unpickler, or is refused.
"""

from __future__ import annotations

import io
import mmap
import struct
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._atomic import opening
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number
from skelsplat.io._unpickle import DAMAGED_NPY, npy_header, read_array

# what zipfile and NumPy raise for an npz whose bytes are damaged, besides OSError and ValueError
_DAMAGED_NPZ = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, NotImplementedError, RuntimeError)
_HDF5 = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Arrays:
    """The arrays of an npz file by name, checked as they are taken."""

    path: Path
    found: dict[str, Any]

    def take(self, key: str) -> Any:
        """Return an array that must be there."""
        if key not in self.found:
            there = ", ".join(sorted(npz_keys(self.path))) or "none"
            raise DatasetError(self.path, key, "an array under this key", f"keys {there}")
        return self.found[key]

    def frames(self, count: int) -> list[int] | None:
        """Return the `count` ascending whole numbers under ``frames``; None if they are not there."""
        if "frames" not in self.found:
            return None
        return list(map(int, frame_numbers(self.path, self.found["frames"], count)))

    def rate(self) -> float | None:
        """Return the number under ``frame_rate``; None if it is NaN or not there."""
        value = self.found.get("frame_rate", np.array(np.nan))
        if value.shape != () or value.dtype.kind not in "fiu":
            raise DatasetError(self.path, "frame_rate", "one number", f"{value.dtype} of shape {value.shape}")
        rate = float(value)
        if not (np.isnan(rate) or 1e-3 <= rate <= 1e6):
            raise DatasetError(self.path, "frame_rate", "a number from 1e-3 to 1e6", f"{rate:g}")
        return None if np.isnan(rate) else rate

    def names(self, key: str, count: int) -> tuple[str, ...] | None:
        """Return the `count` different names under a key; None if they are not there."""
        return array_names(self.path, key, self.found[key], count) if key in self.found else None


def frame_numbers(path: Path, value: object, count: int | None = None) -> Index:
    """Return frame numbers, which ascend; as many as `count`, if that is known."""
    array = np.asarray(value)
    fits = array.ndim == 1 and array.dtype.kind in "iu" and count in (None, len(array))
    if not fits or (np.diff(array.astype(np.int64)) <= 0).any():
        expected = f"{'' if count is None else f'{count} '}whole numbers that ascend"
        raise DatasetError(path, "frames", expected, f"{array.dtype} of shape {array.shape}")
    return np.array([frame_number(path, "frames", int(number)) for number in array], dtype=np.int64)


def array_names(path: Path, field: str, value: object, count: int) -> tuple[str, ...]:
    """Return `count` different names, text or bytes, or raise `DatasetError`."""
    array = np.asarray(value)
    if array.shape != (count,) or array.dtype.kind not in "USO":
        raise DatasetError(path, field, f"{count} names", f"{array.dtype} of shape {array.shape}")
    names = tuple(
        entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry)
        for entry in array.tolist()
    )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DatasetError(path, field, "different names", f"{twice[0]!r} twice")
    return names


def as_numbers(path: Path, field: str, value: object) -> Array:
    """Return an array of numbers as float64, or raise `DatasetError`."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise DatasetError(path, field, "an array of numbers", f"one of {array.dtype}")
    return array.astype(np.float64)


def load_npz(path: Path, keys: Collection[str]) -> Arrays:
    """Return those arrays of an npz file that are among `keys`."""
    try:
        with opening(path, "a readable npz file"), zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            return Arrays(path, {name: _member(archive, path, name) for name in names if name in keys})
    except _DAMAGED_NPZ as error:
        raise DatasetError(path, "file", "a complete npz file", str(error) or type(error).__name__) from error


def _member(archive: zipfile.ZipFile, path: Path, name: str) -> Any:
    with archive.open(f"{name}.npy") as stream:
        return _readable(read_array(stream, path, name), path, name)


def _readable(array: Any, path: Path, name: str) -> Any:
    """Return an array, or raise `DatasetError` for text with numbers that are no characters."""
    if isinstance(array, np.ndarray) and array.dtype.kind == "U":
        codes = np.frombuffer(array.tobytes(), dtype=f"{array.dtype.byteorder}u4")
        if (codes > sys.maxunicode).any():
            raise DatasetError(path, name, "text", f"a character of number {codes.max()}")
    return array


def load_plain_npz(path: Path, kind: str) -> dict[str, Any]:
    """Return all arrays of an npz file by name; nothing in it is unpickled. `kind` names it in messages."""
    with opening(path, "a readable npz file"):
        content = io.BytesIO(path.read_bytes())
    if not zipfile.is_zipfile(content):
        raise DatasetError(path, "file", kind, "another kind of file, or a damaged one")
    content.seek(0)
    try:
        with np.load(content, allow_pickle=False) as archive:
            arrays = {name: array for name, array in archive.items() if isinstance(array, np.ndarray)}
    except (OSError, ValueError, TypeError, tokenize.TokenError, *_DAMAGED_NPZ) as error:
        raise DatasetError(path, "file", kind, error) from error
    return {name: _readable(array, path, name) for name, array in arrays.items()}


def load_npy(path: Path) -> Any:
    """Return the array of an npy file, with the errors of `load_npz`."""
    try:
        with opening(path, "a readable npy file"), path.open("rb") as stream:
            return read_array(stream, path)
    except (MemoryError, OverflowError) as error:
        raise DatasetError(path, "array", "an array that fits into memory", "a larger one") from error


def npz_keys(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz file; none if it is no such file."""
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(name.removesuffix(".npy") for name in archive.namelist())
    except (OSError, *_DAMAGED_NPZ):
        return frozenset()


def npy_shape(path: Path) -> tuple[int, ...]:
    """Return the shape that an npy file announces; () if it is no such file."""
    try:
        with path.open("rb") as stream:
            return tuple(npy_header(stream)[0])
    except (OSError, *DAMAGED_NPY):
        return ()


def hdf5_mentions(path: Path, *names: bytes) -> bool:
    """Whether a file is HDF5 and holds all of `names` as plain text; needs no package that reads HDF5."""
    try:
        with path.open("rb") as stream:
            if stream.read(len(_HDF5)) != _HDF5:
                return False
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return all(content.find(name) >= 0 for name in names)
    except (OSError, ValueError):
        return False
