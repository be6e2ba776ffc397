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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skelsplat._budget import opened
from skelsplat._optional import check_installed
from skelsplat.exceptions import DatasetError
from skelsplat.io._guarded_child import ALLOWED, READERS

_CHILD = Path(__file__).with_name("_guarded_child.py")
# What reading may take: of sound files, 13 bytes of memory and 0.1 µs were measured per byte, of C3D.
_MEMORY, _MEMORY_PER_BYTE = 2**29, 64
_SECONDS, _BYTES_PER_SECOND = 1, 2**20
_BUSY = 10  # times as long on a machine that does other things


class _Answer(pickle.Unpickler):
    """What the child has checked: arrays and values of builtin types."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


class _Reader:
    """The child of a process, which answers one thread after the other."""

    def __init__(self) -> None:
        self._turns = threading.RLock()
        self._child: subprocess.Popen[bytes] | None = None

    def ask(self, request: dict[str, Any], seconds: float) -> tuple[Any, Any]:
        """Return why a file is refused, or how it ended the child, else nothing; and what it holds."""
        with self._turns:
            child = self._child = self._child or _started()
            assert child.stdin is not None
            assert child.stdout is not None
            timer = threading.Timer(seconds, child.kill)
            timer.start()
            try:
                with contextlib.suppress(BrokenPipeError):
                    child.stdin.write(json.dumps(request).encode() + b"\n")
                    child.stdin.flush()
                refused, content = _Answer(child.stdout).load()
            except (EOFError, pickle.UnpicklingError):
                status = child.wait()
                self.end()
                return f"signal {-status}" if status < 0 else f"status {status}", None
            except BaseException:
                self.end()
                raise
            finally:
                timer.cancel()
            return refused, content

    def end(self) -> None:
        """End the child; the next file starts another."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            with contextlib.suppress(OSError):
                child.communicate()


def _started() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-I", str(_CHILD), *(path for path in sys.path if path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,  # so that Ctrl-C reaches this process alone
    )


_readers: dict[int, _Reader] = {}  # by process: a fork has its own


@atexit.register
def _end() -> None:
    if os.getpid() in _readers:
        _readers[os.getpid()].end()


def read_guarded(kind: str, path: Path, expected: str, *, field: str = "file", **options: Any) -> Any:
    """Return what a file of a kind of `_guarded_child` holds; a damaged or hostile one is a `DatasetError`.

    Files of which memory and time are beyond those of a sound one are refused.
    """
    for module in READERS[kind][1]:
        check_installed(module, str(path))
    with opened(path):
        size = path.stat().st_size
    seconds = _SECONDS + size // _BYTES_PER_SECOND
    memory = _MEMORY + _MEMORY_PER_BYTE * size
    asked = {"kind": kind, "path": str(path.absolute()), "memory": memory, "seconds": seconds}
    reader = _readers.setdefault(os.getpid(), _Reader())
    refused, content = reader.ask({**asked, "options": options}, _BUSY * (1 + seconds))
    if isinstance(refused, str):
        raise DatasetError(path, field, expected, f"one that ends its reader ({refused})")
    if refused:
        raise DatasetError(path, (*refused, field)[2], refused[0] or expected, refused[1])
    return content


def read_hdf5(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return the ``arrays`` of these names or patterns in an HDF5 file, and its ``attributes``."""
    found: dict[str, Any] = read_guarded("hdf5", path, "a complete HDF5 file", names=names)
    return found


def unpickle(path: Path) -> Any:
    """Return the object in a pickle: data alone, of builtin types and NumPy; nothing in it is run."""
    return read_guarded("pickle", path, "a complete pickle", field="pickle")
