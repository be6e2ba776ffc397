"""What the layouts on disk share: names of actions, the four cameras, and what a caller may choose.

In the ``camera-parameters.json`` that is passed around, p1 and p2 are exchanged relative to VideoPose3D's
list (at most 2.4 px in the images); it is read as it stands, and `skelsplat.datasets.check` says which fits
the detections.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import MOST_NAME
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import Separate, Wanted, choose_detector, detector_name
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._rig import read_quietly
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.layouts import H36M17

_NUMBER_IN_FILE_NAMES = {
    "Directions": 2,
    "Discussion": 3,
    "Eating": 4,
    "Greeting": 5,
    "Phoning": 6,
    "Photo": 12,
    "Posing": 7,
    "Purchases": 8,
    "Sitting": 9,
    "SittingDown": 10,
    "Smoking": 11,
    "Waiting": 13,
    "WalkDog": 15,
    "Walking": 14,
    "WalkTogether": 16,
}
"""Number of each action in names such as ``s_09_act_05_subact_02``."""

ACTIONS = tuple(_NUMBER_IN_FILE_NAMES)
"""In the order of the tables."""

NUMBERED = {number: action for action, number in _NUMBER_IN_FILE_NAMES.items()}

ALIASES = {"TakingPhoto": "Photo", "WalkingDog": "WalkDog", "WalkingTogether": "WalkTogether"}


def action_of(activity: str) -> str:
    """Return the action of a take: ``"TakingPhoto 1"`` → ``"Photo"``."""
    stem = re.sub(r"[\s_-]*\d*$", "", activity.strip()[:MOST_NAME])
    return ALIASES.get(stem, stem)


def spelling(activity: str) -> str:
    """Return what all spellings of a take's name have in common: ``"WalkingDog_1"`` → ``"walkdog 1"``.

    ``"Greeting 1"`` (the name of the original file) and ``"Greeting-1"`` (its number among the two takes of
    an action) stay different: they can mean different takes.
    """
    number = re.search(r"([\s_-]*)(\d+)$", activity.strip()[:MOST_NAME])
    if number is None:
        return action_of(activity).lower()
    return f"{action_of(activity).lower()}{'-' if '-' in number[1] else ' '}{number[2]}"


def order(activity: str) -> tuple[int, str]:
    """Sort key: actions in the tables' order, then by name."""
    action = action_of(activity)
    return ACTIONS.index(action) if action in ACTIONS else len(ACTIONS), spelling(activity)


def subject_order(subject: str) -> tuple[int, str]:
    """Sort key of ``"S9"`` before ``"S11"``."""
    digits = re.sub(r"\D", "", subject)
    return int(digits[:9] or 0), subject


CAMERAS = ("54138969", "55011271", "58860488", "60457274")
"""In the order of every format."""

FPS = 50.0
"""Of the videos, whose frames every format numbers."""

FILE = "camera-parameters.json"

SIZES = {name: (1000, 1002 if name in ("54138969", "60457274") else 1000) for name in CAMERAS}


def find_cameras(root: Path, given: Path | None) -> Path:
    """Return where the cameras' file is, or should be."""
    if given is not None:
        return given / FILE if given.is_dir() else given
    places = [folder / FILE for folder in (root / "cameras", root, root.parent / "cameras", root.parent)]
    return next((place for place in places if place.is_file()), places[0])


def read_rig(path: Path, subject: str) -> CameraRig:
    """Return the four cameras of ``camera-parameters.json`` as they stood for a subject, mm."""
    try:
        rig = read_quietly(path, "human36m", subject=subject)
    except InvalidInputError as error:
        raise DatasetError(path, "extrinsics", f"the subject {subject}", error) from error
    for name in CAMERAS:
        if name not in rig.names:
            raise DatasetError(
                path, f"extrinsics.{subject}.{name}", "a camera", f"only {', '.join(rig.names)}"
            )
    return CameraRig([rig[name] for name in CAMERAS], rig.unit)


@dataclass(frozen=True)
class Options:
    """The options of `skelsplat.datasets.human36m.read`, parsed.

    Attributes
    ----------
    subjects : sequence of str or None
        Default: the two that the method is tested on. None reads all.
    detector : str, optional
        Which of the detections that are there: ``"metrabs"``, ``"cpn"``, ``"resnet152"``, … Default: metrabs,
        resnet152, cpn, resnet50 or another, the first that is there.
    detections : path, optional
        Detections that are kept apart from the data: a folder ``<subject>/<activity>[/<camera>]/poses.npz``
        (or ``.json``), an npz or a JSON file. Takes without any there are left out.
    cameras : path, optional
        ``camera-parameters.json``, if it lies elsewhere.
    monocular : str, optional
        Format ``skelsplat``: the folder in ``initial_guess`` with 3D poses of monocular estimators.
    """

    subjects: Sequence[str] | None = ("S9", "S11")
    detector: str | None = None
    detections: Path | None = None
    cameras: Path | None = None
    monocular: str | None = None

    @classmethod
    def parse(cls, **given: Any) -> Options:
        """Return the options given; a text in place of several subjects is an `InvalidInputError`."""
        subjects = given.get("subjects", cls.subjects)
        if isinstance(subjects, str) or (subjects is not None and not subjects):
            raise InvalidInputError(f'subjects: expected names such as ("S9", "S11"), got {subjects!r}')
        parsers: dict[str, Callable[[Any], Any]] = {
            "detector": detector_name,
            "detections": Path,
            "cameras": Path,
        }
        known = {key: value for key, value in given.items() if value is not None or key == "subjects"}
        return cls(**{key: parsers.get(key, lambda value: value)(value) for key, value in known.items()})

    def chosen(self, path: Path, there: Iterable[str]) -> list[str]:
        """Return the subjects to read of those that are there."""
        available = sorted(set(there), key=subject_order)
        for subject in self.subjects or ():
            if subject not in available:
                raise DatasetError(path, "subjects", subject, f"only {', '.join(available) or 'none'}")
        return available if self.subjects is None else list(self.subjects)


@dataclass
class Reading:
    """A data set while it is read: its takes, and what has to be said of them."""

    takes: list[Take] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    detector: str | None = None
    origin: str = ""

    def choose(self, there: dict[str, Path], options: Options, root: Path) -> Path | None:
        """Return where the chosen detector's detections lie, and note which it is; None if there are none.

        None as well if other detections are given. Raises `DatasetError` if the wanted detector is not there.
        """
        if options.detections is not None:
            return None
        self.detector = choose_detector(there, options.detector, root)
        if self.detector is None:
            return None
        if len(there) > 1 and options.detector is None:
            self.notes.append(f"detector {self.detector} of {', '.join(sorted(there))}")
        return there[self.detector]

    def detected(self, takes: Iterable[Take], add: Callable[[Take], Take | None]) -> Iterator[Take]:
        """Give the takes with what `add` makes of them; leave out those of which it makes nothing."""
        for take in takes:
            found = add(take)
            if found is None:
                self.left_out.append(take.key)
            else:
                yield found

    def dataset(self, name: str, root: Path) -> Dataset:
        """Return the data set, takes in the order of the tables."""
        if not self.takes:
            raise DatasetError(root, "takes", "at least one", "none")
        keys = [take.key for take in self.takes]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise DatasetError(root, "takes", "each take once", f"{twice} twice")
        if self.left_out:
            self.notes.append(f"left out, without detections: {', '.join(self.left_out)}")
        takes = sorted(self.takes, key=lambda take: (subject_order(take.subject), order(activity_of(take))))
        takes = [replace(take, fps=FPS) for take in takes]
        return Dataset(name, H36M17, tuple(takes), self.detector, self._source(), tuple(self.notes))

    def _source(self) -> str:
        if self.detector is None:
            return f"{self.origin}; without detections"
        if self.detector == "gt":
            return f"{self.origin}; detections are the projected truth (oracle)"
        return f"{self.origin}; detections of {self.detector}"


def activity_of(take: Take) -> str:
    """Return the take's name without the subject."""
    return take.key.partition("/")[2]


def take_of(subject: str, activity: str, rig: CameraRig, truth: Array, files: dict[str, Path]) -> Take:
    """Return a take, frames numbered from 0; `files` says where its truth and its cameras are from."""
    frames = np.arange(len(truth))
    return Take(f"{subject}/{activity}", subject, action_of(activity), rig, frames, truth, files=files)


def wanted(take: Take) -> Wanted:
    """Return what detections of a take must fit."""
    return Wanted(take.key, take.frames, take.rig.names, H36M17)


def with_separate(takes: Iterable[Take], options: Options, reading: Reading) -> Iterator[Take]:
    """Give the takes the detections of ``Options.detections``; leave out those that have none there."""
    if options.detections is None:
        yield from takes
        return
    source = Separate(options.detections, spelling)
    reading.detector = options.detector or detector_name(options.detections.stem)

    def detected(take: Take) -> Take | None:
        found = source.read(take.subject, activity_of(take), wanted(take))
        return None if found is None else take.with_detections(*found)

    yield from reading.detected(takes, detected)
