"""Opening pickled data without running what is in it.

A pickle is a program: it may import any function and call it. This unpickler knows a short list of names and
refuses every other before it is imported: NumPy arrays, dtypes and scalars (under the module names of
NumPy 1 and 2), builtin containers and numbers, ``collections.OrderedDict``. Even those are stand-ins from
this file where the original would believe what the pickle says of memory: a dtype is rebuilt from its parts,
an array takes exactly the bytes that its shape asks for, and all that is copied is charged to the size of the
file, which a pickle could otherwise multiply by naming the same bytes again and again.
"""

from __future__ import annotations

import io
import math
import pickle
import re
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from skelsplat._budget import afford, check_tree
from skelsplat.exceptions import DatasetError

Charge = Callable[[int], None]
_MOST_LENGTH, _MOST_EMPTY = 2**62, 10**7  # of an axis, and of one of an array without any number
_MOST_CODE = 1000  # characters of the name of a type, and its fields
_COPIES = 4  # of what a pickle holds: bytes that were written as text are copied twice
_PART = 2**24  # bytes read at once
_EXPECTED = "NumPy arrays, numbers and builtin containers only"


def unpickle(stream: IO[bytes], path: Path, field: str = "pickle") -> Any:
    """Return the object of the pickle that begins here in a binary stream, the `field` of the file `path`.

    One that names a class or function that is not allowed (it is not imported), is damaged, or has more in it
    than its bytes can hold, is a `DatasetError`.
    """
    content = stream.read()
    try:
        _check_memo(content)
        value = _Unpickler(content, path, field).load()
    except DatasetError:
        raise
    except Exception as error:  # a damaged pickle can make the unpickler raise nearly anything
        reason = str(error).strip() or type(error).__name__
        raise DatasetError(path, field, "a complete pickle", reason) from error
    check_tree(path, field, value, len(content))
    return value


# what a pickle consists of: operations of a fixed length, texts and bytes after their length, and lines
_FIXED = re.compile(
    rb"(?:[]()}012NQRabdelosut\x81\x85-\x89\x8f-\x94\x97\x98]|[Khq\x80\x82].|[M\x83]..|[Jj\x84].{4}"
    rb"|[G\x95].{8}){1,1000}",
    re.DOTALL,
)
_SIZED = {
    **dict.fromkeys(b"CU\x8a\x8c", 1),
    **dict.fromkeys(b"BTX\x8b", 4),
    **dict.fromkeys(b"\x8d\x8e\x96", 8),
}
_LINES = {**dict.fromkeys(b"ILFSVPpg", 1), **dict.fromkeys(b"ci", 2)}


def _check_memo(content: bytes) -> None:
    """Raise if an object is kept under a number above that of the bytes: Python makes room up to it."""
    at, end = 0, len(content)
    while at < end:
        if found := _FIXED.match(content, at):
            at = found.end()
            continue
        kind, start = content[at], at + 1
        if kind in _SIZED:
            width = _SIZED[kind]
            at = start + width + int.from_bytes(content[start : start + width], "little")
        elif kind in _LINES:
            for _ in range(_LINES[kind]):
                at = content.find(b"\n", at) + 1 or end
            digits = content[start:at].strip() if kind == ord("p") else b"0"
            if not digits.isdigit() or len(digits) > len(str(end)) or int(digits) > end:
                raise pickle.UnpicklingError(f"an object kept under {digits[:20]!r} in {end} bytes")
        elif kind == ord("r"):
            at = start + 4
            if int.from_bytes(content[start:at], "little") > end:
                raise pickle.UnpicklingError(f"an object kept under a number above {end}, that of the bytes")
        else:  # the end, or what the unpickler will not know
            return


class _Unpickler(pickle.Unpickler):
    """Finds names in `_allowed` alone, and copies no more bytes than the pickle has."""

    def __init__(self, content: bytes, path: Path, field: str) -> None:
        # Python 2 wrote arrays as text; latin1 maps its characters to bytes one to one.
        super().__init__(io.BytesIO(content), encoding="latin1")
        self._path = path
        self._field = field
        self._left = _COPIES * len(content)
        self._allowed = _allowed(self._charge)

    def _charge(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise pickle.UnpicklingError("more than the file holds, by naming the same bytes again")

    def find_class(self, module: str, name: str) -> Any:
        try:
            return self._allowed[module, name]
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
    """An array whose state is checked before NumPy sees it, and whose bytes are charged."""

    charge: Charge

    def __setstate__(self, state: Any) -> None:
        _, shape, dtype, fortran, raw = state
        kind = dtype.built if type(dtype) is _Dtype and dtype.built is not None else _resolved(dtype)
        count = _count(shape)
        if kind.hasobject:
            if not isinstance(raw, list) or len(raw) != count:
                raise pickle.UnpicklingError(f"an array of shape {shape} without its {count} objects")
        else:
            raw = raw if type(raw) is bytes else _raw(raw)
            if len(raw) != count * kind.itemsize or (count and not raw):
                raise pickle.UnpicklingError(
                    f"{len(raw)} bytes for an array of shape {shape} and type {kind}"
                )
        self.__dict__.pop("charge")(len(raw))
        checked: Any = (1, shape, kind, bool(fortran), raw)
        super().__setstate__(checked)


class _Dtype:
    """What a pickle says of a dtype; `build` makes it anew from the parts that are harmless."""

    __slots__ = ("_code", "_state", "built", "count")

    def __init__(self, code: str) -> None:
        self._code = code
        self.count = 1  # of fields, with those of fields
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
        parts = [fields[name] for name in names if isinstance(name, str)]
        self.count = sum(part[0].count for part in parts)
        if self.count > _MOST_CODE:
            raise pickle.UnpicklingError(f"a dtype of {self.count} fields")
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
        raise pickle.UnpicklingError(f"{type(shape).__name__} in place of a shape")
    count = 1
    for length in shape:  # a loop: this runs for each of the million arrays of a large file
        if type(length) is not int or not 0 <= length <= _MOST_LENGTH:
            there = f"{length}" if type(length) is int else type(length).__name__
            raise pickle.UnpicklingError(f"a shape with the length {there[:40]}")
        count *= length
    return count if count or max(shape) <= _MOST_EMPTY else _refuse(f"{max(shape)} rows of nothing")


def _raw(value: Any) -> bytes:
    """Return the bytes of an array; never those of a number, which would only ask for memory."""
    if isinstance(value, str):
        return value.encode("latin1")
    if not isinstance(value, bytes | bytearray):
        raise pickle.UnpicklingError(f"{type(value).__name__} in place of bytes")
    return bytes(value)


def _dtype(code: object, *_: object) -> _Dtype:
    if not isinstance(code, str) or len(code) > _MOST_CODE:
        raise pickle.UnpicklingError(f"{type(code).__name__} in place of the name of a type")
    return _Dtype(code)


def _reconstruct(charge: Charge, kind: object, *_: object) -> _Array:
    if kind is not _NDARRAY:
        raise pickle.UnpicklingError("an array of a class other than numpy.ndarray")
    array = _Array((0,), np.int8)
    array.charge = charge
    return array


def _frombuffer(charge: Charge, raw: Any, dtype: object, shape: Any, order: Any) -> Any:
    kind, data = _resolved(dtype), _raw(raw)
    charge(len(data))
    flat = np.frombuffer(data, kind, _count(shape))
    return flat.reshape(shape, order="F" if order == "F" else "C").copy(order="K")


def _scalar(dtype: object, raw: Any = b"") -> Any:
    kind = _resolved(dtype)
    data = _raw(raw)
    if kind.hasobject or len(data) != kind.itemsize:
        raise pickle.UnpicklingError(f"a scalar of type {kind} from {len(data)} bytes")
    return np.frombuffer(data, kind)[0] if data else kind.type()


def _bytes(charge: Charge, raw: Any = b"", encoding: str = "latin1") -> bytes:
    """Bytes as protocol 2 writes them."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError("bytes in another encoding than latin1")
    data = _raw(raw)
    charge(len(data))
    return data


def _collection(charge: Charge, kind: type, value: Any = ()) -> Any:
    """Return a list, table or set of what is in another."""
    if not isinstance(value, list | tuple | dict | set | frozenset):
        raise pickle.UnpicklingError(f"a {kind.__name__} of {type(value).__name__}")
    charge(len(value))
    return kind(value)


def _atom(kind: type, *args: Any) -> Any:
    """Return a number or text of one; never a number in digits or the text of a list, which take long."""
    if not all(isinstance(arg, str if kind is str else bool | int | float | complex) for arg in args):
        raise pickle.UnpicklingError(f"a {kind.__name__} of something else")
    return kind(*args)


def _allowed(charge: Charge) -> dict[tuple[str, str], Any]:
    """Return what names of modules and what is in them stand for, which charges the bytes that it copies."""

    def charged(call: Callable[..., Any], *args: Any) -> _Function:
        return _Function(partial(call, charge, *args))

    names: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): _NDARRAY,
        ("numpy", "dtype"): _Function(_dtype),
        ("collections", "OrderedDict"): charged(_collection, OrderedDict),
        ("_codecs", "encode"): charged(_bytes),
    }
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = charged(_reconstruct)
        names[f"{core}.multiarray", "scalar"] = _Function(_scalar)
        names[f"{core}.numeric", "_frombuffer"] = charged(_frombuffer)
    for module in ("builtins", "__builtin__"):
        for kind in (list, tuple, dict, set, frozenset):
            names[module, kind.__name__] = charged(_collection, kind)
        for atom in (bool, int, float, complex, str):
            names[module, atom.__name__] = _Function(partial(_atom, atom))
        names[module, "bytes"] = charged(_bytes)
        names[module, "bytearray"] = _Function(lambda *args: bytearray(_bytes(charge, *args)))
    names["__builtin__", "long"] = names["__builtin__", "int"]
    names["__builtin__", "unicode"] = names["__builtin__", "str"]
    return names


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order (Fortran's or not) and dtype of an array in NumPy's npy format.

    Of another or a damaged file, whose header is evaluated as Python, this can raise nearly anything.
    """
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version} of the npy format")
    shape, fortran, dtype = readers[version](stream)
    _count(shape)
    return shape, fortran, dtype


def read_array(
    stream: IO[bytes], path: Path, field: str, held: int, *, pickled: bool = True
) -> npt.NDArray[Any]:
    """Read an array in NumPy's npy format of `held` bytes; one of objects is unpickled, or refused.

    No npy file, one that ends too early, and what `unpickle` refuses are a `DatasetError`.
    """
    try:
        shape, fortran, dtype = npy_header(stream)
    except Exception as error:
        raise DatasetError(path, field, "an array in npy format", error) from error
    count = math.prod(shape)
    if dtype.hasobject and pickled:
        value = unpickle(stream, path, field)
        if not isinstance(value, np.ndarray) or value.size != count:
            raise DatasetError(path, field, f"a pickled array of shape {shape}", type(value).__name__)
        return np.asarray(value)
    if dtype.hasobject or (count and not dtype.itemsize):
        raise DatasetError(path, field, "numbers or texts", f"the type {dtype}")
    size = count * dtype.itemsize
    data = _filled(stream, path, field, held, size, f"{size} bytes (shape {shape}, {dtype})")
    try:
        flat = data.view(dtype) if size else np.empty(0, dtype)
        return flat.reshape(shape, order="F" if fortran else "C")
    except (TypeError, ValueError) as error:  # more axes than NumPy has, types of several numbers
        raise DatasetError(path, field, "an array in npy format", error) from error


def _filled(
    stream: IO[bytes], path: Path, field: str, held: int, size: int, expected: str
) -> npt.NDArray[np.uint8]:
    """Return the next `size` bytes in memory of their own; there are `held` at most."""
    if size > held:
        raise DatasetError(path, field, expected, f"{held}, cut short")
    afford(path, field, size)
    data = np.empty(size, dtype=np.uint8)
    rest: memoryview = data.data
    while len(rest) and (got := stream.readinto(rest[:_PART])):  # type: ignore[attr-defined]
        rest = rest[got:]
    if len(rest):
        raise DatasetError(path, field, expected, f"{size - len(rest)}, cut short")
    return data
