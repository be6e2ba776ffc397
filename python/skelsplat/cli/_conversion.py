"""What ``convert`` converts: one `Kind` per kind of file, found from the input."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass(frozen=True)
class Request:
    """One conversion: from where to where, and the options that the user gave, by name."""

    source: Path
    target: Path
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Written:
    """What was written: a sentence, and the same as values of JSON."""

    sentence: str
    document: dict[str, Any]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes
    ----------
    name : str
        Such as "calibration".
    recognises : callable
        Whether a path is one; it must not raise for files of other kinds.
    convert : callable
        Reads, writes, and says what was written.
    suffixes : tuple of str
        What OUTPUT may end in.
    options : frozenset of str
        The options of the command that it takes.
    """

    name: str
    recognises: Callable[[Path], bool]
    convert: Callable[[Request], Written]
    suffixes: tuple[str, ...]
    options: frozenset[str]
