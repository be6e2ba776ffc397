"""Folders beneath a path: the one to give may lie a level or more below the one that was given."""

from __future__ import annotations

import os
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# a session, a participant, a trial: Pose2Sim's deepest; and never a walk through somebody's whole disk
_LEVELS = 3
_FOLDERS = 200
_ENTRIES = 10_000


def folders_beneath(top: Path, wanted: Callable[[Path], bool]) -> list[Path]:
    """Return the folders that are `wanted`, of the highest level beneath `top` that has any.

    Looks at a limited number of levels, of folders in all and of entries in each; what cannot be read is
    passed over.
    """
    level, left = [top], _FOLDERS
    for _ in range(_LEVELS):
        level = list(islice(chain.from_iterable(map(_inside, level)), left))
        left -= len(level)
        found = [folder for folder in level if wanted(folder)]
        if found:
            return found
    return []


def _inside(folder: Path) -> list[Path]:
    """Folders in a folder, by name, without hidden ones."""
    try:
        with os.scandir(folder) as entries:
            shown = [one for one in islice(entries, _ENTRIES) if not one.name.startswith(".")]
            return sorted(Path(one.path) for one in shown if one.is_dir())
    except OSError:
        return []
