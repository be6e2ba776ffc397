"""EasyMocap annotations: one folder per camera beneath ``annots``, one JSON file per frame.

``{"filename", "height", "width", "annots": [{"personID", "bbox", "keypoints": [[x, y, c], …]}]}``; older
files are the bare list. A confidence of 0 or below marks a joint that was not detected. The frame number is
the last integer in the file's name. Hands and faces are separate keys and are left out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skelsplat.io._fields import Field
from skelsplat.io._files import head
from skelsplat.io.detections._format import Person, View, joints_of
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._text import json_document

_LIST = "a list of people"


def read_folder(folder: Path) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    files = frame_files(folder, "*.json", "one JSON file per frame")
    return View(folder, list(files), lambda number: _read_frame(files[number]))


def _read_frame(path: Path) -> list[Person]:
    document = json_document(path, "an EasyMocap annotation")
    people = document if isinstance(document.value, list) else document.member("annots", _LIST)
    return [_read_person(person) for person in people.entries(_LIST)]


def _read_person(person: Field) -> Person:
    key = "keypoints2d" if "keypoints2d" in person else "keypoints"
    keypoints = person.member(key, "a list of [x, y, confidence]")
    joints = keypoints.rows(3)
    if not len(joints):
        raise keypoints.error("one [x, y, confidence] per joint", "an empty list")
    where = person.path, keypoints.place
    return Person(*where, joints_of(*where, joints[:, :2], np.maximum(joints[:, 2], 0.0), clip=False))


def matches(path: Path) -> bool:
    """Whether a file begins like an annotation."""
    start = head(path)
    bare = start.startswith("[") and ('"personID"' in start or '"keypoints2d"' in start)
    return '"annots"' in start or bare
