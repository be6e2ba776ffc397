"""Finding files where one of several layouts has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from skelsplat.datasets._registry import Survey
from skelsplat.exceptions import DatasetError


def find(candidates: Sequence[Path], what: str) -> Path:
    """Return the first of `candidates` that exists.

    Raises
    ------
    DatasetError
        If none does; names all of them.
    """
    for path in candidates:
        if path.exists():
            return path
    others = ", ".join(str(path) for path in candidates[1:])
    raise DatasetError(candidates[0], "file", what, f"nothing there{', nor at ' if others else ''}{others}")


@dataclass
class Wishes:
    """Files that a survey looks for, one after the other."""

    there: list[Path] = field(default_factory=list)
    missing: list[tuple[Path, str]] = field(default_factory=list)

    def look(self, candidates: Sequence[Path], what: str) -> Path | None:
        """Note whether one of `candidates` exists, and return it."""
        found = next((path for path in candidates if path.exists()), None)
        if found is None:
            self.missing.append((candidates[0], what))
        else:
            self.there.append(found)
        return found

    def survey(self, layout: str = "") -> Survey:
        """Return what was found."""
        return Survey(there=self.there, missing=self.missing, format=layout)
