"""Caliscope's tracked points, ``xy_<tracker>.csv``: one file of all cameras, one line per point."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import check_ratio
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import csv_header, csv_lines
from skelsplat.io.detections._arrays import mediapipe_names
from skelsplat.io.detections._csv import frame_in, number_in
from skelsplat.io.detections._format import Person, Recording, View, joints_of, list_view

# today's columns, and what older versions call them
_CAMERA, _POINT, _OBJECT = ("cam_id", "port"), ("keypoint_id", "point_id"), "object_id"
_FRAME, _X, _Y = "sync_index", "img_loc_x", "img_loc_y"
_HIGHEST = 9999
# trackers of older versions, whose points 0 to 32 are MediaPipe's body
_MEDIAPIPE = re.compile(r"xy_(POSE|HOLISTIC|SIMPLE_HOLISTIC)", re.IGNORECASE)
# x and y by frame, object and point of one camera
_Lines = dict[int, dict[str, dict[int, tuple[float, float]]]]


def read_caliscope(path: Path, _: str | None) -> Recording:
    """Return the views of Caliscope's ``xy_<tracker>.csv``, pixels, called ``0``, ``1``, … like its cameras.

    Columns ``sync_index`` (the frame number of all cameras), ``cam_id`` (older files: ``port``),
    ``keypoint_id`` (``point_id``), ``img_loc_x``, ``img_loc_y``, and perhaps ``object_id``, a person; others
    are left out. A point that was not found has no line. There is no confidence: it counts as 1. Points are
    joints by number; those of the trackers POSE and HOLISTIC of older versions are MediaPipe's, by name.
    """
    lines = csv_lines(path)
    columns = _columns(path, next(lines, []))
    cameras: dict[str, _Lines] = {}
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
    return Recording({name: _view(path, lines, count, names) for name, lines in cameras.items()}, named=True)


def _columns(path: Path, header: list[str]) -> dict[str, int]:
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


def _view(path: Path, camera: _Lines, count: int, names: tuple[str, ...] | None) -> View:
    people = {
        frame: [Person(path, f"{_FRAME} {frame}", _joints(path, points, count)) for points in found.values()]
        for frame, found in camera.items()
    }
    return replace(list_view(path, people), joints=names, sparse=True)


def _joints(path: Path, points: dict[int, tuple[float, float]], count: int) -> Array:
    xy = np.full((count, 2), np.nan)
    xy[list(points)] = list(points.values())
    return joints_of(path, _X, xy, None, clip=False)


def is_caliscope(path: Path) -> bool:
    """Whether the first line of a file has Caliscope's columns."""
    return {_FRAME, _X, _Y} <= {name.strip() for name in csv_header(path)}
