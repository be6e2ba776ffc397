"""Caliscope's own ``camera_array.toml``: one table ``[cameras.N]`` per camera, metres.

Like the Anipose family, but the tables lie under ``cameras``, the name is ``cam_id`` (older files: ``port``),
``rotation`` is a Rodrigues vector or, in older files, a matrix 3×3, and both it and ``translation`` are null
before the cameras were calibrated together. Cameras with ``ignore = true`` are passed over.
``rotation_count`` turns Caliscope's display, not the pixels that were calibrated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._anipose import looks_like_toml
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera
from skelsplat.io.calibration._rotation import matrix_from_vector

if TYPE_CHECKING:
    from skelsplat.io.calibration._raw import Array, Options
    from skelsplat.io.calibration._source import Source


def _matches(source: Source) -> bool:
    return "cameras." in source.text and looks_like_toml(source.text) and _tables(source) is not None


def _tables(source: Source) -> dict[str, Any] | None:
    tables = source.toml.get("cameras")
    return tables if isinstance(tables, dict) and tables else None


def _parse(source: Source, options: Options) -> Parsed:  # noqa: ARG001
    tables = _tables(source)
    if tables is None:
        raise DatasetError(
            source.path, "cameras", "tables [cameras.N]", f"tables {', '.join(source.toml) or 'none'}"
        )
    top = Entry(source.path, "cameras", tables)
    entries = [entry for entry in map(top.entry, tables) if not entry.flag("ignore")]
    if not entries:
        raise DatasetError(source.path, "cameras", "a camera without ignore = true", "none")
    return Parsed([_camera(entry) for entry in entries], "m")


def _camera(entry: Entry) -> RawCamera:
    if entry.values.get("rotation") in (None, "null") or entry.values.get("translation") in (None, "null"):
        expected = "a camera that is calibrated with the others, or ignore = true"
        raise entry.error("rotation", expected, "no rotation and translation")
    fisheye = entry.flag("fisheye")
    return RawCamera(
        table=entry.key,
        name=_name(entry),
        K=entry.numbers("matrix", (3, 3)),
        R=_rotation(entry),
        t=entry.numbers("translation", (3,)),
        distortion=entry.distortion("distortions", fisheye=fisheye),
        fisheye=fisheye,
        size=entry.size("size"),
    )


def _name(entry: Entry) -> str:
    """Name of Caliscope's videos: ``cam_N``, or ``port_N`` in older versions."""
    if "port" in entry.values and "cam_id" not in entry.values:
        return f"port_{entry.text('port')}"
    return f"cam_{entry.text('cam_id')}"


def _rotation(entry: Entry) -> Array:
    if np.shape(entry.values["rotation"])[:1] == (3,) and np.ndim(entry.values["rotation"]) == 2:
        return entry.numbers("rotation", (3, 3))
    return matrix_from_vector(entry.numbers("rotation", (3,)))


CALISCOPE = CalibrationFormat("caliscope", "Caliscope's camera_array.toml", _matches, _parse)
