"""The formats by name, and which of them a path holds."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import VIDEO_SUFFIXES
from skelsplat.io._run_files import is_run
from skelsplat.io.detections import (
    alphapose,
    coco,
    deeplabcut,
    deeplabcut_csv,
    easymocap,
    freemocap,
    metrabs,
    mmpose,
    openpose,
    plain_csv,
    plain_npz,
    rtmlib,
    sleap,
    videopose3d,
)
from skelsplat.io.detections._beneath import folders_beneath
from skelsplat.io.detections._sources import subfolders

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from skelsplat.io.detections._format import DetectionFormat

_MODULES = (
    *(openpose, mmpose, alphapose, coco, rtmlib, metrabs, deeplabcut, deeplabcut_csv, sleap),
    *(freemocap, easymocap, videopose3d, plain_npz, plain_csv),
)
FORMATS: dict[str, DetectionFormat] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
# files looked at per folder: enough for every camera of a dome, and never a folder of a million images
_MOST = 64
# folders named in a message
_NAMED = 10


def find_format(path: Path, name: str | None) -> DetectionFormat:
    """Return the format called `name`; without a name the one that `path` holds.

    A path is a file, or a folder with files or folders of one camera each; their beginnings are looked at.

    Raises
    ------
    InvalidInputError
        If `name` is unknown.
    DatasetError
        If there is nothing, nothing known, or more than one format.
    """
    known = ", ".join(FORMATS)
    if name is not None:
        if name not in FORMATS:
            raise InvalidInputError(f"format: expected one of {known}, got {name!r}")
        return FORMATS[name]
    found = _recognised(path)
    if len(found) == 1:
        return FORMATS[next(iter(found))]
    if found:
        actual = ", ".join(f"{known} ({found[known].name})" for known in FORMATS if known in found)
        expected = "one format, or its name (format=, --format)"
        raise DatasetError(path, "content", expected, actual)
    expected = f"detections in a known format ({known})"
    raise DatasetError(path, "content", expected, _told(path))


def _recognised(path: Path) -> dict[str, Path]:
    """Return the formats that a look at the path finds, each with the file that it was found in."""
    found: dict[str, Path] = {}
    for sample in _samples(path):
        for candidate in FORMATS.values():
            if sample.suffix.lower() in candidate.suffixes and candidate.matches(sample):
                found.setdefault(candidate.name, sample)
    return found


def _told(path: Path) -> str:
    """Say what is there if it is no detections: folders with some beneath it, or only videos."""
    deeper = folders_beneath(path, _has_detections)
    if deeper:
        return f"folders with such detections beneath it: give one of them ({_names(path, deeper)})"
    if any(one.suffix.lower() in VIDEO_SUFFIXES for one in chain([path], path.glob("*"), path.glob("*/*"))):
        return "videos; run a 2D keypoint detector on them first, and give the files that it writes"
    return "none that is recognised"


def _has_detections(folder: Path) -> bool:
    try:
        return not is_run(folder) and bool(_recognised(folder))
    except DatasetError:  # it cannot be read
        return False


def _names(top: Path, folders: list[Path]) -> str:
    names = [f"{folder.relative_to(top).as_posix()}/" for folder in folders]
    more = [f"and {len(names) - _NAMED} more"] if len(names) > _NAMED else []
    return ", ".join(names[:_NAMED] + more)


def _samples(path: Path) -> Iterator[Path]:
    """Yield the file; or the files of the folder, and the first of each kind in the folders beneath."""
    if path.is_file():
        yield path
        return
    folders = subfolders(path)
    suffixes = {suffix for candidate in FORMATS.values() for suffix in candidate.suffixes}
    for suffix in sorted(suffixes):
        yield from sorted(path.glob(f"*{suffix}"))[:_MOST]
        for folder in folders[:_MOST]:
            yield from sorted(folder.glob(f"*{suffix}"))[:1]
