"""TOML calibrations of the Anipose family: Anipose, Pose2Sim, FreeMoCap and Caliscope's export.

One table per camera with ``matrix`` 3×3, ``rotation`` (Rodrigues, radians) and ``translation``, both
world → camera, ``size`` (width, height), ``distortions`` (a camera without them has no lens, which is warned
of), and optionally ``fisheye``, ``name``. Other tables are passed over. The format has no place for the
length unit; files that this package wrote state it as ``unit`` under ``metadata``.
"""

from __future__ import annotations

import re
import warnings
from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera
from skelsplat.io.calibration._rotation import matrix_from_vector

if TYPE_CHECKING:
    from skelsplat.io.calibration._raw import Options
    from skelsplat.io.calibration._source import Source

_REQUIRED = ("matrix", "rotation", "translation")
_LENS = ("distortion", "distortions")
_NOT_CAMERAS = frozenset({"metadata", "capture_volume", "charuco", "checkerboard"})


def looks_like_toml(text: str) -> bool:
    """Whether the text has a TOML table header or an assignment at the start of a line."""
    return re.search(r"^\s*(\[[^\[\]\n]+\]\s*(#.*)?$|[\w.\"-]+\s*=)", text, re.MULTILINE) is not None


def _matches(source: Source) -> bool:
    return not source.start.startswith(("<", "{", "%YAML")) and looks_like_toml(source.text)


def _parse(source: Source, options: Options) -> Parsed:  # noqa: ARG001  the signature of a format
    """Return the cameras of the file in its order; at least one, or `DatasetError`."""
    document = source.toml
    tables = [(key, value) for key, value in document.items() if _is_camera(key, value)]
    if not tables:
        expected = "at least one camera table with matrix, rotation and translation"
        raise DatasetError(source.path, "cameras", expected, f"tables {', '.join(document) or 'none'}")
    without = [str(value.get("name", key)) for key, value in tables if value.keys().isdisjoint(_LENS)]
    if without:
        text = f"{source.path}: no distortions for {', '.join(without)}: read as without a lens"
        warnings.warn(text, UserWarning, stacklevel=4)
    return Parsed([_camera(Entry(source.path, key, value)) for key, value in tables], _unit(document))


def _is_camera(key: str, value: object) -> bool:
    """Whether a top-level entry is a camera.

    One of the three required keys is enough: a camera that lacks another is an error, not a table to skip.
    """
    return key not in _NOT_CAMERAS and isinstance(value, dict) and any(name in value for name in _REQUIRED)


def _unit(document: dict[str, Any]) -> str | None:
    metadata = document.get("metadata")
    unit = metadata.get("unit") if isinstance(metadata, dict) else None
    return unit if unit in ("mm", "cm", "m") else None


def _camera(entry: Entry) -> RawCamera:
    matrix = entry.numbers("matrix", (3, 3))
    rotation = entry.numbers("rotation", (3,))
    translation = entry.numbers("translation", (3,))
    fisheye = entry.flag("fisheye")
    lens = next((name for name in _LENS if name in entry.values), None)
    size = "size" if "size" in entry.values or "image_size" not in entry.values else "image_size"
    return RawCamera(
        table=entry.key,
        name=str(entry.values.get("name", entry.key)),
        K=matrix,
        R=matrix_from_vector(rotation),
        t=translation,
        distortion=None if lens is None else entry.distortion(lens, fisheye=fisheye),
        fisheye=fisheye,
        size=entry.size(size),
    )


ANIPOSE = CalibrationFormat("anipose", "TOML of Anipose, Pose2Sim, FreeMoCap, Caliscope", _matches, _parse)
