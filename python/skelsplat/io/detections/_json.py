"""Detections in JSON: OpenPose, EasyMocap (one file per frame), COCO, AlphaPose, MMPose (one per camera)."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._fields import Field, whole_size
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number, head, json_document
from skelsplat.io.detections._format import DetectionFormat, View, each, frame_view, joints_of
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._record import with_record

# more than any map's peak: a pixel in the place of a score
_NO_SCORE = 100.0
_NO_FILES = "; without= leaves out a camera that has no detections"


def read_openpose(folder: Path) -> View:
    """Read ``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}`` of a frame each; zeros were not detected.

    A person ``{}``, or one with an empty list or null, as other programs write them, is nobody in that place,
    and a document ``{}`` an image with nobody. Joints, rate and size are those that ``skelsplat detect``
    states.
    """
    files = frame_files(folder, "*.json", "one JSON file per frame", _NO_FILES)
    return with_record(frame_view(folder, files, lambda number: _openpose_people(files[number])))


def _openpose_people(path: Path) -> list[Array]:
    document, people = json_document(path, "an OpenPose document"), []
    if document.value == {}:
        return []
    for person in document.member("people", "an object with a list under this key").entries("a list"):
        keypoints = person["pose_keypoints_2d"]
        # nothing but an identity: joints may have another program's name, which is an error
        empty = isinstance(person.value, dict) and not any({**person.value, "person_id": None}.values())
        nobody = empty or keypoints.value in ([], None)
        people.append(np.empty((0, 3)) if nobody else _triples(keypoints, clip=False))
    return people


def _triples(keypoints: Field, *, clip: bool) -> Array:
    """Return a person from a flat list x, y, confidence, …; unless with `clip`, no score is an error."""
    flat = keypoints.row()
    if flat.size % 3 or not flat.size:
        raise keypoints.error("three numbers per joint", f"{flat.size} numbers")
    joints = flat.reshape(-1, 3)
    wrong = ((joints[:, 2] < 0.0) | (joints[:, 2] >= _NO_SCORE)) & np.isfinite(joints[:, :2]).all(axis=1)
    if wrong.any() and not clip:
        raise keypoints.error("a confidence in [0, 1] per joint", f"{joints[wrong.argmax(), 2]:g}")
    return joints_of(keypoints.path, keypoints.place, joints[:, :2], joints[:, 2], clip=True)


def read_easymocap(folder: Path) -> View:
    """Read ``{"height", "width", "annots": [{"keypoints": [[x, y, c], …]}]}`` of a frame, or the bare list.

    A confidence of 0 or below marks a joint that was not detected. The images' size is that of the first.
    """
    files = frame_files(folder, "*.json", "one JSON file per frame", _NO_FILES)
    size = None
    with suppress(DatasetError):  # older files, or a broken one, which is an error when it is read
        first = json_document(next(iter(files.values())), "an EasyMocap annotation")
        size = whole_size(first["width"].number(), first["height"].number())
    return replace(frame_view(folder, files, lambda number: _easymocap_people(files[number])), size=size)


def _easymocap_people(path: Path) -> list[Array]:
    document, expected, found = json_document(path, "an EasyMocap annotation"), "a list of people", []
    people = document if isinstance(document.value, list) else document.member("annots", expected)
    for person in people.entries(expected):
        key = "keypoints2d" if "keypoints2d" in person else "keypoints"
        keypoints = person.member(key, "a list of [x, y, confidence]")
        joints = keypoints.rows(3)
        if not len(joints):
            raise keypoints.error("one [x, y, confidence] per joint", "an empty list")
        sure = np.maximum(joints[:, 2], 0.0)
        found.append(joints_of(path, keypoints.place, joints[:, :2], sure, clip=False))
    return found


def read_coco(path: Path) -> View:
    """Read a list of ``{"image_id", "keypoints": [x, y, c, …]}`` of a person; `image_id` is the frame."""
    return _results(path, "COCO keypoint results", Field.index)


def read_alphapose(path: Path) -> View:
    """Read results like COCO's, whose `image_id` is an image's name, ``"12.jpg"``, with the frame number."""
    images: dict[int, str] = {}

    def number(image: Field) -> int:
        digits = re.findall(r"\d+", Path(image.value).stem) if isinstance(image.value, str) else []
        if not digits:
            raise image.error("an image's name with a number, like '12.jpg'", repr(image.value)[:40])
        found = frame_number(path, image.place, digits[-1])
        if images.setdefault(found, image.value) != image.value:
            expected = f"one image for frame {found} (the last integer in its name), here {images[found]!r}"
            raise image.error(expected, repr(image.value)[:80])
        return found

    return _results(path, "AlphaPose results", number)


def _results(path: Path, document: str, frame_of: Callable[[Field], int]) -> View:
    """Return the view of a list of people with one skeleton; an image with nobody is not in it."""
    expected = f"{document}, a list of people"
    people: dict[int, list[Array]] = {}
    kinds = set()
    for person in json_document(path, document).entries(expected):
        frame = frame_of(person.member("image_id", "the image of the person"))
        keypoints = person.member("keypoints", "a list of numbers x, y, confidence")
        people.setdefault(frame, []).append(_triples(keypoints, clip=True))
        kinds.add(person["category_id"].shown)
    if not people:
        raise DatasetError(path, "file", expected, "an empty list")
    if len(kinds) > 1:
        actual = ", ".join(sorted(kinds))[:80]
        raise DatasetError(path, "category_id", "one category, that of the layout", actual)
    return replace(frame_view(path, people, people.__getitem__), sparse=True)


def read_mmpose(path: Path) -> View:
    """Read a list of ``{"frame_id", "instances": [{"keypoints": [[x, y], …], "keypoint_scores": […]}]}``.

    The demos write it as ``instance_info`` of an object whose ``meta_info.keypoint_id2name`` confirms the
    layout, the inferencer bare.
    """
    document, expected = json_document(path, "MMPose predictions"), "a list of frames"
    bare = isinstance(document.value, list)
    found = document if bare else document.member("instance_info", expected)
    people: dict[int, list[Array]] = {}
    for frame in found.entries(expected):
        number = frame.member("frame_id", "a frame number").index()
        if number in people:
            raise frame["frame_id"].error("every frame once", f"{number} again")
        instances = frame.member("instances", "a list of people").entries("a list of people")
        people[number] = [_mmpose_person(person) for person in instances]
    if not people:
        raise found.error(expected, "an empty list")
    names = None if bare else _mmpose_names(document["meta_info"]["keypoint_id2name"])
    return replace(frame_view(path, people, people.__getitem__), joints=names, own_order=True)


def _mmpose_person(person: Field) -> Array:
    keypoints = person.member("keypoints", "a list of [x, y]")
    found = person.member("keypoint_scores", "a list of numbers")
    xy, scores = keypoints.rows(2), found.row()
    if len(scores) != len(xy) or not len(xy):
        expected = f"{max(len(xy), 1)} numbers, one per keypoint"
        raise found.error(expected, f"{len(scores)} for {len(xy)} keypoints")
    return joints_of(keypoints.path, keypoints.place, xy, scores, clip=True)


def _mmpose_names(table: Field) -> tuple[str, ...] | None:
    """Return the names of the joints, if the file has them."""
    if not isinstance(table.value, dict) or not table.value:
        return None
    names = [table.value.get(str(place)) for place in range(len(table.value))]
    if not all(isinstance(name, str) for name in names):
        raise table.error(f"a name for each of 0 to {len(names) - 1}", ", ".join(table.value))
    return tuple(map(str, names))


def _begins(pattern: str) -> Callable[[Path], bool]:
    """Return what says whether a file begins like a regular expression."""
    return lambda path: re.match(pattern, head(path), re.DOTALL) is not None


_IS_MMPOSE = _begins(r'.*"(instance_info|keypoint_id2name)"|\[(?=.*"instances").*"frame_id"')
_IS_EASYMOCAP = _begins(r'.*"annots"|\[.*"(personID|keypoints2d)"')
_IMAGE = r'\[.*?"image_id"\s*:\s*'
# what tools add to the camera's name in that of a file
_ADDED = r"[-_ ]*alphapose[-_ ]results"
_JSON = (".json",)
FORMATS = (
    DetectionFormat("openpose", _JSON, _begins(r'{.*"people"\s*:\s*[^\s\d]'), folder=read_openpose),
    DetectionFormat("mmpose", _JSON, _IS_MMPOSE, each(read_mmpose)),
    DetectionFormat("alphapose", _JSON, _begins(_IMAGE + '"'), each(read_alphapose), added=_ADDED),
    DetectionFormat("coco", _JSON, _begins(_IMAGE + r"\d"), each(read_coco)),
    DetectionFormat("easymocap", _JSON, _IS_EASYMOCAP, folder=read_easymocap),
)
