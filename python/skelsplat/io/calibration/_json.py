"""Calibrations in JSON: this package's own, which also comes as npz, and those of data sets.

Own JSON::

    {"format": "skelsplat-calibration", "version": 1, "unit": "mm",
     "cameras": [{"name": "cam_01", "size": [1920, 1080], "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
                  "R": [[…], […], […]], "t": [x, y, z],
                  "distortion": [k1, k2, p1, p2, …] or null, "fisheye": false, "clock": 3.4}, …]}

npz, M cameras: ``K (M,3,3)``, ``R (M,3,3)``, ``t (M,3)``, ``size (M,2)``, ``names (M,)``, ``unit ()`` and,
optionally, ``distortion (M,n)``, padded with NaN (a row of NaN: no distortion), ``fisheye (M,)`` and
``clock (M,)``.

R and t are world → camera, x_c = R x_w + t, K and size are pixels, distortion is in OpenCV's order. Clocks
are frames (`skelsplat.CameraRig`), 0 where there is none.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._fields import Field
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import as_numbers, load_plain_npz, npz_keys
from skelsplat.io.calibration._entries import camera_of, lens_of, matrix_of, rotation_of, warn_of_no_lens
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source

_MARK = "skelsplat-calibration"
_VERSION = 1
_NPZ_ARRAYS = ("K", "R", "t", "size", "fisheye", "clock")
_NPZ_REQUIRED = ("K", "R", "t", "size", "names", "unit")


def _is_json(source: Source) -> bool:
    return bool(source.json["format"].value == _MARK)


def _parse_json(source: Source) -> Parsed:
    """Return the cameras of this package's JSON."""
    document = source.json
    for key, known in (("format", _MARK), ("version", _VERSION)):
        if document[key].value != known:
            raise document[key].error(known, document[key].shown)
    entries = document["cameras"].entries("a list of cameras")
    cameras = [_own(camera) for camera in entries if source.keeps(camera["name"].value)]
    return with_joint_sigma(cameras, document), _unit(document)


def _own(entry: Field) -> RawCamera:
    return camera_of(entry, lens="distortion", size="size", own=True)


def _unit(document: Field) -> str:
    unit = document["unit"].text()
    if unit not in MM_PER_UNIT:
        raise document["unit"].error("mm, cm or m", unit)
    return unit


def to_json(rig: sk.CameraRig, note: str | None = None) -> str:
    """Return the rig as JSON text, with a note if there is one; numbers have all their digits."""
    cameras = [
        {
            "name": name,
            "size": list(camera.size),
            "K": camera.K.tolist(),
            "R": camera.R.tolist(),
            "t": camera.t.tolist(),
            "distortion": None if camera.distortion is None else camera.distortion.tolist(),
            "fisheye": camera.fisheye,
            **clock_of(rig, name),
        }
        for name, camera in zip(rig.names, rig, strict=True)
    ]
    noted = {} if note is None else {"note": note}
    stated = {"unit": rig.unit, **joint_sigma_of(rig)}
    document = {"format": _MARK, "version": _VERSION, **noted, **stated, "cameras": cameras}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def clock_of(rig: sk.CameraRig, name: str) -> dict[str, float]:
    """Return the clock of a camera as an entry of a file, if it has one."""
    return {"clock": rig.clocks[name]} if name in rig.clocks else {}


def with_joint_sigma(cameras: Sequence[RawCamera], entry: Field) -> list[RawCamera]:
    """Return cameras with what an entry says of the error of their rig, if it does."""
    sigma = entry["joint_sigma"].number() if "joint_sigma" in entry else 0.0
    return [replace(camera, joint_sigma=sigma) for camera in cameras]


def joint_sigma_of(rig: sk.CameraRig) -> dict[str, float]:
    """Return the error of a rig as an entry of a file, if its places were estimated."""
    return {"joint_sigma": rig.joint_sigma} if rig.joint_sigma else {}


def _is_npz(source: Source) -> bool:
    return source.suffix == ".npz" and not source.is_folder and npz_keys(source.path) >= {"K", "R", "t"}


def _parse_npz(source: Source) -> Parsed:
    """Return the cameras of this package's npz."""
    path, arrays = source.path, load_plain_npz(source.path, "an npz archive of plain arrays")
    for name in _NPZ_REQUIRED:
        if name not in arrays:
            raise DatasetError(path, name, f"the arrays {', '.join(_NPZ_REQUIRED)}", f"no {name}")
    names = np.atleast_1d(arrays["names"]).tolist()
    odd = sorted(name for name in arrays if name != "distortion" and name.lower().startswith("dist"))
    if odd and "distortion" not in arrays:  # it would pass for cameras without lenses
        raise DatasetError(path, odd[0], "lens coefficients under the name distortion", odd[0])
    for name in (*_NPZ_ARRAYS, "distortion"):
        if name in arrays and arrays[name].shape[:1] != (len(names),):
            raise DatasetError(path, name, f"{len(names)} entries, as of names", arrays[name].shape)
    lenses = as_numbers(path, "distortion", arrays.get("distortion", np.full((len(names), 4), np.nan)))
    lenses = lenses.reshape(len(names), -1)
    counts = (~np.isnan(lenses)).sum(axis=1)
    rows = [
        {
            "name": str(names[i]),
            "distortion": lenses[i, : counts[i]].tolist() if counts[i] else None,
            **{name: arrays[name][i].tolist() for name in _NPZ_ARRAYS if name in arrays},
        }
        for i in range(len(names))
    ]
    stated = {name: arrays[name].item() for name in ("joint_sigma",) if name in arrays}
    document = Field(path, "", {"unit": str(arrays["unit"]), **stated})
    cameras = [_own(Field(path, f"[{i}]", row)) for i, row in enumerate(rows)]
    return with_joint_sigma(cameras, document), _unit(document)


def to_arrays(rig: sk.CameraRig) -> dict[str, Any]:
    """Return the rig as the arrays of an npz."""
    lenses = [np.empty(0) if c.distortion is None else np.asarray(c.distortion) for c in rig]
    padded = np.full((len(rig), max([4, *(lens.size for lens in lenses)])), np.nan)
    for row, lens in zip(padded, lenses, strict=True):
        row[: lens.size] = lens
    return {
        **{name: np.stack([getattr(camera, name) for camera in rig]) for name in ("K", "R", "t")},
        "size": np.array([camera.size for camera in rig], dtype=np.int64),
        "names": np.array(rig.names),
        "unit": np.array(rig.unit),
        "distortion": padded,
        "fisheye": np.array([camera.fisheye for camera in rig]),
        **({"clock": np.array([rig.clocks.get(name, 0.0) for name in rig.names])} if rig.clocks else {}),
        **{name: np.array(sigma) for name, sigma in joint_sigma_of(rig).items()},
    }


def _is_panoptic(source: Source) -> bool:
    cameras = source.json["cameras"].value
    listed = isinstance(cameras, list) and "format" not in source.json
    return listed and any(isinstance(camera, dict) and "distCoef" in camera for camera in cameras)


def _parse_panoptic(source: Source, camera_type: str | None) -> Parsed:
    """Return the cameras of the type that is asked for, of CMU Panoptic's ``calibration_SEQUENCE.json``.

    Centimetres, world → camera, y down in the world. ``cameras`` is a list of ``name`` (``"00_03"``),
    ``type`` (``hd``, the default, ``vga``, ``kinect-color``, …), ``resolution`` (width, height), ``K`` 3×3,
    ``distCoef`` (k1, k2, p1, p2, k3), ``R`` 3×3 and ``t`` 3×1.
    """
    wanted = camera_type or "hd"
    cameras = source.json["cameras"].entries("a list of cameras")
    chosen = [camera for camera in cameras if wanted == "all" or camera["type"].text() == wanted]
    if not chosen:
        types = sorted({camera["type"].text() for camera in cameras})
        raise DatasetError(source.path, "type", f"cameras of type {wanted}", f"types {', '.join(types)}")
    chosen = [entry for entry in chosen if source.keeps(entry["name"].value)]
    return [camera_of(entry, lens="distCoef", size="resolution") for entry in chosen], "cm"


# of the videos
HUMAN36M_SIZES = {
    "54138969": (1000, 1002),
    "55011271": (1000, 1000),
    "58860488": (1000, 1000),
    "60457274": (1000, 1002),
}


def _is_human36m(source: Source) -> bool:
    return "intrinsics" in source.json and "extrinsics" in source.json


def _parse_human36m(source: Source, subject: str | None) -> Parsed:
    """Return the cameras of a subject of Human3.6M's ``camera-parameters.json``; mm, world → camera.

    ``intrinsics`` has per camera ``calibration_matrix`` 3×3 and ``distortion`` (k1, k2, p1, p2, k3);
    ``extrinsics`` has per subject and camera ``R`` 3×3 and ``t`` 3×1. Cameras were moved between subjects, so
    of several one must be named. The image sizes are those of the data set: two cameras have 1002 lines, two
    1000.
    """
    intrinsics, extrinsics = (source.json[key].table() for key in ("intrinsics", "extrinsics"))
    poses = extrinsics[one_subject(source.path, list(extrinsics.value), subject)].table()
    cameras = [
        RawCamera(
            name=name,
            K=intrinsics[name]["calibration_matrix"].numbers((3, 3)),
            R=poses[name]["R"].numbers((3, 3)),
            t=poses[name]["t"].numbers((3,)),
            distortion=lens_of(intrinsics[name]["distortion"]),
            size=HUMAN36M_SIZES.get(name),
        )
        for name in poses.value
        if source.keeps(name)
    ]
    return cameras, "mm"


def one_subject(path: Path, subjects: Sequence[str], subject: str | None) -> str:
    """Return the subject that is named, or the only one."""
    chosen = subjects[0] if subject is None and len(subjects) == 1 else str(subject)
    if chosen not in subjects:
        expected = f"one of {', '.join(subjects)} for {path}"
        raise InvalidInputError(f"subject: expected {expected}, got {chosen}")
    return chosen


def _cameras(source: Source, *keys: set[str]) -> list[Field]:
    """Return all entries of a document of which one has the keys of one of these sets; else none."""
    document = source.json
    entries = list(document.members().values()) if isinstance(document.value, dict) else []
    tables = [entry.value for entry in entries if isinstance(entry.value, dict)]
    return entries if any(wanted <= table.keys() for wanted in keys for table in tables) else []


def _is_voxelpose(source: Source) -> bool:
    return bool(_cameras(source, {"R", "T", "fx", "fy", "cx", "cy"}))


def _parse_voxelpose(source: Source) -> Parsed:
    """Return the cameras of VoxelPose's calibration of Shelf and Campus, which MMPose reads as well; mm.

    ``{"0": {R, T, fx, fy, cx, cy, k, p}, …}``: ``T`` (3×1) is the centre of the camera, x_c = R (x − T);
    ``k`` has OpenCV's k1, k2, k3 and ``p`` its p1, p2. The image size is not in the file.
    """
    cameras = []
    for entry in filter(lambda one: source.keeps(one.place), _cameras(source, {"fx"})):
        K = matrix_of(*(entry.table()[name].number() for name in ("fx", "fy", "cx", "cy")))
        (k1, k2, k3), (p1, p2) = entry["k"].numbers((3,)), entry["p"].numbers((2,))
        R, lens = entry["R"].numbers((3, 3)), np.array([k1, k2, p1, p2, k3])
        cameras.append(RawCamera(entry.place, K, R, -R @ entry["T"].numbers((3,)), lens))
    return cameras, "mm"


def _is_association(source: Source) -> bool:
    return bool(_cameras(source, {"K", "imgSize", "RT"}, {"K", "imgSize", "R", "T"}))


def _parse_association(source: Source) -> Parsed:
    """Return the cameras of 4D association; the unit is not in the file (its own data are in metres).

    ``{"0": {K, RT, imgSize}, …}``: ``K`` are 9 numbers by rows, ``RT`` 12, world → camera; in its place may
    be ``R`` (9 numbers, or a rotation vector) and ``T``. ``distCoeff`` is in OpenCV's order; without it there
    is no lens. ``rectifyAlpha`` belongs to images that the program undistorts and is passed over.
    """
    entries = [entry for entry in _cameras(source, {"K"}) if source.keeps(entry.place)]
    warn_of_no_lens(source.path, [entry.place for entry in entries if "distCoeff" not in entry.table()])
    return [_association_camera(entry) for entry in entries], None


def _association_camera(entry: Field) -> RawCamera:
    if "RT" in entry:
        pose = entry["RT"].numbers((12,)).reshape(3, 4)
    else:
        pose = np.column_stack([rotation_of(entry["R"]), entry["T"].numbers((3,))])
    return RawCamera(
        name=entry.place,
        K=entry["K"].numbers((9,)).reshape(3, 3),
        R=pose[:, :3],
        t=pose[:, 3],
        distortion=lens_of(entry["distCoeff"]) if "distCoeff" in entry else None,
        size=entry["imgSize"].size(),
    )


_OF_SUBJECT = ("subject", "size")
FORMATS = (
    CalibrationFormat("npz", "NumPy arrays K, R, t, size, names, unit", _is_npz, _parse_npz),
    CalibrationFormat("json", "this package's JSON", _is_json, _parse_json),
    CalibrationFormat("human36m", "Human3.6M's JSON", _is_human36m, _parse_human36m, _OF_SUBJECT),
    CalibrationFormat("voxelpose", "VoxelPose's JSON", _is_voxelpose, _parse_voxelpose, ("size",)),
    CalibrationFormat("4d-association", "4D association's JSON", _is_association, _parse_association),
    CalibrationFormat("panoptic", "CMU Panoptic's JSON", _is_panoptic, _parse_panoptic, ("camera_type",)),
)
