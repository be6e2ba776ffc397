"""Plain npz files: for detections of one's own, big ones read in stretches of frames."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import Arrays, as_numbers, load_npz, npz_keys
from skelsplat.io._rows import NpzRows, big_array
from skelsplat.io.detections._arrays import checked_view
from skelsplat.io.detections._format import Recording, View, joints_of, refuse_other_names, rows_view

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
