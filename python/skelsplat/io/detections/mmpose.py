"""MMPose 1.x predictions of one video: one JSON file per camera.

The demos write ``{"meta_info": {…}, "instance_info": [{"frame_id", "instances": [{"keypoints": [[x, y], …],
"keypoint_scores": […]}]}]}``, the inferencer the bare list of frames. Scores are maxima of heat maps or SimCC
and can exceed 1; they are clipped to [0, 1]. ``meta_info.keypoint_id2name`` confirms the layout.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from skelsplat.io._fields import Field
from skelsplat.io._files import head
from skelsplat.io.detections._format import Person, View, joints_of, list_view
from skelsplat.io.detections._text import json_document

_LIST = "a list of frames"


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    document = json_document(path, "MMPose predictions")
    bare = isinstance(document.value, list)
    found = document if bare else document.member("instance_info", _LIST)
    people: dict[int, list[Person]] = {}
    for frame in found.entries(_LIST):
        number = frame.member("frame_id", "a frame number").index()
        if number in people:
            raise frame["frame_id"].error("every frame once", f"{number} again")
        instances = frame.member("instances", "a list of people").entries("a list of people")
        people[number] = [_read_person(person) for person in instances]
    if not people:
        raise found.error(_LIST, "an empty list")
    names = None if bare else _names(document["meta_info"]["keypoint_id2name"])
    return replace(list_view(path, people), joints=names, own_order=True)


def _read_person(person: Field) -> Person:
    keypoints = person.member("keypoints", "a list of [x, y]")
    xy = keypoints.rows(2)
    found = person.member("keypoint_scores", "a list of numbers")
    scores = found.row()
    if len(scores) != len(xy) or not len(xy):
        expected = f"{max(len(xy), 1)} numbers, one per keypoint"
        raise found.error(expected, f"{len(scores)} for {len(xy)} keypoints")
    where = person.path, keypoints.place
    return Person(*where, joints_of(*where, xy, scores, clip=True))


def _names(table: Field) -> tuple[str, ...] | None:
    """Return the names of the joints, if the file has them."""
    if not isinstance(table.value, dict) or not table.value:
        return None
    names = [table.value.get(str(place)) for place in range(len(table.value))]
    if not all(isinstance(name, str) for name in names):
        raise table.error(f"a name for each of 0 to {len(names) - 1}", ", ".join(table.value))
    return tuple(str(name) for name in names)


def matches(path: Path) -> bool:
    """Whether a file begins like MMPose's predictions."""
    start = head(path)
    bare = start.startswith("[") and '"frame_id"' in start and '"instances"' in start
    return '"instance_info"' in start or '"keypoint_id2name"' in start or bare
