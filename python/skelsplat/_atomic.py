"""Files written whole or not at all, with the package's errors."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from errno import ENOSPC
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from skelsplat.exceptions import DatasetError


@contextmanager
def opening(path: Path, expected: str = "a readable file", field: str = "file") -> Iterator[None]:
    """Raise `DatasetError` for what the system says against opening or reading `path` in this block."""
    try:
        yield
    except OSError as error:
        raise DatasetError(path, field, expected, (error.strerror or str(error)).lower()) from error


@contextmanager
def atomic_path(
    path: str | os.PathLike[str], suffix: str | None = None, *, durable: bool = True
) -> Iterator[Path]:
    """Give the path of an empty file that takes the place of `path` when the block ends without an exception.

    For libraries that open a path themselves. The file is a temporary one in the same folder, with the given
    suffix or else the same; it is flushed to disk and then moved over `path` in one step. On an exception an
    older file stays as it was. A symbolic link is followed, and a file that is replaced hands on who may read
    and write it. Without `durable` nothing waits for the disk: after a power failure the file may be torn.
    A folder that is missing, a path that cannot be written, a device and a pipe are a `DatasetError`.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(6)}{suffix or target.suffix}")
    with opening(Path(path), "a path that can be written", "output"):
        if target.exists() and not (target.is_file() or target.is_dir()):
            raise OSError("a device or a pipe, which it would replace")
        try:
            temporary.open("xb").close()
            yield temporary
            if durable:
                with temporary.open("rb+") as stream:
                    os.fsync(stream.fileno())
            with suppress(OSError):  # there is none
                shutil.copymode(target, temporary)
            temporary.replace(target)
        except BaseException:
            with suppress(OSError):  # the folder cannot be reached: what led here is the one to report
                temporary.unlink(missing_ok=True)
            raise


def remove_left(folder: Path, names: Iterable[str]) -> None:
    """Remove what processes that were killed while they wrote files of these names left in a folder."""
    stems = {Path(name).stem for name in names}
    for path in folder.glob(".*"):
        parts = re.fullmatch(r"\.(.*)\.[0-9a-f]{12}\.\w+", path.name)
        if parts and parts[1] in stems:
            with suppress(OSError):
                path.unlink()


def make_room(path: Path, size: int) -> None:
    """Raise `OSError` if there is no room for so many bytes in a file.

    For libraries that cannot be stopped by a full disk.
    """
    if shutil.disk_usage(path.parent).free < size:
        raise OSError(ENOSPC, os.strerror(ENOSPC))


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, durable: bool = True) -> Iterator[BinaryIO]:
    """Open a binary file that takes the place of `path` as `atomic_path` does."""
    with atomic_path(path, ".tmp", durable=durable) as temporary, temporary.open("wb") as stream:
        yield stream


def atomic_write_text(path: str | os.PathLike[str], *parts: Iterable[str]) -> None:
    """Write texts, or parts of them, as UTF-8 to `path` with `atomic_write`; line ends are as given."""
    with atomic_write(path) as stream:
        texts = chain.from_iterable([one] if isinstance(one, str) else one for one in parts)
        stream.writelines(text.encode("utf-8") for text in texts)
