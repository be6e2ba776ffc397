"""Vicon's ``.xcp``: XML, millimetres.

``Camera`` has ``DEVICEID`` (the camera's name here), ``TYPE``, ``SENSOR_SIZE`` and ``PIXEL_ASPECT_RATIO``;
its first ``KeyFrame`` has ``FOCAL_LENGTH`` in px, ``PRINCIPAL_POINT``, ``ORIENTATION``, a quaternion (x, y,
z, w: scalar last) that turns world into camera, ``POSITION`` of the camera in the world, and the lens as
``VICON_RADIAL2`` (model's name, centre x y, k1 k2 k3) or, in older files, ``VICON_RADIAL`` (k1 k2 about the
principal point); a camera with neither is refused. `_vicon_lens` makes OpenCV's coefficients of it.

Marker cameras have no images: only cameras whose ``TYPE`` has "video" in it are read.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration import _vicon_lens, _xml
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera
from skelsplat.io.calibration._rotation import matrix_from_quaternion

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET
    from pathlib import Path

    from skelsplat.io.calibration._raw import Array, Options
    from skelsplat.io.calibration._source import Source

# a fit this good is lost in any detector's noise
_GOOD_FIT_PX = 0.1
_UNIT_NORM = 1e-3


def _matches(source: Source) -> bool:
    return source.xml is not None and source.xml.tag == "Cameras"


def _parse(source: Source, options: Options) -> Parsed:
    root = source.xml
    nodes = [] if root is None else root.findall("Camera")
    if not nodes:
        raise DatasetError(source.path, "Cameras", "at least one <Camera> in <Cameras>", "none")
    chosen = [n for n in nodes if options.camera_type == "all" or "video" in n.get("TYPE", "").lower()]
    if not chosen:
        types = sorted({node.get("TYPE", "none") for node in nodes})
        expected = 'a camera whose TYPE has "video" in it (camera_type="all" takes every camera)'
        raise DatasetError(source.path, "TYPE", expected, f"types {', '.join(types)}")
    return Parsed([_camera(source.path, node, i) for i, node in enumerate(chosen)], "mm")


def _camera(path: Path, node: ET.Element, index: int) -> RawCamera:
    key = f"Camera {node.get('DEVICEID', index)}"
    width, height = _xml.numbers(path, key, node, "SENSOR_SIZE", 2)
    if min(width, height) < 1 or not (width.is_integer() and height.is_integer()):
        raise DatasetError(
            path, f"{key}.SENSOR_SIZE", "a positive whole width and height", f"{width:g} {height:g}"
        )
    size = int(width), int(height)
    aspect = float(_xml.numbers(path, key, node, "PIXEL_ASPECT_RATIO", 1)[0])
    if not aspect > 0.0:
        raise DatasetError(path, f"{key}.PIXEL_ASPECT_RATIO", "a positive number", f"{aspect:g}")
    if node.get("SKEW") is not None and _xml.numbers(path, key, node, "SKEW", 1)[0] != 0.0:
        raise DatasetError(path, f"{key}.SKEW", "0 (skew is not supported)", node.get("SKEW"))
    frame = _xml.child(path, key, node, "KeyFrames/KeyFrame")
    focal = float(_xml.numbers(path, key, frame, "FOCAL_LENGTH", 1)[0])
    principal = _xml.numbers(path, key, frame, "PRINCIPAL_POINT", 2)
    K = np.array([[focal, 0.0, principal[0]], [0.0, focal / aspect, principal[1]], [0.0, 0.0, 1.0]])
    if not focal > 0.0:
        raise DatasetError(path, f"{key}.FOCAL_LENGTH", "a positive number", f"{focal:g}")
    quaternion = _xml.numbers(path, key, frame, "ORIENTATION", 4)
    if abs(np.linalg.norm(quaternion) - 1.0) > _UNIT_NORM:
        raise DatasetError(path, f"{key}.ORIENTATION", "a quaternion of norm 1", quaternion)
    x, y, z, w = quaternion
    R = matrix_from_quaternion(np.array([w, x, y, z]))
    return RawCamera(
        table=key,
        name=_xml.attribute(path, key, node, "DEVICEID"),
        K=K,
        R=R,
        t=-R @ _xml.numbers(path, key, frame, "POSITION", 3),
        distortion=_lens(path, key, frame, K, size, aspect),
        fisheye=False,
        size=size,
    )


def _lens(
    path: Path, key: str, frame: ET.Element, K: Array, size: tuple[int, int], aspect: float
) -> Array | None:
    """OpenCV's coefficients of the camera's radial model; None without one or with zeros."""
    centre, radial, field = _radial(path, key, frame, K[:2, 2])
    if not radial.any():
        return None
    if not _vicon_lens.is_plausible(size, centre, radial, aspect):
        expected = "coefficients in 1/px², 1/px⁴ and 1/px⁶, as of a lens"
        raise DatasetError(path, f"{key}.{field}", expected, " ".join(f"{k:g}" for k in radial))
    coefficients, error = _vicon_lens.fit(K, size, centre, radial, aspect)
    if error > _GOOD_FIT_PX:
        message = (
            f"{path}: {key}.{field}: OpenCV's lens model follows Vicon's to {error:.2g} px at worst "
            "(towards the corners of the image)"
        )
        warnings.warn(message, UserWarning, stacklevel=6)
    return coefficients


def _radial(path: Path, key: str, frame: ET.Element, principal: Array) -> tuple[Array, Array, str]:
    """Centre (2,), coefficients and the name of the attribute that they come from."""
    text = frame.get("VICON_RADIAL2")
    if text is None:
        if frame.get("VICON_RADIAL") is None:  # a misspelt name must not pass for a camera without a lens
            expected = "lens coefficients, here or in VICON_RADIAL, zeros for no lens"
            raise DatasetError(path, f"{key}.VICON_RADIAL2", expected, "none")
        return principal, _xml.numbers(path, key, frame, "VICON_RADIAL", 2), "VICON_RADIAL"
    field = f"{key}.VICON_RADIAL2"
    parts = text.split()
    try:
        values = np.array([float(part) for part in parts[1:]])
    except ValueError:
        values = np.empty(0)
    if values.size != 5 or not np.isfinite(values).all():
        raise DatasetError(path, field, "a name, then cx cy k1 k2 k3", repr(text))
    return values[:2], values[2:], "VICON_RADIAL2"


VICON = CalibrationFormat("vicon", "Vicon .xcp", _matches, _parse, frozenset({"camera_type"}))
