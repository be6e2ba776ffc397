"""The formats by name, which of them a path holds, and what there may belong to the cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path

from skelsplat._atomic import opening
from skelsplat._budget import opened
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._files import SEMICOLONS, VIDEO_SUFFIXES, csv_header, has_semicolons, head, listed
from skelsplat.io._run_files import DETECTIONS, folders_of_run, is_run
from skelsplat.io.detections import _animals, _arrays, _csv, _hdf5, _json, _wide
from skelsplat.io.detections._format import DetectionFormat, View, each
from skelsplat.io.detections._match import Candidates

# in the order in which a message lists them
FORMATS: dict[str, DetectionFormat] = {
    form.name: form for module in (_json, _arrays, _animals, _hdf5, _csv, _wide) for form in module.FORMATS
}
_SUFFIXES = sorted({suffix for form in FORMATS.values() for suffix in form.suffixes})
_MOST, _ENTRIES = 64, 10_000  # files looked at per folder: never a million images
_NAMED, _BEGINNING = 10, 40  # files in a message, and characters of a file that nobody knows
# looked for beneath a folder: a session, a participant, a trial is Pose2Sim's deepest; never a whole disk
_LEVELS, _FOLDERS = ("*/", "*/*/", "*/*/*/"), 200
# what may belong to the cameras, and what opens the label of each of them
_Offer = tuple[Candidates, Callable[[Mapping[str, str]], Mapping[str, View]]]


def find_format(path: Path, name: str | None) -> DetectionFormat:
    """Return the format called `name`; without a name the one that `path` holds.

    A path is a file, or a folder with files or folders of one camera each; their beginnings are looked at.
    """
    one_of("format", name, (None, *FORMATS))
    if name is not None:
        return FORMATS[name]
    if is_run(path):
        there = path / next(iter(folders_of_run(path)), "") / DETECTIONS
        raise DatasetError(path, "folder", "detections", f"the folder of a run, whose detections are {there}")
    found = recognised(path)
    if not found:
        expected = f"detections in a known format ({', '.join(FORMATS)})"
        raise DatasetError(path, "content", expected, _told(path))
    if len(found) > 1:
        actual = ", ".join(f"{form} ({found[form].name})" for form in FORMATS if form in found)
        raise DatasetError(path, "content", "one format, or its name (format=)", actual)
    return FORMATS[next(iter(found))]


def recognised(path: Path) -> dict[str, Path]:
    """Return the formats that a look at the path finds, each with the file that it was found in."""
    found: dict[str, Path] = {}
    for sample in _samples(path):
        for form in FORMATS.values():
            if sample.suffix.lower() in form.suffixes and form.matches(sample):
                found.setdefault(form.name, sample)
    return found


def _samples(path: Path) -> Iterator[Path]:
    """Yield the file; or the files of the folder, and the first of each kind in the folders beneath."""
    if path.exists() and not path.is_dir():
        with opened(path):
            yield path
        return
    folders = _subfolders(path)
    for suffix in _SUFFIXES:
        yield from _shown(path, suffix)[:_MOST]
        for folder in folders[:_MOST]:
            files = _shown(folder, suffix)[:_ENTRIES]
            # an image with nobody may be {}, which shows no format
            yield from islice(chain((one for one in files if head(one).strip() != "{}"), files), 1)


def _shown(folder: Path, *suffixes: str) -> list[Path]:
    """Return the files with these suffixes, but for hidden ones, as macOS puts "._name" beside each."""
    files = (path for suffix in suffixes for path in folder.glob(f"*{suffix}"))
    return sorted(path for path in files if not path.name.startswith("."))


def _subfolders(path: Path) -> list[Path]:
    """Folders beneath a folder, by name, without hidden ones and those that a run wrote."""
    with opening(path, "a readable folder", "folder"):
        shown = sorted(p for p in path.iterdir() if p.is_dir() and not p.name.startswith("."))
    return [folder for folder in shown if not is_run(folder)]


def _told(path: Path) -> str:
    """Say what is there if it is no detections."""
    from skelsplat.io._kinds import damage, seems  # which imports this module

    if deeper := folders_beneath(path):
        return f"folders with such detections beneath it: give one of them ({listed(deeper, _NAMED)})"
    if any(one.suffix.lower() in VIDEO_SUFFIXES for one in chain([path], path.glob("*"), path.glob("*/*"))):
        return "videos; run skelsplat detect or another detector on them first, and give what it writes"
    for sample in _samples(path) if path.is_dir() else ():
        if (wrong := damage(sample)) is not None:
            return f"none that is recognised: {sample.name} is {wrong}"
        if sample.suffix.lower() in (".csv", ".json"):
            begins = head(sample).partition("\n")[0][:_BEGINNING]
            more = (
                f", {SEMICOLONS}" if sample.suffix != ".json" and has_semicolons(csv_header(sample)) else ""
            )
            return f"none that is recognised: {sample.name} begins with {begins!r}{more}"
    return seems(path) or "none that is recognised"


def _itself(folder: Path) -> list[str]:
    return [""] if not is_run(folder) and recognised(folder) else []


def folders_beneath(top: Path, there: Callable[[Path], list[str]] = _itself) -> list[str]:
    """Return the folders with detections, of the highest level beneath `top` that has any.

    ``there`` returns what of a folder has some, ``""`` for itself.
    """
    for level in _LEVELS:
        inside = (one.relative_to(top).as_posix() for one in top.glob(level) if one.is_dir())
        names = sorted(islice((name for name in inside if "/." not in f"/{name}"), _FOLDERS))
        found = []
        for name in names:
            with suppress(DatasetError):  # it cannot be read
                found += [f"{name}/{one}" for one in there(top / name)]
        if found:
            return found
    return []


def offered(path: Path, form: DetectionFormat, sequence: str | None) -> _Offer:
    """Return what is at a path: the views in one file, or the cameras' files or folders."""
    if sequence is not None and not form.sequences:
        expected = f"none for the format {form.name}, whose files have one sequence"
        raise InvalidInputError(f"sequence: expected {expected}, got {sequence!r}")
    if not path.is_file():
        recording = _only_recording(path, form, sequence)
        if recording is None:
            return _of_folder(path, form)
        path = recording
    if form.recording is None:
        raise DatasetError(path, "path", f"a folder ({form.name} has files per camera)", "a file")
    views, named = form.recording(path, sequence)
    candidates = Candidates(path, "view", {label: label for label in views}, named=named)
    return candidates, lambda labels: {camera: views[label] for camera, label in labels.items()}


def _only_recording(folder: Path, form: DetectionFormat, sequence: str | None) -> Path | None:
    """Return the only file of a folder if it has the detections of all cameras, or None."""
    files = _shown(folder, *form.suffixes)
    if form.recording is None or len(files) != 1 or not form.matches(files[0]):
        return None
    if form.files is None:
        return files[0]
    with suppress(DatasetError):  # one that is not named may as well be of one camera
        return files[0] if form.recording(files[0], sequence).named else None
    return None


def _of_folder(path: Path, form: DetectionFormat) -> _Offer:
    """Return the cameras' files, or their folders, with files of one frame each or with a single one."""
    folders, files = _subfolders(path), _shown(path, *form.suffixes)
    known = [file for file in files if form.matches(file)]
    beneath = {folder.name for folder in folders if _shown(folder, *form.suffixes)}
    if form.files is not None and (known or (files and not beneath)):
        # one that is not recognised is still taken for a camera of its name
        idle = {file.name for file in files if known and file not in known}
        texts = {file.name: form.camera_part(file.stem) for file in files}
        return _by_path(Candidates(path, "file", texts, idle), form.files, lambda file: file)
    names = {folder.name: folder.name for folder in folders}
    candidates = Candidates(path, "folder", names, names.keys() - beneath)
    if form.folder is not None:
        return _by_path(candidates, each(form.folder), lambda folder: folder)
    if form.files is not None and folders:
        return _by_path(candidates, form.files, lambda folder: _the_file(folder, form))
    which = "files" if form.files is not None else "the file of all cameras itself,"
    there = listed(sorted(file.name for file in path.iterdir() if file.is_file()), _NAMED) or "none"
    raise DatasetError(path, "path", f"{which} of {form.name} ({', '.join(form.suffixes)})", there)


def _by_path(
    candidates: Candidates,
    read: Callable[[Mapping[str, Path]], Mapping[str, View]],
    locate: Callable[[Path], Path],
) -> _Offer:
    root = candidates.root
    return candidates, lambda labels: read({name: locate(root / label) for name, label in labels.items()})


def _the_file(folder: Path, form: DetectionFormat) -> Path:
    """Return the one file in a camera's folder."""
    files = _shown(folder, *form.suffixes)
    found = [file for file in files if form.matches(file)] or files
    if len(found) != 1:
        there = ", ".join(file.name for file in found) or "none"
        raise DatasetError(folder, "files", f"one {form.name} file of the camera", there)
    return found[0]
