"""Calibrations in XML: Qualisys' ``.qca.txt``, Theia3D's, which look alike, and Vicon's ``.xcp``."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._fields import Field, whole_size
from skelsplat.cameras import matrix_from_quaternion
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, warn
from skelsplat.io.calibration._entries import GOOD_FIT_PX, cameras_of, matrix_of, warn_of_fit
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source

Camera = tuple[str, Field]
"""The name of a camera, and its element."""


def _tree(node: ET.Element) -> dict[str, Any]:
    """Return an element as a table: its attributes, and the first element of each name beneath it."""
    attributes = {name: _value(text) for name, text in node.attrib.items()}
    return {**{inner.tag: _tree(inner) for inner in reversed(node)}, **attributes}


def _value(text: str) -> Any:
    """Return an attribute: a number, a list of them, or the text."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers


def _row(entry: Field, *names: str) -> Array:
    return np.array([entry[name].number() for name in names])


def _cameras(source: Source, tag: str, kind: str, camera_type: str | None) -> list[Camera]:
    """Return the video cameras by the attribute `kind`, or all, that are in use; warn of those rotated."""
    nodes = [] if source.xml is None else list(source.xml.iter(tag))
    used = [n for n in nodes if n.get("active") != "0" and n.get("calibrated", "true").lower() != "false"]
    kinds = {node: node.get(kind, "none") for node in used}
    chosen = [n for n in used if camera_type == "all" or kinds[n] == "none" or "video" in kinds[n].lower()]
    named = "DEVICEID" if tag == "Camera" else "serial"
    chosen = [node for node in chosen if source.keeps(node.get(named, ""))]
    if not chosen:
        expected = 'an active, calibrated video camera (camera_type="all" takes every camera)'
        raise DatasetError(source.path, kind, expected, ", ".join(sorted(set(kinds.values()))) or "none")
    names = [node.get(named, "") for node in chosen]
    turned = [name for name, node in zip(names, chosen, strict=True) if node.get("viewrotation", "0") != "0"]
    if turned:
        words = (
            f"{source.path}: viewrotation: images of {', '.join(turned)} were rotated for display; "
            "detections must come from images as the sensor records them."
        )
        warn(Finding("calibration_read_as", "note", cameras_of(source.path, turned), sentence=words))
    pairs = zip(names, chosen, strict=True)
    return [(name, Field(source.path, f"{tag} {name}", _tree(node))) for name, node in pairs]


_SUBPIXELS = 64.0
_FLIP = np.diag([1.0, -1.0, -1.0])
# 1088 lines are called 1080p
_SAME_LINES = 0.02


def _is_qualisys(source: Source) -> bool:
    root = source.xml
    return root is not None and root.tag == "calibration" and root.find("cameras/camera") is not None


def _parse_qualisys(source: Source, camera_type: str | None, binning: float | None) -> Parsed:
    """Return the video cameras that are active and calibrated, or all; millimetres.

    * ``focalLengthU/V`` and ``centerPointU/V`` are in 1/64 px of the whole sensor; in files of some programs
      in px, which the place of the centre shows. The image is the part of the sensor that ``fov_video``
      names, so its left and top come off the principal point.
    * ``radialDistortion1..3`` and ``tangentalDistortion1..2`` are OpenCV's k1, k2, k3, p1, p2. They have no
      dimension and are *not* divided by 64 (Pose2Sim divides them, which makes them nothing).
    * ``transform`` is the camera's position in the world and a rotation ``r11`` … ``r33`` whose rows are the
      camera's axes x right, y up and z backward.
    * A video of fewer lines than the sensor is binned or scaled; ``video_resolution`` says so, but not how.

    Video cameras have the model ``…Video…``, or ``none`` in files that other programs wrote.
    """
    cameras = _cameras(source, "camera", "model", camera_type)
    read = [_qualisys_camera(name, entry, binning or _no_binning(entry)) for name, entry in cameras]
    if names := [name for name, entry in cameras if _parts_of_pixel(entry) == 1.0]:
        words = f"{source.path}: focal length and centre of {', '.join(names)} are read as px, not 1/64 px."
        warn(Finding("calibration_read_as", "note", cameras_of(source.path, names), sentence=words))
    return read, "mm"


def _qualisys_camera(name: str, camera: Field, binning: float) -> RawCamera:
    """Return a camera whose image has `binning` sensor pixels per pixel."""
    left, top, right, bottom = _row(camera["fov_video"], "left", "top", "right", "bottom")
    lengths = np.array([right - left + 1.0, bottom - top + 1.0]) / binning
    size = whole_size(*lengths.round())
    if size is None or np.abs(lengths - size).max() > 1e-6:
        expected = "right − left + 1 and bottom − top + 1 to be whole pixels"
        raise camera["fov_video"].error(expected, " by ".join(f"{length:g}" for length in lengths))
    rotation = _FLIP @ _axes(camera)
    return RawCamera(
        name=name,
        K=_matrix(camera["intrinsic"], np.array([left, top]), binning, _parts_of_pixel(camera)),
        R=rotation,
        t=-rotation @ _row(camera["transform"], "x", "y", "z"),
        distortion=_lens(camera["intrinsic"]),
        size=size,
    )


def _axes(camera: Field) -> Array:
    return _row(camera["transform"], *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))).reshape(3, 3)


def _lens(intrinsic: Field) -> Array:
    k3 = "radialDistortion3"
    k1, k2 = _row(intrinsic, "radialDistortion1", "radialDistortion2")
    p1, p2 = _row(intrinsic, "tangentalDistortion1", "tangentalDistortion2")
    return np.array([k1, k2, p1, p2, intrinsic[k3].number() if k3 in intrinsic else 0.0])


def _parts_of_pixel(camera: Field) -> float:
    """Return 64, or 1 for a camera whose focal length and centre are in px.

    In 1/64 px, a centre below twice the sensor's size would be within a 32nd of its upper left corner.
    """
    sensor = _row(camera["fov_video"], "right", "bottom") + 1.0
    centre = _row(camera["intrinsic"], "centerPointU", "centerPointV")
    return 1.0 if (centre < 2.0 * sensor).all() else _SUBPIXELS


def _matrix(intrinsic: Field, corner: Array, binning: float, parts: float) -> Array:
    focal = _row(intrinsic, "focalLengthU", "focalLengthV") / parts / binning
    centre = _row(intrinsic, "centerPointU", "centerPointV") / parts - corner
    centre = (centre + 0.5) / binning - 0.5  # integers are pixel centres
    _check_skew(intrinsic["skew"])
    return matrix_of(*focal, *centre)


def _check_skew(skew: Field) -> None:
    if not skew.is_missing and skew.number() != 0.0:
        raise skew.error("0 (skew is not supported)", skew.shown)


def _no_binning(camera: Field) -> float:
    """Return 1; it is an error if ``video_resolution`` is not the sensor's."""
    lines = re.fullmatch(r"(\d+)p", str(camera["video_resolution"].value))
    area = next((camera[tag] for tag in ("fov_video_max", "fov_marker_max") if tag in camera), None)
    if lines and area:
        sensor = area["bottom"].number() + 1.0
        if abs(float(lines[1]) / sensor - 1.0) > _SAME_LINES:
            expected = f"the sensor's {sensor:.0f} lines, or the option binning (sensor px per image px)"
            raise camera["video_resolution"].error(expected, lines[0])
    return 1.0


# of a sensor in px; in 1/64 px, a larger one than that would have 312 px
_MOST_PIXELS = 20_000.0


def _is_theia(source: Source) -> bool:
    root = source.xml
    if root is None or root.tag != "calibration" or root.find("cameras/camera/fov_video") is not None:
        return False
    sizes = [_value(node.get("sensorMaxU", node.get("sensorDimU", ""))) for node in root.iter("intrinsic")]
    return bool(sizes) and all(isinstance(size, float) and size < _MOST_PIXELS for size in sizes)


def _parse_theia(source: Source) -> Parsed:
    """Return the active cameras of Theia3D's calibration; millimetres.

    ``transform`` is world → camera, with x right, y down and z forward (Qualisys' is the other way round, to
    other axes); focal length and centre are in px, the image's size is that of ``sensorMin`` to ``sensorMax``
    or ``sensorDim``; the lens is as with Qualisys. Images are those of the sensor, whatever ``viewrotation``.
    """
    cameras = _cameras(source, "camera", "model", "all")
    return [_theia_camera(name, camera) for name, camera in cameras], "mm"


def _theia_camera(name: str, camera: Field) -> RawCamera:
    intrinsic = camera["intrinsic"]
    if "sensorDimU" in intrinsic:
        lengths = _row(intrinsic, "sensorDimU", "sensorDimV")
    else:
        lengths = _row(intrinsic, "sensorMaxU", "sensorMaxV") - _row(intrinsic, "sensorMinU", "sensorMinV")
    size = whole_size(*lengths)
    if size is None:
        raise intrinsic["sensorMaxU"].error("a positive whole width and height", f"{lengths[0]:g}")
    K, t = _matrix(intrinsic, np.zeros(2), 1.0, 1.0), _row(camera["transform"], "x", "y", "z")
    return RawCamera(name, K, _axes(camera), t, _lens(intrinsic), size)


_UNIT_NORM = 1e-3
_GRID, _STEPS = 40, 60
_LEAST_BELOW = 0.1  # of the fraction's lower part within the image: at 0 a lens has a pole
_WORST_FIT_PX = 100.0  # no lens is followed as badly: its coefficients are of another unit


def _is_vicon(source: Source) -> bool:
    return source.xml is not None and source.xml.tag == "Cameras"


def _parse_vicon(source: Source, camera_type: str | None) -> Parsed:
    """Return the video cameras, or all; millimetres.

    ``Camera`` has ``DEVICEID`` (the camera's name here), ``TYPE``, ``SENSOR_SIZE`` and
    ``PIXEL_ASPECT_RATIO``; its first ``KeyFrame`` has ``FOCAL_LENGTH`` in px, ``PRINCIPAL_POINT``,
    ``ORIENTATION``, a quaternion (x, y, z, w: scalar last) that turns world into camera, ``POSITION`` of the
    camera in the world, and the lens as ``VICON_RADIAL2`` (model's name, centre x y, k1 k2 k3) or, in older
    files, ``VICON_RADIAL`` (k1 k2 about the principal point); a camera with neither is refused.

    Vicon maps a measured pixel to an ideal one, in pixels about a centre c of its own:

        ideal = c + (1 + k1 r² + k2 r⁴ + k3 r⁶)·(measured − c),      r = |measured − c|

    OpenCV maps ideal to measured, in multiples of the focal length about the principal point, so that the
    coefficients cannot be copied: k1 to k6, p1, p2 and the thin-prism terms s1..s4 are fitted over the image.
    Video cameras have "video" in their ``TYPE``.
    """
    errors: dict[str, float] = {}
    cameras = _cameras(source, "Camera", "TYPE", camera_type)
    read = [_vicon_camera(name, camera, errors) for name, camera in cameras]
    warn_of_fit(source.path, errors, "OpenCV's lens model follows Vicon's")
    return read, "mm"


def _vicon_camera(name: str, camera: Field, errors: dict[str, float]) -> RawCamera:
    """Return a camera; the error of its lens is added to `errors`."""
    size, aspect = camera["SENSOR_SIZE"].size(), camera["PIXEL_ASPECT_RATIO"].number()
    if not aspect > 0.0:
        raise camera["PIXEL_ASPECT_RATIO"].error("a positive number", f"{aspect:g}")
    _check_skew(camera["SKEW"])
    frame = camera["KeyFrames"]["KeyFrame"]
    focal, principal = frame["FOCAL_LENGTH"].number(), frame["PRINCIPAL_POINT"].numbers((2,))
    K = matrix_of(focal, focal / aspect, *principal)
    quaternion = frame["ORIENTATION"].numbers((4,))
    if abs(np.linalg.norm(quaternion) - 1.0) > _UNIT_NORM:
        raise frame["ORIENTATION"].error("a quaternion of norm 1", quaternion)
    R = matrix_from_quaternion(np.roll(quaternion, 1))
    centre, radial, field = _radial(frame, principal)
    distortion = None
    if radial.any():
        distortion, errors[name] = _fit(K, size, centre, radial, aspect)
        if not errors[name] < _WORST_FIT_PX:
            expected = "coefficients in 1/px², 1/px⁴ and 1/px⁶, as of a lens"
            raise field.error(expected, " ".join(f"{k:g}" for k in radial))
    return RawCamera(name, K, R, -R @ frame["POSITION"].numbers((3,)), distortion, size)


def _radial(frame: Field, principal: Array) -> tuple[Array, Array, Field]:
    """Return the centre (2,), the coefficients and the attribute that they come from."""
    field = frame["VICON_RADIAL2"]
    if field.is_missing and "VICON_RADIAL" in frame:
        return principal, frame["VICON_RADIAL"].numbers((2,)), frame["VICON_RADIAL"]
    _, _, numbers = str(field.value).partition(" ")  # a misspelt name must not pass for one without a lens
    given = field if field.is_missing else Field(field.path, field.place, _value(numbers))
    values = given.numbers((5,))
    return values[:2], values[2:], field


def _fit(K: Array, size: tuple[int, int], centre: Array, radial: Array, aspect: float) -> tuple[Array, float]:
    """Return OpenCV's 12 coefficients and the largest error of the fit in px.

    A polynomial (k4 to k6 are 0), unless a strong lens needs the rational terms to be followed.
    """
    axes = [np.linspace(0.0, length - 1.0, _GRID) for length in size]
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    focal, principal = np.array([[K[0, 0]], [K[1, 1]]]), K[:2, 2]
    offset = (pixels - centre) * [1.0, aspect]
    squared = (offset**2).sum(axis=1, keepdims=True)
    scale = 1.0 + sum(k * squared ** (i + 1) for i, k in enumerate(radial))
    ideal = (offset * scale / [1.0, aspect] + centre - principal).T / focal
    wanted = (pixels - principal).T
    terms = _terms(*ideal)
    solution = np.zeros(len(terms))
    error = np.inf
    if np.isfinite(terms).all() and np.isfinite(wanted).all():
        columns = (terms * focal).reshape(len(terms), -1).T
        right = (wanted - ideal * focal).ravel()
        solution = np.linalg.lstsq(columns, right, rcond=None)[0]
        error = float(np.abs(columns @ solution - right).max())
    k1, k2, k3, *rest = solution
    p1, p2, *s = rest
    polynomial = np.array([k1, k2, p1, p2, k3, 0.0, 0.0, 0.0, *s])
    if not GOOD_FIT_PX < error < _WORST_FIT_PX:
        return polynomial, error
    return min((polynomial, error), _rational(ideal, terms[3:], wanted, focal), key=lambda fit: fit[1])


def _rational(ideal: Array, others: Array, wanted: Array, focal: Array) -> tuple[Array, float]:
    """Return the coefficients with k4 to k6, and their error, by Levenberg and Marquardt's method.

    ``ideal`` (2, n) and ``others`` (6, 2, n) in multiples of ``focal`` (2, 1), ``wanted`` (2, n) in px.
    """
    squared = (ideal**2).sum(axis=0)
    largest = squared.max()
    powers = np.stack([(squared / largest) ** k for k in (1, 2, 3)])

    def at(solution: Array) -> tuple[Array, Array, Array]:
        above, below = 1.0 + solution[:3] @ powers, 1.0 + solution[3:6] @ powers
        moved = ideal * above / below + np.tensordot(solution[6:], others, 1)
        return (moved * focal - wanted).ravel(), above, below

    solution, damping = np.zeros(6 + len(others)), 1e-3
    error, above, below = at(solution)
    for _ in range(_STEPS):
        slopes = np.concatenate([powers / below, -powers * above / below**2])[:, None] * ideal
        jacobian = (np.concatenate([slopes, others]) * focal).reshape(len(solution), -1).T
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ error
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), gradient, rcond=None)[0]
        new, above_new, below_new = at(solution - step)
        if below_new.min() > _LEAST_BELOW and new @ new < error @ error:
            solution, error, above, below = solution - step, new, above_new, below_new
            damping /= 6.0
        else:
            damping *= 4.0
    scale = np.tile([largest, largest**2, largest**3], 2)
    k1, k2, k3, k4, k5, k6 = solution[:6] / scale
    p1, p2, *s = solution[6:]
    return np.array([k1, k2, p1, p2, k3, k4, k5, k6, *s]), float(np.abs(error).max())


def _terms(x: Array, y: Array) -> Array:
    """Return what k1, k2, k3, p1, p2, s1, s2, s3, s4 multiply in x and in y, (9, 2, n)."""
    r2, zero = x * x + y * y, np.zeros_like(x)
    r4, both = r2**2, np.stack([x, y])
    tangential = [(2 * x * y, r2 + 2 * y * y), (r2 + 2 * x * x, 2 * x * y)]
    prism = [(r2, zero), (r4, zero), (zero, r2), (zero, r4)]
    return np.stack([both * r2, both * r4, both * r2**3, *map(np.stack, [*tangential, *prism])])


_BOTH = ("camera_type", "binning")
FORMATS = (
    CalibrationFormat("theia", "Theia3D's XML", _is_theia, _parse_theia),
    CalibrationFormat("qualisys", "Qualisys .qca.txt", _is_qualisys, _parse_qualisys, _BOTH),
    CalibrationFormat("vicon", "Vicon .xcp", _is_vicon, _parse_vicon, ("camera_type",)),
)
