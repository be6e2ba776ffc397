"""Qualisys Track Manager's ``.qca.txt``: XML, millimetres.

* ``focalLengthU/V`` and ``centerPointU/V`` are in 1/64 px of the whole sensor. The image is the part of it
  that ``fov_video`` names, so its left and top come off the principal point.
* ``radialDistortion1..3`` and ``tangentalDistortion1..2`` are OpenCV's k1, k2, k3, p1, p2. They have no
  dimension and are *not* divided by 64 (Pose2Sim divides them, which makes them nothing).
* ``transform`` is the camera's position in the world and a rotation ``r11`` … ``r33`` whose rows are the
  camera's axes x right, y up and z backward. World → camera is therefore diag(1, −1, −1)·r and −R·position.
* A video of fewer lines than the sensor is binned or scaled; ``video_resolution`` says so, but not how. The
  ``binning`` option does.

Marker cameras have no images, so that only video cameras are read (model ``…Video…``, or ``none`` in files
that other programs wrote), and of them those that are active and calibrated.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._entries import Element
from skelsplat.io.calibration._format import Array, Parsed, RawCamera, Source

_SUBPIXELS = 64.0
_FLIP = np.diag([1.0, -1.0, -1.0])
# 1088 lines are called 1080p
_SAME_LINES = 0.02


def matches(source: Source) -> bool:
    """Whether a document has Qualisys' cameras."""
    root = source.xml
    return root is not None and root.tag == "calibration" and root.find("cameras/camera") is not None


def parse(source: Source, camera_type: str | None, binning: float | None) -> Parsed:
    """Return the video cameras that are active and calibrated, or all."""
    nodes = [] if source.xml is None else source.xml.findall("cameras/camera")
    if not nodes:
        raise DatasetError(source.path, "cameras", "at least one <camera> in <calibration>", "none")
    chosen = [node for node in nodes if _is_wanted(node, camera_type)]
    if not chosen:
        models = sorted({node.get("model", "no model") for node in nodes})
        expected = 'an active, calibrated video camera (camera_type="all" takes every camera)'
        raise DatasetError(source.path, "model", expected, f"models {', '.join(models)}")
    cameras = [Element(source.path, f"camera {n.get('serial', i)}", n) for i, n in enumerate(chosen)]
    turned = [camera.place for camera in cameras if camera.node.get("viewrotation", "0") != "0"]
    message = (
        f"{source.path}: viewrotation: {', '.join(turned)} were rotated for display; the calibration is "
        "for images as the sensor records them, so the detections must come from unrotated images"
    )
    read = [_camera(camera, binning or _no_binning(camera)) for camera in cameras]
    return Parsed(read, "mm", [message] if turned else [])


def _is_wanted(node: ET.Element, camera_type: str | None) -> bool:
    if node.get("active", "1") == "0" or node.get("calibrated", "true").lower() == "false":
        return False
    model = node.get("model", "none").lower()
    return camera_type == "all" or "video" in model or model == "none"


def _camera(camera: Element, binning: float) -> RawCamera:
    """Return a camera whose image has `binning` sensor pixels per pixel."""
    left, top, right, bottom = _numbers(camera.child("fov_video"), "left", "top", "right", "bottom")
    size = np.array([right - left + 1.0, bottom - top + 1.0]) / binning
    if (size < 1.0).any() or np.abs(size - size.round()).max() > 1e-6:
        expected = "right − left + 1 and bottom − top + 1 to be whole pixels"
        raise camera.error("fov_video", expected, " by ".join(f"{length:g}" for length in size))
    transform = camera.child("transform")
    axes = _numbers(transform, *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)))
    rotation = _FLIP @ axes.reshape(3, 3)
    intrinsic = camera.child("intrinsic")
    return RawCamera(
        name=camera.text("serial"),
        K=_matrix(intrinsic, np.array([left, top]), binning),
        R=rotation,
        t=-rotation @ _numbers(transform, "x", "y", "z"),
        distortion=_lens(intrinsic),
        size=(round(size[0]), round(size[1])),
    )


def _numbers(element: Element, *names: str) -> Array:
    return np.array([element.number(name) for name in names])


def _matrix(intrinsic: Element, corner: Array, binning: float) -> Array:
    focal = _numbers(intrinsic, "focalLengthU", "focalLengthV") / _SUBPIXELS / binning
    centre = _numbers(intrinsic, "centerPointU", "centerPointV") / _SUBPIXELS - corner
    centre = (centre + 0.5) / binning - 0.5  # integers are pixel centres
    if _optional(intrinsic, "skew") != 0.0:
        raise intrinsic.error("skew", "0 (skew is not supported)", _optional(intrinsic, "skew"))
    return np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])


def _lens(intrinsic: Element) -> Array:
    k1, k2 = _numbers(intrinsic, "radialDistortion1", "radialDistortion2")
    p1, p2 = _numbers(intrinsic, "tangentalDistortion1", "tangentalDistortion2")
    return np.array([k1, k2, p1, p2, _optional(intrinsic, "radialDistortion3")])


def _optional(intrinsic: Element, name: str) -> float:
    return 0.0 if intrinsic.node.get(name) is None else intrinsic.number(name)


def _no_binning(camera: Element) -> float:
    """Return 1; it is an error if ``video_resolution`` is not the sensor's."""
    resolution = camera.node.get("video_resolution", "")
    lines = re.fullmatch(r"(\d+)p", resolution)
    sensor = [camera.node.find(tag) for tag in ("fov_video_max", "fov_marker_max")]
    ends = [float(node.get("bottom", "nan")) + 1.0 for node in sensor if node is not None]
    if lines and ends and abs(float(lines[1]) / ends[0] - 1.0) > _SAME_LINES:
        expected = f"the sensor's {ends[0]:.0f} lines, or the option binning (sensor px per image px)"
        raise camera.error("video_resolution", expected, resolution)
    return 1.0
