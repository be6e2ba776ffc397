"""EasyMocap annotations: one folder per camera beneath ``annots``, one JSON file per frame.

``{"filename", "height", "width", "annots": [{"personID", "bbox", "keypoints": [[x, y, c], …]}]}``; older
files are the bare list. A confidence of 0 or below marks a joint that was not detected. The frame number is
the last integer in the file's name. Hands and faces are separate keys and are left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import DetectionFormat, Person, View, joints_of
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._json import as_list, json_head, load_json, member, rows

if TYPE_CHECKING:
    from pathlib import Path


def read_folder(folder: Path) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    files = frame_files(folder, "*.json", "one JSON file per frame")
    return View(folder, list(files), lambda number: _read_frame(files[number]))


def _read_frame(path: Path) -> list[Person]:
    document = load_json(path, "an EasyMocap annotation")
    found = (
        document if isinstance(document, list) else member(path, "", document, "annots", "a list of people")
    )
    people = as_list(path, "annots", found, "a list of people")
    return [_read_person(path, f"annots[{index}]", person) for index, person in enumerate(people)]


def _read_person(path: Path, field: str, person: object) -> Person:
    key = "keypoints2d" if isinstance(person, dict) and "keypoints2d" in person else "keypoints"
    value = member(path, field, person, key, "a list of [x, y, confidence]")
    joints = rows(path, f"{field}.{key}", value, 3)
    if not len(joints):
        raise DatasetError(path, f"{field}.{key}", "one [x, y, confidence] per joint", "an empty list")
    confidence = np.maximum(joints[:, 2], 0.0)
    return Person(
        path, f"{field}.{key}", joints_of(path, f"{field}.{key}", joints[:, :2], confidence, clip=False)
    )


def _matches(path: Path) -> bool:
    head = json_head(path)
    bare = head.startswith("[") and ('"personID"' in head or '"keypoints2d"' in head)
    return '"annots"' in head or bare


FORMAT = DetectionFormat(name="easymocap", suffixes=(".json",), matches=_matches, folder=read_folder)
