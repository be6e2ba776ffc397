"""The package's own calibration files, JSON and npz: every field of a rig, and its unit.

JSON::

    {"format": "skelsplat-calibration", "version": 1, "unit": "mm",
     "cameras": [{"name": "cam_01", "size": [1920, 1080], "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
                  "R": [[…], […], […]], "t": [x, y, z],
                  "distortion": [k1, k2, p1, p2, …] or null, "fisheye": false}, …]}

npz, M cameras: ``K (M,3,3)``, ``R (M,3,3)``, ``t (M,3)``, ``size (M,2)``, ``names (M,)``, ``unit ()`` and,
optionally, ``distortion (M,n)``, padded with NaN (a row of NaN: no distortion), and ``fisheye (M,)``.

R and t are world → camera, x_c = R x_w + t, K and size are pixels, distortion is in OpenCV's order.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import load_plain_npz
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera

if TYPE_CHECKING:
    from pathlib import Path

    import skelsplat as sk
    from skelsplat.io.calibration._raw import Array, Options
    from skelsplat.io.calibration._source import Source

_MARK = "skelsplat-calibration"
_VERSION = 1
_UNITS = ("mm", "cm", "m")
_NPZ_KIND = "an npz archive of plain arrays"
_NPZ_REQUIRED = ("K", "R", "t", "size", "names", "unit")


def _is_json(source: Source) -> bool:
    return isinstance(source.json, dict) and source.json.get("format") == _MARK


def _parse_json(source: Source, options: Options) -> Parsed:  # noqa: ARG001
    document = source.json if isinstance(source.json, dict) else {}
    top = Entry(source.path, "", document)
    if document.get("format") != _MARK:
        raise top.error("format", f'"{_MARK}"', repr(document.get("format")))
    if document.get("version") != _VERSION:
        raise top.error("version", str(_VERSION), repr(document.get("version")))
    unit = _checked_unit(source.path, document.get("unit"))
    return Parsed([_camera(entry) for entry in _entries(top)], unit)


def _entries(top: Entry) -> list[Entry]:
    cameras = top.values.get("cameras")
    if not isinstance(cameras, list) or not cameras:
        actual = "an empty list" if cameras == [] else type(cameras).__name__
        raise top.error("cameras", "a list of at least one camera", actual)
    for i, values in enumerate(cameras):
        if not isinstance(values, dict):
            raise top.error(f"cameras[{i}]", "an object with the fields of a camera", type(values).__name__)
    return [Entry(top.path, f"cameras[{i}]", values) for i, values in enumerate(cameras)]


def _camera(entry: Entry) -> RawCamera:
    fisheye = entry.flag("fisheye")
    return entry.camera(distortion="distortion", size="size", fisheye=fisheye)


def _checked_unit(path: Path, unit: object) -> str:
    if unit not in _UNITS:
        raise DatasetError(path, "unit", '"mm", "cm" or "m"', repr(unit))
    return str(unit)


def to_json(rig: sk.CameraRig) -> str:
    """Return the rig as JSON text; numbers have all their digits."""
    cameras = [
        {
            "name": name,
            "size": list(camera.size),
            "K": np.asarray(camera.K).tolist(),
            "R": np.asarray(camera.R).tolist(),
            "t": np.asarray(camera.t).tolist(),
            "distortion": None if camera.distortion is None else np.asarray(camera.distortion).tolist(),
            "fisheye": camera.fisheye,
        }
        for name, camera in zip(rig.names, rig, strict=True)
    ]
    document = {"format": _MARK, "version": _VERSION, "unit": rig.unit, "cameras": cameras}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _is_npz(source: Source) -> bool:
    return (
        source.suffix == ".npz"
        and not source.is_folder
        and {"K", "R", "t"} <= set(load_plain_npz(source.path, _NPZ_KIND))
    )


def _parse_npz(source: Source, options: Options) -> Parsed:  # noqa: ARG001
    arrays = load_plain_npz(source.path, _NPZ_KIND)
    missing = [name for name in _NPZ_REQUIRED if name not in arrays]
    if missing:
        raise DatasetError(
            source.path, missing[0], f"the arrays {', '.join(_NPZ_REQUIRED)}", f"no {', '.join(missing)}"
        )
    unit = _checked_unit(source.path, str(arrays["unit"]))
    names = np.atleast_1d(arrays["names"])
    shapes = {"K": (3, 3), "R": (3, 3), "t": (3,), "size": (2,), "fisheye": ()}
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != (len(names), *shape):
            raise DatasetError(source.path, name, f"shape {(len(names), *shape)}", arrays[name].shape)
    lenses = arrays.get("distortion", np.full((len(names), 4), np.nan))
    if lenses.ndim != 2 or len(lenses) != len(names):
        raise DatasetError(source.path, "distortion", f"shape ({len(names)}, n)", lenses.shape)
    fisheye = arrays.get("fisheye", np.zeros(len(names), dtype=bool))
    rows = [
        {
            "name": _name(source.path, i, names[i]),
            "fisheye": bool(fisheye[i]),
            "distortion": _unpadded(source.path, i, lenses[i]),
            **{name: arrays[name][i].tolist() for name in ("K", "R", "t", "size")},
        }
        for i in range(len(names))
    ]
    return Parsed([_camera(Entry(source.path, f"[{i}]", row)) for i, row in enumerate(rows)], unit)


def _name(path: Path, index: int, value: object) -> str:
    """Return a camera's name, which may be of bytes."""
    if not isinstance(value, bytes):
        return str(value)
    try:
        return value.decode()
    except UnicodeDecodeError:
        raise DatasetError(path, f"names[{index}]", "a name in UTF-8", repr(bytes(value))) from None


def _unpadded(path: Path, index: int, row: Array) -> list[float] | None:
    known = np.isfinite(row)
    if not known.any():
        return None
    if not known[: known.sum()].all():
        raise DatasetError(path, f"distortion[{index}]", "coefficients first, then NaN", row)
    values: list[float] = row[known].tolist()
    return values


def to_arrays(rig: sk.CameraRig) -> dict[str, Any]:
    """Return the rig as the arrays of an npz."""
    lenses = [np.empty(0) if c.distortion is None else np.asarray(c.distortion) for c in rig]
    padded = np.full((len(rig), max([4, *(lens.size for lens in lenses)])), np.nan)
    for row, lens in zip(padded, lenses, strict=True):
        row[: lens.size] = lens
    return {
        "K": np.stack([camera.K for camera in rig]),
        "R": np.stack([camera.R for camera in rig]),
        "t": np.stack([camera.t for camera in rig]),
        "size": np.array([camera.size for camera in rig], dtype=np.int64),
        "names": np.array(rig.names),
        "unit": np.array(rig.unit),
        "distortion": padded,
        "fisheye": np.array([camera.fisheye for camera in rig]),
    }


JSON = CalibrationFormat("json", "this package's JSON", _is_json, _parse_json)
NPZ = CalibrationFormat("npz", "NumPy npz with K, R, t, size, names, unit", _is_npz, _parse_npz)
