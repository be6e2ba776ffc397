"""Detections in NumPy's files: rtmlib, MeTRAbs, FreeMoCap, VideoPose3D, and those of one's own."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import layouts
from skelsplat._arrays import Array
from skelsplat._budget import check_ratio
from skelsplat._fields import whole_size
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import Arrays, as_numbers, load_npy, load_npz, npy_shape, npz_keys
from skelsplat.io._rows import NpzRows, big_array
from skelsplat.io.detections._format import (
    DetectionFormat,
    Person,
    Recording,
    View,
    array_view,
    joints_of,
    refuse_other_names,
    rows_view,
)
from skelsplat.io.detections._frames import frame_files

_KEYPOINTS, _SCORES = "keypoints", "scores"
_TAIL = f"_{_KEYPOINTS}.npy"


def checked_view(arrays: Arrays, key: str, people: Array) -> View:
    """Return the view of joints (T, P, K, 3), with the numbers of the frames and names that the file has."""
    frames, names = arrays.frames(len(people)), arrays.names("joint_names", people.shape[2])
    view = array_view(arrays.path, key, people, frames=frames, names=names)
    return replace(view, rate=arrays.rate())


def read_rtmlib_folder(folder: Path) -> View:
    """Return the view of one camera from arrays of rtmlib: ``keypoints`` (P, K, 2), ``scores`` (P, K).

    A folder with one file per frame, ``<frame>.npz`` with both arrays or the pair ``<frame>_keypoints.npy``
    and ``<frame>_scores.npy``. Scores are maxima of SimCC and can exceed 1; they are clipped to [0, 1], and a
    joint whose score is not positive is missing.
    """
    pattern = f"*{_TAIL}" if any(folder.glob(f"*{_TAIL}")) else "*.npz"
    files = frame_files(folder, pattern, "one npz file, or pair of npy files, per frame")

    def in_frame(number: int) -> list[Person]:
        path = files[number]
        joints = _rtmlib_joints(_rtmlib_pair(path), ("P", "K"))
        return [Person(path, f"{_KEYPOINTS}[{p}]", person) for p, person in enumerate(joints)]

    return View(folder, list(files), in_frame)


def read_rtmlib(path: Path) -> View:
    """Return the view of one camera from one npz file with the arrays of rtmlib.

    With a leading axis of frames, (T, P, K, 2) and (T, P, K), NaN for nobody, and perhaps ``frames`` (T,).
    """
    arrays = load_npz(path, (_KEYPOINTS, _SCORES, "frames"))
    return checked_view(arrays, _KEYPOINTS, _rtmlib_joints(arrays, ("T", "P", "K")))


def _rtmlib_pair(path: Path) -> Arrays:
    if path.suffix == ".npz":
        return load_npz(path, (_KEYPOINTS, _SCORES))
    scores = path.with_name(f"{path.name.removesuffix(_TAIL)}_{_SCORES}.npy")
    return Arrays(path, {_KEYPOINTS: load_npy(path), _SCORES: load_npy(scores)})


def _rtmlib_joints(arrays: Arrays, axes: tuple[str, ...]) -> Array:
    """Return joints (…, K, 3); both arrays have to be there and fit."""
    path = arrays.path
    xy, scores = (as_numbers(path, key, arrays.take(key)) for key in (_KEYPOINTS, _SCORES))
    if xy.ndim != len(axes) + 1 or xy.shape[-1] != 2:
        raise DatasetError(path, _KEYPOINTS, f"shape ({', '.join((*axes, '2'))})", xy.shape)
    if scores.shape != xy.shape[:-1]:
        raise DatasetError(path, _SCORES, f"shape {xy.shape[:-1]} like the keypoints", scores.shape)
    return joints_of(path, _KEYPOINTS, xy, scores, clip=True)


def is_rtmlib(path: Path) -> bool:
    """Whether a file is the keypoints' part of a pair of rtmlib's, or holds both arrays."""
    if path.suffix == ".npy":
        return path.name.endswith(_TAIL)
    return {_KEYPOINTS, _SCORES} <= npz_keys(path)


_METRABS = ("poses2d", "poses")


def read_metrabs(path: Path) -> View:
    """Return the view of one camera from MeTRAbs' predictions.

    ``poses2d`` (pixels; ``poses`` if that is missing) of shape (T, K, 2), (T, P, K, 2) with NaN for nobody,
    or an array of T arrays (P, K, 2). ``frames`` (T,) and ``joint_names`` (K,) are read if they are there.
    MeTRAbs gives a place to every joint and no confidence: it counts as 1.
    """
    arrays = load_npz(path, (*_METRABS, "frames", "joint_names"))
    key = "poses" if "poses2d" not in arrays.found and "poses" in arrays.found else "poses2d"
    pixels = _metrabs_pixels(path, key, arrays.take(key))
    return checked_view(arrays, key, joints_of(path, key, pixels, None, clip=False))


def _metrabs_pixels(path: Path, key: str, value: Any) -> Array:
    """Return pixels (T, P, K, 2)."""
    array = np.asarray(value)
    if array.dtype == object and array.ndim == 1:
        return _stacked(path, key, [as_numbers(path, f"{key}[{t}]", part) for t, part in enumerate(array)])
    array = as_numbers(path, key, array)
    if array.ndim not in (3, 4) or array.shape[-1] != 2:
        raise DatasetError(path, key, "pixels of shape (T, K, 2) or (T, P, K, 2)", array.shape)
    return array if array.ndim == 4 else array[:, None]


def _stacked(path: Path, key: str, parts: list[Array]) -> Array:
    """Join arrays (P, K, 2) of the frames, padded with NaN."""
    people = [part for part in parts if part.size]
    joints = people[0].shape[1] if people and people[0].ndim == 3 else 0
    for t, part in enumerate(parts):
        if part.size and (part.ndim != 3 or part.shape[1:] != (joints, 2)):
            expected = f"shape (P, {joints}, 2) like the other frames" if joints else "shape (P, K, 2)"
            raise DatasetError(path, f"{key}[{t}]", expected, part.shape)
    most = max([1, *map(len, people)])
    check_ratio(path, key, 16 * len(parts) * most * joints, path.stat().st_size)
    out = np.full((len(parts), most, joints, 2), np.nan)
    for t, part in enumerate(parts):
        if part.size:
            out[t, : len(part)] = part
    return out


def is_metrabs(path: Path) -> bool:
    """Whether a file has one of MeTRAbs' arrays."""
    return not npz_keys(path).isdisjoint(_METRABS)


# MediaPipe's body; with two hands of 21; with 468 or 478 points of the face
_COUNTS = (33, 75, 543, 553)


def read_freemocap(path: Path, _: str | None) -> Recording:
    """Return the views of FreeMoCap 1.x by their place in ``mediapipe_2dData_…_pixelXY.npy``.

    Shape (M, T, K, 2) in pixels, NaN for missing; a third number per point is MediaPipe's depth and is left
    out. There is one person and no confidence: it counts as 1. The file names no cameras, so their order must
    be stated; FreeMoCap's is that of the synchronised videos' names. A file whose name begins with
    ``mediapipe``, or with as many points as MediaPipe alone has (75, 543 or 553), has MediaPipe's: their
    first 33, the body, are matched to joints by name.
    """
    array = as_numbers(path, "array", load_npy(path))
    if array.ndim != 4 or array.shape[3] not in (2, 3) or 0 in array.shape:
        raise DatasetError(path, "array", "shape (cameras, frames, points, 2)", array.shape)
    names = _mediapipe_names(path, array.shape[2])
    people = joints_of(path, "array", array[..., :2], None, clip=False)
    views = {
        str(m): array_view(path, f"array[{m}]", view[:, None], names=names) for m, view in enumerate(people)
    }
    return Recording(views, named=False)


def _mediapipe_names(path: Path, count: int) -> tuple[str, ...] | None:
    if not path.name.lower().startswith("mediapipe") and count not in _COUNTS[1:]:
        return None
    if count not in _COUNTS:
        counts = ", ".join(str(known) for known in _COUNTS)
        raise DatasetError(path, "array", f"one of {counts} points of MediaPipe", count)
    return mediapipe_names(count)


def mediapipe_names(count: int) -> tuple[str, ...]:
    """Return the names of MediaPipe's points, of which the first 33 are the body."""
    body = layouts.MEDIAPIPE33.joints
    return (*body, *(f"point_{place}" for place in range(len(body), count)))


def is_freemocap(path: Path) -> bool:
    """Whether a file has an array of FreeMoCap's shape."""
    shape = npy_shape(path)
    return len(shape) == 4 and shape[3] in (2, 3)


_POSITIONS, _CUSTOM = "positions_2d", "custom"
_CAMERAS = ("54138969", "55011271", "58860488", "60457274")
_NAMED = 8  # sequences in a message
_LAYOUTS = {"h36m": layouts.H36M17, "coco": layouts.COCO17}


def read_videopose3d(path: Path, sequence: str | None) -> Recording:
    """Return the views of one sequence of VideoPose3D, ``"S9/Directions 1"``; of a custom file all videos.

    In ``data_2d_h36m_<detector>.npz`` ``positions_2d`` [subject][action] is a list of one (T, K, 2) per
    camera, pixels; ``metadata.layout_name`` says what the joints are; the four cameras of Human3.6M are
    54138969, 55011271, 58860488 and 60457274. ``data_2d_custom_<name>.npz`` has one video per subject and the
    action "custom": there a subject is a camera. There is one person and no confidence: it counts as 1. The
    file is pickled and opened by a restricted unpickler.
    """
    arrays = load_npz(path, (_POSITIONS, "metadata"))
    subjects = _table(path, _POSITIONS, _content(arrays.take(_POSITIONS)))
    table = {str(name): _table(path, f"{_POSITIONS}.{name}", actions) for name, actions in subjects.items()}
    layout = _layout(arrays.found.get("metadata"))
    names = None if layout is None else tuple(_LAYOUTS[layout].joints)
    if all(list(actions) == [_CUSTOM] for actions in table.values()):
        if sequence is not None:
            raise InvalidInputError(f"sequence: expected none for the videos in {path}, got {sequence!r}")
        views = {}
        for video, actions in table.items():
            part = _videos(path, f"{_POSITIONS}.{video}.custom", actions[_CUSTOM])[0]
            view = _pixel_view(path, f"{_POSITIONS}.{video}", part, names)
            views[video] = replace(view, size=_video_size(arrays.found.get("metadata"), video))
        return Recording(views, named=True)
    key, value = _choose(path, table, sequence)
    parts = _videos(path, key, value)
    human36m = layout == "h36m" and len(parts) == len(_CAMERAS)
    labels = _CAMERAS if human36m else [str(place) for place in range(len(parts))]
    views = {label: _pixel_view(path, f"{key}[{i}]", parts[i], names) for i, label in enumerate(labels)}
    return Recording(views, named=human36m)


def _content(value: Any) -> Any:
    return value.item() if getattr(value, "shape", None) == () else value


def _table(path: Path, field: str, value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict) or not value:
        raise DatasetError(path, field, "a table of sequences", type(value).__name__)
    return value


def _layout(metadata: Any) -> str | None:
    content = _content(metadata)
    name = content.get("layout_name") if isinstance(content, dict) else None
    return name if isinstance(name, str) and name in _LAYOUTS else None


def _video_size(metadata: Any, video: str) -> tuple[int, int] | None:
    """Return width and height from ``video_metadata``, if they are there."""
    value = _content(metadata)
    for key in ("video_metadata", video):
        value = value.get(key) if isinstance(value, dict) else None
    width, height = (value.get("w"), value.get("h")) if isinstance(value, dict) else (None, None)
    return whole_size(width, height) if isinstance(width, int) and isinstance(height, int) else None


def _choose(path: Path, table: dict[str, dict[Any, Any]], sequence: str | None) -> tuple[str, Any]:
    """Return the field and the content of the sequence asked for, or of the only one."""
    found = {f"{who}/{action}": value for who, actions in table.items() for action, value in actions.items()}
    some = ", ".join([*list(found)[:_NAMED], *(["…"] if len(found) > _NAMED else [])])
    if sequence is None and len(found) > 1:
        raise InvalidInputError(f"sequence: expected one of {len(found)} in {path} ({some}), got none")
    name = next(iter(found)) if sequence is None else sequence
    if name not in found:
        raise DatasetError(path, _POSITIONS, f"the sequence {name!r}", some)
    return f"{_POSITIONS}.{name}", found[name]


def _videos(path: Path, field: str, value: Any) -> list[Any]:
    parts = list(value) if isinstance(value, list | tuple) or getattr(value, "ndim", 0) == 4 else []
    if not parts:
        raise DatasetError(path, field, "a list of one array per camera", type(value).__name__)
    return parts


def _pixel_view(path: Path, field: str, value: Any, names: tuple[str, ...] | None) -> View:
    array = as_numbers(path, field, value)
    if array.ndim != 3 or array.shape[2] != 2:
        raise DatasetError(path, field, "pixels of shape (T, K, 2)", array.shape)
    if names is not None and array.shape[1] != len(names):
        raise DatasetError(path, field, f"{len(names)} joints (metadata.layout_name)", f"{array.shape[1]}")
    return array_view(path, field, joints_of(path, field, array, None, clip=False)[:, None], names=names)


def is_videopose3d(path: Path) -> bool:
    """Whether a file has VideoPose3D's array."""
    return _POSITIONS in npz_keys(path)


_OWN = "detections"
_OWN_KEYS = (_OWN, "confidence", "camera_names", "frames", "joint_names", "frame_rate")


def read_npz_recording(path: Path, _: str | None) -> Recording:
    """Return the views of an npz file of all cameras, for detections of one's own.

    ``detections`` in pixels, NaN for missing, with 2 numbers per joint or with confidence as the third.

    ================  ======================  ===========================================================
    detections        (T, M, P, K, 2 or 3)    all cameras in one file; P may be left out: (T, M, K, …)
    detections        (T, P, K, 2 or 3)       one file per camera, named like it; P may be left out
    confidence        detections' but last    in [0, 1], if it is not in ``detections``; else 1
    camera_names      (M,)                    of a file of all cameras; else their order must be stated
    frames            (T,)                    ascending; else from 0
    joint_names       (K,)                    else the layout that is asked for has to have K joints
    frame_rate        ()                      frames per second; NaN, or no such key, if unknown
    ================  ======================  ===========================================================
    """
    big = _big(path, 4)
    if big is not None:
        return _big_recording(path, big)
    arrays = load_npz(path, _OWN_KEYS)
    people = _own_joints(arrays, "(T, M, P, K, 2 or 3)", 4)
    people = people if people.ndim == 5 else people[:, :, None]
    names = arrays.names("camera_names", people.shape[1])
    labels = names or [str(m) for m in range(people.shape[1])]
    views = {label: checked_view(arrays, _OWN, people[:, m]) for m, label in enumerate(labels)}
    return Recording(views, named=names is not None)


def read_npz(path: Path) -> View:
    """Return the view of an npz file of one camera, as `read_npz_recording` describes it."""
    big = _big(path, 3)
    if big is not None:
        return _big_view(path, big)
    arrays = load_npz(path, _OWN_KEYS)
    people = _own_joints(arrays, "(T, P, K, 2 or 3)", 3)
    return checked_view(arrays, _OWN, people if people.ndim == 4 else people[:, None])


def _own_joints(arrays: Arrays, shape: str, least: int, first: int = 0) -> Array:
    """Return joints (…, 3) from an array of `least` or one more axes, whose rows count from ``first``."""
    path, array = arrays.path, as_numbers(arrays.path, _OWN, arrays.take(_OWN))
    if array.ndim not in (least, least + 1) or array.shape[-1] not in (2, 3) or 0 in array.shape[1:]:
        raise DatasetError(path, _OWN, f"shape {shape}, P may be left out", array.shape)
    confidence = array[..., 2] if array.shape[-1] == 3 else None
    apart = arrays.found.get("confidence")
    if confidence is apart is None:
        refuse_other_names(path, "confidence", npz_keys(path))
    if apart is not None:
        apart = as_numbers(path, "confidence", apart)
        if confidence is not None or apart.shape != array.shape[:-1]:
            expected = f"shape {array.shape[:-1]}, and pixels alone in {_OWN}"
            actual = f"{apart.shape} with {_OWN} of shape {array.shape}"
            raise DatasetError(path, "confidence", expected, actual)
        confidence = apart
    return joints_of(path, _OWN, array[..., :2], confidence, clip=False, first=first)


def _big(path: Path, least: int) -> NpzRows | None:
    """Return the detections if they are to be read in stretches: many, of `least` or one more axes."""
    rows = big_array(path, _OWN)
    if rows is None or len(rows.shape) not in (least, least + 1) or rows.shape[-1] not in (2, 3):
        return None
    return rows


def _big_recording(path: Path, big: NpzRows) -> Recording:
    """Return the views of `read_npz_recording`, read in stretches, of which the last one stays in memory."""
    rest, read = _in_stretches(path, big, "(T, M, P, K, 2 or 3)", 4)
    read = functools.lru_cache(maxsize=1)(read)
    count = read(0, 1).shape[1]
    names = rest.names("camera_names", count)

    def view(m: int) -> View:
        return _row_view(rest, big, lambda first, end: read(first, end)[:, m])

    views = {label: view(m) for m, label in enumerate(names or map(str, range(count)))}
    return Recording(views, named=names is not None)


def _big_view(path: Path, big: NpzRows) -> View:
    """Return the view of `read_npz`, read in stretches."""
    rest, read = _in_stretches(path, big, "(T, P, K, 2 or 3)", 3)
    return _row_view(rest, big, read)


def _in_stretches(
    path: Path, big: NpzRows, shape: str, least: int
) -> tuple[Arrays, Callable[[int, int], Array]]:
    """Return the small arrays, and what reads the joints (t, …, P, K, 3) of a stretch of frames."""
    rest = load_npz(path, [key for key in _OWN_KEYS if key not in (_OWN, "confidence")])
    known = "confidence" in npz_keys(path)
    apart: Any = (big_array(path, "confidence") or load_npz(path, ["confidence"])) if known else None

    def read(first: int, end: int) -> Array:
        found = {_OWN: big.read(first, end)}
        if apart is not None:
            there = isinstance(apart, NpzRows)
            found["confidence"] = apart.read(first, end) if there else apart.found["confidence"][first:end]
        joints = _own_joints(Arrays(path, found), shape, least, first)
        return joints if joints.ndim == least + 1 else joints[..., None, :, :]

    return rest, read


def _row_view(rest: Arrays, big: NpzRows, read: Callable[[int, int], Array]) -> View:
    """Return a view with the numbers of the frames and names that the file has."""
    frames = rest.frames(big.shape[0])
    numbers = range(big.shape[0]) if frames is None else np.array(frames)
    joints = read(0, 1).shape[2]
    view = rows_view(rest.path, _OWN, numbers, read)
    return replace(view, joints=rest.names("joint_names", joints), rate=rest.rate())


def is_npz(path: Path) -> bool:
    """Whether a file has an array called ``detections``."""
    return _OWN in npz_keys(path)


FORMATS = (
    DetectionFormat("rtmlib", "rtmlib", (".npz", ".npy"), is_rtmlib, read_rtmlib, read_rtmlib_folder),
    DetectionFormat("metrabs", "MeTRAbs", (".npz",), is_metrabs, read_metrabs),
    DetectionFormat("freemocap", "FreeMoCap 1.x", (".npy",), is_freemocap, recording=read_freemocap),
    DetectionFormat(
        "videopose3d", "VideoPose3D", (".npz",), is_videopose3d, recording=read_videopose3d, sequences=True
    ),
    DetectionFormat("npz", "arrays of one's own", (".npz",), is_npz, read_npz, recording=read_npz_recording),
)
