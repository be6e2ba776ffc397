"""The folder that results go to."""

from __future__ import annotations

import contextlib
import tempfile
from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextlib.contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make a folder and write into it once, so that a bad one is known before the work.

    If the block fails, the folders that were made and are still empty go again.

    Raises
    ------
    DatasetError
        If the folder cannot be made or written.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise DatasetError(folder, "--output", "a folder that can be written", reason) from error
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.rmdir()
        raise
