"""The formats by name, and which of them a path holds."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import chain, islice
from pathlib import Path

from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import VIDEO_SUFFIXES
from skelsplat.io._run_files import is_run
from skelsplat.io.detections import _animals, _arrays, _csv, _json
from skelsplat.io.detections._format import DetectionFormat
from skelsplat.io.detections._sources import subfolders

# in the order in which a message lists them
FORMATS: dict[str, DetectionFormat] = {
    form.name: form
    for form in (
        DetectionFormat("openpose", (".json",), _json.is_openpose, folder=_json.read_openpose),
        DetectionFormat("mmpose", (".json",), _json.is_mmpose, _json.read_mmpose),
        DetectionFormat(
            "alphapose", (".json",), _json.is_alphapose, _json.read_alphapose, cut=_json.cut_alphapose
        ),
        DetectionFormat("coco", (".json",), _json.is_coco, _json.read_coco),
        DetectionFormat(
            "rtmlib", (".npz", ".npy"), _arrays.is_rtmlib, _arrays.read_rtmlib, _arrays.read_rtmlib_folder
        ),
        DetectionFormat("metrabs", (".npz",), _arrays.is_metrabs, _arrays.read_metrabs),
        DetectionFormat(
            "deeplabcut",
            (".h5",),
            _animals.is_deeplabcut,
            _animals.read_deeplabcut,
            cut=_animals.cut_deeplabcut,
        ),
        DetectionFormat(
            "deeplabcut_csv",
            (".csv",),
            _animals.is_deeplabcut_csv,
            _animals.read_deeplabcut_csv,
            cut=_animals.cut_deeplabcut,
        ),
        DetectionFormat(
            "sleap", (".h5", ".hdf5"), _animals.is_sleap, _animals.read_sleap, cut=_animals.cut_sleap
        ),
        DetectionFormat("freemocap", (".npy",), _arrays.is_freemocap, recording=_arrays.read_freemocap),
        DetectionFormat("easymocap", (".json",), _json.is_easymocap, folder=_json.read_easymocap),
        DetectionFormat("videopose3d", (".npz",), _arrays.is_videopose3d, recording=_arrays.read_videopose3d),
        DetectionFormat(
            "npz", (".npz",), _arrays.is_npz, _arrays.read_npz, recording=_arrays.read_npz_recording
        ),
        DetectionFormat("csv", (".csv",), _csv.is_csv, _csv.read_csv, recording=_csv.read_csv_recording),
    )
}
# files looked at per folder: enough for every camera of a dome, and never a folder of a million images
_MOST = 64
# folders named in a message
_NAMED = 10
# looked for beneath a folder: a session, a participant, a trial is Pose2Sim's deepest; never a whole disk
_LEVELS = 3
_FOLDERS = 200
_ENTRIES = 10_000


def find_format(path: Path, name: str | None) -> DetectionFormat:
    """Return the format called `name`; without a name the one that `path` holds.

    A path is a file, or a folder with files or folders of one camera each; their beginnings are looked at.
    """
    known = ", ".join(FORMATS)
    if name is not None and name not in FORMATS:
        raise InvalidInputError(f"format: expected one of {known}, got {name!r}")
    if name is not None:
        return FORMATS[name]
    found = _recognised(path)
    if not found:
        raise DatasetError(path, "content", f"detections in a known format ({known})", _told(path))
    if len(found) > 1:
        actual = ", ".join(f"{form} ({found[form].name})" for form in FORMATS if form in found)
        raise DatasetError(path, "content", "one format, or its name (format=, --format)", actual)
    return FORMATS[next(iter(found))]


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
    """Return the folders in a folder, by name, without hidden ones."""
    try:
        with os.scandir(folder) as entries:
            shown = [one for one in islice(entries, _ENTRIES) if not one.name.startswith(".")]
            return sorted(Path(one.path) for one in shown if one.is_dir())
    except OSError:
        return []
