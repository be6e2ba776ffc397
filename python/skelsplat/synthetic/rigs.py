"""Simulated camera rigs: a room like Human3.6M's, a dome, a stereo pair, a table-size ring.

World frame: mm, z up, floor at z = 0 (the table rig: object at the origin). Pixels are square, and the
principal point is the image's centre ((w−1)/2, (h−1)/2): pixel centres are integers.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, numbers, positive
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DegenerateGeometryError, InvalidInputError

# Chest height: an upright adult fills the image evenly above and below.
_BODY_CENTRE = (0.0, 0.0, 900.0)
ROOM_MM = 4500.0  # distance of the cameras from the middle of the room in which people meet
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> tuple[Array, Array]:
    """World→camera R (3, 3) and t (3,) of a camera at `eye` whose optical axis meets `target`, image upright.

    `up` is the world direction that points up in the image. Raises `DegenerateGeometryError` if `eye` equals
    `target`, or the axis is parallel to `up`.
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
    focal_px: float,
    size: tuple[int, int],
    target: ArrayLike = _BODY_CENTRE,
    distortion: tuple[float, ...] | None = None,
) -> Camera:
    R, t = look_at(eye, target)
    K = np.array([[focal_px, 0.0, (size[0] - 1) / 2], [0.0, focal_px, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera(K, R, t, distortion=distortion, size=size, name=name)


def human36m_like(*, distortion: bool = False) -> CameraRig:
    """Four cameras in the corners of a room, as in Human3.6M: 5.3 m from the centre, 1.5 m high, mm.

    The positions are those of such a room rounded and shifted, not a copy of any calibration; `distortion`
    adds five coefficients of the size that those lenses have.
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
            _camera(f"cam{k}", eye, focal, (1000, height), distortion=lens if distortion else None)
            for k, (eye, focal, height, lens) in enumerate(cameras, start=1)
        ]
    )


def dome(n_views: int = 31, *, radius_mm: float = 2800.0) -> CameraRig:
    """Up to 31 cameras on a dome round the centre, as in CMU Panoptic: 1920×1080 px, focal length 1400 px.

    Camera k is the same for every `n_views` > k.
    """
    _check(n_views, 31, radius_mm=radius_mm)
    cameras = []
    for k in range(n_views):
        azimuth = k * _GOLDEN_ANGLE
        # Elevations fill −5° to 60° by bit reversal, so that any first n are spread out in both angles.
        share = int(f"{k:05b}"[::-1], 2) / 32.0
        elevation = np.deg2rad(-5.0 + 65.0 * share)
        level = np.cos(elevation)
        direction = np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, np.sin(elevation)])
        eye = np.asarray(_BODY_CENTRE) + radius_mm * direction
        cameras.append(_camera(f"hd{k:02d}", eye, 1400.0, (1920, 1080)))
    return CameraRig(cameras)


def stereo(*, baseline_mm: float = 600.0, distance_mm: float = 3500.0) -> CameraRig:
    """Two cameras side by side, turned to a person `distance_mm` away: 1280×720 px, focal length 1000 px."""
    _check(2, 2, baseline_mm=baseline_mm, distance_mm=distance_mm)
    x, y, z = _BODY_CENTRE
    # Facing along +y, the world's x axis points right in the image.
    left, right = ((x + side * baseline_mm / 2, y - distance_mm, z) for side in (-1.0, 1.0))
    pair = (("left", left), ("right", right))
    return CameraRig([_camera(name, eye, 1000.0, (1280, 720)) for name, eye in pair])


def table(n_views: int = 4, *, radius_mm: float = 600.0) -> CameraRig:
    """Return a ring of up to 16 cameras that look down at the origin from `radius_mm`, for hand-size objects.

    640×480 px, focal length 600 px, 35° above the horizon.
    """
    _check(n_views, 16, radius_mm=radius_mm)
    elevation = np.deg2rad(35.0)
    eyes = _circle(np.arange(n_views) + 0.5, radius_mm * np.cos(elevation), radius_mm * np.sin(elevation))
    named = enumerate(eyes, start=1)
    return CameraRig([_camera(f"cam{k}", eye, 600.0, (640, 480), (0.0, 0.0, 0.0)) for k, eye in named])


def ring(n_views: int = 8, *, radius_mm: float = 3500.0, height_mm: float = 1500.0) -> CameraRig:
    """Up to 32 cameras evenly spaced on a circle round a room, as in Occlusion-Person: 1280×720 px."""
    _check(n_views, 32, radius_mm=radius_mm, height_mm=height_mm)
    eyes = _circle(np.arange(n_views), radius_mm, height_mm)
    return CameraRig([_camera(f"cam{k}", eye, 640.0, (1280, 720)) for k, eye in enumerate(eyes)])


def mixed_heights(n_views: int) -> CameraRig:
    """Return a ring of cameras that are 1.2 and 2.6 m high in turn."""
    low, high = (ring(n_views, radius_mm=ROOM_MM, height_mm=h) for h in (1200.0, 2600.0))
    return CameraRig([(low, high)[k % 2][k] for k in range(n_views)])


def _circle(steps: ArrayLike, radius_mm: float, height_mm: float) -> Iterable[tuple[float, ...]]:
    """Return places on a level circle, which as many steps go round."""
    angles = 2 * np.pi * np.asarray(steps) / np.size(steps)
    return [(radius_mm * np.cos(angle), radius_mm * np.sin(angle), height_mm) for angle in angles]


def _check(n_views: int, most: int, **lengths_mm: float) -> None:
    if not 1 <= n_views <= most:
        raise InvalidInputError(f"n_views: expected 1 to {most}, got {n_views!r}")
    for name, length in lengths_mm.items():
        positive(name, length)
