"""Where a folder has the detections, videos and calibrations of a recording, or the folders of several."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from skelsplat.exceptions import DatasetError, SkelSplatError
from skelsplat.io._files import VIDEO_SUFFIXES
from skelsplat.io._run_files import is_run
from skelsplat.io.calibration import find_format as calibration_format
from skelsplat.io.detections import sights
from skelsplat.io.detections._registry import folders_beneath, recognised

RECORDING, SEVERAL = "recording", "recordings"
_LOOKED_AT = 200  # files of a folder
_BY_COMMANDS = ("overlay", "plots", "opensim")


def contents(folder: Path) -> tuple[tuple[str, ...], str, tuple[str, ...]]:
    """Return the detections and the folder of videos of a recording; or folders in it with a recording each.

    Names are paths from the folder. It holds several recordings if several folders of it have detections, or
    videos without being called so, and it has none itself.
    """
    found, videos = _detections(folder), _videos(folder)
    of = dict.fromkeys(_recording_of(folder, name) for name in found)
    if folder in of or len(of) == 1:
        here = folder if folder in of else next(iter(of))
        own = tuple(name for name in found if _recording_of(folder, name) == here)
        return own, next(iter(videos), ""), ()
    several = [one.relative_to(folder).parts[0] for one in of]
    if not of and len(videos) > 1 and not any("video" in name for name in videos):
        several = [name for name in videos if _count(folder / name) > 1]
        videos = []
    return (), "" if several else next(iter(videos), ""), tuple(dict.fromkeys(several))


def folders_of_one_video(folder: Path) -> list[str]:
    """Return the folders in one that have one video each, as if it were that of a camera."""
    return [name for name in _videos(folder) if name != "." and _count(folder / name) == 1]


def kind_of(folder: Path) -> str:
    """Return what a folder is, if it is a recording or holds several."""
    with suppress(SkelSplatError, OSError):
        detections, videos, inside = contents(folder)
        whole = detections or (videos and (videos != "." or _count(folder) > 1))
        return SEVERAL if inside else RECORDING if whole else ""
    return ""


def kinds_of(folder: Path, inside: Iterable[Path]) -> dict[Path, str]:
    """Return what folders in a folder are; those in a recording are parts of it."""
    return {} if kind_of(folder) == RECORDING else {one: kind_of(one) for one in inside}


def _detections(folder: Path) -> list[str]:
    """Return the folders and files of detections of the highest level that has any."""
    with suppress(DatasetError):  # it cannot be read
        if found := _detections_at(folder):
            return found
    beneath = map(Path, folders_beneath(folder, _detections_at))
    return [path.as_posix() for path in beneath if not any(part in _BY_COMMANDS for part in path.parts)]


def _detections_at(folder: Path) -> list[str]:
    """Return ``.`` if a folder is one of detections, else the files in it that have those of all cameras."""
    found = {} if is_run(folder) else recognised(folder)
    if not found or any(map(_is_calibration, found.values())):
        return []
    # how texts begin is sure; arrays may as well be poses
    if any(path.suffix != ".npz" for path in found.values()) or _are_read(folder):
        return ["."]
    return [one.name for one in sorted(folder.glob("*.npz"))[:_LOOKED_AT] if _are_read(one)]


def _is_calibration(path: Path) -> bool:
    with suppress(SkelSplatError):
        return calibration_format(path) is not None
    return False


def _are_read(path: Path) -> bool:
    with suppress(SkelSplatError, OSError):
        return bool(sights(path))
    return False


def _recording_of(folder: Path, detections: str) -> Path:
    """Return the folder of the recording that detections in a folder are of."""
    place = folder / detections
    own = place == folder or (place.is_dir() and _is_calibration(place))
    return place if own else place.parent


def _count(place: Path) -> int:
    """Return the number of videos in a folder."""
    return sum(one.suffix.lower() in VIDEO_SUFFIXES for one in place.iterdir())


def _videos(folder: Path) -> list[str]:
    """Return the folders of videos: itself, or those in it, the ones that a tool has drawn on last."""
    if _count(folder):
        return ["."]
    inside = (one for one in folder.iterdir() if one.is_dir() and not one.name.startswith("."))
    names = (one.name for one in inside if one.name not in _BY_COMMANDS and not is_run(one) and _count(one))
    return sorted(names, key=lambda name: (name.startswith("annotated"), name))
