"""What the layouts on disk share: names of actions, the four cameras, and what a caller may choose.

In the ``camera-parameters.json`` that is passed around, p1 and p2 are exchanged relative to VideoPose3D's
list (at most 2.4 px in the images); it is read as it stands, and `skelsplat.datasets.check` says which fits
the detections.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import MOST_NAME
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, making, read_cameras
from skelsplat.datasets._model import Take
from skelsplat.exceptions import DatasetError, InvalidInputError

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

SUBJECTS = ("S9", "S11")
"""Those that the method is tested on."""

CAMERAS = ("54138969", "55011271", "58860488", "60457274")
"""In the order of every format."""

SIZES = {name: (1000, 1002 if name in ("54138969", "60457274") else 1000) for name in CAMERAS}

FPS = 50.0
"""Of the videos, whose frames every format numbers."""

FILE = "camera-parameters.json"


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
    ending = "" if number is None else f"{'-' if '-' in number[1] else ' '}{number[2]}"
    return action_of(activity).lower() + ending


def take_order(take: Take) -> tuple[int, str, int, str]:
    """Sort key: S9 before S11, then actions in the tables' order, then by name."""
    digits = re.sub(r"\D", "", take.subject)
    action = ACTIONS.index(take.action) if take.action in ACTIONS else len(ACTIONS)
    return int(digits[:9] or 0), take.subject, action, spelling(activity_of(take))


def activity_of(take: Take) -> str:
    """Return the take's name without the subject."""
    return take.key.partition("/")[2]


def take_of(subject: str, activity: str, rig: CameraRig, truth: Array, files: dict[str, Path]) -> Take:
    """Return a take, frames numbered from 0; `files` says where its truth and its cameras are from."""
    frames = np.arange(len(truth))
    return Take(f"{subject}/{activity}", subject, action_of(activity), rig, frames, truth, files=files)


@dataclass(frozen=True)
class Options:
    """The options of `skelsplat.datasets.human36m.read` but for the format."""

    subjects: Sequence[str] | None
    detector: str | None
    detections: Path | str | None
    cameras: Path | str | None
    monocular: str | None

    def __post_init__(self) -> None:
        if isinstance(self.subjects, str) or (self.subjects is not None and not self.subjects):
            raise InvalidInputError(f'subjects: expected names such as ("S9", "S11"), got {self.subjects!r}')

    def chosen(self, path: Path, there: Iterable[str]) -> list[str]:
        """Return the subjects to read of those that are there."""
        available = sorted(set(there))
        for subject in self.subjects or ():
            if subject not in available:
                raise DatasetError(path, "subjects", subject, f"only {', '.join(available) or 'none'}")
        return available if self.subjects is None else list(self.subjects)

    def find_cameras(self, survey: Survey, root: Path) -> Path:
        """Return the file of the cameras."""
        given = None if self.cameras is None else Path(self.cameras)
        if given is not None:
            return survey.find([given / FILE if given.is_dir() else given], "cameras")
        folders = (root / "cameras", root, root.parent / "cameras", root.parent)
        return survey.find([folder / FILE for folder in folders], "cameras")


def read_rig(path: Path, subject: str) -> CameraRig:
    """Return the four cameras of ``camera-parameters.json`` as they stood for a subject, mm."""
    with making(path, "extrinsics", f"the subject {subject}"):
        return read_cameras(path, "human36m", CAMERAS, subject=subject)
