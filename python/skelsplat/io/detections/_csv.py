"""Csv files with a line per joint: Caliscope's tracked points, and detections of one's own.

The latter have a header line with the columns ``frame``, ``joint``, ``x``, ``y``, in any order, and perhaps
``confidence`` (else 1), ``person`` (a number or name; else there is one) and ``camera`` (else one file per
camera, named like it). ``joint`` is a name, or in every line the place in the layout, from 0. A joint with an
empty ``x``, ``y`` or ``confidence`` is missing, like one whose line is not there.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import check_ratio
from skelsplat._skelsplat import HIGHEST_CONFIDENCE
from skelsplat.exceptions import DatasetError
from skelsplat.io import _rows
from skelsplat.io._files import csv_header, csv_lines, frame_number, whole_number
from skelsplat.io.detections._arrays import mediapipe_names
from skelsplat.io.detections._csv_index import Index
from skelsplat.io.detections._format import (
    DetectionFormat,
    Person,
    Recording,
    View,
    joints_of,
    list_view,
    refuse_other_names,
    stretch_view,
)

# x, y, confidence by frame, person and joint of one camera
Lines = dict[int, dict[str, dict[str, tuple[float, ...]]]]

_NEEDED = ("frame", "joint", "x", "y")
_HIGHEST, _DIGITS = 9999, 20
_BLOCKS = 512  # of a big file that are in memory, some 50 MB
_KNOWN = (*_NEEDED, "confidence", "person", "camera")


def read_csv_recording(path: Path, _: str | None) -> Recording:
    """Return the views of a file of all cameras."""
    views = _views(path)
    if "" in views:
        actual = "none; or a folder of one file per camera"
        raise DatasetError(path, "camera", "a camera in every line", actual)
    return Recording(views, named=True)


def read_csv(path: Path) -> View:
    """Return the view of the one camera of a file."""
    views = _views(path)
    if len(views) > 1:
        raise DatasetError(path, "camera", "one camera (or the path of this file)", ", ".join(views))
    return next(iter(views.values()))


def completed(views: Mapping[str, View]) -> dict[str, View]:
    """Give each camera the joints that others list: in its own file, a joint that it never saw has no line.

    A camera that lists a joint as no other does is left as it is: it may have another name for what it lacks.
    """
    own = {name: view.joints or _places(view) for name, view in views.items()}
    listing = Counter(itertools.chain.from_iterable(own.values()))
    comparable = len({view.joints is None for view in views.values()}) == 1  # all have names, or none
    lacking = [name for name, joints in own.items() if len(joints) < len(listing) and comparable]
    alike = [name for name in lacking if all(listing[joint] > 1 for joint in own[name])]
    return {**views, **{name: _with_joints(views[name], own[name], tuple(listing)) for name in alike}}


def _places(view: View) -> tuple[str, ...]:
    return tuple(map(str, range(len(view.people(view.frames[0])[0].joints))))


def _with_joints(view: View, own: tuple[str, ...], every: tuple[str, ...]) -> View:
    places, read = [every.index(joint) for joint in own], view.people

    def wide(person: Person) -> Person:
        joints = np.full((len(every), 3), np.nan)
        joints[places] = person.joints
        return person._replace(joints=joints)

    names = every if view.joints else None
    return replace(view, joints=names, people=lambda number: [*map(wide, read(number))], stretch=None)


def _views(path: Path) -> dict[str, View]:
    """Return the view of each camera; of a big file in the order of its frames, read in stretches."""
    if path.stat().st_size >= _rows.BIG:
        header = csv_header(path)
        index = Index.of(path, _columns(path, header), len(header))
        if index is not None:
            return _indexed_views(index)
    lines = csv_lines(path)
    columns = _columns(path, next(lines, []))
    cameras, joints = _read(path, columns, enumerate(lines, start=2))
    if not cameras:
        raise DatasetError(path, "lines", "one line per joint after the header", "none")
    names = _ordered(path, tuple(joints))
    people = sum(len(frame) for camera in cameras.values() for frame in camera.values())
    check_ratio(path, "joint", 24 * people * len(names), path.stat().st_size)
    return {name: _view(path, camera, names) for name, camera in cameras.items()}


def _read(
    path: Path, columns: Mapping[str, int], lines: Iterable[tuple[int, Sequence[str]]]
) -> tuple[dict[str, Lines], dict[str, None]]:
    """Return the lines of each camera, and all joints in the order in which they come."""
    cameras: dict[str, Lines] = {}
    joints: dict[str, None] = {}
    for number, line in lines:
        if not line:
            continue
        cell = {name: line[place].strip() for name, place in columns.items()}
        cell["joint"] = joint_in(cell["joint"])
        camera = cameras.setdefault(cell.get("camera", ""), {})
        frame = camera.setdefault(frame_in(path, f"line {number}, frame", cell["frame"]), {})
        person = frame.setdefault(cell.get("person", ""), {})
        if not cell["joint"] or cell["joint"] in person:
            alone = bool(cell["joint"]) and "person" not in columns
            expected = f"a joint, once per {'frame, or a column person for several' if alone else 'person'}"
            again = f" again in frame {cell['frame']}" if cell["joint"] else ""
            raise DatasetError(path, f"line {number}, joint", expected, repr(cell["joint"]) + again)
        person[cell["joint"]] = _values(path, number, cell)
        joints[cell["joint"]] = None
    return cameras, joints


def _indexed_views(index: Index) -> dict[str, View]:
    """Return the views of a big file."""
    names = _ordered(index.path, tuple(dict.fromkeys(map(joint_in, index.joints))))
    people = sum(map(len, index.frames.values()))  # or more
    check_ratio(index.path, "joint", 24 * people * len(names), index.path.stat().st_size)

    @functools.lru_cache(maxsize=_BLOCKS)
    def block(number: int) -> dict[str, dict[int, list[Person]]]:
        cameras, _ = _read(index.path, index.columns, index.lines(number))
        return {camera: _by_frame(index.path, lines, names) for camera, lines in cameras.items()}

    def view(camera: str) -> View:
        frames, blocks = index.frames[camera], index.blocks[camera]

        def stretch(first: int, end: int) -> list[list[Person]]:
            places = zip(frames[first:end], blocks[first:end], strict=True)
            return [block(number)[camera][frame] for frame, number in places]

        found = stretch_view(index.path, np.array(frames, dtype=np.int64), stretch)
        return replace(found, joints=None if names[0].isdecimal() else names, sparse=True)

    return {camera: view(camera) for camera in index.frames}


def _columns(path: Path, header: Sequence[str]) -> dict[str, int]:
    names = [name.strip().lower() for name in header]
    missing = [name for name in _NEEDED if name not in names]
    if missing or len(set(names)) < len(names):
        expected = f"the columns {', '.join(_NEEDED)}" if missing else "every column once"
        raise DatasetError(path, "line 1", expected, ", ".join(header) or "an empty line")
    if "confidence" not in names:
        refuse_other_names(path, "line 1", names)
    return {name: names.index(name) for name in _KNOWN if name in names}


def joint_in(text: str) -> str:
    """Return the name of a joint, or its place without leading zeros."""
    return str(int(text)) if text.isdecimal() and len(text) < _DIGITS else text


def frame_in(path: Path, field: str, text: str) -> int:
    """Return the frame number that a field of a line holds."""
    if not text.isdecimal():
        raise DatasetError(path, field, "a frame number, a whole number from 0", repr(text))
    return frame_number(path, field, text)


def _values(path: Path, line: int, cell: dict[str, str]) -> tuple[float, ...]:
    """Return x, y and the confidence, which is that of a detection only where x and y are there."""
    x, y, sure = (
        number_in(path, f"line {line}, {name}", cell.get(name, "1")) for name in ("x", "y", "confidence")
    )
    if not np.isnan([x, y, sure]).any() and not 0.0 <= sure <= HIGHEST_CONFIDENCE:
        expected, actual = "a confidence in [0, 1]", cell["confidence"]
        raise DatasetError(path, f"line {line}, confidence", expected, actual)
    return x, y, sure


def number_in(path: Path, field: str, text: str) -> float:
    """Return the number that a field of a line holds; NaN for an empty one."""
    try:
        value = float(text) if text.strip() else float("nan")
    except ValueError:
        value = float("inf")
    if np.isinf(value):
        raise DatasetError(path, field, "a number or nothing", repr(text))
    return value


def _ordered(path: Path, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the joints in their order: places by number, names as they come."""
    places = [joint for joint in joints if joint.isdecimal()]
    if places and len(places) < len(joints):
        names = ", ".join(joint for joint in joints if not joint.isdecimal())
        raise DatasetError(path, "joint", "names or places, not both", f"places and {names}")
    highest = max(map(whole_number, places), default=0)
    if highest > _HIGHEST:
        raise DatasetError(path, "joint", f"places from 0 to {_HIGHEST}", highest)
    return tuple(str(place) for place in range(int(highest) + 1)) if places else joints


def _view(path: Path, camera: Lines, joints: tuple[str, ...]) -> View:
    names = None if joints[0].isdecimal() else joints
    return replace(list_view(path, _by_frame(path, camera, joints)), joints=names, sparse=True)


def _by_frame(path: Path, camera: Lines, joints: tuple[str, ...]) -> dict[int, list[Person]]:
    return {
        number: [_person(path, f"frame {number}", person, joints) for person in frame.values()]
        for number, frame in camera.items()
    }


def _person(path: Path, where: str, person: dict[str, tuple[float, ...]], joints: tuple[str, ...]) -> Person:
    rows = np.array([person.get(joint, (np.nan, np.nan, np.nan)) for joint in joints])
    return Person(path, where, joints_of(path, where, rows[:, :2], rows[:, 2], clip=False))


def is_csv(path: Path) -> bool:
    """Whether the first line of a file names the columns that are needed, and not those of poses."""
    names = {name.strip().lower() for name in csv_header(path)}
    return set(_NEEDED) <= names and not {"z", "status"} <= names


# Caliscope's columns of today, and what older versions call them
_CAMERA, _POINT, _OBJECT = ("cam_id", "port"), ("keypoint_id", "point_id"), "object_id"
_FRAME, _X, _Y = "sync_index", "img_loc_x", "img_loc_y"
# trackers of older versions, whose points 0 to 32 are MediaPipe's body
_MEDIAPIPE = re.compile(r"xy_(POSE|HOLISTIC|SIMPLE_HOLISTIC)", re.IGNORECASE)
# x and y by frame, object and point of one camera
_Tracked = dict[int, dict[str, dict[int, tuple[float, float]]]]


def read_caliscope(path: Path, _: str | None) -> Recording:
    """Return the views of Caliscope's ``xy_<tracker>.csv``, pixels, called ``0``, ``1``, … like its cameras.

    Columns ``sync_index`` (the frame number of all cameras), ``cam_id`` (older files: ``port``),
    ``keypoint_id`` (``point_id``), ``img_loc_x``, ``img_loc_y``, and perhaps ``object_id``, a person; others
    are left out. A point that was not found has no line. There is no confidence: it counts as 1. Points are
    joints by number; those of the trackers POSE and HOLISTIC of older versions are MediaPipe's, by name.
    """
    lines = csv_lines(path)
    columns = _tracked_columns(path, next(lines, []))
    cameras: dict[str, _Tracked] = {}
    highest = 0
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        frame, point = (
            frame_in(path, f"line {number}, {field}", line[columns[field]]) for field in (_FRAME, _POINT[0])
        )
        if point > _HIGHEST:
            raise DatasetError(path, f"line {number}, point", f"numbers from 0 to {_HIGHEST}", point)
        camera = cameras.setdefault(line[columns[_CAMERA[0]]], {})
        who = line[columns[_OBJECT]] if _OBJECT in columns else ""
        points = camera.setdefault(frame, {}).setdefault(who, {})
        if point in points:
            expected, actual = f"a point once per camera, {_FRAME} and {_OBJECT}", f"{point} again"
            raise DatasetError(path, f"line {number}, point", expected, actual)
        x, y = (number_in(path, f"line {number}, {field}", line[columns[field]]) for field in (_X, _Y))
        points[point], highest = (x, y), max(highest, point)
    if not cameras:
        raise DatasetError(path, "lines", "one line per point after the header", "none")
    names = mediapipe_names(max(highest + 1, 33)) if _MEDIAPIPE.match(path.name) else None
    count = highest + 1 if names is None else len(names)
    people = sum(len(found) for camera in cameras.values() for found in camera.values())
    check_ratio(path, "point", 24 * people * count, path.stat().st_size)
    return Recording(
        {name: _tracked_view(path, lines, count, names) for name, lines in cameras.items()}, named=True
    )


def _tracked_columns(path: Path, header: list[str]) -> dict[str, int]:
    """Return the places of the columns under today's names."""
    given = [name.strip() for name in header]
    found = {name: given.index(name) for name in (_FRAME, _X, _Y, _OBJECT) if name in given}
    for names in (_CAMERA, _POINT):
        present = [name for name in names if name in given]
        if present:
            found[names[0]] = given.index(present[0])
    lacking = [name for name in (_FRAME, _CAMERA[0], _POINT[0], _X, _Y) if name not in found]
    if lacking:
        raise DatasetError(path, "line 1", f"a column {lacking[0]}", ", ".join(given) or "an empty line")
    return found


def _tracked_view(path: Path, camera: _Tracked, count: int, names: tuple[str, ...] | None) -> View:
    people = {
        frame: [
            Person(path, f"{_FRAME} {frame}", _tracked_joints(path, points, count))
            for points in found.values()
        ]
        for frame, found in camera.items()
    }
    return replace(list_view(path, people), joints=names, sparse=True)


def _tracked_joints(path: Path, points: dict[int, tuple[float, float]], count: int) -> Array:
    xy = np.full((count, 2), np.nan)
    xy[list(points)] = list(points.values())
    return joints_of(path, _X, xy, None, clip=False)


def is_caliscope(path: Path) -> bool:
    """Whether the first line of a file has Caliscope's columns."""
    return {_FRAME, _X, _Y} <= {name.strip() for name in csv_header(path)}


FORMATS = (
    DetectionFormat("caliscope", "Caliscope", (".csv",), is_caliscope, recording=read_caliscope),
    DetectionFormat("csv", "tables of one's own", (".csv",), is_csv, read_csv, recording=read_csv_recording),
)
