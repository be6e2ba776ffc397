"""OpenPose folders: one folder per camera, one JSON file per frame.

``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``, pixels of the original image; x = y = c = 0 marks a
joint that was not detected. A score is the peak of a map and may lie above 1, where it counts as 1. The frame
number is the last integer in the file's name.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skelsplat.io._fields import Field
from skelsplat.io._files import head
from skelsplat.io.detections._format import Person, View, joints_of
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._text import json_document

_FIELD = "pose_keypoints_2d"
# more than any map's peak: a pixel in the place of a score
_NO_SCORE = 100.0


def read_folder(folder: Path) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    files = frame_files(folder, "*.json", "one JSON file per frame")
    return View(folder, list(files), lambda number: _read_frame(files[number]), flat=True)


def _read_frame(path: Path) -> list[Person]:
    document = json_document(path, "an OpenPose document")
    people = document["people"]
    if "people" not in document:
        raise people.error("an object with a list under this key", type(document.value).__name__)
    return [_read_person(person) for person in people.entries("a list")]


def _read_person(person: Field) -> Person:
    if _FIELD not in person:
        actual = "nothing (the key is missing)"
        raise person[_FIELD].error("a list of numbers x, y, confidence", actual)
    return triples(person[_FIELD], clip=False)


def triples(keypoints: Field, *, clip: bool) -> Person:
    """Return a person from a flat list x, y, confidence, …; other formats write it as well.

    Scores above 1 count as 1. With `clip` anything outside [0, 1] does as well, or as missing; otherwise what
    cannot be a score is an error.
    """
    flat = keypoints.row()
    if flat.size % 3 or not flat.size:
        raise keypoints.error("three numbers per joint", f"{flat.size} numbers")
    joints = flat.reshape(-1, 3)
    wrong = ((joints[:, 2] < 0.0) | (joints[:, 2] >= _NO_SCORE)) & np.isfinite(joints[:, :2]).all(axis=1)
    if wrong.any() and not clip:
        place = 3 * int(wrong.argmax()) + 2
        score = keypoints.entries("a list")[place]
        raise score.error("a confidence, 0 to 1", f"{flat[place]:g}")
    where = keypoints.path, keypoints.place
    return Person(*where, joints_of(*where, joints[:, :2], joints[:, 2], clip=True))


def matches(path: Path) -> bool:
    """Whether a file begins like a frame of OpenPose."""
    start = head(path)
    return start.startswith("{") and '"people"' in start
