"""What the verification of a data set says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from skelsplat.datasets._model import Take
from skelsplat.exceptions import DatasetError


@dataclass(frozen=True)
class Finding:
    """Something that is not as it should be.

    Attributes
    ----------
    topic : str
        ``"unit"``, ``"sides"``, ``"joint order"``, ``"cameras"``, ``"lens"`` or ``"views"``.
    file : Path
    field, expected, actual : str
        As in `DatasetError`.
    fatal : bool
        Whether the data cannot be used like this.
    takes : tuple of str
        Keys of the takes it was found in.
    """

    topic: str
    file: Path
    field: str
    expected: str
    actual: str
    fatal: bool = False
    takes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.field}: expected {self.expected}, got {self.actual}{self._where()}"

    def _where(self) -> str:
        more = f" and {len(self.takes) - 1} more" if len(self.takes) > 1 else ""
        return f" in {self.takes[0]}{more}" if self.takes else ""

    def error(self) -> DatasetError:
        """Return the exception that says the same."""
        return DatasetError(self.file, self.field, self.expected, self.actual + self._where())


def merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Join findings of the same kind: the words of the first, the takes of all."""
    found: dict[tuple[str, str], Finding] = {}
    for finding in findings:
        key = finding.topic, finding.field
        first = found.get(key)
        takes = (first.takes if first else ()) + finding.takes
        found[key] = replace(first or finding, takes=takes)
    return tuple(found.values())


def file_of(take: Take, *parts: str) -> Path:
    """Where a part of the take comes from; the take's key if it does not say."""
    return next((take.files[part] for part in parts if part in take.files), Path(take.key))
