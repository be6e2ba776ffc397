"""Where a camera would have to be to see known points where it detects them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.rig_check._scene import Array, Scene

if TYPE_CHECKING:
    import skelsplat as sk

_ROUNDS = 30
_LEAST = 20


def resect(scene: Scene, view: int, points: Array, *, move: bool) -> sk.Camera | None:
    """Return the camera turned about its centre, and with `move` also moved, to fit its detections.

    Gauss–Newton on ideal pixels under a Welsch kernel whose width follows the residuals, so that wrong
    detections do not count. `points` (J, N, 3) are mm. None if too few points are seen, or they lie behind.
    """
    camera = scene.cameras[view]
    seen = scene.seen(view)
    known = np.isfinite(seen).all(axis=-1) & np.isfinite(points).all(axis=-1)
    world = points[known]
    pixels = np.asarray(camera.undistort(seen[known]))
    inside = np.isfinite(pixels).all(axis=-1)
    world, pixels = world[inside], pixels[inside]
    R, t = np.asarray(camera.R), np.asarray(camera.t)
    for _ in range(_ROUNDS):
        here = world @ R.T + t
        ahead = here[:, 2] > 1.0
        if ahead.sum() < _LEAST:
            return None
        step = _step(here[ahead], pixels[ahead], np.asarray(camera.K), move=move)
        turn = matrix_from_vector(step[:3])
        R, t = turn @ R, turn @ t + step[3:]
        if np.abs(step[:3]).max() < 1e-7:
            break
    left, _, right = np.linalg.svd(R)
    return altered(camera, R=left @ right, t=t)


def _step(here: Array, pixels: Array, K: Array, *, move: bool) -> Array:
    """Rotation vector and translation (6,) of one Gauss–Newton step; `here` (n, 3) in the camera's frame."""
    x, y, z = here.T
    focal = np.array([K[0, 0], K[1, 1]])
    residual = pixels - here[:, :2] / z[:, None] * focal - K[:2, 2]
    zero = np.zeros_like(z)
    jacobian = np.stack(
        [np.stack([1 / z, zero, -x / z**2], axis=1), np.stack([zero, 1 / z, -y / z**2], axis=1)], axis=1
    )
    jacobian *= focal[None, :, None]
    # d(exp(ω)p + δ) = −[p]ₓ ω + δ
    cross = np.stack(
        [
            np.stack([zero, z, -y], axis=1),
            np.stack([-z, zero, x], axis=1),
            np.stack([y, -x, zero], axis=1),
        ],
        axis=1,
    )
    rows = np.concatenate([jacobian @ cross, jacobian], axis=2) if move else jacobian @ cross
    distance = np.linalg.norm(residual, axis=1)
    weight = np.exp(-0.5 * (distance / (2.0 * max(float(np.median(distance)), 1e-6))) ** 2)
    root = np.sqrt(weight)[:, None]
    scale = np.array([1.0, 1.0, 1.0] + [1e-3] * 3 * move)  # mm and radians
    left = (rows * root[..., None]).reshape(-1, rows.shape[2]) / scale
    solution = np.linalg.lstsq(left, (residual * root).ravel(), rcond=1e-8)[0] / scale
    return np.concatenate([solution, np.zeros(6 - solution.size)])


def turn_between(one: sk.Camera, other: sk.Camera) -> Array:
    """Small rotation from one camera's orientation to another's about the camera's x, y, z axes, radians."""
    turn = np.asarray(other.R) @ np.asarray(one.R).T
    return 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def angle_between(one: sk.Camera, other: sk.Camera) -> float:
    """Angle of the rotation from one camera's orientation to another's, degrees."""
    cosine = (np.trace(np.asarray(one.R).T @ np.asarray(other.R)) - 1.0) / 2.0
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
