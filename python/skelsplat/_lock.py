"""A folder that one process at a time writes into."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from errno import EACCES, EAGAIN, EDEADLK
from pathlib import Path

from skelsplat._atomic import opening
from skelsplat.exceptions import DatasetError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_HELD = (EACCES, EAGAIN, EDEADLK)
_BEYOND = 1 << 30  # where Windows locks a byte, so that the text before it can be read


@contextmanager
def locked(folder: Path, name: str = ".skelsplat.lock") -> Iterator[None]:
    """Hold the lock of a folder, or raise `DatasetError` that says who does.

    The operating system releases it when the process ends, however it ends: the file that a killed process
    leaves locks nothing. It is removed at the end. Where the file system has no locks, nothing is locked.
    """
    path = folder / name
    with opening(folder, "a folder that can be written", "output"):
        file = _take(path)
    try:
        yield
    finally:
        if sys.platform == "win32":  # which removes no file that is open
            os.close(file)
        with suppress(OSError):  # while it is held: a file removed later could be another's
            path.unlink()
        if sys.platform != "win32":
            os.close(file)


def _take(path: Path) -> int:
    """Return the open file whose lock this process holds, with who it is written into it."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)  # another process may have removed it, empty as it was
        # not through a link: what it leads to would be emptied
        file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            _lock(file, path)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file), path.lstat()):
                    since = datetime.now().astimezone().isoformat(" ", "seconds")
                    os.truncate(file, 0)
                    os.write(file, f"process {os.getpid()} on {platform.node()} since {since}".encode())
                    return file
        except BaseException:
            os.close(file)
            raise
        os.close(file)  # its holder has removed it meanwhile


def _lock(file: int, path: Path) -> None:
    try:
        if sys.platform == "win32":
            os.lseek(file, _BEYOND, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
            os.lseek(file, 0, os.SEEK_SET)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:  # else a file system without locks
            who = os.read(file, 200).decode("utf-8", "replace").strip() or "another process"
            expected, actual = "a folder into which no other run writes", f"one in use by {who}"
            raise DatasetError(path.parent, "output", expected, actual) from error
