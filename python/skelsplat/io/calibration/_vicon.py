"""Calibrations of Vicon, ``.xcp``: XML with a lens model of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skelsplat._arrays import Array
from skelsplat.cameras import matrix_from_quaternion
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding
from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import Parsed, RawCamera, Source, noted, whole_size
from skelsplat.io.calibration._xml import child, number, numbers, parsed, tree

# a fit this good is lost in any detector's noise
_GOOD_FIT_PX = 0.1
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
    nodes = [] if source.xml is None else source.xml.findall("Camera")
    if not nodes:
        raise DatasetError(source.path, "Cameras", "at least one <Camera> in <Cameras>", "none")
    chosen = [n for n in nodes if camera_type == "all" or "video" in n.get("TYPE", "").lower()]
    if not chosen:
        types = sorted({node.get("TYPE", "none") for node in nodes})
        expected = 'a camera whose TYPE has "video" in it (camera_type="all" takes every camera)'
        raise DatasetError(source.path, "TYPE", expected, f"types {', '.join(types)}")
    findings: list[Finding] = []
    cameras = [Field(source.path, f"Camera {n.get('DEVICEID', i)}", tree(n)) for i, n in enumerate(chosen)]
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
    if error > _GOOD_FIT_PX:
        findings.append(noted("lens_approximated", camera.path, name, error_px=error))
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
