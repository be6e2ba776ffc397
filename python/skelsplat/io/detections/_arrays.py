"""Detections in NumPy's files: rtmlib, MeTRAbs, FreeMoCap, VideoPose3D, and those of one's own."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import layouts
from skelsplat._arrays import Array
from skelsplat._budget import check_ratio
from skelsplat._fields import Field, whole_size
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import (
    Arrays,
    as_numbers,
    big_array,
    load_npy,
    load_npz,
    npy_shape,
    npz_fields,
    npz_keys,
)
from skelsplat.io._files import listed
from skelsplat.io.detections._csv import mediapipe_names
from skelsplat.io.detections._format import (
    DetectionFormat,
    Recording,
    View,
    array_view,
    each,
    frame_view,
    joints_of,
    refuse_other_names,
    rows_view,
)
from skelsplat.io.detections._frames import frame_files

_KEYPOINTS, _SCORES = "keypoints", "scores"
_TAIL = f"_{_KEYPOINTS}.npy"


def read_rtmlib_folder(folder: Path) -> View:
    """Read ``keypoints`` (P, K, 2) and ``scores`` (P, K), an npz or a pair of npy files per frame."""
    pattern = f"*{_TAIL}" if any(folder.glob(f"*{_TAIL}")) else "*.npz"
    files = frame_files(folder, pattern, "one npz file, or pair of npy files, per frame")

    def in_frame(number: int) -> list[Array]:
        path = files[number]
        if path.suffix == ".npz":
            arrays = load_npz(path, (_KEYPOINTS, _SCORES))
        else:
            scores = path.with_name(f"{path.name.removesuffix(_TAIL)}_{_SCORES}.npy")
            arrays = Arrays(path, {_KEYPOINTS: load_npy(path), _SCORES: load_npy(scores)})
        return list(_rtmlib_joints(arrays, ("P", "K")))

    return frame_view(folder, files, in_frame)


def read_rtmlib(path: Path) -> View:
    """Read ``keypoints`` (T, P, K, 2), NaN for nobody, ``scores`` (T, P, K) and perhaps ``frames`` (T,)."""
    arrays = load_npz(path, (_KEYPOINTS, _SCORES, "frames"))
    joints = _rtmlib_joints(arrays, ("T", "P", "K"))
    return array_view(path, joints, arrays.frames(len(joints)))


def _rtmlib_joints(arrays: Arrays, axes: tuple[str, ...]) -> Array:
    """Return joints (…, K, 3); both arrays have to be there and fit."""
    path = arrays.path
    xy, scores = (as_numbers(path, key, arrays.take(key)) for key in (_KEYPOINTS, _SCORES))
    if xy.ndim != len(axes) + 1 or xy.shape[-1] != 2:
        raise DatasetError(path, _KEYPOINTS, f"shape ({', '.join((*axes, '2'))})", xy.shape)
    if scores.shape != xy.shape[:-1]:
        raise DatasetError(path, _SCORES, f"shape {xy.shape[:-1]} like the keypoints", scores.shape)
    return joints_of(path, _KEYPOINTS, xy, scores, clip=True)


def _is_rtmlib(path: Path) -> bool:
    if path.suffix == ".npy":
        return path.name.endswith(_TAIL)
    return {_KEYPOINTS, _SCORES} <= npz_keys(path)


_METRABS = ("poses2d", "poses")


def read_metrabs(path: Path) -> View:
    """Read ``poses2d`` or ``poses``: (T, K, 2), (T, P, K, 2) with NaN for nobody, or T arrays (P, K, 2).

    ``frames`` (T,) and ``joint_names`` (K,) are read if they are there.
    """
    arrays = load_npz(path, (*_METRABS, "frames", "joint_names"))
    key = next((key for key in _METRABS if key in arrays.found), _METRABS[0])
    pixels = np.asarray(arrays.take(key))
    if pixels.dtype == object and pixels.ndim == 1:
        pixels = _stacked(path, key, [as_numbers(path, f"{key}[{t}]", p) for t, p in enumerate(pixels)])
    pixels = as_numbers(path, key, pixels)
    if pixels.ndim not in (3, 4) or pixels.shape[-1] != 2:
        raise DatasetError(path, key, "pixels of shape (T, K, 2) or (T, P, K, 2)", pixels.shape)
    joints = joints_of(path, key, pixels if pixels.ndim == 4 else pixels[:, None], None, clip=False)
    names = arrays.names("joint_names", joints.shape[2])
    return replace(array_view(path, joints, arrays.frames(len(joints))), joints=names)


def _stacked(path: Path, key: str, parts: list[Array]) -> Array:
    """Join arrays (P, K, 2) of the frames, padded with NaN."""
    shapes = {part.shape[1:] for part in parts if part.size} or {(0, 2)}
    if len(shapes) > 1:
        raise DatasetError(path, key, "arrays (P, K, 2) with K the same in all frames", sorted(shapes))
    shape = (len(parts), max([1, *(len(part) for part in parts if part.size)]), *shapes.pop())
    check_ratio(path, key, 8 * math.prod(shape), path.stat().st_size)
    stacked = np.full(shape, np.nan)
    for t, part in enumerate(parts):
        if part.size:
            stacked[t, : len(part)] = part
    return stacked


# MediaPipe's body with two hands of 21; with 468 or 478 points of the face
_COUNTS = (75, 543, 553)


def read_freemocap(path: Path, _: str | None) -> Recording:
    """Read ``mediapipe_2dData_…_pixelXY.npy`` of FreeMoCap 1.x: (M, T, K, 2), or 3 with MediaPipe's depth.

    The file names no cameras. A file of this name, or with as many points as MediaPipe alone has (75, 543 or
    553), has MediaPipe's, of which the first 33, the body, are matched to joints by name.
    """
    array = as_numbers(path, "array", load_npy(path))
    if array.ndim != 4 or array.shape[3] not in (2, 3) or 0 in array.shape:
        raise DatasetError(path, "array", "shape (cameras, frames, points, 2)", array.shape)
    count = array.shape[2]
    known = path.name.lower().startswith("mediapipe") or count in _COUNTS
    names = mediapipe_names(count) if known else None
    people = joints_of(path, "array", array[..., :2], None, clip=False)[:, :, None]
    views = {str(m): replace(array_view(path, view), joints=names) for m, view in enumerate(people)}
    return Recording(views, named=False)


_POSITIONS, _CUSTOM = "positions_2d", "custom"
_CAMERAS = ("54138969", "55011271", "58860488", "60457274")
_NAMED = 8  # sequences in a message
_LAYOUTS = {"h36m": layouts.H36M17, "coco": layouts.COCO17}


def read_videopose3d(path: Path, sequence: str | None) -> Recording:
    """Read one sequence, ``"S9/Directions 1"``; of ``data_2d_custom_<name>.npz`` all videos.

    ``positions_2d`` [subject][action] is a list of one (T, K, 2) per camera; ``metadata.layout_name`` says
    what the joints are. A custom file has the action "custom" alone, and a subject is a camera.
    """
    content = npz_fields(path, (_POSITIONS, "metadata"))
    subjects = content.member(_POSITIONS, "sequences by subject").members()
    table, metadata = {who: actions.members() for who, actions in subjects.items()}, content["metadata"]
    layout = str(metadata["layout_name"].value)
    names = _LAYOUTS[layout].joints if layout in _LAYOUTS else None
    if table and all(list(actions) == [_CUSTOM] for actions in table.values()):
        if sequence is not None:
            raise InvalidInputError(f"sequence: expected none for the videos in {path}, got {sequence!r}")
        views = {}
        for video, actions in table.items():
            view = _pixel_view(_parts(actions[_CUSTOM])[0], names)
            sides = [metadata["video_metadata"][video][side].value for side in ("w", "h")]
            known = all(isinstance(side, int) for side in sides)
            views[str(video)] = replace(view, size=whole_size(*sides) if known else None)
        return Recording(views, named=True)
    found = {f"{who}/{action}": value for who, actions in table.items() for action, value in actions.items()}
    some = listed(list(found), _NAMED)
    if sequence is None and len(found) > 1:
        raise InvalidInputError(f"sequence: expected one of {len(found)} in {path} ({some}), got none")
    name = next(iter(found), "") if sequence is None else sequence
    if name not in found:
        raise DatasetError(path, _POSITIONS, f"the sequence {name!r}", some or "none")
    parts = _parts(found[name])
    human36m = layout == "h36m" and len(parts) == len(_CAMERAS)
    labels = _CAMERAS if human36m else [str(place) for place in range(len(parts))]
    pairs = zip(labels, parts, strict=True)
    return Recording({label: _pixel_view(part, names) for label, part in pairs}, named=human36m)


def _parts(sequence: Field) -> list[Field]:
    parts = sequence.entries("a list of one array per camera")
    if not parts:
        raise sequence.error("a list of one array per camera", "an empty list")
    return parts


def _pixel_view(part: Field, names: tuple[str, ...] | None) -> View:
    array = as_numbers(part.path, part.place, part.value)
    if array.ndim != 3 or array.shape[2] != 2:
        raise part.error("pixels of shape (T, K, 2)", array.shape)
    if names is not None and array.shape[1] != len(names):
        raise part.error(f"{len(names)} joints (metadata.layout_name)", f"{array.shape[1]}")
    joints = joints_of(part.path, part.place, array, None, clip=False)
    return replace(array_view(part.path, joints[:, None]), joints=names)


_OWN, _SURE = "detections", "confidence"
_SMALL = ("camera_names", "frames", "joint_names", "frame_rate")


def read_npz_recording(path: Path, _: str | None) -> Recording:
    """Read detections of one's own: pixels, NaN for missing, and perhaps confidence as a third number.

    ``detections`` (T, M, P, K, 2 or 3), of a file of one camera (T, P, K, 2 or 3), where P may be left out;
    perhaps ``confidence`` of this shape but the last, ``camera_names`` (M,), else their order must be stated,
    ``frames`` (T,), ``joint_names`` (K,) and ``frame_rate``.
    """
    own = _OwnRows(path, "(T, M, P, K, 2 or 3)", 4)
    read = functools.lru_cache(maxsize=1)(own.read)  # for a stretch, it is called by each camera

    def view(m: int) -> View:
        return own.view(lambda first, end: read(first, end)[:, m])

    count = own.pixels.shape[1]
    names = own.rest.names("camera_names", count)
    views = {label: view(m) for m, label in enumerate(names or map(str, range(count)))}
    return Recording(views, named=names is not None)


def read_npz(path: Path) -> View:
    """Read a file of one camera, as `read_npz_recording` describes it."""
    own = _OwnRows(path, "(T, P, K, 2 or 3)", 3)
    return own.view(own.read)


class _OwnRows:
    """The detections in a file of one's own, of ``least`` axes or with that of people one more."""

    def __init__(self, path: Path, shape: str, least: int) -> None:
        self._path, self._least, self._sure = path, least, None
        self.rest, self.pixels = load_npz(path, _SMALL), _rows_of(path, _OWN)
        there = self.pixels.shape
        if len(there) not in (least, least + 1) or there[-1] not in (2, 3) or 0 in there[1:]:
            raise DatasetError(path, _OWN, f"shape {shape}, P may be left out", there)
        if _SURE in npz_keys(path):
            self._sure = _rows_of(path, _SURE)
            if there[-1] == 3 or self._sure.shape != there[:-1]:
                expected = f"shape {there[:-1]}, and pixels alone in {_OWN}"
                actual = f"{self._sure.shape} with {_OWN} of shape {there}"
                raise DatasetError(path, _SURE, expected, actual)
        elif there[-1] == 2:
            refuse_other_names(path, _SURE, npz_keys(path))

    def read(self, first: int, end: int) -> Array:
        """Return the joints (t, …, P, K, 3) of the frames from ``first`` to before ``end``."""
        numbers = as_numbers(self._path, _OWN, self.pixels[first:end])
        sure = numbers[..., 2] if numbers.shape[-1] == 3 else None
        if self._sure is not None:
            sure = as_numbers(self._path, _SURE, self._sure[first:end])
        joints = joints_of(self._path, _OWN, numbers[..., :2], sure, clip=False, first=first)
        return joints if joints.ndim == self._least + 1 else joints[..., None, :, :]

    def view(self, read: Callable[[int, int], Array]) -> View:
        """Return the view of a camera, with the numbers of the frames and names that the file has."""
        view = rows_view(self._path, self.rest.frames(self.pixels.shape[0]), read)
        names = self.rest.names("joint_names", self.pixels.shape[-2])
        return replace(view, joints=names, rate=self.rest.rate())


def _rows_of(path: Path, name: str) -> Any:
    """Return an array, or if it is big its rows."""
    return big_array(path, name) or load_npz(path, (name,)).take(name)


def _has_any(*names: str) -> Callable[[Path], bool]:
    """Return what says whether an npz file has one of these arrays."""
    return lambda path: not npz_keys(path).isdisjoint(names)


def _is_freemocap(path: Path) -> bool:
    return npy_shape(path)[3:] in ((2,), (3,))


_NPZ, _IS_VIDEOPOSE3D = (".npz",), _has_any(_POSITIONS)
FORMATS = (
    DetectionFormat("rtmlib", (".npz", ".npy"), _is_rtmlib, each(read_rtmlib), read_rtmlib_folder),
    DetectionFormat("metrabs", _NPZ, _has_any(*_METRABS), each(read_metrabs)),
    DetectionFormat("freemocap", (".npy",), _is_freemocap, recording=read_freemocap),
    DetectionFormat("videopose3d", _NPZ, _IS_VIDEOPOSE3D, recording=read_videopose3d, sequences=True),
    DetectionFormat("npz", _NPZ, _has_any(_OWN), each(read_npz), recording=read_npz_recording),
)
