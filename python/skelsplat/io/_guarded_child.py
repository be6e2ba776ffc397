"""Reads files whose libraries can run code, hang or crash, in a process of its own; `_guarded` starts it.

The process imports what a file needs and not this package. A pickle gets the names in `ALLOWED` alone, also
where another library opens it: NumPy for arrays of objects, PyTables for attributes.
"""

import contextlib
import fnmatch
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
# types of values that a pickle may name, and that are handed back
_CONTAINERS = (list, tuple, set, frozenset)
_ATOMS = (bool, int, float, complex, str, bytes, bytearray)


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


def _scalar(dtype: _Dtype, raw: Any = b"") -> Any:
    raw = raw.encode("latin1") if isinstance(raw, str) else raw
    return np.frombuffer(raw, dtype.made())[0] if raw else dtype.made().type()


def _frombuffer(raw: Any, dtype: _Dtype, shape: Any, order: str) -> Any:
    flat = np.frombuffer(raw, dtype.made())
    return flat.reshape(shape, order="F" if order == "F" else "C").copy(order="K")


# what a pickle may name, under the names of NumPy 1 and 2 and of Python 2 and 3
ALLOWED: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("collections", "OrderedDict"): OrderedDict,
    ("_codecs", "encode"): lambda text, *_: text.encode("latin1"),  # bytes as protocol 2 writes them
    ("__builtin__", "long"): int,
    ("__builtin__", "unicode"): str,
}
for _core in ("numpy.core", "numpy._core"):
    ALLOWED[f"{_core}.multiarray", "_reconstruct"] = lambda *_: _Array((0,), np.int8)
    ALLOWED[f"{_core}.multiarray", "scalar"] = _scalar
    ALLOWED[f"{_core}.numeric", "_frombuffer"] = _frombuffer
for _module in ("builtins", "__builtin__"):
    ALLOWED |= {(_module, kind.__name__): kind for kind in (dict, *_CONTAINERS, *_ATOMS)}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise RefusedError(_CLASSES, f"the class or function {module}.{name}")
        call = ALLOWED[module, name]
        return lambda *args: call(*args)  # which a pickle may give attributes without harm

    def persistent_load(self, _: Any) -> Any:
        raise RefusedError(_CLASSES, "a reference to something outside the file")


def _load(stream: Any, **_: object) -> Any:
    """Open a pickle; Python 2 wrote arrays as text, of which Latin-1 maps the characters to bytes."""
    return _Unpickler(stream, encoding="latin1").load()


class _Checker:
    """Lets through values of builtin types and NumPy alone, so many of them and nested so deep."""

    def __init__(self, most: int) -> None:
        self._left = most

    def checked(self, value: Any, level: int = 0) -> Any:
        """Return a value, arrays of this module's type as NumPy's own."""
        if value is None or type(value) in _ATOMS:
            return value
        self._left -= 1
        if self._left < 0:
            raise RefusedError("at most one value per byte", "more, by naming the same ones again")
        if level > _DEEPEST:
            raise RefusedError(f"lists and tables nested at most {_DEEPEST} deep", "deeper ones")
        if isinstance(value, np.ndarray):
            return self._array(np.asarray(value), level)
        if isinstance(value, dict):
            pairs = value.items()
            return {self.checked(key, level + 1): self.checked(one, level + 1) for key, one in pairs}
        if type(value) in _CONTAINERS:
            return type(value)(self.checked(one, level + 1) for one in value)
        if isinstance(value, np.generic) and not value.dtype.hasobject:
            return value
        raise RefusedError(_CLASSES, type(value).__name__)

    def _array(self, array: Any, level: int) -> Any:
        if array.dtype.names and array.dtype.hasobject:
            columns = {name: self.checked(array[name], level + 1) for name in array.dtype.names}
            array = array.copy()
            for name, column in columns.items():
                array[name] = column
        elif array.dtype.hasobject:
            flat = np.empty(array.size, object)
            flat[:] = [self.checked(one, level + 1) for one in array.ravel().tolist()]
            return flat.reshape(array.shape)
        return array


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
    """Return the keys of the file, and the datasets, or groups, of these names with their attributes.

    A name with a ``*`` is that of all datasets, or with a ``/`` at its end groups, that it fits.
    """
    h5py = importlib.import_module("h5py")
    found, attributes, known = {}, {}, list[str]()
    with h5py.File(path, "r") as file:
        if any("*" in name for name in names):  # links are not followed
            file.visititems(lambda name, item: known.append(name + "/" * isinstance(item, h5py.Group)))
        for name in (one for pattern in names for one in _fitting(pattern, known)):
            if name not in file:
                continue
            item = file[name]
            if item.file.filename != file.filename or not isinstance(item, (h5py.Dataset, h5py.Group)):
                raise RefusedError("a dataset in this file", "something else", name)
            attributes[name] = _attributes(h5py, item)
            if isinstance(item, h5py.Dataset):
                if item.is_virtual or item.external:
                    raise RefusedError("data in this file", "those of another", name)
                found[name] = item[()]
        return {
            "keys": list(file),
            "arrays": found,
            "attributes": {"": _attributes(h5py, file), **attributes},
        }


def _fitting(pattern: str, known: list[str]) -> list[str]:
    level = pattern.count("/")
    there = (name for name in known if name.count("/") == level)
    return fnmatch.filter(there, pattern) if "*" in pattern else [pattern]


def _attributes(h5py: Any, item: Any) -> dict[str, Any]:
    """Return the attributes, but for those that refer to objects of the file."""
    kinds = {key: item.attrs.get_id(key).dtype for key in item.attrs}
    return {key: item.attrs[key] for key, kind in kinds.items() if not h5py.check_ref_dtype(kind)}


def _table(path: str) -> Any:
    """Return the only table that pandas has stored in a file."""
    with importlib.import_module("pandas").HDFStore(path, mode="r") as store:
        keys = [key.strip("/") for key in store.keys()]  # noqa: SIM118 - a store, not a dict
        tables = [key for key in keys if str(store.get_storer(key).pandas_type).startswith("frame")]
        table = store[tables[0]] if len(tables) == 1 else None
    if table is None or not hasattr(table.columns, "levels"):
        there = f"tables {', '.join(tables)}" if tables else f"keys {', '.join(keys) or 'none'}"
        expected = "one table in the file (df_with_missing or tracks), of several levels"
        raise RefusedError(expected, there if table is None else "columns of one level", "key")
    if table.index.nlevels != 1 or table.index.dtype.kind not in "iu":
        raise RefusedError("frame numbers (results of a video)", str(table.index[:1].tolist()), "index")
    if not all(dtype.kind in "fiu" for dtype in table.dtypes):
        raise RefusedError("numbers", "columns of another kind", "values")
    return {
        "columns": [tuple(map(str, column)) for column in table.columns],
        "levels": tuple(map(str, table.columns.names)),
        "index": table.index.tolist(),
        "values": np.asarray(table.to_numpy(dtype=np.float64)),
    }


def _netcdf(path: str) -> Any:
    """Return the attributes, variables and coordinates of a dataset: dimensions and values of each."""
    with importlib.import_module("xarray").open_dataset(path, engine="h5netcdf") as opened:
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
    ends = {name: int(file["header"]["points"][name]) for name in ("first_frame", "last_frame")}
    points, residuals = file["data"]["points"], file["data"]["meta_points"]["residuals"]
    return {"parameters": parameters, **ends, "points": points, "residuals": residuals}


def _text(value: Any) -> str:
    """Return text, which older programs write in Latin-1."""
    content = str(value).encode("utf-8", "surrogateescape")
    with contextlib.suppress(UnicodeDecodeError):
        return content.decode("utf-8")
    return content.decode("latin-1")


# by kind, how a file is read, and what has to be installed, and is imported before its time counts
READERS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "pickle": (_pickle, ()),
    "npy": (_npy, ()),
    "mat": (_mat, ("scipy.io",)),
    "hdf5": (_hdf5, ("h5py",)),
    "table": (_table, ("pandas", "tables")),
    "netcdf": (_netcdf, ("xarray", "h5netcdf", "h5py")),
    "c3d": (_c3d, ("ezc3d",)),
}


def _limit(memory: int, seconds: int) -> None:
    """Limit this process to so many bytes, and seconds of its processor, beyond what it has taken."""
    held = 2**29
    with contextlib.suppress(OSError), open("/proc/self/statm") as stream:  # noqa: PTH123
        held = int(stream.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(ImportError, OSError, ValueError):  # Windows has no limits, macOS not all
        import resource

        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        for what, most in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, int(used) + 1 + seconds),
            (resource.RLIMIT_DATA, held + memory),
        ):
            hard = resource.getrlimit(what)[1]
            resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _answer(kind: str, path: str, memory: int, seconds: int, options: dict[str, Any]) -> bytes:
    """Return, pickled, why a file is not read, or nothing, and what it holds."""
    read, modules = READERS[kind]
    refused: tuple[Any, ...] = ()
    try:
        for module in modules:
            importlib.import_module(module)
        _limit(memory, seconds)
        checker = _Checker(os.path.getsize(path) + _FURTHER)  # noqa: PTH202
        return pickle.dumps((refused, checker.checked(read(path, **options))), protocol=5)
    except RefusedError as error:
        refused = error.args
    except MemoryError:
        refused = None, "more than the memory that such a file may take"
    except BaseException as error:
        lines = str(error).strip().splitlines()
        refused = None, lines[-1] if lines else type(error).__name__
    return pickle.dumps((refused, None))


def _serve() -> None:
    """Answer each line of requests; the libraries' own output goes nowhere."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    module: Any = pickle  # of which every library here takes what opens pickles
    module.load = module._load = _load
    module.loads = module._loads = lambda data, **_: _load(io.BytesIO(data))
    for line in sys.stdin:
        answers.write(_answer(**json.loads(line)))
        answers.flush()


if __name__ == "__main__":
    _serve()
