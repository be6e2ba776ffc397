"""Where the page may read and write: in the folder that it was opened with, and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skelsplat._atomic import opening
from skelsplat.exceptions import InvalidInputError
from skelsplat.io._files import natural

_MOST = 500  # folders that are listed


@dataclass(frozen=True)
class Place:
    """The folder that the page was opened with, with links followed."""

    root: Path

    def inside(self, path: str, base: Path | None = None) -> Path:
        """Return a path from a folder here, with links followed; `InvalidInputError` if it is outside."""
        if "\0" in path:
            raise InvalidInputError(f"folder: expected a path, got {path!r}")
        found = ((base or self.root) / path).resolve()
        if found != self.root and self.root not in found.parents:
            way = "start skelsplat app with a folder that has it"
            raise InvalidInputError(f"folder: expected one in {self.root} ({way}), got {path}")
        return found

    def folder(self, path: str) -> Path:
        """Return a folder here that exists."""
        found = self.inside(path)
        if not found.is_dir():
            raise InvalidInputError(f"folder: expected one that exists, got {found}")
        return found

    def relative(self, path: Path) -> str:
        """Return the path from the root, with slashes; of the root itself nothing."""
        text = path.relative_to(self.root).as_posix()
        return "" if text == "." else text

    def folders(self, folder: Path) -> list[Path]:
        """Return the folders in a folder here, without hidden ones and those that links lead out to."""
        with opening(folder, "a folder that can be read", "folder"):
            there = [one for one in folder.iterdir() if not one.name.startswith(".") and one.is_dir()]
        inside = [one for one in there if self.root in one.resolve().parents]
        return sorted(inside, key=lambda one: natural(one.name))[:_MOST]

    def file_to_write(self, folder: Path, name: str) -> Path:
        """Return where a file is put that is brought into a folder here; its name may have folders in it."""
        parts = [part for part in name.replace("\\", "/").split("/") if part]
        if not parts or any(part.startswith(".") or ":" in part for part in parts):
            raise InvalidInputError(f"file: expected a name without .. and not hidden, got {name!r}")
        return self.inside("/".join(parts), folder)
