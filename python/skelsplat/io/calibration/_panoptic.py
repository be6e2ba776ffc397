"""CMU Panoptic's ``calibration_SEQUENCE.json``: centimetres, world → camera, y down in the world.

``cameras`` is a list of ``name`` (``"00_03"``), ``type`` (``hd``, ``vga``, ``kinect-color``, …),
``resolution`` (width, height), ``K`` 3×3, ``distCoef`` (k1, k2, p1, p2, k3), ``R`` 3×3 and ``t`` 3×1.
"""

from __future__ import annotations

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._entries import camera_of
from skelsplat.io.calibration._format import Parsed, Source

_DEFAULT_TYPE = "hd"


def matches(source: Source) -> bool:
    """Whether a document has a list of cameras with Panoptic's name for the lens."""
    cameras = source.json["cameras"].value
    return (
        isinstance(cameras, list)
        and "format" not in source.json
        and any(isinstance(camera, dict) and "distCoef" in camera for camera in cameras)
    )


def parse(source: Source, camera_type: str | None) -> Parsed:
    """Return the cameras of the type that is asked for."""
    wanted = camera_type or _DEFAULT_TYPE
    cameras = source.json["cameras"].entries("a list of cameras")
    for camera in cameras:
        if not isinstance(camera.value, dict):
            raise camera.error("a camera's fields", type(camera.value).__name__)
    chosen = [camera for camera in cameras if wanted == "all" or camera["type"].text() == wanted]
    if not chosen:
        types = sorted({str(camera.value.get("type")) for camera in cameras})
        actual = f"types {', '.join(types) or 'none'}"
        raise DatasetError(source.path, "type", f"cameras of type {wanted}", actual)
    return Parsed([camera_of(entry, distortion="distCoef", size="resolution") for entry in chosen], "cm")
