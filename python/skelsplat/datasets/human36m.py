"""Human3.6M (Ionescu et al. 2014) in the layouts in which it is passed around; 17 joints, four cameras, mm.

- Format ``"skelsplat"``, of the method's authors: ``3d_gt/<subject>/<activity>/poses.npz``,
  ``2d_<detector>/<subject>/<activity>[/<camera>]/poses.npz``, and monocular poses in
  ``initial_guess/<name>/<subject>/<activity>[/<camera>]/poses.npz`` or beside the detections. Activities have
  the names of the original files, such as "SittingDown 1".
- Format ``"videopose3d"``: ``data_3d_h36m.npz``, ``positions_3d`` [subject][activity] (T, 32, 3), **metres**;
  ``data_2d_h36m_<detector>.npz``, ``positions_2d`` [subject][activity] a list of one (T, 17, 2) per camera.
  S11 "Directions" is not in it. Detections may run on after the truth has ended; the rest is cut off, as
  VideoPose3D does.

Both need ``camera-parameters.json``, in which p1 and p2 are exchanged relative to VideoPose3D's list (at most
2.4 px in the images); it is read as it stands, and `skelsplat.datasets.check` says which fits the detections.

Human3.6M-Occ is Human3.6M with objects pasted over the person in two or three of the four views: the authors'
layout, one folder per variant, ``…occ-2``, ``…occ-3``, ``…occ-3-hard``, whose name goes under the tables.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import MOST_NAME
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import (
    KEY_WORLD,
    Wanted,
    as_detections,
    choose_detector,
    detector_name,
    detectors_of,
    poses_file,
    read_truth,
    read_world,
    with_detections,
)
from skelsplat.datasets._files import Survey, making, read_cameras
from skelsplat.datasets._model import Dataset, Take
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._arrays import npz_fields
from skelsplat.layouts import H36M17

ACTIONS = (
    "Directions",
    "Discussion",
    "Eating",
    "Greeting",
    "Phoning",
    "Photo",
    "Posing",
    "Purchases",
    "Sitting",
    "SittingDown",
    "Smoking",
    "Waiting",
    "WalkDog",
    "Walking",
    "WalkTogether",
)
"""In the order of the tables."""

ALIASES = {"TakingPhoto": "Photo", "WalkingDog": "WalkDog", "WalkingTogether": "WalkTogether"}
SUBJECTS = ("S9", "S11")  # those that the method is tested on
CAMERAS = ("54138969", "55011271", "58860488", "60457274")  # in the order of every format
# Place of each h36m17 joint among the 32 of the motion capture.
JOINTS_OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)
_FPS = 50.0  # of the videos, whose frames every format numbers
_MM_PER_M = 1000.0
_FORMATS = {"skelsplat": "3d_gt", "videopose3d": "data_3d_h36m.npz"}  # and what a folder has in it


def _read(
    name: str,
    title: str,
    root: Path,
    survey: Survey,
    *,
    format: str | None = None,
    subjects: Sequence[str] | None = SUBJECTS,
    detector: str | None = None,
    detections: Path | str | None = None,
    cameras: Path | str | None = None,
    monocular: str | None = None,
) -> Dataset:
    """Read the data set, takes in the order of the tables.

    `subjects` None is all of them; `cameras` is the file ``camera-parameters.json``, if it lies elsewhere.
    """
    if isinstance(subjects, str) or (subjects is not None and not subjects):
        raise InvalidInputError(f'subjects: expected names such as ("S9", "S11"), got {subjects!r}')
    survey.format, place = _find_format(root, format)
    usual = (place / "cameras", place, place.parent / "cameras", place.parent)
    files = [folder / "camera-parameters.json" for folder in usual] if cameras is None else [Path(cameras)]
    rig_of = partial(_rig, survey.find(files, "cameras"))
    takes_of = _authors_takes if survey.format == "skelsplat" else _videopose3d_takes
    takes = list(takes_of(place, survey, subjects, rig_of))
    chosen, add = _detections(place, survey, detector, detections)
    if add is not None:
        takes = [add(take) for take in takes]
        left_out = [take.key for take in takes if take.detections is None]
        takes = [take for take in takes if take.detections is not None]
        survey.notes += [f"left out, without detections: {', '.join(left_out)}"] if left_out else []
    if monocular is not None:
        takes = [_with_guess(survey, place / "initial_guess" / monocular, take) for take in takes]
    if not takes:
        raise DatasetError(place, "takes", "at least one", "none")
    words = f"detections of {chosen}" if chosen else "without detections"
    source = f"{title}, {place.resolve().name}, {survey.format} layout; {words}"
    return Dataset(name, H36M17, tuple(sorted(takes, key=order_of)), chosen, source, tuple(survey.notes))


read = partial(_read, "human36m", "Human3.6M")
read_occluded = partial(_read, "human36m-occ", "Human3.6M-Occ")


def _find_format(root: Path, format: str | None) -> tuple[str, Path]:
    """Return the layout on disk, and the folder that it begins at; refuse none, or several."""
    one_of("format", format, (None, *_FORMATS))
    wanted = _FORMATS if format is None else {format: _FORMATS[format]}
    found = []
    for name, has in wanted.items():
        places = [root] if (root / has).exists() else _folders(root)
        found += [(name, place) for place in places if (place / has).exists()]
    if len(found) != 1:
        expected = " or ".join(f"{has} (format {name})" for name, has in wanted.items())
        got = ", ".join(f"{name} at {place}" for name, place in found) or "none of these"
        raise DatasetError(root, "format", f"{expected}, once", got)
    return found[0]


def _folders(path: Path) -> list[Path]:
    return sorted(entry for entry in path.iterdir() if entry.is_dir()) if path.is_dir() else []


def action_of(activity: str) -> str:
    """Return the action of a take: ``"TakingPhoto 1"`` → ``"Photo"``."""
    stem = re.sub(r"[\s_-]*\d*$", "", activity.strip()[:MOST_NAME])
    return ALIASES.get(stem, stem)


def order_of(take: Take) -> tuple[int, str, int, str]:
    """Sort key: S9 before S11, then actions in the tables' order, then by name."""
    digits = re.sub(r"\D", "", take.subject)
    action = ACTIONS.index(take.action) if take.action in ACTIONS else len(ACTIONS)
    return int(digits[:9] or 0), take.subject, action, take.key


def subjects_of(path: Path, there: Iterable[str], subjects: Sequence[str] | None) -> list[str]:
    """Return the subjects to read of those that are there."""
    available = sorted(set(there))
    for subject in subjects or ():
        if subject not in available:
            raise DatasetError(path, "subjects", subject, f"only {', '.join(available) or 'none'}")
    return available if subjects is None else list(subjects)


RigOf = Callable[[str], tuple[CameraRig, Path]]


def _rig(path: Path, subject: str) -> tuple[CameraRig, Path]:
    """Return the four cameras as they stood for a subject, mm, and the file."""
    with making(path, "extrinsics", f"the subject {subject}"):
        return read_cameras(path, "human36m", CAMERAS, subject=subject), path


def _take(subject: str, activity: str, rig: CameraRig, truth: Array, files: Mapping[str, Path]) -> Take:
    frames = np.arange(len(truth))
    key, action = f"{subject}/{activity}", action_of(activity)
    return Take(key, subject, action, rig, frames, truth, fps=_FPS, files=files)


def _authors_takes(
    root: Path, survey: Survey, subjects: Sequence[str] | None, rig_of: RigOf
) -> Iterator[Take]:
    folder = root / _FORMATS["skelsplat"]
    for subject in subjects_of(folder, (path.name for path in _folders(folder)), subjects):
        rig, cameras = rig_of(subject)
        for activity in _folders(folder / subject):
            truth, joints, _ = read_truth(survey, activity, H36M17.n_joints)
            yield _take(subject, activity.name, rig, joints, {"truth": truth.path, "cameras": cameras})


def _videopose3d_takes(
    root: Path, survey: Survey, subjects: Sequence[str] | None, rig_of: RigOf
) -> Iterator[Take]:
    path = survey.find([root / _FORMATS["videopose3d"]], "truth")
    positions = npz_fields(path, ("positions_3d",))["positions_3d"].members()
    for subject in subjects_of(path, map(str, positions), subjects):
        rig, cameras = rig_of(subject)
        for activity, value in positions[subject].members().items():
            truth = value.array_of("frames", "joints", 3)
            if truth.shape[1] == 32:
                truth = truth[:, list(JOINTS_OF_32)]
            if truth.shape[1] != H36M17.n_joints:
                raise value.error("32 joints, or 17 of h36m17", truth.shape[1])
            yield _take(subject, activity, rig, _MM_PER_M * truth, {"truth": path, "cameras": cameras})


def _detections(
    root: Path, survey: Survey, detector: str | None, given: Path | str | None
) -> tuple[str | None, Callable[[Take], Take] | None]:
    """Return the detector, and what gives a take its detections if there are any for it."""
    if given is not None:
        path = survey.find([Path(given)], "folder of detections")
        return detector_name(detector or path.stem), partial(_from_folder, survey, path)
    if survey.format == "skelsplat":
        there, usual = detectors_of(root), root / "2d_metrabs"
    else:
        archives = sorted(root.glob("data_2d_h36m_*.npz"))
        there, usual = {detector_name(one.stem): one for one in archives}, root / "data_2d_h36m_cpn.npz"
    name = choose_detector(survey, there, detector, usual)
    if name is None:
        return None, None
    if len(there) > 1 and detector is None:
        survey.notes.append(f"detector {name} of {', '.join(sorted(there))}")
    if survey.format == "skelsplat":
        return name, partial(_from_folder, survey, there[name])
    return name, _from_archive(survey, there[name])


def _from_folder(survey: Survey, root: Path, take: Take) -> Take:
    """Give a take its detections in ``<subject>/<activity>``, and the monocular poses beside them."""
    folder = root / take.key
    if not folder.is_dir():
        return take
    found = with_detections(survey, take, H36M17, folder)
    files = [poses_file(folder / name) for name in take.rig.names]
    poses = [npz_fields(path) for path in files if path is not None]
    if not all(files) or not all(KEY_WORLD in content for content in poses):
        return found
    views = [content[KEY_WORLD].array_of(len(found), H36M17.n_joints, 3) for content in poses]
    return replace(found, monocular=np.stack(views, axis=1))


def _from_archive(survey: Survey, path: Path) -> Callable[[Take], Take]:
    """Return what gives a take its detections in ``data_2d_h36m_<detector>.npz``, one array per camera."""
    positions = npz_fields(survey.found(path), ("positions_2d",))["positions_2d"]

    def add(take: Take) -> Take:
        views = positions[take.subject].members().get(take.key.partition("/")[2])
        if views is None:
            return take
        given, parts = views.entries(), []
        if len(given) != len(CAMERAS):
            raise views.error(f"{len(CAMERAS)} cameras ({', '.join(CAMERAS)})", len(given))
        for name, view in zip(CAMERAS, given, strict=True):
            at = replace(view, place=f"{views.place}, camera {name}")
            pixels = at.array_of("frames", "joints", 2)
            note = f"{path.name}: views cut where the truth ends"
            if len(pixels) > len(take) and note not in survey.notes:
                survey.notes.append(note)
            one = replace(at, value=pixels[: len(take), None])
            parts.append(as_detections(one, Wanted(take.key, take.frames, (name,), H36M17)))
        return take.with_detections(np.concatenate(parts, axis=1), path)

    return add


def _with_guess(survey: Survey, root: Path, take: Take) -> Take:
    """Add ``initial_guess/<name>``: one pose per view, or one in all that is fused already."""
    folder = root / take.key
    poses = read_world(survey, folder, take, len(take), f"poses {root.name!r} of {take.key}")
    return replace(take, monocular=poses, files={**take.files, "monocular": folder})
