"""Calibrations in XML: Qualisys' ``.qca.txt``, Theia3D's, which look alike, and Vicon's ``.xcp``."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.cameras import matrix_from_quaternion
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding
from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import (
    GOOD_FIT_PX,
    CalibrationFormat,
    Parsed,
    RawCamera,
    Source,
    approximated,
    cameras_of,
    whole_size,
)


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
    cameras, found = _chosen(source, "camera", "model", lambda node: _is_wanted(node, camera_type))
    read = [_qualisys_camera(camera, binning or _no_binning(camera)) for camera in cameras]
    pairs = zip(read, cameras, strict=True)
    if names := [camera.name for camera, entry in pairs if _parts_of_pixel(entry) == 1.0]:
        words = f"{source.path}: focal length and centre of {', '.join(names)} are read as px, not 1/64 px."
        found.append(Finding("calibration_read_as", "note", cameras_of(source.path, names), sentence=words))
    return Parsed(read, "mm", found)


def _chosen(
    source: Source, tag: str, kind: str, is_wanted: Callable[[ET.Element], bool]
) -> tuple[list[Field], list[Finding]]:
    """Return the wanted cameras, called by their number, and a note on those rotated for display.

    ``kind`` is the attribute that says why others are not wanted.
    """
    nodes = [] if source.xml is None else list(source.xml.iter(tag))
    if not nodes:
        raise DatasetError(source.path, "cameras", f"at least one <{tag}>", "none")
    chosen = [node for node in nodes if is_wanted(node)]
    if not chosen:
        kinds = sorted({node.get(kind, "none") for node in nodes})
        expected = 'an active, calibrated video camera (camera_type="all" takes every camera)'
        raise DatasetError(source.path, kind, expected, ", ".join(kinds))
    number = "serial" if tag == "camera" else "DEVICEID"
    cameras = [Field(source.path, f"{tag} {n.get(number, i)}", tree(n)) for i, n in enumerate(chosen)]
    turned = [one.value.get(number, "") for one in cameras if one.value.get("viewrotation", "0") != "0"]
    if not turned:
        return cameras, []
    words = (
        f"{source.path}: viewrotation: images of {', '.join(turned)} were rotated for display; detections "
        "must come from images as the sensor records them."
    )
    return cameras, [Finding("calibration_read_as", "note", cameras_of(source.path, turned), sentence=words)]


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
    cameras, found = _chosen(source, "camera", "active", lambda node: node.get("active", "1") != "0")
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


_UNIT_NORM = 1e-3
_GRID = 40


def is_vicon(source: Source) -> bool:
    """Whether a document has Vicon's root."""
    return source.xml is not None and source.xml.tag == "Cameras"


def parse_vicon(source: Source, camera_type: str | None) -> Parsed:
    """Return the video cameras, or all; millimetres.

    ``Camera`` has ``DEVICEID`` (the camera's name here), ``TYPE``, ``SENSOR_SIZE`` and
    ``PIXEL_ASPECT_RATIO``; its first ``KeyFrame`` has ``FOCAL_LENGTH`` in px, ``PRINCIPAL_POINT``,
    ``ORIENTATION``, a quaternion (x, y, z, w: scalar last) that turns world into camera, ``POSITION`` of the
    camera in the world, and the lens as ``VICON_RADIAL2`` (model's name, centre x y, k1 k2 k3) or, in older
    files, ``VICON_RADIAL`` (k1 k2 about the principal point); a camera with neither is refused.

    Vicon maps a measured pixel to an ideal one, in pixels about a centre c of its own:

        ideal = c + (1 + k1 r² + k2 r⁴ + k3 r⁶)·(measured − c),      r = |measured − c|

    OpenCV maps ideal to measured, in multiples of the focal length about the principal point, so that the
    coefficients cannot be copied: k1, k2, p1, p2, k3 and the thin-prism terms s1..s4 are fitted over the
    image.

    Marker cameras have no images: only cameras whose ``TYPE`` has "video" in it are read.
    """
    cameras, findings = _chosen(
        source,
        "Camera",
        "TYPE",
        lambda node: camera_type == "all" or "video" in node.get("TYPE", "").lower(),
    )
    return Parsed([_vicon_camera(camera, findings) for camera in cameras], "mm", findings)


def _vicon_camera(camera: Field, findings: list[Finding]) -> RawCamera:
    width, height = numbers(camera, "SENSOR_SIZE", 2)
    size = whole_size(width, height)
    if size is None:
        raise camera["SENSOR_SIZE"].error("a positive whole width and height", f"{width:g} {height:g}")
    aspect = _positive(camera, "PIXEL_ASPECT_RATIO")
    if number(camera, "SKEW", 0.0) != 0.0:
        raise camera["SKEW"].error("0 (skew is not supported)", camera["SKEW"].value)
    frame = replace(child(child(camera, "KeyFrames"), "KeyFrame"), place=camera.place)
    focal, principal = _positive(frame, "FOCAL_LENGTH"), numbers(frame, "PRINCIPAL_POINT", 2)
    K = np.array([[focal, 0.0, principal[0]], [0.0, focal / aspect, principal[1]], [0.0, 0.0, 1.0]])
    quaternion = numbers(frame, "ORIENTATION", 4)
    if abs(np.linalg.norm(quaternion) - 1.0) > _UNIT_NORM:
        raise frame["ORIENTATION"].error("a quaternion of norm 1", quaternion)
    R, name = matrix_from_quaternion(np.roll(quaternion, 1)), camera.member("DEVICEID", "an attribute").value
    distortion, error = _vicon_lens(frame, K, size, aspect)
    if error > GOOD_FIT_PX:
        findings.append(approximated(camera.path, [name], error, "OpenCV's lens model follows Vicon's"))
    return RawCamera(
        name=name, K=K, R=R, t=-R @ numbers(frame, "POSITION", 3), distortion=distortion, size=size
    )


def _positive(entry: Field, name: str) -> float:
    value = number(entry, name)
    if not value > 0.0:
        raise entry[name].error("a positive number", f"{value:g}")
    return value


def _vicon_lens(frame: Field, K: Array, size: tuple[int, int], aspect: float) -> tuple[Array | None, float]:
    """Return OpenCV's coefficients of the camera's radial model, None if they are zeros, and their error."""
    centre, radial, field = _radial(frame, K[:2, 2])
    if not radial.any():
        return None, 0.0
    if not _is_plausible(size, centre, radial, aspect):
        expected = "coefficients in 1/px², 1/px⁴ and 1/px⁶, as of a lens"
        raise frame[field].error(expected, " ".join(f"{k:g}" for k in radial))
    return _fit(K, size, centre, radial, aspect)


def _radial(frame: Field, principal: Array) -> tuple[Array, Array, str]:
    """Return the centre (2,), the coefficients and the name of the attribute that they come from."""
    text = frame.value.get("VICON_RADIAL2")
    if text is None:
        if "VICON_RADIAL" not in frame:  # a misspelt name must not pass for one without a lens
            expected = "lens coefficients, here or in VICON_RADIAL, zeros for no lens"
            raise frame["VICON_RADIAL2"].error(expected, "none")
        return principal, numbers(frame, "VICON_RADIAL", 2), "VICON_RADIAL"
    values = parsed(text.split()[1:])
    if values.size != 5 or not np.isfinite(values).all():
        raise frame["VICON_RADIAL2"].error("a name, then cx cy k1 k2 k3", repr(text))
    return values[:2], values[2:], "VICON_RADIAL2"


def ideal_pixels(pixels: Array, centre: Array, radial: Array, aspect: float) -> Array:
    """Ideal pixels of measured ones (n, 2); `aspect` is that of a pixel."""
    offset = (pixels - centre) * [1.0, aspect]
    squared = (offset**2).sum(axis=1, keepdims=True)
    scale = 1.0 + sum(k * squared ** (i + 1) for i, k in enumerate(radial))
    ideal: Array = offset * scale / [1.0, aspect] + centre
    return ideal


def _is_plausible(size: tuple[int, int], centre: Array, radial: Array, aspect: float) -> bool:
    """Whether the ideal radius grows with the measured one all over the image, and not beyond twice it."""
    corners = np.array([[0.0, 0.0], [size[0], 0.0], [0.0, size[1]], [size[0], size[1]]])
    most = np.linalg.norm((corners - centre) * [1.0, aspect], axis=1).max()
    r = np.linspace(0.0, most, 200)
    with np.errstate(over="ignore", invalid="ignore"):
        scale = 1.0 + sum(k * r ** (2 * i + 2) for i, k in enumerate(radial))
        growth = 1.0 + sum((2 * i + 3) * k * r ** (2 * i + 2) for i, k in enumerate(radial))
    return bool((np.asarray(growth) > 0.1).all() and (np.asarray(scale) < 2.0).all())


def _fit(K: Array, size: tuple[int, int], centre: Array, radial: Array, aspect: float) -> tuple[Array, float]:
    """Return OpenCV's 12 coefficients (k4 to k6 are 0) and the largest error of the fit in px.

    A polynomial: the rational terms would fit a strong lens better, but with large coefficients that cancel.
    """
    axes = [np.linspace(0.0, length - 1.0, _GRID) for length in size]
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    focal, principal = np.array([K[0, 0], K[1, 1]]), K[:2, 2]
    ideal = (ideal_pixels(pixels, centre, radial, aspect) - principal) / focal
    terms = np.concatenate(list(_terms(ideal) * focal[:, None, None]))
    right = (pixels - principal - ideal * focal).T.ravel()
    solution = np.linalg.lstsq(terms, right, rcond=None)[0]
    error = float(np.abs(terms @ solution - right).max())
    k1, k2, p1, p2, k3, *s = solution
    return np.array([k1, k2, p1, p2, k3, 0.0, 0.0, 0.0, *s]), error


def _terms(ideal: Array) -> Array:
    """Return what k1, k2, p1, p2, k3, s1, s2, s3, s4 multiply in x and in y, (2, n, 9)."""
    x, y = ideal.T
    r2 = x * x + y * y
    r4, r6, zero = r2**2, r2**3, np.zeros_like(x)
    along_x = [x * r2, x * r4, 2 * x * y, r2 + 2 * x * x, x * r6, r2, r4, zero, zero]
    along_y = [y * r2, y * r4, r2 + 2 * y * y, 2 * x * y, y * r6, zero, zero, r2, r4]
    return np.stack([np.stack(along_x, axis=1), np.stack(along_y, axis=1)])


FORMATS = (
    CalibrationFormat("theia", "Theia3D's XML", "mm", is_theia, parse_theia),
    CalibrationFormat(
        "qualisys", "Qualisys .qca.txt", "mm", is_qualisys, parse_qualisys, ("camera_type", "binning")
    ),
    CalibrationFormat("vicon", "Vicon .xcp", "mm", is_vicon, parse_vicon, ("camera_type",)),
)
