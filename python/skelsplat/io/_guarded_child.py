"""Reads files whose libraries can run code, hang or crash, in a process of its own; `_guarded` starts it.

The process imports what a file needs and not this package. A pickle gets the names in `_allowed` alone, also
where another library opens it: NumPy for arrays of objects, PyTables for attributes.
"""

import ast
import contextlib
import importlib
import io
import json
import os
import pickle
import struct
import sys
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Any

if __name__ == "__main__":  # the packages are those of the process that asks
    sys.path[:] = sys.argv[1:]

import numpy as np

_DEEPEST = 64  # lists within lists
_FURTHER = 10**5  # values beyond one per byte of the file: a pickle can name a list again and again
_CLASSES = "NumPy arrays, numbers and builtin containers only"


class RefusedError(Exception):
    """What a file holds is not read: what was expected, what is there, and perhaps in which field."""


class _Dtype:
    """What a pickle says of a dtype; NumPy's own would believe flags by which bytes pass for addresses."""

    def __init__(self, code: str, *_: object) -> None:
        self.code = code
        self.state: tuple[Any, ...] = (3, "|", None, None, None)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.state = state

    def made(self) -> Any:
        _, order, sub, names, fields = self.state[:5]
        if sub is not None:
            return np.dtype((sub[0].made(), tuple(sub[1])))
        base = np.dtype(self.code)
        if fields is None:
            return base.newbyteorder(order) if order in ("<", ">") else base
        formats = [fields[name][0].made() for name in names]
        offsets = [fields[name][1] for name in names]
        parts: Any = {"names": list(names), "formats": formats, "offsets": offsets, "itemsize": base.itemsize}
        return np.dtype(parts)


class _Array(np.ndarray[Any, Any]):
    """An array whose type is made from its parts."""

    def __setstate__(self, state: Any) -> None:
        _, shape, dtype, fortran, raw = state
        super().__setstate__((1, shape, dtype.made(), bool(fortran), raw))  # type: ignore[arg-type]


def _reconstruct(*_: object) -> _Array:
    return _Array((0,), np.int8)


def _scalar(dtype: _Dtype, raw: Any = b"") -> Any:
    raw = raw.encode("latin1") if isinstance(raw, str) else raw
    return np.frombuffer(raw, dtype.made())[0] if raw else dtype.made().type()


def _frombuffer(raw: Any, dtype: _Dtype, shape: Any, order: str) -> Any:
    flat = np.frombuffer(raw, dtype.made())
    return flat.reshape(shape, order="F" if order == "F" else "C").copy(order="K")


def _encode(text: str, _: str = "latin1") -> bytes:
    """Bytes as protocol 2 writes them."""
    return text.encode("latin1")


class _Function:
    """A function that a pickle may call, and not change."""

    __slots__ = ("_call",)

    def __init__(self, call: Callable[..., Any]) -> None:
        self._call = call

    def __call__(self, *args: Any) -> Any:
        return self._call(*args)


def _names() -> dict[tuple[str, str], Any]:
    """Return what a pickle may name, under the names of NumPy 1 and 2 and of Python 2 and 3."""
    names: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): _Array,
        ("numpy", "dtype"): _Function(_Dtype),
        ("collections", "OrderedDict"): _Function(OrderedDict),
        ("_codecs", "encode"): _Function(_encode),
        ("__builtin__", "long"): _Function(int),
        ("__builtin__", "unicode"): _Function(str),
    }
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = _Function(_reconstruct)
        names[f"{core}.multiarray", "scalar"] = _Function(_scalar)
        names[f"{core}.numeric", "_frombuffer"] = _Function(_frombuffer)
    kinds = (list, tuple, dict, set, frozenset, bool, int, float, complex, str, bytes, bytearray)
    for module in ("builtins", "__builtin__"):
        names |= {(module, kind.__name__): _Function(kind) for kind in kinds}
    return names


_allowed = _names()


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _allowed:
            raise RefusedError(_CLASSES, f"the class or function {module}.{name}")
        return _allowed[module, name]

    def persistent_load(self, _: Any) -> Any:
        raise RefusedError(_CLASSES, "a reference to something outside the file")


def _load(stream: Any, **_: object) -> Any:
    """Open a pickle; Python 2 wrote arrays as text, of which Latin-1 maps the characters to bytes."""
    return _Unpickler(stream, encoding="latin1").load()


def _restrict_pickles() -> None:
    """Let every library of this process open pickles with `_load`."""
    module: Any = pickle
    module.load = module._load = _load
    module.loads = module._loads = lambda data, **_: _load(io.BytesIO(data))


class _Packer:
    """Turns a value into JSON and bytes: arrays are one after the other in one array of bytes."""

    def __init__(self, most: int) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self._left = most

    def pack(self, value: Any, level: int = 0) -> Any:
        if value is None or (
            isinstance(value, bool | str | int | float) and not isinstance(value, np.generic)
        ):
            return value
        self._left -= 1
        if self._left < 0:
            raise RefusedError("at most one value per byte", "more, by naming the same ones again")
        if level > _DEEPEST:
            raise RefusedError(f"lists and tables nested at most {_DEEPEST} deep", "deeper ones")
        if isinstance(value, np.ndarray | np.generic):
            return self._array(value, level)
        if isinstance(value, dict):
            pairs = [[self.pack(key, level + 1), self.pack(one, level + 1)] for key, one in value.items()]
            return ["dict", pairs]
        for kind in (list, tuple, set, frozenset):
            if isinstance(value, kind):
                return [kind.__name__, [self.pack(one, level + 1) for one in value]]
        if isinstance(value, bytes | bytearray):
            return [type(value).__name__, value.decode("latin1")]
        if isinstance(value, complex):
            return ["complex", [value.real, value.imag]]
        raise RefusedError(_CLASSES, type(value).__name__)

    def _array(self, value: Any, level: int) -> Any:
        array = np.asarray(value)
        shape, is_scalar = list(array.shape), isinstance(value, np.generic)
        if array.dtype.names and array.dtype.hasobject:
            columns = [[name, self.pack(array[name], level + 1)] for name in array.dtype.names]
            return ["record", shape, is_scalar, columns]
        if array.dtype.hasobject:
            return ["objects", shape, [self.pack(one, level + 1) for one in array.ravel().tolist()]]
        order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
        content = array.tobytes(order=order)  # type: ignore[arg-type]
        start, self.size = self.size, self.size + len(content)
        self.parts.append(content)
        dtype = repr(np.lib.format.dtype_to_descr(array.dtype)) if array.dtype.names else array.dtype.str
        return ["array", shape, is_scalar, dtype, order, start, len(content)]


def _pickle(path: str) -> Any:
    with open(path, "rb") as stream:  # noqa: PTH123 - plain paths here
        return _load(stream)


def _npy(path: str, names: Iterable[str]) -> Any:
    """Return an array of objects, or those of these names in an npz file."""
    found = np.load(path, allow_pickle=True)
    return found if isinstance(found, np.ndarray) else {name: found[name] for name in names}


def _mat(path: str, names: list[str] | None) -> Any:
    found = importlib.import_module("scipy.io").loadmat(path, variable_names=names)
    return {key: value for key, value in found.items() if key[:2] != "__"}


def _hdf5(path: str, names: Iterable[str]) -> Any:
    """Return the keys of the file, and the datasets of these names with their attributes."""
    h5py = importlib.import_module("h5py")
    with h5py.File(path, "r") as file:
        found = {name: _dataset(h5py, file, name) for name in names if name in file}
        attributes = {name: dict(file[name].attrs) for name in found}
        return {"keys": list(file), "arrays": found, "attributes": {"": dict(file.attrs), **attributes}}


def _dataset(h5py: Any, file: Any, name: str) -> Any:
    item = file[name]
    if isinstance(file.get(name, getlink=True), h5py.ExternalLink) or not isinstance(item, h5py.Dataset):
        raise RefusedError("a dataset in this file", "something else", name)
    if item.is_virtual or item.external:
        raise RefusedError("data in this file", "those of another", name)
    return item[()]


def _table(path: str) -> Any:
    """Return the only table that pandas has stored in a file."""
    pandas = importlib.import_module("pandas")
    with pandas.HDFStore(path, mode="r") as store:
        keys = [key.strip("/") for key in store.keys()]  # noqa: SIM118 - a store, not a dict
        tables = [key for key in keys if str(store.get_storer(key).pandas_type).startswith("frame")]
        table = store[tables[0]] if len(tables) == 1 else None
    if table is None or not hasattr(table.columns, "levels"):
        named = f"tables {', '.join(tables)}" if tables else f"keys {', '.join(keys) or 'none'}"
        actual = named if table is None else "columns of one level"
        raise RefusedError(
            "one table in the file (df_with_missing or tracks), of several levels", actual, "key"
        )
    if table.index.nlevels != 1 or table.index.dtype.kind not in "iu":
        raise RefusedError("frame numbers (results of a video)", str(table.index[:1].tolist()), "index")
    if not all(dtype.kind in "fiu" for dtype in table.dtypes):
        raise RefusedError("numbers", "columns of another kind", "values")
    columns = [tuple(str(part) for part in column) for column in table.columns]
    levels = tuple(str(name) for name in table.columns.names)
    values = np.asarray(table.to_numpy(dtype=np.float64))
    return {"columns": columns, "levels": levels, "index": table.index.tolist(), "values": values}


def _netcdf(path: str) -> Any:
    """Return the attributes, variables and coordinates of a dataset: dimensions and values of each."""
    xarray = importlib.import_module("xarray")
    with xarray.open_dataset(path, engine="h5netcdf") as opened:
        found = opened.load()
    variables = {str(name): (list(one.dims), one.values) for name, one in found.variables.items()}
    return {"attributes": dict(found.attrs), "variables": variables}


_GROUPS = {"POINT": ("LABELS", "UNITS", "RATE", "Y_SCREEN"), "SKELSPLAT": ("FRAME_SHIFT", "PROCESSING")}
_NUMBERS = ("RATE", "FRAME_SHIFT")
# Intel, DEC, MIPS: the order of the bytes of an integer, and which byte of a float has the sign
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}
_BLOCK, _MOST_FRAMES = 512, 65535  # longer recordings count their frames elsewhere


def _check_length(path: str) -> None:
    """Raise if the frames that the header counts end beyond the file, where ezc3d reads zeros.

    The format: a header and parameters in blocks of 512 bytes, and the points after them
    (https://www.c3d.org/docs/C3D_User_Guide.pdf).
    """
    with open(path, "rb") as stream:  # noqa: PTH123 - plain paths here
        header = stream.read(_BLOCK)
        stream.seek(_BLOCK * (header[0] - 1) + 3)
        order, sign = _PROCESSORS[stream.read(1)[0]]
        held = stream.seek(0, os.SEEK_END)
    points, analog, first, last = struct.unpack_from(f"{order}4H", header, 2)
    (start,) = struct.unpack_from(f"{order}H", header, 16)
    size = 4 if header[12 + sign] & 0x80 else 2  # a scale below 0: floats, else 16-bit integers
    end = _BLOCK * (start - 1) + (last - first + 1) * size * (4 * points + analog)
    if last < _MOST_FRAMES and end > held:
        raise RefusedError(f"them to end at byte {end}", f"a file of {held} bytes", "frames")


def _c3d(path: str) -> Any:
    file = importlib.import_module("ezc3d").c3d(path)
    _check_length(path)
    parameters = {
        group: {
            name: [float(value) if name in _NUMBERS else _text(value) for value in entry["value"]]
            for name, entry in file["parameters"].get(group, {}).items()
            if name.rstrip("23456789") in known  # labels continue in LABELS2 to LABELS9
        }
        for group, known in _GROUPS.items()
    }
    points = file["header"]["points"]
    about = {"parameters": parameters, **{k: int(points[k]) for k in ("first_frame", "last_frame")}}
    data = file["data"]
    return {**about, "points": data["points"], "residuals": data["meta_points"]["residuals"]}


def _text(value: Any) -> str:
    """Return text, which older programs write in Latin-1."""
    content = str(value).encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


# by kind, how a file is read, and what is imported before its time counts
_READERS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "pickle": (_pickle, ()),
    "npy": (_npy, ()),
    "mat": (_mat, ("scipy.io",)),
    "hdf5": (_hdf5, ("h5py",)),
    "table": (_table, ("pandas", "tables")),
    "netcdf": (_netcdf, ("xarray", "h5netcdf", "h5py")),
    "c3d": (_c3d, ("ezc3d",)),
}


def _held() -> int:
    """Return the bytes of data of this process."""
    with contextlib.suppress(OSError, IndexError, ValueError), open("/proc/self/statm") as stream:  # noqa: PTH123
        return int(stream.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    return 2**29


def _limit(memory: int, seconds: int) -> None:
    """Limit this process to so many bytes, and seconds of its processor, beyond what it has taken."""
    with contextlib.suppress(ImportError, OSError, ValueError):  # Windows has no limits, macOS not all
        import resource

        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        for what, most in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, int(used) + 1 + seconds),
            (resource.RLIMIT_DATA, _held() + memory),
        ):
            hard = resource.getrlimit(what)[1]
            resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _answer(kind: str, path: str, target: str, memory: int, seconds: int, options: dict[str, Any]) -> Any:
    """Read a file and write what is in it as npz; return why not, or nothing."""
    read, modules = _READERS[kind]
    try:
        for module in modules:
            importlib.import_module(module)
        _limit(memory, seconds)
        packer = _Packer(os.path.getsize(path) + _FURTHER)  # noqa: PTH202
        tree = json.dumps(packer.pack(read(path, **options))).encode()
        content = np.frombuffer(b"".join(packer.parts), np.uint8)
        np.savez(target, tree=np.frombuffer(tree, np.uint8), content=content)
    except RefusedError as error:
        return error.args
    except MemoryError:
        return None, "more than the memory that such a file may take"
    except BaseException as error:
        lines = str(error).strip().splitlines()
        return None, lines[-1] if lines else type(error).__name__
    return ()


def _serve() -> None:
    """Answer each line of requests; the libraries' own output goes nowhere."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    _restrict_pickles()
    for line in sys.stdin:
        print(json.dumps(_answer(**json.loads(line))), file=answers, flush=True)


def unpacked(tree: Any, content: Any) -> Any:
    """Return the value that a `_Packer` has packed into a tree of JSON and bytes."""
    if not isinstance(tree, list):
        return tree
    kind, first, *rest = tree
    if kind == "dict":
        return {unpacked(key, content): unpacked(value, content) for key, value in first}
    if kind in ("list", "tuple", "set", "frozenset"):
        make = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}[kind]
        return make(unpacked(one, content) for one in first)
    if kind in ("bytes", "bytearray"):
        return first.encode("latin1") if kind == "bytes" else bytearray(first, "latin1")
    return complex(*first) if kind == "complex" else _unpacked_array(kind, first, rest, content)


def _unpacked_array(kind: str, shape: list[int], rest: list[Any], content: Any) -> Any:
    if kind == "objects":
        array: Any = np.empty(len(rest[0]), object)
        array[:] = [unpacked(one, content) for one in rest[0]]
        return array.reshape(shape)
    if kind == "record":
        columns = [(name, np.asarray(unpacked(column, content))) for name, column in rest[1]]
        array = np.empty(shape, [(name, one.dtype, one.shape[len(shape) :]) for name, one in columns])
        for name, column in columns:
            array[name] = column
    else:
        descr, order, start, size = rest[1:]
        known = np.lib.format.descr_to_dtype(ast.literal_eval(descr)) if descr[0] == "[" else np.dtype(descr)
        raw = content[start : start + size].tobytes()
        array = np.frombuffer(raw, known).reshape(shape, order=order) if raw else np.empty(shape, known)
    return array[()] if rest[0] else array.copy(order="K")


if __name__ == "__main__":
    _serve()
