"""Files whose libraries can run code, hang or crash: pickles, arrays of objects, MAT, HDF5, NetCDF, C3D.

One child process (`_guarded_child`) reads all of them, within limits of memory and time, and hands back plain
arrays. It is started with the first such file, and again after a file has ended it.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._budget import opened
from skelsplat._optional import check_installed
from skelsplat.exceptions import DatasetError
from skelsplat.io._guarded_child import unpacked

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


class _Child:
    """The process, and the folder in which it leaves what it has read."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="skelsplat-")
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(_CHILD), *(path for path in sys.path if path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # so that Ctrl-C reaches this process alone
        )
        self.owner = os.getpid()

    def ask(self, request: dict[str, Any], seconds: float) -> tuple[list[Any] | str, Any]:
        """Return the answer to a request, or how the child ended; and what it has read."""
        target = Path(self._folder.name, "read.npz")
        target.unlink(missing_ok=True)
        timer = threading.Timer(seconds, self._process.kill)
        timer.start()
        try:
            line = self._told({**request, "target": str(target)})
        finally:
            timer.cancel()
        if not line:
            return self._ended(), None
        answer = json.loads(line)
        return answer, _content(target) if not answer else None

    def _told(self, request: dict[str, Any]) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        return self._process.stdout.readline()

    def _ended(self) -> str:
        status = self._process.wait()
        return f"signal {-status}" if status < 0 else f"status {status}"

    def close(self) -> None:
        """End the process; in a fork of the one that started it, only forget it."""
        if self.owner == os.getpid():
            self._process.kill()
            self._process.wait()
            self._folder.cleanup()
        else:
            self._process.returncode = 0
            self._folder._finalizer.detach()  # type: ignore[attr-defined]
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()


def _content(target: Path) -> Any:
    with np.load(target, allow_pickle=False) as arrays:
        return unpacked(json.loads(arrays["tree"].tobytes()), arrays["content"])


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
            answer, content = _child.ask(request, _BUSY * (1 + seconds))
        except BaseException:
            _end()
            raise
        if isinstance(answer, str):
            _end()
            raise DatasetError(path, field, expected, f"one that ends its reader ({answer})")
    if answer:
        raise DatasetError(path, (*answer, field)[2], answer[0] or expected, answer[1])
    return content


def unpickle(path: Path) -> Any:
    """Return the object in a pickle: data alone, of builtin types and NumPy; nothing in it is run."""
    return read_guarded("pickle", path, "a complete pickle", field="pickle")


def load_mat(path: Path, expected: str, names: Collection[str] | None = None) -> dict[str, Any]:
    """Return the variables of a MAT-file, or those of these names."""
    wanted = None if names is None else list(names)
    found: dict[str, Any] = read_guarded("mat", path, expected, names=wanted)
    return found
