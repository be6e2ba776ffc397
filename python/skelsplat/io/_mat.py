"""MAT-files of MATLAB, which SciPy reads once they are known to hold what they claim.

Version 5 (https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf): elements of a type, a length and
data, those of variables packed by zlib; a matrix begins with its flags and lengths, and may hold matrices.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from skelsplat._budget import MOST_DEPTH, check_ratio, read_bytes
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import parsing

_HEADER, _VERSION_5, _OLDEST = 128, 1, b"\0"
_MATRIX, _PACKED = 14, 15
_CELLS, _STRUCTURE, _OBJECT, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 5, 16, 17  # kinds of matrices
_OF_OTHER_LENGTHS = (_SPARSE, _FUNCTION, _OPAQUE)  # than that of their data
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}  # types of numbers and characters
_PIECE = 2**20

Element = tuple[int, int, int]  # type, and where its data begin and end


def load_mat(path: Path, expected: str, names: Collection[str] | None = None) -> dict[str, Any]:
    """Return the variables of a MAT-file, or those of these names, or raise `DatasetError`."""
    scipy = require("scipy.io", "MAT-files")
    with parsing(path, expected):
        _check(path, read_bytes(path), expected)
        chosen = None if names is None else list(names)
        return {
            key: value for key, value in scipy.loadmat(path, variable_names=chosen).items() if key[:2] != "__"
        }


def _check(path: Path, content: bytes, expected: str) -> None:
    """Raise `DatasetError` for a file whose matrices are not what they claim, or too deep."""
    order = ">" if content[126:128] == b"MI" else "<"
    if len(content) < _HEADER or _OLDEST in content[:4]:
        raise DatasetError(path, "file", expected, "another file, or one of version 4")
    if struct.unpack_from(f"{order}H", content, 124)[0] >> 8 != _VERSION_5:
        return  # SciPy says what it is
    total = 0
    for kind, first, end in _elements(content, _HEADER, len(content), order, padded=False):
        if end > len(content):
            raise DatasetError(path, "file", expected, "a damaged one")
        data = content[first if kind == _PACKED else first - 8 : end]
        if kind == _PACKED:
            data = b"".join(_unpacked(path, data, len(content), total, order))
            total += len(data)
        level = [data]
        for _ in range(MOST_DEPTH):
            level = [inner for one in level for inner in _matrices(path, expected, one, order)]
        if level:
            raise DatasetError(path, "file", f"cells nested at most {MOST_DEPTH} deep", "deeper ones")


def _unpacked(path: Path, data: bytes, held: int, total: int, order: str) -> Iterator[bytes]:
    """Yield the data of a packed variable; `total` bytes have come from the `held` ones before."""
    packer = zlib.decompressobj()
    claim = packer.decompress(data, 8)
    if len(claim) == 8:
        check_ratio(path, "file", total + struct.unpack(f"{order}II", claim)[1], held)
    packer = zlib.decompressobj()
    while part := packer.decompress(data, _PIECE):
        total += len(part)
        check_ratio(path, "file", total, held)
        data = packer.unconsumed_tail
        yield part


def _elements(data: bytes, at: int, end: int, order: str, *, padded: bool = True) -> Iterator[Element]:
    while at + 8 <= end:
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # a short one, within eight bytes
            yield kind & 0xFFFF, at + 4, at + 4 + min(kind >> 16, 4)
            at += 8
            continue
        yield kind, at + 8, at + 8 + size
        at += 8 + size + (-size % 8 if padded else 0)


def _matrices(path: Path, expected: str, data: bytes, order: str) -> Iterator[bytes]:
    """Yield what the matrices in data hold, after a look at each: SciPy believes what they claim."""
    damaged = DatasetError(path, "file", expected, "a damaged one")
    for kind, first, end in _elements(data, 0, len(data), order):
        if kind != _MATRIX or first == end:
            continue
        parts = list(_elements(data, first, min(end, len(data)), order))
        if end > len(data) or len(parts) < 3 or parts[0][1:] != (first + 8, first + 16) or parts[-1][2] > end:
            raise damaged
        flags = struct.unpack_from(f"{order}I", data, first + 8)[0]
        lengths = data[parts[1][1] : parts[1][2]][: 4 * 32]
        shape = [size for (size,) in struct.iter_unpack(f"{order}i", lengths[: len(lengths) // 4 * 4])]
        if flags & 0xFF not in _OF_OTHER_LENGTHS and math.prod(shape) > end - first:
            actual = f"one of {'×'.join(map(str, shape))} in {end - first}"
            raise DatasetError(path, "file", "a matrix of at most a value per byte", actual)
        if not _is_whole(data, flags, shape, parts[3:], order):
            raise damaged
        yield data[parts[1][2] + -(parts[1][2] - parts[1][1]) % 8 : end]


def _is_whole(data: bytes, flags: int, shape: list[int], held: list[Element], order: str) -> bool:
    """Whether a matrix of a shape holds, after its name, what its flags say."""
    matrix, is_complex, count = flags & 0xFF, flags >> 11 & 1, math.prod(shape)
    if matrix in (_STRUCTURE, _OBJECT):
        width, names, *held = [*held[matrix == _OBJECT :], (0, 0, 0), (0, 0, 0)]
        size = struct.unpack_from(f"{order}i", data, width[1])[0]
        count *= (names[2] - names[1]) // max(size, 1)
        held = held[:-2]
    kinds = [kind for kind, _, _ in held]
    if matrix == _OPAQUE:
        return _MATRIX in kinds
    if len(shape) < 2:
        return False
    if matrix in (_CELLS, _STRUCTURE, _OBJECT, _FUNCTION):
        return len(kinds) == (1 if matrix == _FUNCTION else count) and set(kinds) <= {_MATRIX}
    return len(kinds) == (3 if matrix == _SPARSE else 1) + is_complex and set(kinds) <= _NUMBERS
