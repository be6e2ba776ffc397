"""Files whose libraries can run code, hang or crash: pickles, arrays of objects, MAT, HDF5, NetCDF, C3D.

One child process (`_guarded_child`) reads all of them, within limits of memory and time, and hands back
arrays and values of builtin types. It is started with the first such file, and after one that has ended it.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from skelsplat._budget import opened
from skelsplat._optional import check_installed
from skelsplat.exceptions import DatasetError
from skelsplat.io._guarded_child import ALLOWED

_CHILD = Path(__file__).with_name("_guarded_child.py")
# What reading may take: of sound files, 13 bytes of memory and 0.1 µs were measured per byte, of C3D.
_MEMORY, _MEMORY_PER_BYTE = 2**29, 64
_SECONDS, _BYTES_PER_SECOND = 1, 2**20
_BUSY = 10  # times as long on a machine that does other things
# by kind, what messages call such files, and the packages that read them
_NEEDED = {
    "mat": ("MAT-files", ("scipy.io",)),
    "hdf5": ("SLEAP's h5", ("h5py",)),
    "table": ("DeepLabCut's h5", ("pandas", "tables")),
    "netcdf": ("NetCDF files", ("h5py", "h5netcdf", "xarray")),
    "c3d": ("C3D files", ("ezc3d",)),
}


class _Answer(pickle.Unpickler):
    """What the child has checked: arrays and values of builtin types."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


class _Child:
    """The process."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(_CHILD), *(path for path in sys.path if path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # so that Ctrl-C reaches this process alone
        )
        self._owner = os.getpid()

    def ask(self, request: dict[str, Any], seconds: float) -> tuple[Any, Any]:
        """Return why a file is refused, or how it ended the child, else nothing; and what it holds."""
        requests, answers = self._process.stdin, self._process.stdout
        assert requests is not None
        assert answers is not None
        timer = threading.Timer(seconds, self._process.kill)
        timer.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                requests.write(json.dumps(request).encode() + b"\n")
                requests.flush()
            refused, content = _Answer(answers).load()
        except (EOFError, pickle.UnpicklingError):
            status = self._process.wait()
            return f"signal {-status}" if status < 0 else f"status {status}", None
        finally:
            timer.cancel()
        return refused, content

    def close(self) -> None:
        """End the process; in a fork of the one that started it, only forget it."""
        if self._owner == os.getpid():
            self._process.kill()
            self._process.wait()
        else:
            self._process.returncode = 0
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()


_child: _Child | None = None
_taking_turns = threading.RLock()


def _end() -> None:
    global _child
    if _child is not None:
        _child.close()
    _child = None


def _after_fork() -> None:
    global _taking_turns
    _taking_turns = threading.RLock()  # the thread that held it may not exist
    _end()


atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def read_guarded(kind: str, path: Path, expected: str, *, field: str = "file", **options: Any) -> Any:
    """Return what a file of a kind of `_guarded_child` holds; a damaged or hostile one is a `DatasetError`.

    Files of which memory and time are beyond those of a sound one are refused.
    """
    global _child
    called, modules = _NEEDED.get(kind, ("", ()))
    for module in modules:
        check_installed(module, f"{path}: {called}")
    with opened(path):
        size = path.stat().st_size
    seconds = _SECONDS + size // _BYTES_PER_SECOND
    request = {
        "kind": kind,
        "path": str(path.absolute()),
        "memory": _MEMORY + _MEMORY_PER_BYTE * size,
        "seconds": seconds,
        "options": options,
    }
    with _taking_turns:
        try:
            _child = _child or _Child()
            refused, content = _child.ask(request, _BUSY * (1 + seconds))
        except BaseException:
            _end()
            raise
        if isinstance(refused, str):
            _end()
            raise DatasetError(path, field, expected, f"one that ends its reader ({refused})")
    if refused:
        raise DatasetError(path, (*refused, field)[2], refused[0] or expected, refused[1])
    return content


def unpickle(path: Path) -> Any:
    """Return the object in a pickle: data alone, of builtin types and NumPy; nothing in it is run."""
    return read_guarded("pickle", path, "a complete pickle", field="pickle")
