"""TOML calibrations of the Anipose family (Anipose, Pose2Sim, FreeMoCap, Caliscope's export) and Caliscope.

Anipose: one table per camera with ``matrix`` 3×3, ``rotation`` (Rodrigues, radians) and ``translation``, both
world → camera, ``size`` (width, height), and perhaps ``distortions``, ``fisheye``, ``name``. There is no
place for the length unit; files that this package wrote state it as ``unit`` under ``metadata``, and of a
camera that was started at another time its ``clock`` (`skelsplat.CameraRig`), which other programs ignore.

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
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._budget import read_toml
from skelsplat._fields import Field, whole_size
from skelsplat.cameras import MM_PER_UNIT, vector_from_matrix
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, warn
from skelsplat.io.calibration._entries import camera_of, cameras_of, rotation_of, warn_of_no_lens
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source
from skelsplat.io.calibration._json import clock_of, joint_sigma_of, with_joint_sigma

_REQUIRED = ("matrix", "rotation", "translation")
_LENS = ("distortion", "distortions")
_NOT_CAMERAS = re.compile(r"metadata|capture_volume|charuco|checkerboard|stereo_.*")
_TOML_LINE = re.compile(r"^[ \t]*(\[[^\[\]\n]+\][ \t]*(#.*)?$|[\w.\"-]+[ \t]*=)", re.MULTILINE)
# of Anipose; `config.toml` is in the project's folder, some levels above the calibration
_ANIPOSE, _PROJECT, _LEVELS = "calibration.toml", "config.toml", 4


def _is_toml(source: Source) -> bool:
    other = source.suffix == ".json" or source.start.startswith(("<", "{", "%YAML"))
    if other or _TOML_LINE.search(source.text) is None:
        return False
    if source.suffix == ".toml":
        return True
    with suppress(DatasetError):  # many a text has lines with an equals sign
        return bool(source.toml.value)
    return False


def _is_anipose(source: Source) -> bool:
    return _is_toml(source) and bool(_anipose(source))


def _anipose(source: Source) -> list[Field]:
    """Return the tables of cameras: those with one of the required keys; without another it is an error."""
    entries = [source.toml[key] for key in source.toml.value if not _NOT_CAMERAS.fullmatch(key)]
    return [entry for entry in entries if any(name in entry for name in _REQUIRED)]


def _parse_anipose(source: Source) -> Parsed:
    """Return the cameras of a file of the Anipose family, in its order."""
    named = {one.place: one["name"].text() if "name" in one else one.place for one in _anipose(source)}
    entries = [one for one in _anipose(source) if source.keeps(named[one.place])]
    named = {one.place: named[one.place] for one in entries}
    bare = [named[entry.place] for entry in entries if entry.value.keys().isdisjoint(_LENS)]
    warn_of_no_lens(source.path, bare)
    unit = source.toml["metadata"]["unit"].value
    offsets = _offsets(source.path, list(named.values()))
    if offsets:
        file, names = next(iter(offsets.values())).path, list(offsets)
        words = f"{file}: offset: {', '.join(names)}: detections are taken to be in pixels of the crop."
        warn(Finding("crop_applied", "note", cameras_of(file, names), sentence=words))
    cameras = []
    for entry in entries:
        lens = next((key for key in _LENS if key in entry), None)
        size = "image_size" if "image_size" in entry and "size" not in entry else "size"
        cameras.append(_camera(entry, named[entry.place], lens, size))
    cropped = [_cropped(one, offsets[one.name]) if one.name in offsets else one for one in cameras]
    return with_joint_sigma(cropped, source.toml["metadata"]), unit if unit in MM_PER_UNIT else None


def _camera(entry: Field, name: str, lens: str | None, size: str) -> RawCamera:
    turn = rotation_of(entry["rotation"])
    return camera_of(entry, name, K="matrix", R=turn, t="translation", lens=lens, size=size, own=True)


def _offsets(path: Path, names: Sequence[str]) -> dict[str, Field]:
    """Return by camera the offsets, other than 0, that the project around Anipose's calibration states."""
    for folder in path.absolute().parents[:_LEVELS] if path.name == _ANIPOSE else []:
        cameras = Field(folder / _PROJECT, "", None)
        with suppress(DatasetError):  # there is no such file, or somebody else's
            cameras = replace(cameras, value=read_toml(cameras.path))["cameras"]
        given = {name: cameras[name]["offset"] for name in names if "offset" in cameras[name]}
        if given:
            return {name: offset for name, offset in given.items() if _corner(offset).any()}
    return {}


def _corner(offset: Field) -> Array:
    """Return the first two numbers, as Anipose does: some give the other corner as well."""
    numbers = offset.numbers(None)
    if numbers.size not in (2, 4):
        raise offset.error("x and y of the crop's upper left corner", f"{numbers.size} numbers")
    return numbers[:2]


def _cropped(camera: RawCamera, offset: Field) -> RawCamera:
    """Return the camera of the part of its image that begins at an offset and reaches at most to its end."""
    whole, corner = camera.size or (0, 0), _corner(offset)
    size = whole_size(*(np.array(whole) - corner))
    if size is None or (corner < 0).any():
        raise offset.error(f"whole pixels within {whole[0]}×{whole[1]}", corner.tolist())
    K = camera.K.copy()
    K[:2, 2] -= corner
    return replace(camera, K=K, size=size)


def _is_caliscope(source: Source) -> bool:
    shown = "cameras." in source.text or "rotation_count" in source.text
    return shown and _is_toml(source) and bool(_caliscope(source))


def _caliscope(source: Source) -> list[Field]:
    """Return the tables of cameras, if they are numbered: those of ``cameras``, in older files ``cam_N``."""
    within = source.toml["cameras"]
    if isinstance(within.value, dict):
        tables = list(within.members().values())
    else:
        tables = [source.toml[name] for name in source.toml.value if name.startswith("cam_")]
    numbered = any("cam_id" in table or "port" in table for table in tables)
    return tables if numbered else []


def _parse_caliscope(source: Source) -> Parsed:
    """Return the cameras of Caliscope's own file that are not ignored."""
    entries = [entry.table() for entry in _caliscope(source)]
    wanted = [(_caliscope_name(entry), entry) for entry in entries if not entry["ignore"].flag()]
    return [_caliscope_camera(name, entry) for name, entry in wanted if source.keeps(name)], "m"


def _caliscope_name(entry: Field) -> str:
    """Return the camera's name, as its videos are called."""
    return f"port_{entry['port'].text()}" if "cam_id" not in entry else f"cam_{entry['cam_id'].text()}"


def _caliscope_camera(name: str, entry: Field) -> RawCamera:
    if entry["rotation"].is_missing or entry["rotation"].value in (None, "null"):
        expected = "a camera that is calibrated with the others, or ignore = true"
        raise entry["rotation"].error(expected, "no rotation and translation")
    return _camera(entry, name, lens="distortions", size="size")


def to_toml(rig: sk.CameraRig, note: str | None = None, *, adjusted: bool = False) -> str:
    """Return a rig as Anipose's TOML, with a note as its first line.

    ``adjusted`` is Anipose's mark of cameras that detections of a recording have adjusted; otherwise unknown.
    """
    digits = len(str(len(rig) - 1))  # equal lengths, because Anipose sorts tables by name
    named = enumerate(zip(rig.names, rig, strict=True))
    tables = [_table(f"cam_{i:0{digits}d}", camera, clock_of(rig, name)) for i, (name, camera) in named]
    mark = "adjusted = true\n" if adjusted else ""
    sigma = "".join(f"{name} = {value}\n" for name, value in joint_sigma_of(rig).items())
    metadata = f'[metadata]\n{mark}unit = "{rig.unit}"\n{sigma}'
    return "\n".join([*([] if note is None else [f"# {' '.join(note.split())}\n"]), *tables, metadata])


def _table(key: str, camera: sk.Camera, clock: dict[str, float]) -> str:
    distortion = [] if camera.distortion is None else np.asarray(camera.distortion).tolist()
    entries = {
        "name": json.dumps(camera.name or key, ensure_ascii=False),
        "size": list(camera.size),
        "matrix": camera.K.tolist(),
        "distortions": distortion or [0.0] * 4,
        "rotation": vector_from_matrix(np.asarray(camera.R)).tolist(),
        "translation": camera.t.tolist(),
        "fisheye": str(camera.fisheye).lower(),
        **clock,
    }
    return "".join([f"[{key}]\n", *(f"{name} = {value}\n" for name, value in entries.items())])


FORMATS = (
    CalibrationFormat("caliscope", "Caliscope's camera_array.toml", _is_caliscope, _parse_caliscope),
    CalibrationFormat("anipose", "TOML of Anipose, Pose2Sim and FreeMoCap", _is_anipose, _parse_anipose),
)
