"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import secrets
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, durable: bool = True) -> Iterator[BinaryIO]:
    """Open a binary file that takes the place of `path` when the block ends without an exception.

    The bytes go to a temporary file in the same folder, are flushed to disk, and are then moved over `path`
    in one step; a reader never sees half a file, and on an exception an older file stays as it was. A
    symbolic link is followed. Without `durable` nothing waits for the disk: after a power failure the file
    may be empty or torn, so its reader must check it.

    Raises
    ------
    DatasetError
        If the folder is missing or the path cannot be written.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        try:
            with temporary.open("xb") as stream:
                yield stream
                stream.flush()
                if durable:
                    os.fsync(stream.fileno())
            temporary.replace(target)
        except BaseException:
            _discard(temporary)
            raise
    except OSError as error:
        raise DatasetError(Path(path), "output", "a path that can be written", _reason(error)) from error


def atomic_write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8 to `path` with `atomic_write`; line ends are written as given."""
    with atomic_write(path) as stream:
        stream.write(text.encode("utf-8"))


def _discard(temporary: Path) -> None:
    try:
        temporary.unlink(missing_ok=True)
    except OSError:
        return  # the folder itself cannot be reached; the error that led here is the one to report


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
