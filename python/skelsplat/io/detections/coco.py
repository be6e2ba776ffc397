"""COCO keypoint results, and those of AlphaPose (``alphapose-results.json``): one JSON file per camera.

A list of ``{"image_id", "keypoints": [x, y, c, …], "score": s}``, one entry per person. For COCO `image_id`
is the frame number; for AlphaPose an image's name, ``"12.jpg"``, the last integer of which is the frame
number. `score` belongs to the person and is not used. An annotation file, whose third number is a visibility
0, 1 or 2, is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io._files import frame_number, head
from skelsplat.io.detections._format import Person, View, list_view
from skelsplat.io.detections._text import json_document
from skelsplat.io.detections.openpose import triples


def read_coco(path: Path) -> View:
    """Return the view of one camera from COCO's results."""
    entries = _entries(path, "COCO keypoint results", lambda image: image.index())
    third = [keypoints.value[2::3] for _, keypoints in entries if isinstance(keypoints.value, list)]
    values = [value for part in third for value in part]
    if 2 in values and all(value in (0, 1, 2) for value in values):
        actual = "visibility flags 0, 1, 2 of an annotation file"
        raise DatasetError(path, "keypoints", "confidences of a detector", actual)
    return _view(path, entries)


def read_alphapose(path: Path) -> View:
    """Return the view of one camera from AlphaPose's results."""
    return _view(path, _entries(path, "AlphaPose results", _number_in_name))


def _number_in_name(image: Field) -> int:
    digits = re.findall(r"\d+", Path(image.value).stem) if isinstance(image.value, str) else []
    if not digits:
        raise image.error("an image's name with a number, like '12.jpg'", repr(image.value)[:40])
    return frame_number(image.path, image.place, digits[-1])


def _entries(path: Path, document: str, frame_of: Callable[[Field], int]) -> list[tuple[int, Field]]:
    """Return frame number and keypoints of every person in a file."""
    expected = f"{document}, a list of people"
    entries = [
        (
            frame_of(person.member("image_id", "the image of the person")),
            person.member("keypoints", "a list of numbers x, y, confidence"),
        )
        for person in json_document(path, document).entries(expected)
    ]
    if not entries:
        raise DatasetError(path, "document", expected, "an empty list")
    return entries


def _view(path: Path, entries: list[tuple[int, Field]]) -> View:
    """Return the view; confidences above 1, maxima of heat maps, are clipped.

    An image in which nobody was found is not in the file.
    """
    people: dict[int, list[Person]] = {}
    for frame, keypoints in entries:
        people.setdefault(frame, []).append(triples(keypoints, clip=True))
    return replace(list_view(path, people), flat=True, sparse=True)


def is_coco(path: Path) -> bool:
    """Whether a file begins like COCO's results."""
    start = head(path)
    return start.startswith("[") and re.search(r'"image_id"\s*:\s*\d', start) is not None


def is_alphapose(path: Path) -> bool:
    """Whether a file begins like AlphaPose's results."""
    start = head(path)
    return start.startswith("[") and re.search(r'"image_id"\s*:\s*"', start) is not None


def cut_alphapose(stem: str) -> str:
    """Cut AlphaPose's own words off the name of a file."""
    return re.sub(r"[-_ ]*alphapose[-_ ]results", "", stem) or stem
