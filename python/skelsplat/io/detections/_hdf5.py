"""Telling HDF5 files apart without the packages that read them."""

from __future__ import annotations

import mmap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def hdf5_mentions(path: Path, *names: bytes) -> bool:
    """Say whether a file is HDF5 and holds all of `names`, which stand in it as plain text."""
    try:
        with path.open("rb") as stream:
            if stream.read(len(_SIGNATURE)) != _SIGNATURE:
                return False
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return all(content.find(name) >= 0 for name in names)
    except (OSError, ValueError):
        return False
