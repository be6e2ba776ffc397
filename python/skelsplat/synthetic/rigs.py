"""Simulated camera rigs: a room like Human3.6M's, a dome, a stereo pair, a table-size ring.

World frame: mm, z up, floor at z = 0 (the table rig: object at the origin).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, numbers, positive
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DegenerateGeometryError, InvalidInputError

# Chest height: an upright adult fills the image evenly above and below.
_BODY_CENTRE = (0.0, 0.0, 900.0)
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> tuple[Array, Array]:
    """World→camera R (3, 3) and t (3,) of a camera at `eye` whose optical axis meets `target`, image upright.

    Parameters
    ----------
    eye, target : (3,)
        Camera centre and a point on its axis, one unit.
    up : (3,)
        World direction that points up in the image.

    Raises
    ------
    DegenerateGeometryError
        If `eye` equals `target`, or the axis is parallel to `up`.
    """
    centre, upwards = _vector(eye, "eye"), _vector(up, "up")
    axis = _vector(target, "target") - centre
    right = np.cross(axis, upwards)
    # 1e-9: the sine of the angle to `up` below which rounding decides where "right" is.
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(axis) * np.linalg.norm(upwards):
        raise DegenerateGeometryError(
            f"look_at: expected a viewing direction not zero and not parallel to up, got {axis.tolist()}"
        )
    z = axis / np.linalg.norm(axis)
    x = right / np.linalg.norm(right)
    R = np.stack([x, np.cross(z, x), z])
    return R, -R @ centre


def _vector(value: ArrayLike, name: str) -> Array:
    vector = numbers(value, name)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InvalidInputError(f"{name}: expected three finite numbers, got {vector.tolist()}")
    return vector


def _camera(
    name: str,
    eye: ArrayLike,
    target: ArrayLike,
    focal_px: float,
    size: tuple[int, int],
    distortion: tuple[float, ...] | None = None,
) -> Camera:
    """Square pixels, principal point at the image's centre ((w−1)/2, (h−1)/2): pixel centres are integers."""
    R, t = look_at(eye, target)
    K = np.array([[focal_px, 0.0, (size[0] - 1) / 2], [0.0, focal_px, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera(K, R, t, distortion=distortion, size=size, name=name)


def _check_count(n_views: int, most: int) -> None:
    if not 1 <= n_views <= most:
        raise InvalidInputError(f"n_views: expected 1 to {most}, got {n_views!r}")


def _ring(n_views: int, radius_mm: float, height_mm: float, turned: float = 0.0) -> list[tuple[float, ...]]:
    """Return places on a level circle, evenly spaced; the first is `turned` by this part of the spacing."""
    angles = 2 * np.pi * (np.arange(n_views) + turned) / n_views
    return [(radius_mm * np.cos(angle), radius_mm * np.sin(angle), height_mm) for angle in angles]


def human36m_like(*, distortion: bool = False) -> CameraRig:
    """Four cameras in the corners of a room, as in Human3.6M: 5.3 m from the centre, 1.5 m high, mm.

    The images are 1000×1000 or 1000×1002 px with a focal length of about 1147 px. The positions are those of
    such a room rounded and shifted, not a copy of any calibration; `distortion` adds five coefficients of the
    size that those lenses have.
    """
    # (centre x, y, z mm; focal length px; image height px; k1, k2, p1, p2, k3)
    cameras = (
        ((1850, 5000, 1560), 1145.0, 1002, (-0.207, 0.246, -0.0010, -0.0014, -0.003)),
        ((1770, -5060, 1610), 1149.0, 1000, (-0.194, 0.240, -0.0016, -0.0027, -0.007)),
        ((-1840, 5160, 1490), 1149.0, 1000, (-0.208, 0.255, -0.0008, -0.0001, -0.002)),
        ((-1800, -4950, 1580), 1145.0, 1002, (-0.198, 0.219, -0.0018, 0.0004, -0.001)),
    )
    return CameraRig(
        [
            _camera(f"cam{k}", eye, _BODY_CENTRE, focal, (1000, height), lens if distortion else None)
            for k, (eye, focal, height, lens) in enumerate(cameras, start=1)
        ]
    )


def _bit_reversed(k: int) -> float:
    """Van der Corput sequence in base 2, which starts 0, 1/2, 1/4, 3/4."""
    value, weight = 0.0, 0.5
    while k:
        value += weight * (k & 1)
        k >>= 1
        weight /= 2
    return value


def dome(n_views: int = 31, *, radius_mm: float = 2800.0) -> CameraRig:
    """Up to 31 cameras on a dome round the centre, as in CMU Panoptic: 1920×1080 px, focal length 1400 px.

    Camera k is the same for every `n_views` > k.
    """
    _check_count(n_views, 31)
    positive("radius_mm", radius_mm)
    cameras = []
    for k in range(n_views):
        azimuth = k * _GOLDEN_ANGLE
        # Elevations fill −5° to 60° by bit reversal, so that any first n are spread out in both angles.
        elevation = np.deg2rad(-5.0 + 65.0 * _bit_reversed(k))
        direction = (
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        )
        eye = np.asarray(_BODY_CENTRE) + radius_mm * np.asarray(direction)
        cameras.append(_camera(f"hd{k:02d}", eye, _BODY_CENTRE, 1400.0, (1920, 1080)))
    return CameraRig(cameras)


def stereo(*, baseline_mm: float = 600.0, distance_mm: float = 3500.0) -> CameraRig:
    """Two cameras side by side, turned to a person `distance_mm` away: 1280×720 px, focal length 1000 px."""
    positive("baseline_mm", baseline_mm)
    positive("distance_mm", distance_mm)
    x, y, z = _BODY_CENTRE
    # Facing along +y, the world's x axis points right in the image.
    return CameraRig(
        [
            _camera(name, (x + side * baseline_mm / 2, y - distance_mm, z), _BODY_CENTRE, 1000.0, (1280, 720))
            for name, side in (("left", -1.0), ("right", 1.0))
        ]
    )


def table(n_views: int = 4, *, radius_mm: float = 600.0) -> CameraRig:
    """Return a ring of up to 16 cameras that look down at the origin from `radius_mm`, for hand-size objects.

    640×480 px, focal length 600 px, 35° above the horizon.
    """
    _check_count(n_views, 16)
    positive("radius_mm", radius_mm)
    elevation = np.deg2rad(35.0)
    eyes = _ring(n_views, radius_mm * np.cos(elevation), radius_mm * np.sin(elevation), 0.5)
    return CameraRig(
        [_camera(f"cam{k}", eye, (0.0, 0.0, 0.0), 600.0, (640, 480)) for k, eye in enumerate(eyes, start=1)]
    )


def ring(n_views: int = 8, *, radius_mm: float = 3500.0, height_mm: float = 1500.0) -> CameraRig:
    """Up to 32 cameras evenly spaced on a circle round a room, as in Occlusion-Person: 1280×720 px."""
    _check_count(n_views, 32)
    positive("radius_mm", radius_mm)
    positive("height_mm", height_mm)
    eyes = _ring(n_views, radius_mm, height_mm)
    return CameraRig(
        [_camera(f"cam{k}", eye, _BODY_CENTRE, 640.0, (1280, 720)) for k, eye in enumerate(eyes)]
    )
