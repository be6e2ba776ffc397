"""The JSON file: everything of a refined sequence, for any language; one line per frame."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._atomic import atomic_write_text
from skelsplat._budget import check_ratio
from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import json_document
from skelsplat.io.poses._pose_data import ARRAYS, BONES, PoseData, Poses, checked, parts_of, shape_of

FORMAT, PEOPLE, VERSION = "skelsplat-poses", "skelsplat-people", 1
_BY_JOINT = (
    *("pose", "init_pose", "uncertainty", "error_bar", "covariance"),
    *("velocity", "velocity_uncertainty"),
)
# what an entry of an array may be in JSON, and how messages call it
_KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    np.float64: ((int, float), "a number or null"),
    np.int64: ((int,), "a whole number"),
    np.str_: ((str,), "a string"),
    np.bool_: ((bool,), "true or false"),
}


def write_json(path: str | os.PathLike[str], data: Poses) -> None:
    """Write one JSON object, with a line per frame.

    Its keys are ``format`` ("skelsplat-poses"), ``version`` (1), ``written_by``, ``unit``, ``frame_rate``
    (null if unknown), ``joint_names`` (N), ``camera_names`` (M), ``processing`` (sentences) and ``frames``, a
    list of objects; of a recording solved over time also ``bones`` (B × 2 joint indices, from 0),
    ``bone_lengths`` and ``bone_length_sigma``. Each of the frames has ``frame``, its number, ``pose``, N
    times [x, y, z] in ``unit``, and the other arrays of `PoseData` without their first axis; also
    ``error_bar``, which is not read. What does not exist is null: a number, or a whole joint in ``pose`` and
    the covariances.
    """
    atomic_write_text(path, _texts(data, _head(FORMAT)), "\n")


def people_text(people: Mapping[int, PoseData]) -> str:
    """Return one JSON object with the poses of several people, as `write_people` describes it."""
    lines = [f"{json.dumps(key)}: {_dumps(value)}," for key, value in _head(PEOPLE).items()]
    each = ",\n".join("".join(_texts(data, {"person": identity})) for identity, data in people.items())
    return "\n".join(["{", *lines, '"people": [', each, "]", "}", ""])


def _head(kind: str) -> dict[str, Any]:
    return {"format": kind, "version": VERSION, "written_by": f"skelsplat {sk.__version__}"}


def _texts(data: Poses, first: Mapping[str, Any]) -> Iterator[str]:
    """Yield the object of one person piece by piece, a line per frame; ``first`` are its first keys."""
    head, _, parts = parts_of(data)
    keys = {
        **first,
        "unit": head.unit,
        "frame_rate": head.frame_rate,
        "joint_names": list(head.joint_names),
        "camera_names": list(head.camera_names),
        "processing": list(head.processing),
        **({name: to_json(getattr(head, name)) for name in BONES} if len(head.bones) else {}),
    }
    lines = [f"{json.dumps(key)}: {_dumps(value)}," for key, value in keys.items()]
    yield "\n".join(["{", *lines, '"frames": [', ""])
    for k, part in enumerate(parts):
        yield (",\n" if k else "") + ",\n".join(_dumps(frame) for frame in _frames(part))
    yield "\n]\n}"


def _dumps(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(", ", ": "))


def _frames(data: PoseData) -> Iterator[dict[str, Any]]:
    arrays = {name: getattr(data, name) for name in (*ARRAYS, "error_bar")}
    present = {name: array for name, array in arrays.items() if array.shape[0] == len(data.frames)}
    for t, frame in enumerate(data.frames.tolist()):
        values = {name: to_json(array[t], by_joint=name in _BY_JOINT) for name, array in present.items()}
        yield {"frame": frame, **values}


def to_json(array: Any, *, by_joint: bool = False) -> Any:
    """Return an array as nested lists, with null for NaN and infinity.

    With ``by_joint`` an entry along the first axis that has no number at all is one null.
    """
    values = np.asarray(array)
    finite = np.isfinite(values) if values.dtype.kind == "f" else np.ones(values.shape, dtype=np.bool_)
    if finite.all():
        return values.tolist()
    plain: Any = np.where(finite, values.astype(object), np.array(None)).tolist()
    if not by_joint:
        return plain
    known = np.asarray(finite.reshape(len(values), -1).any(axis=1)).tolist()
    return [joint if there else None for joint, there in zip(plain, known, strict=True)]


def is_json_poses(text: str) -> bool:
    """Tell whether a text begins like a file of `write_json`, or of several people."""
    start = "".join(text[:200].split())
    return start.startswith(tuple(f'{{"format":"{name}"' for name in (FORMAT, PEOPLE)))


@checked
def read_json(path: str | os.PathLike[str]) -> PoseData:
    """Read a file of `write_json`, or one with its keys; ``frames`` needs ``frame`` and ``pose`` only."""
    source = Path(path)
    document = json_document(source, "an object with poses")
    if document["format"].value == PEOPLE:
        raise DatasetError(source, "format", "the poses of one person (person_0/pose.json)", "several people")
    for key, expected in {"format": FORMAT, "version": VERSION}.items():
        if document[key].value != expected:
            raise document[key].error(repr(expected), document[key].shown)
    names: dict[str, Any] = {"joint_names": tuple(document["joint_names"].names())}
    for key in ("camera_names", "processing"):
        names[key] = () if document[key].is_missing else tuple(document[key].names())
    frames = document["frames"].entries("a list of objects")
    sizes = {"M": len(names["camera_names"]), "N": len(names["joint_names"])}
    arrays: dict[str, Any] = {"frames": _array(frames, "frame", (), np.int64)}
    for name, (axes, kind) in ARRAYS.items():
        if name == "pose" or (frames and name in frames[0]):
            arrays[name] = _array(frames, name, shape_of(axes.removeprefix("T"), sizes), kind)
    if not document["bones"].is_missing:
        sizes["B"] = len(document["bones"].entries("a list of pairs"))
        for name, (axes, kind) in BONES.items():
            arrays[name] = _array([document], name, shape_of(axes, sizes), kind)[0]
    rate = document["frame_rate"]
    known = None if rate.is_missing or rate.value is None else rate.number()
    return PoseData(unit=document["unit"].text(), frame_rate=known, **names, **arrays)


def _array(frames: Sequence[Field], name: str, shape: tuple[int, ...], kind: Any) -> npt.NDArray[Any]:
    flat: list[Any] = []
    for frame in frames[:1]:  # a null stands for all numbers of a frame
        check_ratio(frame.path, name, 8 * len(frames) * math.prod(shape), frame.path.stat().st_size)
    for frame in frames:
        value = frame.member(name, f"{name} of the frame").value
        _flatten(frame.path, f"{frame.place}.{name}", value, shape, kind, flat)
    try:
        return np.array(flat, dtype=kind).reshape(len(frames), *shape)
    except OverflowError as error:
        raise frames[0][name].error("numbers of at most 64 bits", "a larger one") from error


def _flatten(path: Path, place: str, value: Any, shape: tuple[int, ...], kind: Any, flat: list[Any]) -> None:
    """Append the entries of ``value`` to ``flat``; null stands for NaN in all of ``shape``."""
    types, called = _KINDS[kind]
    if value is None and kind is np.float64:
        flat.extend([math.nan] * math.prod(shape))
    elif shape:
        if not isinstance(value, list) or len(value) != shape[0]:
            got = f"{len(value)} entries" if isinstance(value, list) else type(value).__name__
            raise DatasetError(path, place, f"a list of {shape[0]}", got)
        for i, entry in enumerate(value):
            _flatten(path, f"{place}[{i}]", entry, shape[1:], kind, flat)
    elif not isinstance(value, types) or (isinstance(value, bool) and kind is not np.bool_):
        raise DatasetError(path, place, called, repr(value)[:60])
    else:
        flat.append(value)
