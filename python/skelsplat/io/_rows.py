"""Arrays that are read and written a stretch of rows at a time, because they do not fit into memory."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from skelsplat._budget import opened, zipped
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import npy_header
from skelsplat.io._files import parsing

BIG = 32 * 2**20
"""Bytes from which a file is read in stretches where its format allows that."""
_PIECE = 2**22  # bytes


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
    """Rows of an array of numbers in an npz file, read in order: going back begins at the first again."""

    def __init__(self, path: Path, name: str) -> None:
        self.path, self._name, self._at = path, name, 0
        with opened(path) as stream:
            zipped(path, stream)
        self._archive = zipfile.ZipFile(path)
        self._open()

    def _open(self) -> None:
        self._stream, self._at = self._archive.open(f"{self._name}.npy"), 0
        self.shape, self.fortran, self.dtype = npy_header(self._stream)
        self._bytes = self.dtype.itemsize * math.prod(self.shape[1:])

    @property
    def size(self) -> int:
        """Bytes of the array."""
        return self.dtype.itemsize * math.prod(self.shape)

    @property
    def in_order(self) -> bool:
        """Whether its rows are numbers that follow each other in the file."""
        held = self._archive.getinfo(f"{self._name}.npy").file_size
        plain = self.dtype.kind in "fiu" and not self.fortran and len(self.shape) > 1
        return plain and self._bytes > 0 and self.size <= held

    def read(self, first: int, end: int) -> npt.NDArray[Any]:
        """Return the rows from ``first`` to before ``end``."""
        if first < self._at:
            self._open()
        left = (first - self._at) * self._bytes
        while left and (piece := self._stream.read(min(left, _PIECE))):
            left -= len(piece)
        content = b"" if left else self._stream.read((end - first) * self._bytes)
        self._at = end
        if len(content) != (end - first) * self._bytes:
            expected = f"{self.size} bytes (shape {self.shape}, {self.dtype})"
            raise DatasetError(self.path, self._name, expected, "fewer, cut short")
        return np.frombuffer(content, self.dtype).reshape(end - first, *self.shape[1:])


def big_array(path: Path, name: str) -> NpzRows | None:
    """Return an array of an npz file to be read in stretches, if it is that big; None for any other."""
    with suppress(DatasetError), parsing(path, "an npz file"):
        rows = NpzRows(path, name)
        if rows.in_order and rows.size >= BIG:
            return rows
    return None


def npz_rows(path: Path, name: str, count: int, own: slice) -> npt.NDArray[Any]:
    """Return ``own`` rows of an array of an npz file that has ``count``, or all if it has another number."""
    with parsing(path, "an npz file"):
        rows = NpzRows(path, name)
        if rows.dtype.hasobject or not rows.dtype.itemsize or (rows.fortran and len(rows.shape) > 1):
            raise DatasetError(path, name, "numbers or texts, row after row", f"the type {rows.dtype}")
        return rows.read(own.start, own.stop) if rows.shape[0] == count else rows.read(0, rows.shape[0])


@dataclass(frozen=True)
class Made:
    """An array that is made in pieces along its first axis."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    pieces: Callable[[], Iterator[npt.NDArray[Any]]]


def write_npz(stream: IO[bytes], arrays: Mapping[str, npt.NDArray[Any] | RowFile | Made]) -> None:
    """Write a compressed npz file as NumPy's `savez_compressed`; some of its arrays are made in pieces."""
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
