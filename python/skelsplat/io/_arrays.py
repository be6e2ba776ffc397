"""Arrays from npy, npz and HDF5 files, checked with the package's errors.

What is pickled goes through the restricted unpickler, or is refused.
"""

from __future__ import annotations

import mmap
import os
import sys
import zipfile
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._budget import MOST_NAME, afford, check_ratio, damaged_zip, opened, zipped
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number, parsing
from skelsplat.io._unpickle import npy_header, read_array

_MOST_ITEMS = 10_000  # of an HDF5 file; a recording has twenty
FRAME_RATES = (1e-3, 1e6)
"""Frames per second, the lowest and the highest, that files state."""
HDF5 = b"\x89HDF\r\n\x1a\n"
_HEAP = b"GCOL\1\0\0\0"  # the beginning of a heap of texts and other values of any length


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
        entries = array.tolist()
        names = tuple(
            entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry) for entry in entries
        )
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
    """Return those arrays of an npz file that are among `keys`."""
    with opened(path, "a readable npz file") as stream, parsing(path, "a complete npz file"):
        return Arrays(path, _members(path, stream, keys, pickled=True))


def _readable(array: Any, path: Path, name: str) -> Any:
    """Return an array, or raise `DatasetError` for text with numbers that are no characters."""
    if isinstance(array, np.ndarray) and array.dtype.kind == "U":
        codes = np.frombuffer(array.tobytes(), dtype=f"{array.dtype.byteorder}u4")
        if (codes > sys.maxunicode).any():
            raise DatasetError(path, name, "text", f"a character of number {codes.max()}")
    return array


def _members(path: Path, stream: BinaryIO, keys: Collection[str] | None, *, pickled: bool) -> dict[str, Any]:
    """Return the arrays among `keys`, or all, that an npz file holds."""
    found = {}
    with zipped(path, stream) as archive:
        infos = {info.filename.removesuffix(".npy"): info for info in _infos(archive)}
        wanted = {name: info for name, info in infos.items() if keys is None or name in keys}
        afford(path, "file", sum(info.file_size for info in wanted.values()))
        for name, info in wanted.items():
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise DatasetError(path, name, "an array packed by deflate or not at all", "another packing")
            with archive.open(info) as member:
                array = read_array(member, path, name, info.file_size, pickled=pickled)
                found[name] = _readable(array, path, name)
    return found


def _infos(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    return [info for info in archive.infolist() if info.filename.endswith(".npy")]


def load_plain_npz(path: Path, kind: str, keys: Collection[str] | None = None) -> dict[str, Any]:
    """Return all arrays of an npz file by name, or those among `keys`; nothing in it is unpickled.

    `kind` names it in messages.
    """
    with opened(path, "a readable npz file") as stream, parsing(path, kind):
        if (wrong := damaged_zip(stream)) is not None:
            raise DatasetError(path, "file", kind, wrong)
        return _members(path, stream, keys, pickled=False)


def load_npy(path: Path) -> Any:
    """Return the array of an npy file, with the errors of `load_npz`."""
    with opened(path, "a readable npy file") as stream:
        size = os.fstat(stream.fileno()).st_size
        return read_array(stream, path, "array", size)


def npz_keys(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz file; none if it is no such file."""
    try:
        with opened(path) as stream, parsing(path, "an npz file"), zipped(path, stream) as archive:
            return frozenset(info.filename.removesuffix(".npy") for info in _infos(archive))
    except DatasetError:
        return frozenset()


def npy_shape(path: Path) -> tuple[int, ...]:
    """Return the shape that an npy file announces; () if it is no such file."""
    try:
        with opened(path) as stream, parsing(path, "an npy file"):
            return tuple(npy_header(stream)[0])
    except DatasetError:
        return ()


@contextmanager
def hdf5(path: Path, purpose: str, expected: str = "a complete HDF5 file") -> Iterator[Any]:
    """Open an HDF5 file of no more than its bytes can hold, and of nothing in other files.

    Another file, and any error within the block, is a `DatasetError` that says what was `expected`.
    """
    h5py = require("h5py", purpose)
    if has_endless_heap(path):
        raise DatasetError(path, "file", expected, "a damaged heap")
    with parsing(path, expected), h5py.File(path, "r") as file:
        sizes: list[int] = []
        links: list[str] = []

        def look(name: str, item: Any) -> None:
            sizes.append(int(item.nbytes) if isinstance(item, h5py.Dataset) else 0)
            if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external):
                raise DatasetError(path, name, "data in this file", "those of another file")
            check_ratio(path, name, sum(sizes), path.stat().st_size)

        def refuse(name: str, link: Any) -> DatasetError | None:
            links.append(name)
            if len(links) > _MOST_ITEMS:
                return DatasetError(path, "file", f"at most {_MOST_ITEMS} groups and datasets", "more")
            if isinstance(link, h5py.ExternalLink):
                return DatasetError(path, name, "data in this file", "a link to another")
            return None

        error = file.visititems_links(refuse)
        if error is not None:
            raise error
        file.visititems(look)
        afford(path, "file", max(sizes, default=0))
        yield file


def hdf5_mentions(path: Path, *names: bytes) -> bool:
    """Whether a file is HDF5 and holds all of `names` as plain text; needs no package that reads HDF5."""
    with _content(path) as content:
        return content is not None and all(content.find(name) >= 0 for name in names)


def has_endless_heap(path: Path) -> bool:
    """Whether HDF5 would never end to read a heap of this file: one of its entries has no length.

    Each is a number, 0 for free space, and after it the length (at 8) of what follows, or of all free space.
    """
    with _content(path) as content:
        start = -1 if content is None else content.find(_HEAP)
        while content is not None and start >= 0:
            at, end = start + 16, start + int.from_bytes(content[start + 8 : start + 16], "little")
            while at + 16 <= min(end, len(content)):
                free = content[at : at + 2] == b"\0\0"
                length = int.from_bytes(content[at + 8 : at + 16], "little")
                if length == 0 if free else length > end - at:
                    return True
                at += length if free else 16 + (length + 7) // 8 * 8
            start = content.find(_HEAP, start + 1)
    return False


@contextmanager
def _content(path: Path) -> Iterator[mmap.mmap | None]:
    """Give the bytes of an HDF5 file; None for another file, and for one that cannot be read."""
    with ExitStack() as stack:
        content = None
        with suppress(DatasetError, ValueError):
            stream = stack.enter_context(opened(path))
            if stream.read(len(HDF5)) == HDF5:
                content = stack.enter_context(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
        yield content
