"""Simulated errors on 3D poses: isotropic noise, and poses as a monocular estimator would give per view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, generator, numbers
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig, mm_per_unit
from skelsplat.exceptions import InvalidInputError

# Standard deviation along the view's ray over that across it: depth is what a single view knows least.
_DEPTH_RATIO = 2.5
# Share of the variance common to all joints of a pose: the body as a whole is placed wrongly.
_COMMON_SHARE = 0.5


def _checked(points: ArrayLike, sigma_mm: float, most_axes: float = np.inf) -> Array:
    array = numbers(points, "points")
    if not 2 <= array.ndim <= most_axes or array.shape[-1] != 3:
        raise InvalidInputError(f"points: expected shape (..., N, 3), got {array.shape}")
    if not (np.isfinite(sigma_mm) and sigma_mm >= 0):
        raise InvalidInputError(f"sigma_mm: expected a finite number >= 0, got {sigma_mm!r}")
    return array


def perturb(points: ArrayLike, sigma_mm: float, *, seed: int | np.random.Generator = 0) -> Array:
    """Add independent normal noise of `sigma_mm` per axis to every joint of points (…, N, 3) mm."""
    array = _checked(points, sigma_mm)
    return array + sigma_mm * generator(seed).standard_normal(array.shape)


def monocular_poses(
    points: ArrayLike,
    cameras: CameraRig | Sequence[Camera],
    sigma_mm: float,
    *,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Simulate one monocular 3D pose per view, in world coordinates.

    Normal errors, independent between views and frames, 2.5 times as large along the ray from the camera to
    the joint as across it; half of the variance is common to all joints of a pose (the body is placed wrongly
    as a whole), half is each joint's own. The root mean square error per axis is `sigma_mm`.

    Takes true joints (T, N, 3) or (N, 3) and returns poses (T, M, N, 3) or (M, N, 3), in the rig's unit.
    """
    array = _checked(points, sigma_mm, most_axes=3)
    truth = array[:, None] if array.ndim == 3 else array[None, None]
    sigma = sigma_mm / mm_per_unit(cameras)
    centres = np.array([-np.asarray(c.R).T @ np.asarray(c.t) for c in cameras])
    ray = truth - centres[None, :, None]
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    rng = generator(seed)
    common = rng.standard_normal((*ray.shape[:2], 1, 3))
    own = rng.standard_normal(ray.shape)
    error = np.sqrt(_COMMON_SHARE) * common + np.sqrt(1.0 - _COMMON_SHARE) * own
    along = (error * ray).sum(axis=-1, keepdims=True) * ray
    # Two axes across and one along: 2·a² + (2.5·a)² = 3·sigma².
    across = sigma * np.sqrt(3.0 / (2.0 + _DEPTH_RATIO**2))
    poses: Array = truth + across * (error + (_DEPTH_RATIO - 1.0) * along)
    return poses if array.ndim == 3 else poses[0]
