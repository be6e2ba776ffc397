"""Exceptions of the package: one base class, one class per kind of cause.

Every message is one line: the argument or file, what was expected, what came.
"""

from __future__ import annotations

from pathlib import Path


class SkelSplatError(Exception):
    """Base of every error raised on purpose by this package."""


class InvalidInputError(SkelSplatError, ValueError):
    """An argument has the wrong shape, type or value; the message names it."""


class DegenerateGeometryError(SkelSplatError):
    """Each argument is valid alone, but together they have no geometric answer."""


class MissingPackageError(SkelSplatError, ImportError):
    """An optional package is not installed; the message gives the command that installs it."""


class DatasetError(SkelSplatError):
    """A file or folder is missing, unreadable or not what its format says.

    Parameters
    ----------
    path : str or Path
        The file or folder.
    field : str
        The part of it that is wrong, such as ``"cam01.matrix"`` or ``"line 3"``.
    expected, actual : object
        What the format asks for and what the file holds; shown with ``str``.

    Attributes
    ----------
    path : Path
    field, expected, actual : str
    """

    def __init__(self, path: str | Path, field: str, expected: object, actual: object) -> None:
        super().__init__(str(path), field, str(expected), str(actual))
        self.path = Path(path)
        self.field = field
        self.expected = str(expected)
        self.actual = str(actual)

    def __str__(self) -> str:
        message = f"{self.path}: {self.field}: expected {self.expected}, got {self.actual}"
        return " ".join(message.split())
