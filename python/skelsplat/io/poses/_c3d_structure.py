"""The structure of a C3D file, checked before a library follows its lengths and offsets.

A damaged file can send ezc3d into an endless loop or out of its memory, so every length is followed here.
The format: a header and parameter entries in blocks of 512 bytes, and the points after them
(https://www.c3d.org/docs/C3D_User_Guide.pdf).
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

from skelsplat.exceptions import DatasetError

_BLOCK, _MOST_FRAMES = 512, 65535
_KEY = 0x50
# Intel, DEC, MIPS: the order of the bytes of an integer, and which byte of a float has the sign
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}
_TYPES = {-1: 1, 1: 1, 2: 2, 4: 4}  # of a parameter: bytes per value


def check_structure(path: Path, content: bytes) -> None:
    """Raise `DatasetError` unless header, parameters and data of a C3D file lie within ``content``."""
    if len(content) < 2 * _BLOCK or content[1] != _KEY or content[0] < 2:
        raise DatasetError(path, "file", "a C3D file (its second byte is 80)", "something else")
    start = _BLOCK * (content[0] - 1)
    if start + 4 > len(content):
        raise _cut(path, "parameters", start, content)
    if content[start + 3] not in _PROCESSORS:
        raise DatasetError(path, "processor type", "84, 85 or 86", content[start + 3])
    order, sign = _PROCESSORS[content[start + 3]]
    _check_parameters(path, content, start + 4, order)
    _check_data(path, content, order, negative_scale=bool(content[12 + sign] & 0x80))


def _cut(path: Path, what: str, end: int, content: bytes) -> DatasetError:
    return DatasetError(path, what, f"them to end at byte {end}", f"a file of {len(content)} bytes")


def _check_parameters(path: Path, content: bytes, at: int, order: str) -> None:
    """Walk from entry to entry: length of the name, number, name, offset of the next, and what it holds."""
    while True:
        if at + 2 > len(content):
            raise _cut(path, "parameters", at + 2, content)
        name_length, number = struct.unpack_from("bb", content, at)
        if name_length == 0:
            return
        at += 2 + abs(name_length)
        if at + 2 > len(content):
            raise _cut(path, "parameters", at + 2, content)
        (offset,) = struct.unpack_from(f"{order}h", content, at)
        end = at + offset if offset else len(content)
        if not at + 2 < end <= len(content):
            raise _cut(path, "parameters", end, content)
        if number > 0:
            _check_value(path, content[at + 2 : end])
        if offset == 0:
            return
        at = end


def _check_value(path: Path, entry: bytes) -> None:
    kind, dimensions = struct.unpack_from("bB", entry.ljust(2, b"\0"))
    sizes = entry[2 : 2 + dimensions]
    if kind not in _TYPES or dimensions > 7 or len(sizes) != dimensions:
        raise DatasetError(path, "parameters", "types and sizes of the format", "another entry")
    end = 2 + dimensions + _TYPES[kind] * math.prod(sizes)
    if end >= len(entry):
        raise DatasetError(path, "parameters", f"an entry of more than {end} bytes", f"{len(entry)} bytes")


def _check_data(path: Path, content: bytes, order: str, *, negative_scale: bool) -> None:
    """Compare the length of the file with the frames that the header counts."""
    points, analog, first, last = struct.unpack_from(f"{order}4H", content, 2)
    (start,) = struct.unpack_from(f"{order}H", content, 16)
    if start < 2 or last < first:
        raise DatasetError(path, "header", "data after the parameters and ascending frames", "others")
    size = 4 if negative_scale else 2  # floats, else 16-bit integers
    end = _BLOCK * (start - 1) + (last - first + 1) * size * (4 * points + analog)
    if last < _MOST_FRAMES and end > len(content):  # longer recordings count their frames elsewhere
        raise _cut(path, "frames", end, content)
