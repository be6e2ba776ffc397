"""Opening pickled data without running what is in it.

A pickle is a program: it may import any function and call it. This unpickler knows a short list of names and
refuses every other before it is imported: NumPy arrays, dtypes and scalars (under the module names of
NumPy 1 and 2), builtin containers and numbers, ``collections.OrderedDict``. Even those are stand-ins from
this file where the original would believe what the pickle says of memory: a dtype is rebuilt from its parts,
and an array takes exactly the bytes that its shape asks for.
"""

from __future__ import annotations

import io
import math
import pickle
import tokenize
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from skelsplat.exceptions import DatasetError

_EXPECTED = "NumPy arrays, numbers and builtin containers only"


def unpickle(stream: IO[bytes], path: Path, field: str = "pickle") -> Any:
    """Return the object of the pickle that begins here in a binary stream, the `field` of the file `path`.

    One that names a class or function that is not allowed (it is not imported), or is damaged, is a
    `DatasetError`.
    """
    try:
        return _Unpickler(stream, path, field).load()
    except DatasetError:
        raise
    except Exception as error:  # a damaged pickle can make the unpickler raise nearly anything
        reason = str(error).strip() or type(error).__name__
        raise DatasetError(path, field, "a complete pickle", reason) from error


class _Unpickler(pickle.Unpickler):
    """Finds names in `_ALLOWED` alone."""

    def __init__(self, stream: IO[bytes], path: Path, field: str) -> None:
        # Python 2 wrote arrays as text; latin1 maps its characters to bytes one to one.
        super().__init__(stream, encoding="latin1")
        self._path = path
        self._field = field

    def find_class(self, module: str, name: str) -> Any:
        try:
            return _ALLOWED[module, name]
        except KeyError:
            actual = f"the class or function {module}.{name}"
            raise DatasetError(self._path, self._field, _EXPECTED, actual) from None

    def persistent_load(self, _: Any) -> Any:
        raise DatasetError(self._path, self._field, _EXPECTED, "a reference to something outside the file")


class _Function:
    """A function that a pickle may call, and not change."""

    __slots__ = ("_call",)

    def __init__(self, call: Callable[..., Any]) -> None:
        self._call = call

    def __call__(self, *args: Any) -> Any:
        return self._call(*args)

    def __setstate__(self, _: object) -> None:
        raise pickle.UnpicklingError("a function given a state")


class _Array(np.ndarray[Any, Any]):
    """An array whose state is checked before NumPy sees it."""

    def __setstate__(self, state: Any) -> None:
        _, shape, dtype, fortran, raw = state
        kind = dtype.built if type(dtype) is _Dtype and dtype.built is not None else _resolved(dtype)
        count = _count(shape)
        if kind.hasobject:
            if not isinstance(raw, list) or len(raw) != count:
                raise pickle.UnpicklingError(f"an array of shape {shape} without its {count} objects")
        else:
            raw = raw if type(raw) is bytes else _raw(raw)
            if len(raw) != count * kind.itemsize:
                raise pickle.UnpicklingError(
                    f"{len(raw)} bytes for an array of shape {shape} and type {kind}"
                )
        checked: Any = (1, shape, kind, bool(fortran), raw)
        super().__setstate__(checked)


class _Dtype:
    """What a pickle says of a dtype; `build` makes it anew from the parts that are harmless."""

    __slots__ = ("_code", "_state", "built")

    def __init__(self, code: str) -> None:
        self._code = code
        self._state: tuple[Any, ...] = (3, "|", None, None, None)
        self.built: np.dtype[Any] | None = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._state = state
        self.built = None

    def build(self) -> np.dtype[Any]:
        if self.built is None:
            self.built = self._made()
        return self.built

    def _made(self) -> np.dtype[Any]:
        _, order, sub, names, fields = self._state[:5]
        if sub is not None:
            return np.dtype((_resolved(sub[0]), tuple(sub[1])))
        base = np.dtype(self._code)
        if base.kind not in "biufcSUVO":
            raise pickle.UnpicklingError(f"the dtype {self._code!r}")
        if fields is None:
            return base.newbyteorder(order) if order in ("<", ">") else base
        parts = [fields[name] for name in names]
        return np.dtype(
            {
                "names": list(names),
                "formats": [_resolved(part[0]) for part in parts],
                "offsets": [part[1] for part in parts],
                "itemsize": base.itemsize,
            }
        )


_NDARRAY = _Function(lambda *_: _refuse("a call of numpy.ndarray"))  # only ever an argument of _reconstruct


def _refuse(what: str) -> Any:
    raise pickle.UnpicklingError(what)


def _resolved(dtype: object) -> np.dtype[Any]:
    if not isinstance(dtype, _Dtype):
        raise pickle.UnpicklingError(f"{type(dtype).__name__} in place of a dtype")
    return dtype.build()


def _count(shape: Any) -> int:
    if type(shape) is not tuple:
        raise pickle.UnpicklingError(f"the shape {shape!r}")
    count = 1
    for length in shape:  # a loop: this runs for each of the million arrays of a large file
        if type(length) is not int or length < 0:
            raise pickle.UnpicklingError(f"the shape {shape!r}")
        count *= length
    return count


def _raw(value: Any) -> bytes:
    """Return the bytes of an array; never those of a number, which would only ask for memory."""
    if isinstance(value, str):
        return value.encode("latin1")
    if not isinstance(value, bytes | bytearray):
        raise pickle.UnpicklingError(f"{type(value).__name__} in place of bytes")
    return bytes(value)


def _reconstruct(kind: object, *_: object) -> _Array:
    if kind is not _NDARRAY:
        raise pickle.UnpicklingError("an array of a class other than numpy.ndarray")
    return _Array((0,), np.int8)


def _frombuffer(raw: Any, dtype: object, shape: Any, order: Any) -> Any:
    kind = _resolved(dtype)
    flat = np.frombuffer(_raw(raw), kind, _count(shape))
    return flat.reshape(shape, order="F" if order == "F" else "C").copy(order="K")


def _scalar(dtype: object, raw: Any = b"") -> Any:
    kind = _resolved(dtype)
    data = _raw(raw)
    if kind.hasobject or len(data) != kind.itemsize:
        raise pickle.UnpicklingError(f"a scalar of type {kind} from {len(data)} bytes")
    return np.frombuffer(data, kind)[0] if data else kind.type()


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """Bytes as protocol 2 writes them."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"bytes in the encoding {encoding!r}")
    return text.encode("latin1")


def _bytes(raw: Any = b"", encoding: str = "latin1") -> bytes:
    return _encode(raw, encoding) if isinstance(raw, str) else _raw(raw)


def _allowed() -> dict[tuple[str, str], Any]:
    names: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): _NDARRAY,
        ("numpy", "dtype"): _Function(lambda code, *_: _Dtype(str(code))),
        ("collections", "OrderedDict"): OrderedDict,
        ("_codecs", "encode"): _Function(_encode),
    }
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = _Function(_reconstruct)
        names[f"{core}.multiarray", "scalar"] = _Function(_scalar)
        names[f"{core}.numeric", "_frombuffer"] = _Function(_frombuffer)
    for module in ("builtins", "__builtin__"):
        for kind in (bool, int, float, complex, str, list, tuple, dict, set, frozenset):
            names[module, kind.__name__] = kind
        names[module, "bytes"] = _Function(_bytes)
        names[module, "bytearray"] = _Function(lambda *args: bytearray(_bytes(*args)))
    names["__builtin__", "long"] = int
    names["__builtin__", "unicode"] = str
    return names


_ALLOWED = _allowed()


# what `npy_header` raises for another file or a damaged one
DAMAGED_NPY = (ValueError, EOFError, SyntaxError, RecursionError, tokenize.TokenError)


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order (Fortran's or not) and dtype of an array in NumPy's npy format."""
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version} of the npy format")
    return readers[version](stream)


def read_array(stream: IO[bytes], path: Path, field: str = "array") -> Any:
    """Read an array in NumPy's npy format; one of objects is unpickled with `unpickle`.

    No npy file, one that ends too early, and what `unpickle` refuses are a `DatasetError`.
    """
    try:
        shape, fortran, dtype = npy_header(stream)
    except DAMAGED_NPY as error:
        raise DatasetError(path, field, "an array in npy format", error) from error
    if not dtype.hasobject:
        return _plain(stream, path, field, shape, fortran, dtype)
    value = unpickle(stream, path, field)
    if not isinstance(value, np.ndarray) or value.size != math.prod(shape):
        raise DatasetError(path, field, f"a pickled array of shape {shape}", type(value).__name__)
    return np.asarray(value)


def _plain(
    stream: IO[bytes], path: Path, field: str, shape: tuple[int, ...], fortran: bool, dtype: np.dtype[Any]
) -> Any:
    size = math.prod(shape) * dtype.itemsize
    data = io.BytesIO(stream.read(size)).getbuffer()
    if len(data) != size:
        raise DatasetError(path, field, f"{size} bytes (shape {shape}, {dtype})", f"{len(data)}, cut short")
    flat = np.frombuffer(bytearray(data), dtype)
    return flat.reshape(shape, order="F" if fortran else "C")
