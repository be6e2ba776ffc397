"""OpenPose folders: one folder per camera, one JSON file per frame.

``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``, pixels of the original image; x = y = c = 0 marks a
joint that was not detected. A score is the peak of a map and may lie above 1, where it counts as 1. The frame
number is the last integer in the file's name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import DetectionFormat, Person, View, joints_of
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._json import flat_numbers, json_head, load_json

if TYPE_CHECKING:
    from pathlib import Path

_FIELD = "pose_keypoints_2d"
# more than any map's peak: a pixel in the place of a score
_NO_SCORE = 100.0


def read_folder(folder: Path) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    files = frame_files(folder, "*.json", "one JSON file per frame")
    return View(folder, list(files), lambda number: _read_frame(files[number]), flat=True)


def _read_frame(path: Path) -> list[Person]:
    return [_read_person(path, index, person) for index, person in enumerate(_people(path))]


def _people(path: Path) -> list[Any]:
    document = load_json(path, "an OpenPose document")
    if not isinstance(document, dict) or "people" not in document:
        raise DatasetError(path, "people", "an object with a list under this key", type(document).__name__)
    people = document["people"]
    if not isinstance(people, list):
        raise DatasetError(path, "people", "a list", type(people).__name__)
    return people


def _read_person(path: Path, index: int, person: object) -> Person:
    field = f"people[{index}].{_FIELD}"
    if not isinstance(person, dict) or _FIELD not in person:
        raise DatasetError(path, field, "a list of numbers x, y, confidence", "nothing (the key is missing)")
    return triples(path, field, person[_FIELD], clip=False)


def triples(path: Path, field: str, value: object, *, clip: bool) -> Person:
    """Return a person from a flat list x, y, confidence, …; other formats write it as well.

    Scores above 1 count as 1. With `clip` anything outside [0, 1] does as well, or as missing; otherwise what
    cannot be a score is an error.
    """
    flat = flat_numbers(path, field, value)
    if flat.size % 3 or not flat.size:
        raise DatasetError(path, field, "three numbers per joint", f"{flat.size} numbers")
    joints = flat.reshape(-1, 3)
    wrong = ((joints[:, 2] < 0.0) | (joints[:, 2] >= _NO_SCORE)) & np.isfinite(joints[:, :2]).all(axis=1)
    if wrong.any() and not clip:
        place = 3 * int(wrong.argmax()) + 2
        raise DatasetError(path, f"{field}[{place}]", "a confidence, 0 to 1", f"{flat[place]:g}")
    return Person(path, field, joints_of(path, field, joints[:, :2], joints[:, 2], clip=True))


FORMAT = DetectionFormat(
    name="openpose",
    suffixes=(".json",),
    matches=lambda path: json_head(path).startswith("{") and '"people"' in json_head(path),
    folder=read_folder,
)
