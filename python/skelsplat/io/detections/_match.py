"""Which folder belongs to which camera, and which frames the folders share."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    Frames = npt.NDArray[np.int64]


def match_folders(
    root: Path, names: Sequence[str], *, allow_missing: bool, suffix: str = ".json"
) -> dict[str, Path | None]:
    """Assign a folder beneath `root` to every camera name, in the order of `names`.

    A folder of exactly the camera's name comes first; otherwise names are compared in lower case, without
    separators, leading zeros and a last word "json": camera ``cam_01`` and folder ``cam01_json`` belong
    together. The match must be one to one. Folders that match no camera may stand beside the others only if
    they hold no `suffix` files.

    Raises
    ------
    DatasetError
        If a camera has no folder (unless `allow_missing`, then it gets None), a folder no camera, or a name
        fits more than one.
    """
    folders = _subfolders(root)
    if not folders:
        raise DatasetError(root, "folders", f"one folder per camera ({', '.join(names)})", "no folders")
    found: dict[str, Path | None] = {name: _folder_of(root, name, names, folders) for name in names}
    stray = [f for f in folders if f not in found.values() and any(f.glob(f"*{suffix}"))]
    missing = [name for name in names if found[name] is None]
    if stray:
        expected = f"a camera in the calibration for every folder (it has {', '.join(names)})"
        raise DatasetError(root, "folders", expected, f"no camera for {_names(stray)}; {_ADVICE}")
    if missing and not (allow_missing and len(missing) < len(names)):
        expected = f"a folder for every camera (folders: {_names(folders)})"
        raise DatasetError(root, "folders", expected, f"none for {', '.join(missing)}; {_ADVICE}")
    return found


_ADVICE = "name each folder like its camera, for example cam_01 or cam01_json for the camera cam_01"


def _subfolders(root: Path) -> list[Path]:
    try:
        return sorted(p for p in root.iterdir() if p.is_dir() and not p.name.startswith("."))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(root, "folder", "a readable folder", reason) from error


def _folder_of(root: Path, name: str, names: Sequence[str], folders: Sequence[Path]) -> Path | None:
    """Return the one folder that fits `name`; None if there is none."""
    exact = [folder for folder in folders if folder.name == name]
    if exact:
        return exact[0]
    key = _key(name)
    fitting = [folder for folder in folders if _key(folder.name) == key and folder.name not in names]
    rivals = [other for other in names if _key(other) == key and all(f.name != other for f in folders)]
    if len(fitting) > 1 or (fitting and len(rivals) > 1):
        actual = f"cameras {', '.join(rivals)} and folders {_names(fitting)} that read the same; {_ADVICE}"
        raise DatasetError(root, "folders", "one folder per camera", actual)
    return fitting[0] if fitting else None


def _key(name: str) -> tuple[str, ...]:
    """Split a name into lower-case words and numbers, without separators, leading zeros and a last "json"."""
    words = [word.lstrip("0") or "0" if word.isdigit() else word for word in _WORDS.findall(name.lower())]
    if len(words) > 1 and words[-1] == "json":
        words.pop()
    return tuple(words)


_WORDS = re.compile(r"\d+|[^\W\d_]+")


def _names(folders: Sequence[Path]) -> str:
    return ", ".join(folder.name for folder in folders)


def common_frames(root: Path, per_folder: Mapping[str, Sequence[int]], mode: str) -> Frames:
    """Return the ascending frame numbers to read, (T,).

    Parameters
    ----------
    root : Path
        For messages.
    per_folder : dict
        Frame numbers of each folder, by folder name.
    mode : "strict", "intersection" or "union"
        ``strict`` asks for the same frames in every folder.

    Raises
    ------
    DatasetError
        If the folders differ under ``strict``, or share no frame under ``intersection``.
    """
    sets = {name: set(frames) for name, frames in per_folder.items()}
    union = set.union(*sets.values())
    shared = set.intersection(*sets.values())
    if mode == "strict" and union != shared:
        raise DatasetError(
            root, "frames", "the same frames in every folder", _difference(sets, union - shared)
        )
    if mode == "intersection" and not shared:
        raise DatasetError(root, "frames", "frames that all folders have", _counts(sets))
    return np.array(sorted(shared if mode == "intersection" else union), dtype=np.int64)


def _difference(sets: dict[str, set[int]], uneven: set[int]) -> str:
    advice = 'frames="intersection" or "union" (--frames) reads them all the same'
    first = min(uneven)
    if len({len(frames) for frames in sets.values()}) > 1:
        return f"{_counts(sets)}; {advice}"
    without = ", ".join(name for name, frames in sets.items() if first not in frames)
    return f"equal counts but no frame {first} in {without}; {advice}"


def _counts(sets: dict[str, set[int]]) -> str:
    return ", ".join(f"{len(frames)} in {name}" for name, frames in sets.items())
