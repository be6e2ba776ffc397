"""TOML calibrations of the Anipose family (Anipose, Pose2Sim, FreeMoCap, Caliscope's export) and Caliscope.

Anipose: one table per camera with ``matrix`` 3×3, ``rotation`` (Rodrigues, radians) and ``translation``, both
world → camera, ``size`` (width, height), ``distortions`` (a camera without them has no lens, which is warned
of), and optionally ``fisheye``, ``name``. Other tables are passed over. The format has no place for the
length unit; files that this package wrote state it as ``unit`` under ``metadata``.

Caliscope's ``camera_array.toml``: the tables are ``[cameras.N]``, in metres, the name is ``cam_id`` (older
files: ``port``), ``rotation`` is a Rodrigues vector or, in older files, a matrix 3×3, and both it and
``translation`` are null before the cameras were calibrated together. Cameras with ``ignore = true`` are
passed over. ``rotation_count`` turns Caliscope's display, not the pixels that were calibrated. Before 0.3,
and in pyxy3d, the same tables were ``[cam_N]`` of ``config.toml``, among ``charuco``, ``capture_volume`` and
``stereo_A_B``, which has the pose of a pair of cameras.

A crop: Anipose's ``config.toml`` may have ``offset`` (x, y) of ``[cameras.NAME]``, the upper left corner in
the calibrated image of the videos in which points were detected. It is taken off the principal point.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._budget import read_toml
from skelsplat.cameras import vector_from_matrix
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding
from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import (
    CalibrationFormat,
    Parsed,
    RawCamera,
    Source,
    camera_of,
    cameras_of,
    lens_assumed,
    rotation_matrix,
    rotation_of,
    whole_size,
)

_REQUIRED = ("matrix", "rotation", "translation")
_LENS = ("distortion", "distortions")
_NOT_CAMERAS = re.compile(r"metadata|capture_volume|charuco|checkerboard|stereo_.*")
# of Anipose; `config.toml` is in the project's folder, some levels above the calibration
_ANIPOSE, _PROJECT, _LEVELS = "calibration.toml", "config.toml", 4


def _looks_like_toml(text: str) -> bool:
    """Whether the text has a TOML table header or an assignment at the start of a line."""
    return re.search(r"^[ \t]*(\[[^\[\]\n]+\][ \t]*(#.*)?$|[\w.\"-]+[ \t]*=)", text, re.MULTILINE) is not None


def is_anipose(source: Source) -> bool:
    """Whether a source may be of the Anipose family: TOML that no other format claims."""
    return not source.start.startswith(("<", "{", "%YAML")) and _looks_like_toml(source.text)


def has_cameras(source: Source) -> bool:
    """Whether TOML has a camera: much other TOML is of no known format, either."""
    return bool(_cameras(source))


def _cameras(source: Source) -> list[Field]:
    document = Field(source.path, "", source.toml)
    return [document[key] for key in source.toml if _is_camera(document[key])]


def parse_anipose(source: Source) -> Parsed:
    """Return the cameras of a file of the Anipose family, in its order."""
    document, cameras = Field(source.path, "", source.toml), _cameras(source)
    if not cameras:
        expected = "at least one camera table with matrix, rotation and translation"
        raise DatasetError(source.path, "cameras", expected, f"tables {', '.join(source.toml) or 'none'}")
    bare = [str(one.value.get("name", one.place)) for one in cameras if one.value.keys().isdisjoint(_LENS)]
    unit = document["metadata"]["unit"].value
    known = unit if unit in ("mm", "cm", "m") else None
    found = [lens_assumed(source.path, bare)] if bare else []
    read = [_anipose_camera(one) for one in cameras]
    offsets, file = _offsets(source, cameras)
    if offsets:
        words = f"{file}: offset: {', '.join(offsets)}: detections are taken to be in pixels of the crop."
        found.append(Finding("crop_applied", "note", cameras_of(file, list(offsets)), sentence=words))
    return Parsed([_cropped(file, camera, offsets.get(camera.name)) for camera in read], known, found)


def _is_camera(entry: Field) -> bool:
    """Whether a top-level entry is a camera.

    One of the three required keys is enough: a camera that lacks another is an error, not a table to skip.
    """
    return not _NOT_CAMERAS.fullmatch(entry.place) and any(name in entry for name in _REQUIRED)


def _offsets(source: Source, cameras: Sequence[Field]) -> tuple[dict[str, Array], Path]:
    """Return the offsets of crops by camera, and the file that has them: this one, or Anipose's project's."""
    named = {str(one.value.get("name", one.place)): one for one in cameras}
    for document in _with_offsets(source):
        table = document["cameras"]
        fields = [(name, one["offset"], table[name]["offset"]) for name, one in named.items()]
        given = {name: beside if own.is_missing else own for name, own, beside in fields}
        corners = {name: _corner(field) for name, field in given.items() if not field.is_missing}
        if corners:
            return {name: corner for name, corner in corners.items() if corner.any()}, document.path
    return {}, source.path


def _with_offsets(source: Source) -> Iterator[Field]:
    """Yield the calibration, and what may be Anipose's configuration in its folder and above."""
    yield Field(source.path, "", source.toml)
    for folder in source.path.absolute().parents[:_LEVELS] if source.path.name == _ANIPOSE else []:
        path = folder / _PROJECT
        if path.is_file():
            with suppress(DatasetError):  # somebody else's
                yield Field(path, "", read_toml(path))


def _corner(field: Field) -> Array:
    """Return the first two numbers of an offset, as Anipose does: some give the other corner as well."""
    offset = field.numbers(None)
    if offset.size not in (2, 4):
        raise field.error("x and y of the crop's upper left corner", f"{offset.size} numbers")
    return offset[:2]


def _cropped(file: Path, camera: RawCamera, offset: Array | None) -> RawCamera:
    """Return the camera of the part of its image that begins at an offset and reaches at most to its end."""
    if offset is None or camera.size is None:
        return camera
    size = whole_size(*(np.array(camera.size) - offset))
    if size is None or (offset < 0).any():
        expected = f"whole pixels within {camera.size[0]}×{camera.size[1]}"
        raise DatasetError(file, f"offset of {camera.name}", expected, offset.tolist())
    K = camera.K.copy()
    K[:2, 2] -= offset
    return replace(camera, K=K, size=size)


def _anipose_camera(entry: Field) -> RawCamera:
    fisheye = entry["fisheye"].flag()
    lens = next((name for name in _LENS if name in entry), None)
    size = "size" if "size" in entry or "image_size" not in entry else "image_size"
    name, turn = entry["name"].text() if "name" in entry else entry.place, rotation_matrix(entry["rotation"])
    return camera_of(entry, name, K="matrix", R=turn, t="translation", lens=lens, size=size, fisheye=fisheye)


def is_caliscope(source: Source) -> bool:
    """Whether a source is TOML with Caliscope's tables."""
    shown = "cameras." in source.text or "rotation_count" in source.text
    return shown and _looks_like_toml(source.text) and bool(_caliscope(source))


def _caliscope(source: Source) -> list[Field]:
    """Return the tables of cameras, if they are numbered: those of ``cameras``, in older files ``cam_N``."""
    document = Field(source.path, "", source.toml)
    cameras = document["cameras"] if isinstance(document["cameras"].value, dict) else document
    tables = [cameras[name] for name in cameras.value if cameras is not document or name.startswith("cam_")]
    numbered = [table for table in tables if not {"cam_id", "port"}.isdisjoint(table.table().value)]
    return tables if numbered else []


def parse_caliscope(source: Source) -> Parsed:
    """Return the cameras of Caliscope's own file that are not ignored."""
    entries = _caliscope(source)
    if not entries:
        actual = f"tables {', '.join(source.toml) or 'none'}"
        raise DatasetError(source.path, "cameras", "tables [cameras.N], or [cam_N]", actual)
    wanted = [entry for entry in entries if not entry.table()["ignore"].flag()]
    if not wanted:
        raise DatasetError(source.path, "cameras", "a camera without ignore = true", "none")
    return Parsed([_caliscope_camera(entry) for entry in wanted], "m")


def _caliscope_camera(entry: Field) -> RawCamera:
    rotation, translation = entry["rotation"], entry["translation"]
    if any(field.is_missing or field.value in (None, "null") for field in (rotation, translation)):
        expected = "a camera that is calibrated with the others, or ignore = true"
        raise rotation.error(expected, "no rotation and translation")
    fisheye = entry["fisheye"].flag()
    number = "port" if "port" in entry and "cam_id" not in entry else "cam_id"
    name = f"{'port' if number == 'port' else 'cam'}_{entry[number].text()}"  # as its videos are called
    rest: dict[str, Any] = {"lens": "distortions", "size": "size", "fisheye": fisheye}
    return camera_of(entry, name, K="matrix", R=rotation_of(rotation), t="translation", **rest)


def to_toml(rig: sk.CameraRig, note: str | None = None, *, adjusted: bool = False) -> str:
    """Return a rig as Anipose's TOML, with a note as its first line.

    ``adjusted`` is Anipose's mark of cameras that detections of a recording have adjusted; otherwise unknown.
    """
    digits = len(str(len(rig) - 1))  # equal lengths, because Anipose sorts tables by name
    tables = [_table(f"cam_{index:0{digits}d}", camera) for index, camera in enumerate(rig)]
    mark = "adjusted = true\n" if adjusted else ""
    metadata = f'[metadata]\n{mark}unit = "{rig.unit}"\n'
    return "\n".join([*([] if note is None else [f"# {' '.join(note.split())}\n"]), *tables, metadata])


def _table(key: str, camera: sk.Camera) -> str:
    distortion = [] if camera.distortion is None else np.asarray(camera.distortion).tolist()
    width, height = camera.size
    entries = {
        "name": json.dumps(camera.name or key, ensure_ascii=False),
        "size": f"[{width}, {height}]",
        "matrix": repr(np.asarray(camera.K).tolist()),
        "distortions": repr(distortion or [0.0] * 4),
        "rotation": repr(vector_from_matrix(np.asarray(camera.R)).tolist()),
        "translation": repr(np.asarray(camera.t).tolist()),
        "fisheye": str(bool(camera.fisheye)).lower(),
    }
    return "".join([f"[{key}]\n", *(f"{name} = {value}\n" for name, value in entries.items())])


_ANIPOSE_FILES = "TOML of Anipose, Pose2Sim, FreeMoCap and Caliscope's export"
FORMATS = (
    CalibrationFormat("caliscope", "Caliscope's camera_array.toml", "m", is_caliscope, parse_caliscope),
    CalibrationFormat("anipose", _ANIPOSE_FILES, "", is_anipose, parse_anipose),
)
