"""Calibrations in XML: Qualisys Track Manager's ``.qca.txt``, and Theia3D's, which look alike."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import Parsed, RawCamera, Source, noted, whole_size


def tree(node: ET.Element) -> dict[str, Any]:
    """Return an XML element as a table: its attributes, and the first element of each name beneath it."""
    return {**{inner.tag: tree(inner) for inner in reversed(node)}, **node.attrib}


def child(entry: Field, tag: str) -> Field:
    """Return an element that must be there."""
    return entry.member(tag, f"an element <{tag}>")


def numbers(entry: Field, name: str, count: int) -> Array:
    """Return `count` finite numbers of an attribute, separated by blanks."""
    text = entry.member(name, "an attribute").value
    values = parsed(text.split())
    if values.size != count or not np.isfinite(values).all():
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        raise entry[name].error(expected, repr(text))
    return values


def number(entry: Field, name: str, default: float | None = None) -> float:
    """Return the one finite number of an attribute; if it is missing, the default, if there is one."""
    if default is not None and name not in entry:
        return default
    return float(numbers(entry, name, 1)[0])


def _row(entry: Field, *names: str) -> Array:
    return np.array([number(entry, name) for name in names])


def parsed(words: Sequence[str]) -> Array:
    """Return numbers; none of them if a word is no number."""
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return np.empty(0)


_SUBPIXELS = 64.0
_FLIP = np.diag([1.0, -1.0, -1.0])
# of the longer side of the image: fields of view of 157° and 2°
_SHORTEST, _LONGEST = 0.1, 30.0
# 1088 lines are called 1080p
_SAME_LINES = 0.02


def is_qualisys(source: Source) -> bool:
    """Whether a document has Qualisys' cameras."""
    root = source.xml
    return root is not None and root.tag == "calibration" and root.find("cameras/camera") is not None


def parse_qualisys(source: Source, camera_type: str | None, binning: float | None) -> Parsed:
    """Return the video cameras that are active and calibrated, or all; millimetres.

    * ``focalLengthU/V`` and ``centerPointU/V`` are in 1/64 px of the whole sensor; in files of some programs
      in px, which the place of the centre shows. The image is the part of the sensor that ``fov_video``
      names, so its left and top come off the principal point.
    * ``radialDistortion1..3`` and ``tangentalDistortion1..2`` are OpenCV's k1, k2, k3, p1, p2. They have no
      dimension and are *not* divided by 64 (Pose2Sim divides them, which makes them nothing).
    * ``transform`` is the camera's position in the world and a rotation ``r11`` … ``r33`` whose rows are the
      camera's axes x right, y up and z backward. World → camera is therefore diag(1, −1, −1)·r and
      −R·position.
    * A video of fewer lines than the sensor is binned or scaled; ``video_resolution`` says so, but not how.
      The ``binning`` option does.

    Marker cameras have no images, so that only video cameras are read (model ``…Video…``, or ``none`` in
    files that other programs wrote), and of them those that are active and calibrated.
    """
    nodes = [] if source.xml is None else source.xml.findall("cameras/camera")
    if not nodes:
        raise DatasetError(source.path, "cameras", "at least one <camera> in <calibration>", "none")
    chosen = [node for node in nodes if _is_wanted(node, camera_type)]
    if not chosen:
        models = sorted({node.get("model", "no model") for node in nodes})
        expected = 'an active, calibrated video camera (camera_type="all" takes every camera)'
        raise DatasetError(source.path, "model", expected, f"models {', '.join(models)}")
    cameras = [Field(source.path, f"camera {n.get('serial', i)}", tree(n)) for i, n in enumerate(chosen)]
    turned = [one.value.get("serial", "") for one in cameras if one.value.get("viewrotation", "0") != "0"]
    whole = [_parts_of_pixel(camera) == 1.0 for camera in cameras]
    read = [_qualisys_camera(camera, binning or _no_binning(camera)) for camera in cameras]
    found = [noted("view_rotated", source.path, *turned)] if turned else []
    if any(whole):
        names = [camera.name for camera, is_whole in zip(read, whole, strict=True) if is_whole]
        found.append(noted("focal_in_pixels", source.path, *names))
    return Parsed(read, "mm", found)


def _is_wanted(node: ET.Element, camera_type: str | None) -> bool:
    if node.get("active", "1") == "0" or node.get("calibrated", "true").lower() == "false":
        return False
    model = node.get("model", "none").lower()
    return camera_type == "all" or "video" in model or model == "none"


def _qualisys_camera(camera: Field, binning: float) -> RawCamera:
    """Return a camera whose image has `binning` sensor pixels per pixel."""
    left, top, right, bottom = _row(child(camera, "fov_video"), "left", "top", "right", "bottom")
    size = np.array([right - left + 1.0, bottom - top + 1.0]) / binning
    if (size < 1.0).any() or np.abs(size - size.round()).max() > 1e-6:
        expected = "right − left + 1 and bottom − top + 1 to be whole pixels"
        raise camera["fov_video"].error(expected, " by ".join(f"{length:g}" for length in size))
    transform = child(camera, "transform")
    axes = _row(transform, *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)))
    rotation = _FLIP @ axes.reshape(3, 3)
    intrinsic = child(camera, "intrinsic")
    return RawCamera(
        name=camera.member("serial", "an attribute").value,
        K=_matrix(intrinsic, np.array([left, top]), binning, _parts_of_pixel(camera)),
        R=rotation,
        t=-rotation @ _row(transform, "x", "y", "z"),
        distortion=_lens(intrinsic),
        size=(round(size[0]), round(size[1])),
    )


def _lens(intrinsic: Field) -> Array:
    k1, k2 = _row(intrinsic, "radialDistortion1", "radialDistortion2")
    p1, p2 = _row(intrinsic, "tangentalDistortion1", "tangentalDistortion2")
    return np.array([k1, k2, p1, p2, number(intrinsic, "radialDistortion3", 0.0)])


def _parts_of_pixel(camera: Field) -> float:
    """Return 64, or 1 for a camera whose focal length and centre are in px.

    In 1/64 px, a centre below twice the sensor's size would be within a 32nd of its upper left corner.
    """
    sensor = _row(child(camera, "fov_video"), "right", "bottom") + 1.0
    intrinsic = child(camera, "intrinsic")
    focal = _row(intrinsic, "focalLengthU", "focalLengthV")
    parts = 1.0 if (_row(intrinsic, "centerPointU", "centerPointV") < 2.0 * sensor).all() else _SUBPIXELS
    lengths = focal / parts / sensor.max()
    if (lengths < _SHORTEST).any() or (lengths > _LONGEST).any():
        name = "px, as the centre is" if parts == 1.0 else "1/64 px, as the centre is"
        expected = f"a focal length in {name}, of {_SHORTEST} to {_LONGEST:g} times the longer side"
        raise intrinsic["focalLengthU"].error(expected, f"{focal[0]:g}, that is {focal[0] / parts:.3g} px")
    return parts


def _matrix(intrinsic: Field, corner: Array, binning: float, parts: float) -> Array:
    focal = _row(intrinsic, "focalLengthU", "focalLengthV") / parts / binning
    centre = _row(intrinsic, "centerPointU", "centerPointV") / parts - corner
    centre = (centre + 0.5) / binning - 0.5  # integers are pixel centres
    if number(intrinsic, "skew", 0.0) != 0.0:
        raise intrinsic["skew"].error("0 (skew is not supported)", intrinsic["skew"].value)
    return np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])


def _no_binning(camera: Field) -> float:
    """Return 1; it is an error if ``video_resolution`` is not the sensor's."""
    resolution = camera.value.get("video_resolution", "")
    lines = re.fullmatch(r"(\d+)p", resolution)
    sensor = [camera[tag] for tag in ("fov_video_max", "fov_marker_max") if tag in camera]
    ends = [float(area.value.get("bottom", "nan")) + 1.0 for area in sensor]
    if lines and ends and abs(float(lines[1]) / ends[0] - 1.0) > _SAME_LINES:
        expected = f"the sensor's {ends[0]:.0f} lines, or the option binning (sensor px per image px)"
        raise camera["video_resolution"].error(expected, resolution)
    return 1.0


# of a sensor in px; in 1/64 px, a larger one than that would have 312 px
_MOST_PIXELS = 20_000.0


def is_theia(source: Source) -> bool:
    """Whether a document looks like Qualisys', but has no fields of view and sensors in px."""
    root = source.xml
    if root is None or root.tag != "calibration" or root.find("cameras/camera/fov_video") is not None:
        return False
    sensors = [node.get("sensorMaxU", node.get("sensorDimU", "")) for node in root.iter("intrinsic")]
    sizes = parsed(sensors)
    return sizes.size > 0 and bool((sizes < _MOST_PIXELS).all())


def parse_theia(source: Source) -> Parsed:
    """Return the active cameras of Theia3D's calibration; millimetres.

    ``transform`` is world → camera, with x right, y down and z forward (Qualisys' is the other way round, to
    other axes); focal length and centre are in px, the image's size is that of ``sensorMin`` to ``sensorMax``
    or ``sensorDim``; the lens is as with Qualisys. Images are those of the sensor, whatever ``viewrotation``.
    """
    nodes = [] if source.xml is None else source.xml.findall("cameras/camera")
    chosen = [node for node in nodes if node.get("active", "1") != "0"]
    if not chosen:
        raise DatasetError(source.path, "cameras", "at least one active <camera> in <calibration>", "none")
    cameras = [Field(source.path, f"camera {n.get('serial', i)}", tree(n)) for i, n in enumerate(chosen)]
    turned = [one.value.get("serial", "") for one in cameras if one.value.get("viewrotation", "0") != "0"]
    found = [noted("view_rotated", source.path, *turned)] if turned else []
    return Parsed([_theia_camera(camera) for camera in cameras], "mm", found)


def _theia_camera(camera: Field) -> RawCamera:
    intrinsic, transform = child(camera, "intrinsic"), child(camera, "transform")
    if "sensorDimU" in intrinsic:
        lengths = _row(intrinsic, "sensorDimU", "sensorDimV")
    else:
        lengths = _row(intrinsic, "sensorMaxU", "sensorMaxV") - _row(intrinsic, "sensorMinU", "sensorMinV")
    size = whole_size(*lengths)
    if size is None:
        raise intrinsic["sensorMaxU"].error("a positive whole width and height", f"{lengths[0]:g}")
    axes = _row(transform, *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)))
    return RawCamera(
        name=camera.member("serial", "an attribute").value,
        K=_matrix(intrinsic, np.zeros(2), 1.0, 1.0),
        R=axes.reshape(3, 3),
        t=_row(transform, "x", "y", "z"),
        distortion=_lens(intrinsic),
        size=size,
    )
