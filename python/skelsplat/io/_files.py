"""Opening files, with the package's errors."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from pathlib import Path

VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".wmv")


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file (a byte-order mark is dropped), or raise `DatasetError`."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(path, "file", "a readable file", reason) from error
    except UnicodeDecodeError as error:
        raise DatasetError(path, "file", "text in UTF-8", f"byte {error.start} that is not") from error


def parse_toml(path: Path, text: str) -> dict[str, Any]:
    """Return the TOML document that ``path`` holds as ``text``, or raise `DatasetError`."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is no TOMLDecodeError
        reason = str(error).partition(";")[0]
        raise DatasetError(path, "TOML", "valid TOML", reason) from error
