"""AlphaPose results (``alphapose-results.json``): one JSON file per camera.

A list of ``{"image_id": "12.jpg", "keypoints": [x, y, c, …], "score": s}``, one entry per person. The frame
number is the last integer in the image's name. `score` belongs to the person and is not used.
"""

from __future__ import annotations

import re
from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number
from skelsplat.io.detections._format import DetectionFormat, View
from skelsplat.io.detections._json import json_head
from skelsplat.io.detections._results import read_entries, view_of


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    return view_of(path, read_entries(path, "AlphaPose results", _frame))


def _frame(path: Path, field: str, image: object) -> int:
    digits = re.findall(r"\d+", Path(image).stem) if isinstance(image, str) else []
    if not digits:
        raise DatasetError(path, field, "an image's name with a number, like '12.jpg'", repr(image)[:40])
    return frame_number(path, field, digits[-1])


def _matches(path: Path) -> bool:
    head = json_head(path)
    return head.startswith("[") and re.search(r'"image_id"\s*:\s*"', head) is not None


FORMAT = DetectionFormat(
    name="alphapose",
    suffixes=(".json",),
    matches=_matches,
    file=read_file,
    camera_part=lambda stem: re.sub(r"[-_ ]*alphapose[-_ ]results", "", stem) or stem,
)
