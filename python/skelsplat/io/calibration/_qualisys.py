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
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration import _xml
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET
    from pathlib import Path

    from skelsplat.io.calibration._raw import Array, Options
    from skelsplat.io.calibration._source import Source

_SUBPIXELS = 64.0
_FLIP = np.diag([1.0, -1.0, -1.0])
# 1088 lines are called 1080p
_SAME_LINES = 0.02


def _matches(source: Source) -> bool:
    root = source.xml
    return root is not None and root.tag == "calibration" and root.find("cameras/camera") is not None


def _parse(source: Source, options: Options) -> Parsed:
    root = source.xml
    nodes = [] if root is None else root.findall("cameras/camera")
    if not nodes:
        raise DatasetError(source.path, "cameras", "at least one <camera> in <calibration>", "none")
    chosen = [node for node in nodes if _is_wanted(node, options.camera_type)]
    if not chosen:
        models = sorted({node.get("model", "no model") for node in nodes})
        expected = 'an active, calibrated video camera (camera_type="all" takes every camera)'
        raise DatasetError(source.path, "model", expected, f"models {', '.join(models)}")
    cameras = [_Camera(source.path, _key(node, i), node) for i, node in enumerate(chosen)]
    turned = [camera.key for camera in cameras if camera.node.get("viewrotation", "0") != "0"]
    if turned:
        message = (
            f"{source.path}: viewrotation: {', '.join(turned)} were turned for display; the calibration is "
            "that of the image as the sensor has it, so the detections must come from images not turned"
        )
        warnings.warn(message, UserWarning, stacklevel=4)
    return Parsed([camera.read(options.binning) for camera in cameras], "mm")


def _is_wanted(node: ET.Element, camera_type: str | None) -> bool:
    if node.get("active", "1") == "0" or node.get("calibrated", "true").lower() == "false":
        return False
    model = node.get("model", "none").lower()
    return camera_type == "all" or "video" in model or model == "none"


def _key(node: ET.Element, index: int) -> str:
    return f"camera {node.get('serial', index)}"


@dataclass(frozen=True)
class _Camera:
    """One ``<camera>`` element; `key` names it in messages."""

    path: Path
    key: str
    node: ET.Element

    def read(self, binning: float | None) -> RawCamera:
        factor = self._binning(binning)
        left, top, right, bottom = self._numbers("fov_video", ("left", "top", "right", "bottom"))
        size = np.array([right - left + 1.0, bottom - top + 1.0]) / factor
        if (size < 1.0).any() or np.abs(size - size.round()).max() > 1e-6:
            expected = "right − left + 1 and bottom − top + 1 to be whole pixels"
            actual = " by ".join(f"{length:g}" for length in size)
            raise DatasetError(self.path, f"{self.key}.fov_video", expected, actual)
        position = self._numbers("transform", ("x", "y", "z"))
        axes = self._numbers("transform", [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)])
        rotation = _FLIP @ axes.reshape(3, 3)
        return RawCamera(
            table=self.key,
            name=_xml.attribute(self.path, self.key, self.node, "serial"),
            K=self._matrix(np.array([left, top]), factor),
            R=rotation,
            t=-rotation @ position,
            distortion=self._lens(),
            fisheye=False,
            size=(round(size[0]), round(size[1])),
        )

    def _numbers(self, tag: str, names: tuple[str, ...] | list[str]) -> Array:
        node = _xml.child(self.path, self.key, self.node, tag)
        key = f"{self.key}.{tag}"
        return np.concatenate([_xml.numbers(self.path, key, node, name, 1) for name in names])

    def _matrix(self, corner: Array, factor: float) -> Array:
        focal = self._numbers("intrinsic", ("focalLengthU", "focalLengthV")) / _SUBPIXELS / factor
        centre = self._numbers("intrinsic", ("centerPointU", "centerPointV")) / _SUBPIXELS - corner
        centre = (centre + 0.5) / factor - 0.5  # integers are pixel centres
        if self._optional("skew") != 0.0:
            field = f"{self.key}.intrinsic.skew"
            raise DatasetError(self.path, field, "0 (skew is not supported)", self._optional("skew"))
        return np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])

    def _lens(self) -> Array:
        k1, k2 = self._numbers("intrinsic", ("radialDistortion1", "radialDistortion2"))
        p1, p2 = self._numbers("intrinsic", ("tangentalDistortion1", "tangentalDistortion2"))
        return np.array([k1, k2, p1, p2, self._optional("radialDistortion3")])

    def _optional(self, name: str) -> float:
        node = _xml.child(self.path, self.key, self.node, "intrinsic")
        if node.get(name) is None:
            return 0.0
        return float(_xml.numbers(self.path, f"{self.key}.intrinsic", node, name, 1)[0])

    def _binning(self, given: float | None) -> float:
        """Sensor pixels per image pixel; it must be given where ``video_resolution`` is not the sensor's."""
        if given is not None:
            return given
        resolution = self.node.get("video_resolution", "")
        lines = re.fullmatch(r"(\d+)p", resolution)
        sensor = [self.node.find(tag) for tag in ("fov_video_max", "fov_marker_max")]
        ends = [float(node.get("bottom", "nan")) + 1.0 for node in sensor if node is not None]
        if lines and ends and abs(float(lines[1]) / ends[0] - 1.0) > _SAME_LINES:
            expected = f"the sensor's {ends[0]:.0f} lines, or the option binning (sensor px per image px)"
            raise DatasetError(self.path, f"{self.key}.video_resolution", expected, resolution)
        return 1.0


QUALISYS = CalibrationFormat(
    "qualisys",
    "Qualisys .qca.txt",
    _matches,
    _parse,
    frozenset({"camera_type", "binning"}),
)
