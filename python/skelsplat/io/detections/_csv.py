"""Csv files with a line per joint (Caliscope's, and detections of one's own) or per animal (SLEAP's).

One's own have a header line with the columns ``frame``, ``joint``, ``x``, ``y``, in any order, and perhaps
``confidence`` (else 1), ``person`` (a number or name; else there is one) and ``camera`` (else one file per
camera, named like it). ``joint`` is a name, or in every line the place in the layout, from 0. A joint with an
empty ``x``, ``y`` or ``confidence`` is missing, like one whose line is not there.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from skelsplat import layouts
from skelsplat._arrays import Array, Index
from skelsplat._budget import check_ratio
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import csv_header, csv_lines, doubled, frame_number, whole_number
from skelsplat.io.detections._format import (
    DetectionFormat,
    Recording,
    View,
    each,
    joints_of,
    refuse_other_names,
)

_HIGHEST, _DIGITS = 9999, 20  # of a joint's place
_NEEDED = ("frame", "joint", "x", "y")
# by column, its names in the header; of Caliscope today's and those of older versions
_OWN = {name: (name,) for name in (*_NEEDED, "confidence", "person", "camera")}
_CALISCOPE = {
    "frame": ("sync_index",),
    "camera": ("cam_id", "port"),
    "joint": ("keypoint_id", "point_id"),
    "person": ("object_id",),
    "x": ("img_loc_x",),
    "y": ("img_loc_y",),
}
# trackers of older versions of Caliscope, whose points 0 to 32 are MediaPipe's body
_MEDIAPIPE = re.compile(r"xy_(POSE|HOLISTIC|SIMPLE_HOLISTIC)", re.IGNORECASE)


def mediapipe_names(count: int) -> tuple[str, ...]:
    """Return the names of MediaPipe's points, of which the first 33 are the body."""
    body = layouts.MEDIAPIPE33.joints[:count]
    return (*body, *(f"point_{place}" for place in range(len(body), count)))


def frame_in(path: Path, field: str, text: str) -> int:
    """Return the frame number that a field of a line holds."""
    if not text.isdecimal():
        raise DatasetError(path, field, "a frame number, a whole number from 0", repr(text))
    return frame_number(path, field, text)


def number_in(path: Path, field: str, text: str) -> float:
    """Return the number that a field of a line holds; NaN for an empty one."""
    try:
        value = float(text) if text.strip() else float("nan")
    except ValueError:
        value = float("inf")
    if np.isinf(value):
        raise DatasetError(path, field, "a number or nothing", repr(text))
    return value


class _Lines:
    """The joints that the lines of csv files say, in numbers alone: a long file has millions."""

    def __init__(self) -> None:
        self.cameras: dict[str, int] = {}  # the number of each
        self._people: dict[str, int] = {}
        self._joints: dict[str, int] = {}
        # of each joint: the frame and the numbers of camera, person and joint; and x, y, confidence
        self._keys, self._values = array("q"), array("d")

    def add(self, camera: str, frame: int, person: str, joint: str, values: Sequence[float]) -> None:
        """Add a joint."""
        named = ((self.cameras, camera), (self._people, person), (self._joints, joint))
        self._keys.extend((frame, *(known.setdefault(name, len(known)) for known, name in named)))
        self._values.extend(values)

    def views(self, paths: Mapping[str, Path], *, clip: bool = False, least: int = 0) -> dict[str, View]:
        """Return the views of the cameras; of MediaPipe's joints, by place, there are at least so many."""
        for camera, path in paths.items():
            if camera not in self.cameras:
                raise DatasetError(path, "lines", "one line or more after the header", "none")
        keys = np.array(self._keys, dtype=np.int64).reshape(-1, 4)
        values = np.array(self._values, dtype=np.float64).reshape(-1, 3)
        places = self._places(next(iter(paths.values())))
        keys[:, 3] = places[keys[:, 3]]
        count = max(int(places.max()) + 1, least)
        names = mediapipe_names(count) if least else tuple(self._joints)
        found = {}
        for camera, number in self.cameras.items():
            own = np.flatnonzero(keys[:, 1] == number)
            own = own[np.argsort(keys[own, 0], kind="stable")]
            view = _view(paths[camera], keys[own], values[own], count, clip=clip)
            found[camera] = view if names[0].isdecimal() else replace(view, joints=names)
        return found

    def _places(self, path: Path) -> Index:
        """Return the places of the joints: as they come if they have names, else their numbers."""
        named = [joint for joint in self._joints if not joint.isdecimal()]
        if len(named) == len(self._joints):
            return np.arange(len(named))
        if named:
            raise DatasetError(path, "joint", "names or places, not both", f"places and {', '.join(named)}")
        highest = max(map(whole_number, self._joints))
        if highest > _HIGHEST:
            raise DatasetError(path, "joint", f"places from 0 to {_HIGHEST}", highest)
        return np.array([int(joint) for joint in self._joints])


def _view(path: Path, keys: Index, values: Array, count: int, *, clip: bool) -> View:
    """Return a camera's view, of ``count`` joints, from keys and values of `_Lines`, frame after frame."""
    frames, begins = np.unique(keys[:, 0], return_index=True)
    ends = np.append(begins, len(keys))
    changes = int(np.diff(keys[:, :3], axis=0).any(axis=1).sum())  # people, or more
    check_ratio(path, "joint", 24 * (changes + 1) * count, path.stat().st_size)

    def in_frame(place: int) -> list[Array]:
        own = slice(ends[place], ends[place + 1])
        where, found = f"frame {frames[place]}", []
        for person in dict.fromkeys(keys[own, 2].tolist()):
            its = keys[own, 2] == person
            joints, at = np.full((count, 3), np.nan), keys[own, 3][its]
            joints[at] = values[own][its]
            if len(np.unique(at)) < len(at):
                expected = "every joint once per person (a column says who)"
                raise DatasetError(path, where, expected, "one twice")
            found.append(joints_of(path, where, joints[:, :2], joints[:, 2], clip=clip))
        return found

    return View(path, frames, lambda places: [in_frame(place) for place in places], sparse=True)


def _read(lines: _Lines, path: Path, columns: Mapping[str, Sequence[str]], camera: str | None = None) -> None:
    """Add the lines of a file: those of a camera, or for None of all, which a column names."""
    rows = csv_lines(path)
    places = _places(path, next(rows, []), columns)
    cameras = set()
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        cell = {name: row[place].strip() for name, place in places.items()}
        joint, own = cell["joint"], cell.get("camera", "")
        if not joint:
            raise DatasetError(path, f"line {number}, joint", "a joint", "nothing")
        if joint.isdecimal() and len(joint) < _DIGITS:
            joint = str(int(joint))
        frame = frame_in(path, f"line {number}, {columns['frame'][0]}", cell["frame"])
        texts = {name: cell.get(name, "1") for name in ("x", "y", "confidence")}
        values = [number_in(path, f"line {number}, {name}", text) for name, text in texts.items()]
        cameras.add(own)
        lines.add(own if camera is None else camera, frame, cell.get("person", ""), joint, values)
    if camera is not None and len(cameras) > 1:
        expected, actual = "one camera (or the path of this file)", ", ".join(sorted(cameras))
        raise DatasetError(path, "camera", expected, actual)


def _places(path: Path, header: Sequence[str], columns: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Return the place of each column that is there."""
    given = [name.strip().lower() for name in header]
    found = {name: given.index(own) for name, names in columns.items() for own in names if own in given}
    missing = [columns[name][0] for name in _NEEDED if name not in found]
    if missing or len(set(given)) < len(given):
        expected = f"a column {missing[0]}" if missing else "every column once"
        actual = (None if missing else doubled(given)) or ", ".join(header) or "an empty line"
        raise DatasetError(path, "line 1", expected, actual)
    if "confidence" not in found:
        refuse_other_names(path, "line 1", given)
    return found


def read_csv(paths: Mapping[str, Path]) -> dict[str, View]:
    """Return the views of files of one camera each; a joint that a camera never sees has no line in its."""
    lines = _Lines()
    for camera, path in paths.items():
        _read(lines, path, _OWN, camera)
    return lines.views(paths)


def _read_recording(columns: Mapping[str, Sequence[str]], path: Path, _: str | None) -> Recording:
    """Return the views of a file of all cameras."""
    lines = _Lines()
    _read(lines, path, columns)
    if "" in lines.cameras:
        actual = "none; or a folder of one file per camera"
        raise DatasetError(path, "camera", "a camera in every line", actual)
    mediapipe = columns is _CALISCOPE and _MEDIAPIPE.match(path.name)
    least = len(layouts.MEDIAPIPE33.joints) if mediapipe else 0
    return Recording(lines.views(dict.fromkeys(lines.cameras or [""], path), least=least), named=True)


def read_sleap_csv(path: Path) -> View:
    """Read lines of ``track``, empty without tracking, ``frame_idx``, and ``NODE.x``, ``.y``, ``.score``."""
    rows, lines = csv_lines(path), _Lines()
    header = next(rows, [])
    nodes = [name.removesuffix(".x") for name in header if name.endswith(".x")]
    needed = {"frame_idx", *(f"{node}.y" for node in nodes)}
    if not nodes or not needed <= set(header) or len(set(header)) < len(header):
        expected = "the columns frame_idx, and NODE.x and NODE.y for every node, once"
        raise DatasetError(path, "line 1", expected, ", ".join(header)[:200] or "an empty line")
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        cell = dict(zip(header, row, strict=True))
        frame = frame_in(path, f"line {number}, frame_idx", cell["frame_idx"].strip())
        who = cell.get("track") or f" {number}"
        for node in nodes:
            x, y, score = (
                number_in(path, f"line {number}, {node}.{part}", cell.get(f"{node}.{part}", ""))
                for part in ("x", "y", "score")
            )
            lines.add("", frame, who, node, (x, y, 1.0 if np.isnan(score) else score))
    return lines.views({"": path}, clip=True)[""]


def _has(*columns: str) -> Callable[[Path], bool]:
    """Return what says whether the first line of a file has these columns, and is not that of poses."""
    return lambda path: {*columns} <= _header(path) and not {"z", "status"} <= _header(path)


def _header(path: Path) -> set[str]:
    return {name.strip().lower() for name in csv_header(path)}


def _is_sleap(path: Path) -> bool:
    return "frame_idx" in _header(path) and any(name.endswith(".x") for name in _header(path))


_CSV, _IS_CALISCOPE = (".csv",), _has("sync_index", "img_loc_x", "img_loc_y")
SLEAP_ADDED = r"\.(analysis|predictions|slp)\b"  # to the camera's name in that of a file
FORMATS = (
    DetectionFormat("sleap_csv", _CSV, _is_sleap, each(read_sleap_csv), added=SLEAP_ADDED),
    DetectionFormat("caliscope", _CSV, _IS_CALISCOPE, recording=partial(_read_recording, _CALISCOPE)),
    DetectionFormat("csv", _CSV, _has(*_NEEDED), read_csv, recording=partial(_read_recording, _OWN)),
)
