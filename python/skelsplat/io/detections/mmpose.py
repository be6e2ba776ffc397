"""MMPose 1.x predictions of one video: one JSON file per camera.

The demos write ``{"meta_info": {…}, "instance_info": [{"frame_id", "instances": [{"keypoints": [[x, y], …],
"keypoint_scores": […]}]}]}``, the inferencer the bare list of frames. Scores are maxima of heat maps or SimCC
and can exceed 1; they are clipped to [0, 1]. ``meta_info.keypoint_id2name`` confirms the layout.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import DetectionFormat, Person, View, joints_of, list_view
from skelsplat.io.detections._json import (
    as_index,
    as_list,
    flat_numbers,
    json_head,
    load_json,
    member,
    rows,
)

if TYPE_CHECKING:
    from pathlib import Path


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    document = load_json(path, "MMPose predictions")
    bare = isinstance(document, list)
    field = "" if bare else "instance_info"
    found = document if bare else member(path, "", document, "instance_info", "a list of frames")
    people: dict[int, list[Person]] = {}
    for index, frame in enumerate(as_list(path, field or "predictions", found, "a list of frames")):
        where = f"{field}[{index}]"
        number = as_index(path, f"{where}.frame_id", member(path, where, frame, "frame_id", "a frame number"))
        if number in people:
            raise DatasetError(path, f"{where}.frame_id", "every frame once", f"{number} again")
        people[number] = _read_frame(path, where, frame)
    if not people:
        raise DatasetError(path, field or "predictions", "a list of frames", "an empty list")
    return replace(list_view(path, people), joints=None if bare else _names(path, document), own_order=True)


def _read_frame(path: Path, where: str, frame: Any) -> list[Person]:
    found = member(path, where, frame, "instances", "a list of people")
    people = as_list(path, f"{where}.instances", found, "a list of people")
    return [_read_person(path, f"{where}.instances[{i}]", person) for i, person in enumerate(people)]


def _read_person(path: Path, where: str, person: Any) -> Person:
    field = f"{where}.keypoints"
    xy = rows(path, field, member(path, where, person, "keypoints", "a list of [x, y]"), 2)
    found = member(path, where, person, "keypoint_scores", "a list of numbers")
    scores = flat_numbers(path, f"{where}.keypoint_scores", found)
    if len(scores) != len(xy) or not len(xy):
        expected = f"{max(len(xy), 1)} numbers, one per keypoint"
        raise DatasetError(
            path, f"{where}.keypoint_scores", expected, f"{len(scores)} for {len(xy)} keypoints"
        )
    return Person(path, field, joints_of(path, field, xy, scores, clip=True))


def _names(path: Path, document: Any) -> tuple[str, ...] | None:
    """Return the names of the joints, if the file has them all."""
    field = "meta_info.keypoint_id2name"
    meta = document.get("meta_info")
    table = meta.get("keypoint_id2name") if isinstance(meta, dict) else None
    if not isinstance(table, dict) or not table:
        return None
    names = [table.get(str(place)) for place in range(len(table))]
    if not all(isinstance(name, str) for name in names):
        raise DatasetError(path, field, f"a name for each of 0 to {len(table) - 1}", ", ".join(table))
    return tuple(str(name) for name in names)


def _matches(path: Path) -> bool:
    head = json_head(path)
    return (
        '"instance_info"' in head
        or '"keypoint_id2name"' in head
        or (head.startswith("[") and '"frame_id"' in head and '"instances"' in head)
    )


FORMAT = DetectionFormat(name="mmpose", suffixes=(".json",), matches=_matches, file=read_file)
