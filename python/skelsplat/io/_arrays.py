"""Arrays in npy and npz files, whole or a stretch of rows at a time, checked with the package's errors.

Arrays of objects are read by `_guarded`; those that do not fit into memory are read and written in stretches.
"""

from __future__ import annotations

import math
import mmap
import os
import zipfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, Index
from skelsplat._budget import MOST_NAME, afford, opened, zipped
from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number, parsing
from skelsplat.io._guarded import read_guarded

_MOST_LENGTH = 10**12  # of an axis, also of an array without any number
FRAME_RATES = (1e-3, 1e6)  # frames per second, the lowest and the highest, that files state
BIG = 32 * 2**20  # bytes from which a file is read in stretches where its format allows that
_PIECE = 2**22  # bytes
HDF5 = b"\x89HDF\r\n\x1a\n"


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

    def frames(self, count: int) -> Index:
        """Return the `count` ascending whole numbers under ``frames``; those from 0 if they are not there."""
        return frame_numbers(self.path, self.found.get("frames", np.arange(count)), count)

    def rate(self) -> float | None:
        """Return the number under ``frame_rate``; None if it is NaN or not there."""
        value = self.found.get("frame_rate", np.array(np.nan))
        if value.shape != () or value.dtype.kind not in "fiu":
            raise DatasetError(self.path, "frame_rate", "one number", f"{value.dtype} of shape {value.shape}")
        rate = float(value)
        if not (np.isnan(rate) or FRAME_RATES[0] <= rate <= FRAME_RATES[1]):
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


def array_names(path: Path, field: str, value: object, count: int, *, unique: bool = True) -> tuple[str, ...]:
    """Return `count` names, text or bytes, none of them there twice if `unique`, or raise `DatasetError`."""
    array = np.asarray(value)
    if array.shape != (count,) or array.dtype.kind not in "USO":
        raise DatasetError(path, field, f"{count} names", f"{array.dtype} of shape {array.shape}")
    try:
        texts = (one.decode("utf-8", "replace") if isinstance(one, bytes) else one for one in array.tolist())
        names = tuple(map(str, texts))
        longest = max(len(name.encode()) for name in ("", *names))
    except ValueError:  # numbers in an array of text that are no characters
        raise DatasetError(path, field, "texts in Unicode", "others") from None
    if unique and longest > MOST_NAME:
        raise DatasetError(path, field, f"names of at most {MOST_NAME} bytes", f"one of {longest}")
    twice = sorted(name for name, times in Counter(names).items() if times > 1)
    if unique and twice:
        raise DatasetError(path, field, "different names", f"{twice[0]!r} twice")
    return names


def as_numbers(path: Path, field: str, value: object) -> Array:
    """Return an array of numbers as float64, or raise `DatasetError`."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise DatasetError(path, field, "an array of numbers", f"one of {array.dtype}")
    with np.errstate(invalid="ignore"):  # of a NaN that signals
        return array.astype(np.float64)


def load_npz(path: Path, keys: Collection[str]) -> Arrays:
    """Return those arrays of an npz file that are among `keys`; those of objects are read by `_guarded`."""
    found = _members(path, "a complete npz file", keys)
    for name in [name for name, array in found.items() if array is None]:
        found |= read_guarded("npy", path, "a complete pickle", field=name, names=[name])
    return Arrays(path, found)


def npz_fields(path: Path, keys: Collection[str] | None = None) -> Field:
    """Return all arrays of an npz file, or those among `keys`; what is pickled in place of one is unboxed."""
    found = load_npz(path, npz_keys(path) if keys is None else keys).found
    boxed = {key: value.dtype == object and value.ndim == 0 for key, value in found.items()}
    return Field(path, "", {key: value.item() if boxed[key] else value for key, value in found.items()})


def load_plain_npz(path: Path, kind: str, keys: Collection[str] | None = None) -> dict[str, Any]:
    """Return all arrays of an npz file of a `kind`, or those among `keys`; one of objects is refused."""
    found = _members(path, kind, keys)
    for name, array in found.items():
        if array is None:
            raise DatasetError(path, name, "numbers or texts", "an array of objects")
    return found


def load_npy(path: Path) -> Any:
    """Return the array of an npy file; one of objects is read by `_guarded`."""
    with opened(path, "a readable npy file") as stream:
        size = os.fstat(stream.fileno()).st_size
        afford(path, "file", size)
        array = _array(stream, path, "array", size)
    if array is None:
        return read_guarded("npy", path, "a complete pickle", field="array", names=())
    return array


def _members(path: Path, kind: str, keys: Collection[str] | None) -> dict[str, Any]:
    """Return the arrays among `keys`, or all, that an npz file holds; None for those of objects."""
    found = {}
    with opened(path, "a readable npz file") as stream, parsing(path, kind), zipped(path, stream) as archive:
        wanted = {name: one for name, one in _infos(archive).items() if keys is None or name in keys}
        afford(path, "file", sum(info.file_size for info in wanted.values()))
        for name, info in wanted.items():
            with archive.open(info) as member:
                found[name] = _array(member, path, name, info.file_size)
    return found


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order (Fortran's or not) and dtype of an array in NumPy's npy format.

    Of another or a damaged file, whose header is evaluated as Python, this can raise nearly anything.
    """
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version} of the npy format")
    return readers[version](stream)


def _array(stream: IO[bytes], path: Path, name: str, held: int) -> Any:
    """Return an array in NumPy's npy format of `held` bytes; None for one of objects."""
    try:
        shape, _, dtype = npy_header(stream)
        count = math.prod(shape)
        if dtype.hasobject:
            return None
        if max((0, *shape)) <= _MOST_LENGTH and 0 <= count * max(1, dtype.itemsize) <= held:
            stream.seek(0)
            array = np.lib.format.read_array(stream, allow_pickle=False)
            if dtype.kind == "U":  # NumPy makes texts of numbers that are no characters
                points = np.frombuffer(array.tobytes(), np.dtype("u4").newbyteorder(dtype.byteorder))
                list(map(chr, np.unique(points).tolist()))
            return array
    except Exception as error:
        raise DatasetError(path, name, "a complete array in npy format", error) from error
    expected = f"{count * dtype.itemsize} bytes (shape {shape}, {dtype})"
    raise DatasetError(path, name, expected, f"{held}, cut short")


def _infos(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    suffix = ".npy"
    infos = (info for info in archive.infolist() if info.filename.endswith(suffix))
    return {info.filename.removesuffix(suffix): info for info in infos}


def npz_keys(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz file; none if it is no such file."""
    with suppress(DatasetError), opened(path) as stream, parsing(path, "an npz file"):
        return frozenset(_infos(zipped(path, stream)))
    return frozenset()


def npy_shape(path: Path) -> tuple[int, ...]:
    """Return the shape that an npy file announces; () if it is no such file."""
    with suppress(DatasetError), opened(path) as stream, parsing(path, "an npy file"):
        return tuple(npy_header(stream)[0])
    return ()


def mentions(*names: bytes) -> Callable[[Path], bool]:
    """Return what says whether a file is HDF5 and holds all of `names`."""
    return lambda path: hdf5_mentions(path, *names)


def hdf5_mentions(path: Path, *names: bytes) -> bool:
    """Whether a file is HDF5 and holds all of `names` as plain text; needs no package that reads HDF5."""
    with suppress(DatasetError, ValueError), opened(path) as stream:
        if stream.read(len(HDF5)) == HDF5:
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return all(content.find(name) >= 0 for name in names)
    return False


class RowFile:
    """Rows in a file of one's own: appended, then read anywhere."""

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: npt.DTypeLike) -> None:
        self.path, self._stored, self._row = path, np.dtype(dtype), shape
        self._bytes = self._stored.itemsize * math.prod(shape)
        self._width = 0
        path.write_bytes(b"")

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.path.stat().st_size // self._bytes if self._bytes else 0, *self._row)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that NumPy would give all rows: of text, the width of the widest appended."""
        return np.dtype(f"U{max(1, self._width)}") if self._stored.kind == "U" else self._stored

    def append(self, rows: npt.NDArray[Any]) -> None:
        """Write rows (t, …) after those that are there."""
        if self._stored.kind == "U":
            self._width = max(self._width, rows.dtype.itemsize // 4)
        with self.path.open("ab") as stream:
            stream.write(np.ascontiguousarray(rows, dtype=self._stored).data.cast("B"))

    def read(self, first: int, end: int) -> npt.NDArray[Any]:
        """Return the rows from ``first`` to before ``end``."""
        count = (end - first) * math.prod(self._row)
        flat = np.fromfile(self.path, self._stored, count, offset=first * self._bytes)
        return flat.reshape(end - first, *self._row)

    def pieces(self) -> Iterator[npt.NDArray[Any]]:
        """Yield all rows, a piece at a time."""
        steps, each = self.shape[0], max(1, _PIECE // max(1, self._bytes))
        for first in range(0, steps, each):
            yield self.read(first, min(first + each, steps)).astype(self.dtype, copy=False)


class NpzRows:
    """Rows of an array in an npz file, read in order: going back begins at the first again."""

    def __init__(self, path: Path, name: str) -> None:
        self._path, self._name = path, name
        with opened(path) as stream:
            self.held = zipped(path, stream).getinfo(f"{name}.npy").file_size
        self._archive = zipfile.ZipFile(path)
        self._stream = self._archive.open(f"{name}.npy")
        self.shape, self.fortran, self.dtype = npy_header(self._stream)
        self._first, self._bytes = self._stream.tell(), self.dtype.itemsize * math.prod(self.shape[1:])

    def __getitem__(self, rows: slice) -> npt.NDArray[Any]:
        """Return the rows of a slice without gaps."""
        first, end, _ = rows.indices(self.shape[0])
        self._stream.seek(self._first + first * self._bytes)
        content = self._stream.read((end - first) * self._bytes)
        if len(content) != (end - first) * self._bytes:
            expected = f"{self.shape[0]} rows of {self._bytes} bytes"
            raise DatasetError(self._path, self._name, expected, "fewer, cut short")
        return np.frombuffer(content, self.dtype).reshape(end - first, *self.shape[1:])


def big_array(path: Path, name: str) -> NpzRows | None:
    """Return an array of an npz file to be read in stretches, if it is that big; None for any other."""
    with suppress(DatasetError), parsing(path, "an npz file"):
        rows = NpzRows(path, name)
        plain = rows.dtype.kind in "fiu" and not rows.fortran and len(rows.shape) > 1
        if plain and BIG <= math.prod(rows.shape) * rows.dtype.itemsize <= rows.held:
            return rows
    return None


def npz_rows(path: Path, name: str, count: int, own: slice) -> npt.NDArray[Any]:
    """Return ``own`` rows of an array of an npz file that has ``count``, or all if it has another number."""
    with parsing(path, "an npz file"):
        rows = NpzRows(path, name)
        if rows.dtype.hasobject or not rows.dtype.itemsize or (rows.fortran and len(rows.shape) > 1):
            raise DatasetError(path, name, "numbers or texts, row after row", f"the type {rows.dtype}")
        return rows[own] if rows.shape[0] == count else rows[:]


@dataclass(frozen=True)
class Made:
    """An array that is made in pieces along its first axis."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    pieces: Callable[[], Iterator[npt.NDArray[Any]]]


def write_npz(stream: IO[bytes], arrays: Mapping[str, npt.NDArray[Any] | RowFile | Made]) -> None:
    """Write a compressed npz file as NumPy's `savez_compressed`; some of its arrays may be made in pieces."""
    if all(isinstance(array, np.ndarray) for array in arrays.values()):
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
        return
    # level 1: of random digits hardly larger than the usual 6, and three times as fast
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if isinstance(array, np.ndarray):
                    np.lib.format.write_array(member, array, allow_pickle=False)
                    continue
                descr = np.lib.format.dtype_to_descr(array.dtype)
                header = {"descr": descr, "fortran_order": False, "shape": array.shape}
                np.lib.format.write_array_header_1_0(member, header)
                for piece in array.pieces():
                    member.write(piece.tobytes())
