"""Detections in JSON: OpenPose, EasyMocap (one file per frame), COCO, AlphaPose, MMPose (one per camera)."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._fields import Field, whole_size
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number, head, load_json
from skelsplat.io.detections._format import DetectionFormat, Person, View, joints_of, list_view
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._record import with_record

# more than any map's peak: a pixel in the place of a score
_NO_SCORE = 100.0
_NO_FILES = "; without= leaves out a camera that has no detections"


def _document(path: Path, document: str) -> Field:
    return Field(path, "", load_json(path, document))


def _frame_view(
    folder: Path,
    people: Callable[[Path], list[Person]],
    size: Callable[[Path], tuple[int, int] | None] = lambda _: None,
    *,
    flat: bool = False,
) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    files = frame_files(folder, "*.json", "one JSON file per frame", _NO_FILES)
    first = next(iter(files.values()))
    return View(folder, list(files), lambda number: people(files[number]), flat=flat, size=size(first))


def read_openpose(folder: Path) -> View:
    """Return the view of one camera from OpenPose's files.

    ``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``, pixels of the original image; x = y = c = 0 marks a
    joint that was not detected. A score is the peak of a map and may lie above 1, where it counts as 1. A
    person ``{}``, or one with an empty list or null, as other programs write them, is nobody in that place,
    and a document ``{}`` is an image with nobody. The frame number is the last integer in the file's name.
    Joints, frame rate and the images' size are those that ``skelsplat detect`` states.
    """
    return with_record(_frame_view(folder, _openpose_people, flat=True))


def _openpose_people(path: Path) -> list[Person]:
    document = _document(path, "an OpenPose document")
    if document.value == {}:
        return []
    people = document.member("people", "an object with a list under this key")
    return [_openpose_person(person) for person in people.entries("a list")]


def _openpose_person(person: Field) -> Person:
    keypoints = person["pose_keypoints_2d"]
    if keypoints.value in ([], None) or _is_empty(person.value):
        return Person(keypoints.path, keypoints.place, np.empty((0, 3)))
    return _triples(keypoints, clip=False)


def _is_empty(person: object) -> bool:
    """Say whether an object holds nothing but an identity: joints may have another program's name."""
    return isinstance(person, dict) and not any(value for key, value in person.items() if key != "person_id")


def _triples(keypoints: Field, *, clip: bool) -> Person:
    """Return a person from a flat list x, y, confidence, ….

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


def is_openpose(path: Path) -> bool:
    """Whether a file begins like a frame of OpenPose."""
    start = head(path)
    return start.startswith("{") and '"people"' in start


def read_easymocap(folder: Path) -> View:
    """Return the view of one camera from EasyMocap's annotations, a folder beneath ``annots``.

    ``{"filename", "height", "width", "annots": [{"personID", "bbox", "keypoints": [[x, y, c], …]}]}``; older
    files are the bare list. A confidence of 0 or below marks a joint that was not detected. The frame number
    is the last integer in the file's name. Hands and faces are separate keys and are left out. The size of
    the images is that of the first frame.
    """
    return _frame_view(folder, _easymocap_people, _easymocap_size)


def _easymocap_size(path: Path) -> tuple[int, int] | None:
    with suppress(DatasetError):  # older files, or a broken one, which is an error when it is read
        document = _document(path, "an EasyMocap annotation")
        return whole_size(document["width"].number(), document["height"].number())
    return None


def _easymocap_people(path: Path) -> list[Person]:
    document, expected = _document(path, "an EasyMocap annotation"), "a list of people"
    people = document if isinstance(document.value, list) else document.member("annots", expected)
    return [_easymocap_person(person) for person in people.entries(expected)]


def _easymocap_person(person: Field) -> Person:
    key = "keypoints2d" if "keypoints2d" in person else "keypoints"
    keypoints = person.member(key, "a list of [x, y, confidence]")
    joints = keypoints.rows(3)
    if not len(joints):
        raise keypoints.error("one [x, y, confidence] per joint", "an empty list")
    where = person.path, keypoints.place
    return Person(*where, joints_of(*where, joints[:, :2], np.maximum(joints[:, 2], 0.0), clip=False))


def is_easymocap(path: Path) -> bool:
    """Whether a file begins like an annotation of EasyMocap."""
    start = head(path)
    bare = start.startswith("[") and ('"personID"' in start or '"keypoints2d"' in start)
    return '"annots"' in start or bare


def read_coco(path: Path) -> View:
    """Return the view of one camera from COCO's keypoint results.

    A list of ``{"image_id", "keypoints": [x, y, c, …], "score": s}``, one entry per person; `image_id` is the
    frame number. `score` belongs to the person and is not used. An annotation file, whose third number is a
    visibility 0, 1 or 2, is refused, and so are results with several skeletons (`category_id`).
    """
    entries = _results(path, "COCO keypoint results", lambda image: image.index())
    third = [keypoints.value[2::3] for _, keypoints in entries if isinstance(keypoints.value, list)]
    values = [value for part in third for value in part]
    if 2 in values and all(value in (0, 1, 2) for value in values):
        actual = "visibility flags 0, 1, 2 of an annotation file"
        raise DatasetError(path, "keypoints", "confidences of a detector", actual)
    return _results_view(path, entries)


def read_alphapose(path: Path) -> View:
    """Return the view of one camera from AlphaPose's results, ``alphapose-results.json``.

    They are those of COCO, but `image_id` is an image's name, ``"12.jpg"``, whose last integer is the frame
    number.
    """
    images: dict[int, str] = {}

    def number(image: Field) -> int:
        found = _number_in_name(image)
        if images.setdefault(found, image.value) != image.value:
            expected = f"one image for frame {found} (the last integer in its name), here {images[found]!r}"
            raise image.error(expected, repr(image.value)[:80])
        return found

    return _results_view(path, _results(path, "AlphaPose results", number))


def _number_in_name(image: Field) -> int:
    digits = re.findall(r"\d+", Path(image.value).stem) if isinstance(image.value, str) else []
    if not digits:
        raise image.error("an image's name with a number, like '12.jpg'", repr(image.value)[:40])
    return frame_number(image.path, image.place, digits[-1])


def _results(path: Path, document: str, frame_of: Callable[[Field], int]) -> list[tuple[int, Field]]:
    """Return frame number and keypoints of every person in a file."""
    expected = f"{document}, a list of people"
    people = _document(path, document).entries(expected)
    entries = [
        (
            frame_of(person.member("image_id", "the image of the person")),
            person.member("keypoints", "a list of numbers x, y, confidence"),
        )
        for person in people
    ]
    if not entries:
        raise DatasetError(path, "document", expected, "an empty list")
    kinds = sorted({person["category_id"].shown for person in people if "category_id" in person})
    if len(kinds) > 1:
        raise DatasetError(path, "category_id", "one category, that of the layout", ", ".join(kinds)[:80])
    return entries


def _results_view(path: Path, entries: list[tuple[int, Field]]) -> View:
    """Return the view; confidences above 1, maxima of heat maps, are clipped.

    An image in which nobody was found is not in the file.
    """
    people: dict[int, list[Person]] = {}
    for frame, keypoints in entries:
        people.setdefault(frame, []).append(_triples(keypoints, clip=True))
    return replace(list_view(path, people), flat=True, sparse=True)


def is_coco(path: Path) -> bool:
    """Whether a file begins like COCO's results."""
    return _has_image_id(path, r"\d")


def is_alphapose(path: Path) -> bool:
    """Whether a file begins like AlphaPose's results."""
    return _has_image_id(path, '"')


def _has_image_id(path: Path, pattern: str) -> bool:
    start = head(path)
    return start.startswith("[") and re.search(rf'"image_id"\s*:\s*{pattern}', start) is not None


def read_mmpose(path: Path) -> View:
    """Return the view of one camera from predictions of MMPose 1.x.

    The demos write ``{"meta_info": {…}, "instance_info": [{"frame_id", "instances": [{"keypoints": [[x, y],
    …], "keypoint_scores": […]}]}]}``, the inferencer the bare list of frames. Scores are maxima of heat maps
    or SimCC and can exceed 1; they are clipped to [0, 1]. ``meta_info.keypoint_id2name`` confirms the layout.
    """
    document, expected = _document(path, "MMPose predictions"), "a list of frames"
    bare = isinstance(document.value, list)
    found = document if bare else document.member("instance_info", expected)
    people: dict[int, list[Person]] = {}
    for frame in found.entries(expected):
        number = frame.member("frame_id", "a frame number").index()
        if number in people:
            raise frame["frame_id"].error("every frame once", f"{number} again")
        instances = frame.member("instances", "a list of people").entries("a list of people")
        people[number] = [_mmpose_person(person) for person in instances]
    if not people:
        raise found.error(expected, "an empty list")
    names = None if bare else _mmpose_names(document["meta_info"]["keypoint_id2name"])
    return replace(list_view(path, people), joints=names, own_order=True)


def _mmpose_person(person: Field) -> Person:
    keypoints = person.member("keypoints", "a list of [x, y]")
    xy = keypoints.rows(2)
    found = person.member("keypoint_scores", "a list of numbers")
    scores = found.row()
    if len(scores) != len(xy) or not len(xy):
        expected = f"{max(len(xy), 1)} numbers, one per keypoint"
        raise found.error(expected, f"{len(scores)} for {len(xy)} keypoints")
    where = person.path, keypoints.place
    return Person(*where, joints_of(*where, xy, scores, clip=True))


def _mmpose_names(table: Field) -> tuple[str, ...] | None:
    """Return the names of the joints, if the file has them."""
    if not isinstance(table.value, dict) or not table.value:
        return None
    names = [table.value.get(str(place)) for place in range(len(table.value))]
    if not all(isinstance(name, str) for name in names):
        raise table.error(f"a name for each of 0 to {len(names) - 1}", ", ".join(table.value))
    return tuple(str(name) for name in names)


def is_mmpose(path: Path) -> bool:
    """Whether a file begins like MMPose's predictions."""
    start = head(path)
    bare = start.startswith("[") and '"frame_id"' in start and '"instances"' in start
    return '"instance_info"' in start or '"keypoint_id2name"' in start or bare


# what tools add to the camera's name in that of a file
_ADDED = r"[-_ ]*alphapose[-_ ]results"
_JSON = (".json",)
FORMATS = (
    DetectionFormat("openpose", "OpenPose, skelsplat detect", _JSON, is_openpose, folder=read_openpose),
    DetectionFormat("mmpose", "MMPose 1.x", _JSON, is_mmpose, read_mmpose),
    DetectionFormat("alphapose", "AlphaPose", _JSON, is_alphapose, read_alphapose, added=_ADDED),
    DetectionFormat("coco", "COCO keypoint results", _JSON, is_coco, read_coco),
    DetectionFormat("easymocap", "EasyMocap's annotations", _JSON, is_easymocap, folder=read_easymocap),
)
