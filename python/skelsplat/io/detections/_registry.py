"""The formats by name, which of them a path holds, and the views of the cameras there, opened."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from skelsplat._atomic import opening
from skelsplat._budget import opened
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._files import VIDEO_SUFFIXES, head, listed
from skelsplat.io._run_files import DETECTIONS, folders_of_run, is_run
from skelsplat.io.detections import _animals, _arrays, _csv, _json
from skelsplat.io.detections._format import DetectionFormat, View
from skelsplat.io.detections._frames import Sources
from skelsplat.io.detections._match import Candidates, match_by_name, match_by_order

# in the order in which a message lists them
FORMATS: dict[str, DetectionFormat] = {
    form.name: form for module in (_json, _arrays, _animals, _csv) for form in module.FORMATS
}
# files looked at per folder: enough for every camera of a dome, and never a folder of a million images
_MOST = 64
# files or folders named in a message, and how much is shown of a file that nobody knows
_NAMED, _BEGINNING = 10, 40
# looked for beneath a folder: a session, a participant, a trial is Pose2Sim's deepest; never a whole disk
_LEVELS = 3
_FOLDERS = 200
_ENTRIES = 10_000
Order = str | Sequence[str]
# what may belong to the cameras, and how one of them is opened by its label
Offer = tuple[Candidates, Callable[[str], View]]


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
        for candidate in FORMATS.values():
            if sample.suffix.lower() in candidate.suffixes and candidate.matches(sample):
                found.setdefault(candidate.name, sample)
    return found


def first_file(path: Path, form: DetectionFormat) -> Path:
    """Return the file, or the first one in a folder, that `find_format` found to be of a format."""
    there = (sample for sample in _samples(path) if sample.suffix.lower() in form.suffixes)
    return next(sample for sample in there if form.matches(sample))


def _told(path: Path) -> str:
    """Say what is there if it is no detections: folders with some beneath it, or only videos."""
    deeper = folders_beneath(path, _has_detections)
    if deeper:
        names = [f"{folder.relative_to(path).as_posix()}/" for folder in deeper]
        return f"folders with such detections beneath it: give one of them ({listed(names, _NAMED)})"
    if any(one.suffix.lower() in VIDEO_SUFFIXES for one in chain([path], path.glob("*"), path.glob("*/*"))):
        return "videos; run skelsplat detect or another detector on them first, and give what it writes"
    from skelsplat.io._kinds import damage, seems  # which imports this module

    if path.is_file() and (other := seems(path)) is not None:
        return other
    for sample in _samples(path):
        if (wrong := damage(sample)) is not None:
            return f"none that is recognised: {sample.name} is {wrong}"
        if sample.suffix.lower() in (".csv", ".json"):
            begins = head(sample).partition("\n")[0][:_BEGINNING]
            return f"none that is recognised: {sample.name} begins with {begins!r}"
    return seems(path) or "none that is recognised"


def _has_detections(folder: Path) -> bool:
    try:
        return not is_run(folder) and bool(recognised(folder))
    except DatasetError:  # it cannot be read
        return False


def _samples(path: Path) -> Iterator[Path]:
    """Yield the file; or the files of the folder, and the first of each kind in the folders beneath."""
    if path.exists() and not path.is_dir():
        with opened(path):
            yield path
        return
    folders = subfolders(path)
    suffixes = {suffix for candidate in FORMATS.values() for suffix in candidate.suffixes}
    for suffix in sorted(suffixes):
        yield from sorted(_shown(path, suffix))[:_MOST]
        for folder in folders[:_MOST]:
            files = sorted(_shown(folder, suffix))[:_ENTRIES]
            # an image with nobody may be {}, which shows no format
            yield from islice(chain((one for one in files if head(one).strip() != "{}"), files), 1)


def _shown(folder: Path, suffix: str) -> Iterator[Path]:
    """Yield the files with a suffix, but for hidden ones, as macOS puts "._name" beside each."""
    return (path for path in folder.glob(f"*{suffix}") if not path.name.startswith("."))


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


@dataclass(frozen=True)
class Matching:
    """How cameras are matched: by name, or by a stated order, and whether some may be without detections.

    What belongs to a camera of `left_out` is passed over, whether it is there or not.
    """

    names: Sequence[str]
    order: Order | None
    allow_missing: bool
    left_out: Collection[str] = ()

    def match(self, candidates: Candidates) -> dict[str, str | None]:
        """Return the label of every camera that is not left out."""
        names, left_out, advice = self.names, self.left_out, "without= leaves out cameras"
        if self.order is not None:
            return match_by_order(candidates, names, self.order, left_out=left_out, otherwise=advice)
        found = match_by_name(
            candidates, names, allow_missing=self.allow_missing, optional=left_out, otherwise=advice
        )
        return {name: label for name, label in found.items() if name not in left_out}


def open_sources(path: Path, form: DetectionFormat, matching: Matching, sequence: str | None) -> Sources:
    """Match and open the views beneath `path`."""
    if sequence is not None and not form.sequences:
        expected = f"none for the format {form.name}, whose files have one sequence"
        raise InvalidInputError(f"sequence: expected {expected}, got {sequence!r}")
    if path.is_file():
        candidates, open_one = _of_recording(path, form, sequence, ordered=matching.order is not None)
    else:
        candidates, open_one = _of_folder(path, form)
    labels = matching.match(candidates)
    views = {name: open_one(label) for name, label in labels.items() if label is not None}
    return Sources(path, candidates.kind, labels, _csv.completed(views) if form.name == "csv" else views)


def _of_recording(path: Path, form: DetectionFormat, sequence: str | None, *, ordered: bool) -> Offer:
    if form.recording is None:
        raise DatasetError(path, "path", f"a folder ({form.name} has files per camera)", "a file")
    recording = form.recording(path, sequence)
    if not recording.named and not ordered:
        places = ", ".join(recording.views)
        expected = 'the order of its views (order=: "sorted", or the place of each camera)'
        raise DatasetError(path, "cameras", expected, f"none; it has no names, only views {places}")
    return Candidates(path, "view", {label: label for label in recording.views}), recording.views.__getitem__


def _of_folder(path: Path, form: DetectionFormat) -> Offer:
    """Return the cameras' files, or their folders, with files of one frame each or with a single one."""
    folders, read_file, read_folder = subfolders(path), form.file, form.folder
    if read_file is not None and _has_files(path, folders, form):
        return _file_candidates(path, form), lambda label: read_file(path / label)
    if read_folder is not None:
        return _folder_candidates(path, folders, form), lambda label: read_folder(path / label)
    if read_file is not None and folders:
        candidates = _folder_candidates(path, folders, form)
        return candidates, lambda label: read_file(_the_file(path / label, form))
    if read_file is not None:
        expected = f"files of {form.name} ({', '.join(form.suffixes)})"
        names = sorted(file.name for file in path.iterdir() if file.is_file())
        raise DatasetError(path, "files", expected, listed(names, _NAMED) or "none")
    there = ", ".join(file.name for file in _files(path, form)) or "a folder"
    raise DatasetError(path, "path", f"the {form.name} file of all cameras itself", there)


def _file_candidates(path: Path, form: DetectionFormat) -> Candidates:
    """Return the files of a folder; one that is not recognised is still taken for a camera of its name."""
    files = _files(path, form, recognised=False)
    known = {file.name for file in _files(path, form)}
    texts = {file.name: form.camera_part(file.stem) for file in files}
    idle = texts.keys() - known if known else set()
    return Candidates(path, "file", texts, idle, within=True)


def _folder_candidates(path: Path, folders: list[Path], form: DetectionFormat) -> Candidates:
    idle = [p.name for p in folders if not any(next(_shown(p, suffix), None) for suffix in form.suffixes)]
    return Candidates(path, "folder", {folder.name: folder.name for folder in folders}, idle)


def _the_file(folder: Path, form: DetectionFormat) -> Path:
    """Return the one file in a camera's folder."""
    found = _files(folder, form) or _files(folder, form, recognised=False)
    if len(found) != 1:
        there = ", ".join(file.name for file in found) or "none"
        raise DatasetError(folder, "files", f"one {form.name} file of the camera", there)
    return found[0]


def subfolders(path: Path) -> list[Path]:
    """Folders beneath a folder, by name, without hidden ones and those that a run wrote."""
    with opening(path, "a readable folder", "folder"):
        shown = sorted(p for p in path.iterdir() if p.is_dir() and not p.name.startswith("."))
    return [folder for folder in shown if not is_run(folder)]


def _files(folder: Path, form: DetectionFormat, *, recognised: bool = True) -> list[Path]:
    """Files in a folder with the format's suffix, by name; if `recognised`, only those of the format."""
    shown = sorted(p for suffix in form.suffixes for p in _shown(folder, suffix) if p.is_file())
    return [path for path in shown if form.matches(path)] if recognised else shown


def _has_files(path: Path, folders: list[Path], form: DetectionFormat) -> bool:
    """Say whether the cameras' files lie in the folder itself, not in one of its own each."""
    beneath = any(_files(folder, form, recognised=False) for folder in folders)
    return bool(_files(path, form)) or (bool(_files(path, form, recognised=False)) and not beneath)
