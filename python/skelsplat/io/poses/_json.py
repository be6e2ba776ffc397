"""The JSON file: everything of a refined sequence, for any language; one line per frame."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._atomic import atomic_write_text
from skelsplat.io._files import FRAME_LIMIT, parse_json, read_text
from skelsplat.io.poses._pose_data import PoseData

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    import numpy.typing as npt

FORMAT, VERSION = "skelsplat-poses", 1
_TYPES = {
    "pose": np.float64,
    "init_pose": np.float64,
    "uncertainty": np.float64,
    "covariance": np.float64,
    "joint_status": np.str_,
    "view_weights": np.float64,
    "swapped": np.bool_,
    "reprojection_error": np.float64,
    "noise": np.float64,
    "loss": np.float64,
    "n_iter": np.int64,
    "stop_reason": np.str_,
}
_BY_JOINT = ("pose", "init_pose", "uncertainty", "covariance")
_KINDS = {np.float64: (int, float), np.int64: (int,), np.str_: (str,), np.bool_: (bool,)}


def write_json(path: str | os.PathLike[str], data: PoseData) -> None:
    """Write one JSON object, with a line per frame.

    Its keys are ``format`` ("skelsplat-poses"), ``version`` (1), ``written_by``, ``unit``, ``frame_rate``
    (null if unknown), ``joint_names`` (N), ``camera_names`` (M), ``processing`` (sentences) and ``frames``, a
    list of objects. Each of these has ``frame``, the number of the frame, ``pose``, N times [x, y, z] in
    ``unit``, and of the other arrays of `PoseData` those that the data have, under their names and without
    their first axis: ``uncertainty`` N times 3 × 3, ``joint_status`` N, ``view_weights`` M times N, ``noise``
    one number, and so on.

    What does not exist is null: a number, or a whole joint in ``pose`` and the covariances. NaN, which is no
    JSON, does not occur.

    Raises
    ------
    DatasetError
        If the path cannot be written.
    """
    head = {
        "format": FORMAT,
        "version": VERSION,
        "written_by": f"skelsplat {sk.__version__}",
        "unit": data.unit,
        "frame_rate": data.frame_rate,
        "joint_names": list(data.joint_names),
        "camera_names": list(data.camera_names),
        "processing": list(data.processing),
    }
    lines = [f"{json.dumps(key)}: {_dumps(value)}," for key, value in head.items()]
    frames = ",\n".join(_dumps(frame) for frame in _frames(data))
    atomic_write_text(path, "\n".join(["{", *lines, '"frames": [', frames, "]", "}", ""]))


def _dumps(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(", ", ": "))


def _frames(data: PoseData) -> Iterator[dict[str, Any]]:
    arrays = {name: getattr(data, name) for name in _TYPES}
    present = {name: array for name, array in arrays.items() if array.shape[0] == len(data.frames)}
    for t, frame in enumerate(data.frames.tolist()):
        yield {
            "frame": frame,
            **{name: to_json(array[t], by_joint=name in _BY_JOINT) for name, array in present.items()},
        }


def to_json(array: Any, *, by_joint: bool = False) -> Any:
    """Return an array as nested lists, with null for NaN and infinity.

    With ``by_joint`` an entry along the first axis that has no number at all is one null.
    """
    values = np.asarray(array)
    if values.dtype.kind != "f":
        return values.tolist()
    finite: npt.NDArray[np.bool_] = np.isfinite(values)
    if finite.all():
        return values.tolist()
    plain: Any = np.where(finite, values.astype(object), np.array(None)).tolist()
    if not by_joint:
        return plain
    known = np.asarray(finite.reshape(len(values), -1).any(axis=1))
    return [joint if there else None for joint, there in zip(plain, known.tolist(), strict=True)]


def is_json_poses(text: str) -> bool:
    """Tell whether a text begins like a file of `write_json`."""
    start = "".join(text[:200].split())
    return start.startswith(f'{{"format":"{FORMAT}"')


def read_json(path: str | os.PathLike[str]) -> PoseData:
    """Read a file of `write_json`, or one with its keys; ``frames`` needs ``frame`` and ``pose`` only.

    Raises
    ------
    DatasetError
        If the file cannot be read, is no JSON, lacks a key, or a value has another type or number of entries
        than it should; names the place, such as ``frames[3].pose[7]``.
    """
    source = Path(path)
    try:
        document = parse_json(read_text(source))
    except (json.JSONDecodeError, RecursionError) as error:
        raise DatasetError(source, "file", "JSON", str(error)) from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        got = f"format {document.get('format')!r}" if isinstance(document, dict) else type(document).__name__
        raise DatasetError(source, "format", f'an object with "format": "{FORMAT}"', got)
    if document.get("version") != VERSION:
        raise DatasetError(source, "version", VERSION, repr(document.get("version")))
    return _Reader(source, document).read()


class _Reader:
    """One document; every method names the place of what it does not like."""

    def __init__(self, path: Path, document: dict[str, Any]) -> None:
        self._path = path
        self._document = document

    def read(self) -> PoseData:
        joints, cameras = self._names("joint_names"), self._names("camera_names")
        frames = self._document.get("frames")
        if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
            raise self._error("frames", "a list of objects", type(frames).__name__)
        shapes = self._shapes(len(joints), len(cameras))
        names = ["pose", *(name for name in shapes if name != "pose" and frames and name in frames[0])]
        arrays = {name: self._array(name, frames, shapes[name]) for name in names}
        numbers = self._array("frame", frames, (), np.int64)
        unit, rate = self._document.get("unit"), self._document.get("frame_rate")
        if rate is not None and (isinstance(rate, bool) or not isinstance(rate, int | float)):
            raise self._error("frame_rate", "a number or null", repr(rate))
        if not isinstance(unit, str):
            raise self._error("unit", "mm, cm or m", repr(unit))
        try:
            return PoseData(
                joint_names=joints,
                camera_names=cameras,
                frames=numbers,
                unit=unit,
                frame_rate=rate,
                processing=self._names("processing"),
                **arrays,
            )
        except InvalidInputError as error:
            field, _, rest = str(error).partition(": expected ")
            expected, _, actual = rest.partition(", got ")
            raise self._error(field, expected, actual) from error

    def _error(self, field: str, expected: object, actual: object) -> DatasetError:
        return DatasetError(self._path, field, expected, actual)

    def _names(self, key: str) -> tuple[str, ...]:
        names = self._document.get(key, [] if key != "joint_names" else None)
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise self._error(key, "a list of strings", repr(names))
        return tuple(names)

    @staticmethod
    def _shapes(joints: int, views: int) -> dict[str, tuple[int, ...]]:
        return {
            **dict.fromkeys(("pose", "init_pose"), (joints, 3)),
            **dict.fromkeys(("uncertainty", "covariance"), (joints, 3, 3)),
            **dict.fromkeys(("view_weights", "swapped", "reprojection_error"), (views, joints)),
            "joint_status": (joints,),
            **dict.fromkeys(("noise", "loss", "n_iter", "stop_reason"), ()),
        }

    def _array(
        self, name: str, frames: list[dict[str, Any]], shape: tuple[int, ...], kind: Any = None
    ) -> npt.NDArray[Any]:
        kind = kind or _TYPES[name]
        flat: list[Any] = []
        for t, frame in enumerate(frames):
            if name not in frame:
                raise self._error(f"frames[{t}]", f'the key "{name}"', ", ".join(frame) or "no keys")
            self._flatten(frame[name], shape, kind, f"frames[{t}].{name}", flat)
        return np.array(flat, dtype=kind).reshape(len(frames), *shape)

    def _flatten(self, value: Any, shape: tuple[int, ...], kind: Any, place: str, flat: list[Any]) -> None:
        """Append the entries of ``value`` to ``flat``; null stands for NaN in all of ``shape``."""
        if value is None and kind is np.float64:
            flat.extend([math.nan] * math.prod(shape))
        elif shape:
            if not isinstance(value, list) or len(value) != shape[0]:
                got = f"{len(value)} entries" if isinstance(value, list) else type(value).__name__
                raise self._error(place, f"a list of {shape[0]}", got)
            for i, entry in enumerate(value):
                self._flatten(entry, shape[1:], kind, f"{place}[{i}]", flat)
        elif isinstance(value, _KINDS[kind]) and (kind is np.bool_ or not isinstance(value, bool)):
            if kind in _LIMITS and isinstance(value, int | float) and abs(value) > _LIMITS[kind]:
                raise self._error(place, f"a {_NAMES[kind]} of at most 64 bits", repr(value)[:40])
            flat.append(value)
        else:
            raise self._error(place, f"a {_NAMES[kind]}", repr(value))


_LIMITS: dict[Any, float] = {np.float64: sys.float_info.max, np.int64: FRAME_LIMIT}
_NAMES = {
    np.float64: "number or null",
    np.int64: "whole number",
    np.str_: "string",
    np.bool_: "true or false",
}
