"""Opening files, with the package's errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from pathlib import Path


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file (a byte-order mark is dropped), or raise `DatasetError`."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(path, "file", "a readable file", reason) from error
    except UnicodeDecodeError as error:
        raise DatasetError(path, "file", "text in UTF-8", f"byte {error.start} that is not") from error
