"""CMU Panoptic's ``calibration_SEQUENCE.json``: centimetres, world → camera, y down in the world.

``cameras`` is a list of ``name`` (``"00_03"``), ``type`` (``hd``, ``vga``, ``kinect-color``, …),
``resolution`` (width, height), ``K`` 3×3, ``distCoef`` (k1, k2, p1, p2, k3), ``R`` 3×3 and ``t`` 3×1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed

if TYPE_CHECKING:
    from skelsplat.io.calibration._raw import Options
    from skelsplat.io.calibration._source import Source

_DEFAULT_TYPE = "hd"


def _matches(source: Source) -> bool:
    document = source.json
    cameras = document.get("cameras") if isinstance(document, dict) else None
    return (
        isinstance(cameras, list)
        and "format" not in document
        and any(isinstance(camera, dict) and "distCoef" in camera for camera in cameras)
    )


def _parse(source: Source, options: Options) -> Parsed:
    document = source.json
    cameras = document.get("cameras") if isinstance(document, dict) else None
    if not isinstance(cameras, list) or not cameras:
        raise DatasetError(source.path, "cameras", "a list of cameras", type(cameras).__name__)
    wanted = options.camera_type or _DEFAULT_TYPE
    entries = []
    for index, values in enumerate(cameras):
        if not isinstance(values, dict):
            raise DatasetError(source.path, f"cameras[{index}]", "a camera's fields", type(values).__name__)
        entry = Entry(source.path, f"cameras[{index}]", values)
        if wanted == "all" or entry.text("type") == wanted:
            entries.append(entry)
    if not entries:
        types = sorted({str(values.get("type")) for values in cameras})
        raise DatasetError(source.path, "type", f"cameras of type {wanted}", f"types {', '.join(types)}")
    return Parsed([entry.camera(distortion="distCoef", size="resolution") for entry in entries], "cm")


PANOPTIC = CalibrationFormat(
    "panoptic", "CMU Panoptic calibration JSON", _matches, _parse, frozenset({"camera_type"})
)
