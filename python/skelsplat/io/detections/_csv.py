"""CSV files, with the package's errors."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import read_text

if TYPE_CHECKING:
    from pathlib import Path


def csv_lines(path: Path) -> list[list[str]]:
    """Return the fields of every line; of a blank line there are none.

    A quoted field may go on over several lines, so that a quote that is never closed swallows what follows:
    it is an error.
    """
    reader = csv.reader(read_text(path).splitlines(), strict=True)
    try:
        return list(reader)
    except csv.Error as error:
        expected = "comma-separated fields, every quote closed"
        raise DatasetError(path, f"line {reader.line_num}", expected, str(error)) from error
