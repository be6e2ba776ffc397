"""COCO keypoint results: one JSON file per camera.

A list of ``{"image_id": 12, "category_id": 1, "keypoints": [x, y, c, …], "score": s}``, one entry per person;
`image_id` is the frame number. An annotation file, whose third number is a visibility 0, 1 or 2, is refused.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import DetectionFormat, View
from skelsplat.io.detections._json import as_index, json_head
from skelsplat.io.detections._results import Entry, read_entries, view_of

if TYPE_CHECKING:
    from pathlib import Path


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    entries = read_entries(path, "COCO keypoint results", as_index)
    _refuse_visibility(path, entries)
    return view_of(path, entries)


def _refuse_visibility(path: Path, entries: list[Entry]) -> None:
    """Raise if all third numbers are 0, 1 or 2 and one is 2: an annotator's flags, not confidences."""
    third = [entry.keypoints[2::3] if isinstance(entry.keypoints, list) else [] for entry in entries]
    values = [value for part in third for value in part]
    if 2 in values and all(value in (0, 1, 2) for value in values):
        expected = "confidences of a detector"
        raise DatasetError(path, "keypoints", expected, "visibility flags 0, 1, 2 of an annotation file")


def _matches(path: Path) -> bool:
    head = json_head(path)
    return head.startswith("[") and re.search(r'"image_id"\s*:\s*\d', head) is not None


FORMAT = DetectionFormat(name="coco", suffixes=(".json",), matches=_matches, file=read_file)
