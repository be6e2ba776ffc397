"""Exceptions of the package: one base class, one class per kind of cause.

Every message is one line: the argument or file, what was expected, what came.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from skelsplat._escape import escaped

# Characters of a message; what a file holds may be longer.
_LONGEST = 1000


class SkelSplatError(Exception):
    """Base of every error raised on purpose by this package."""

    def __str__(self) -> str:
        return escaped(super().__str__())


class InvalidInputError(SkelSplatError, ValueError):
    """An argument has the wrong shape, type or value; the message begins with its name and a colon."""

    @property
    def argument(self) -> str:
        """Name of the argument."""
        return str(self).partition(": ")[0]

    @property
    def reason(self) -> str:
        """The message without the argument: what was expected, and what came."""
        return str(self).partition(": ")[2]

    def of_argument(self, name: str) -> InvalidInputError:
        """Return the same error with another argument name, that of an outer caller."""
        return InvalidInputError(f"{name}: {self.reason}")


def one_of(argument: str, value: object, choices: Iterable[object]) -> None:
    """Raise `InvalidInputError` unless `value` is among `choices`; None, if it is one, is not listed."""
    known = list(choices)
    if value not in known:
        listed = ", ".join(str(choice) for choice in known if choice is not None)
        raise InvalidInputError(f"{argument}: expected one of {listed}, got {value!r}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean …?" with the closest of the known names, empty if none is close."""
    from difflib import get_close_matches

    close = get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]}?" if close else ""


class DegenerateGeometryError(SkelSplatError):
    """Each argument is valid alone, but together they have no geometric answer."""


class MissingPackageError(SkelSplatError, ImportError):
    """An optional package is not installed; the message gives the command that installs it."""


class DatasetError(SkelSplatError):
    """A file or folder is missing, unreadable or not what its format says.

    Attributes
    ----------
    path : Path
        The file or folder.
    field : str
        The part of it that is wrong, such as ``"cam01.matrix"`` or ``"line 3"``.
    expected, actual : str
        What the format asks for and what the file holds.
    """

    def __init__(self, path: str | Path, field: str, expected: object, actual: object) -> None:
        super().__init__(str(path), field, str(expected), str(actual))
        self.path, self.field = Path(path), field
        self.expected, self.actual = str(expected), str(actual)

    @classmethod
    def of_argument(cls, path: str | Path, error: InvalidInputError) -> DatasetError:
        """Return the error for a file whose content was refused as an argument."""
        expected, _, actual = error.reason.removeprefix("expected ").partition(", got ")
        return cls(path, error.argument, expected, actual)

    def __str__(self) -> str:
        message = f"{self.path}: {self.field}: expected {self.expected}, got {self.actual}"
        line = escaped(" ".join(message.split()))
        return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 100]} … {line[-100:]}"
