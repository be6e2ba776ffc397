"""A world for cameras that have none: metric scale, up, and a floor, from the people who were filmed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from skelsplat._arrays import Array, Mask, medians
from skelsplat._skelsplat import Camera, Layout
from skelsplat.cameras import altered

# Stature of adults, mm, and its standard deviation: women and men of many countries together.
ADULT = (1700.0, 90.0)
# Height of the ankle joint above the floor over stature (Winter, figure 4.1).
_ANKLE = 0.039
# Standard deviation of the mean tilt of a body over a recording, rad: of one that stands and walks, and of
# one that does not.
_TILT = 0.06
_TILT_SEATED = 0.3
# Standard deviation of the height of an ankle on the floor over stature.
_UNEVEN = 0.02
# Somebody is stretched from this distance of ankle and head on, relative to the way by knee and hip, and
# stands where this part of the frames shows it.
_STRAIGHT = 0.94
_STOOD = 0.05
_ROUNDS = 10
# The part of the ankles that move least: one of the two stands while people walk.
_STANDING = 0.4
_HIGH = ("head", "nose", "neck", "left_shoulder", "right_shoulder", "left_ear", "right_ear")
_FEET = ("left_ankle", "right_ankle")
_HIPS = ("left_hip", "right_hip")


@dataclass(frozen=True)
class Floor:
    """A plane: `up` (3,), its standard error in degrees, and the point `middle` (3,) on it."""

    up: Array
    sigma_deg: float
    middle: Array


def find_floor(points: Array, layout: Layout, stature: float) -> Floor | None:
    """Return the floor on which somebody of this stature stands and walks, points (T, N, 3).

    Up is from the ankles to the head, on average, and across the plane that best fits the ankles that
    stand: with the tilt as a prior, of the height z = a x + b y + c of such an ankle, (a, b) ~ N(0, τ²). None
    without ankles and shoulders or a head.
    """
    feet = [layout.joints.index(name) for name in _FEET if name in layout.joints]
    high = [layout.joints.index(name) for name in _HIGH if name in layout.joints]
    if not (feet and high):
        return None
    top, ankles = _mean(points[:, high]), points[:, feet]
    body = top - _mean(ankles)
    known = np.isfinite(body).all(axis=1)
    stood = known & _stretched(points, top, layout)
    seated = stood.sum() < _STOOD * known.sum()
    if seated and all(name in layout.joints for name in _HIPS):
        body = top - _mean(points[:, [layout.joints.index(name) for name in _HIPS]])
        known = np.isfinite(body).all(axis=1)
    if not known.any():
        return None
    body = body[known if seated else stood]
    up = np.median(body / np.linalg.norm(body, axis=1, keepdims=True), axis=0)
    axes = _axes(up / np.linalg.norm(up))
    standing = ankles[_stands(ankles)] @ axes.T
    if len(standing) < 3:
        return None
    slope, height, sigma = _plane(standing, stature, _TILT_SEATED if seated else _TILT)
    middle = np.append(np.median(standing[:, :2], axis=0), 0.0)
    middle[2] = middle[:2] @ slope + height - _ANKLE * stature
    normal = np.array([*-slope, 1.0]) / np.sqrt(1.0 + slope @ slope)
    return Floor(normal @ axes, float(np.degrees(sigma)), middle @ axes)


def moved(camera: Camera, axes: Array, origin: Array, scale: float) -> Camera:
    """Return the camera in a world of these axes (3, 3), rows, with this origin, scaled."""
    R = np.asarray(camera.R) @ axes.T
    return altered(camera, R=R, t=-R @ (axes @ (np.asarray(camera.centre) - origin) * scale))


def upright(floor: Floor, viewer: Array) -> Array:
    """Return the axes of a world with z up in which `viewer` (3,) looks along y, (3, 3) by rows."""
    forward = floor.middle - viewer
    forward = forward - floor.up * (forward @ floor.up)
    y = forward / np.linalg.norm(forward)
    return np.stack([np.cross(y, floor.up), y, floor.up])


def movement(points: Array) -> float:
    """Return how far joints (T, N, 3) move, over the size of the body: both root mean squares."""
    return _spread(points, 0) / body_size(points) if np.isfinite(points).any() else 0.0


def body_size(points: Array) -> float:
    """Return the root-mean-square distance of joints (T, N, 3) from their middle in a frame."""
    return _spread(points, 1)


def _spread(points: Array, axis: int) -> float:
    known: Mask = np.asarray(np.isfinite(points).all(axis=2, keepdims=True))
    count = np.maximum(known.sum(axis=axis, keepdims=True), 1)
    mean = np.where(known, points, 0.0).sum(axis=axis, keepdims=True) / count
    return float(np.sqrt(((points - mean) ** 2)[known[..., 0]].sum(axis=-1).mean()))


def mean_size(points: Array, layout: Layout) -> float:
    """Return the mean over frames (T, N, 3) of how large people are, relative to the median of each bone."""
    ends = np.array(layout.limbs)
    lengths = np.linalg.norm(points[:, ends[:, 0]] - points[:, ends[:, 1]], axis=2)
    return float(np.nanmean(medians(lengths / medians(lengths.T))))


def _mean(points: Array) -> Array:
    """Return the mean of joints (T, K, 3) that are known; NaN where none is."""
    known = np.isfinite(points).all(axis=2, keepdims=True)
    count = known.sum(axis=1)
    mean: Array = np.where(known, points, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)
    return mean


def _stretched(points: Array, top: Array, layout: Layout) -> Mask:
    """Return in which frames (T,) ankles, knees, hips and `top` (T, 3) are in line; none without them."""
    stretched: Mask = np.ones(len(points), dtype=np.bool_)
    for side in ("left", "right"):
        names = [f"{side}_{joint}" for joint in ("ankle", "knee", "hip")]
        if not all(name in layout.joints for name in names):
            return np.zeros(len(points), dtype=np.bool_)
        line = [*(points[:, layout.joints.index(name)] for name in names), top]
        along = sum(np.linalg.norm(a - b, axis=1) for a, b in pairwise(line))
        stretched = stretched & np.asarray(np.linalg.norm(top - line[0], axis=1) >= _STRAIGHT * along)
    return stretched


def _axes(up: Array) -> Array:
    """Return some axes (3, 3), rows, with `up` the last."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def _stands(ankles: Array) -> Mask:
    """Return which ankles (T, K, 3) move least, (T, K)."""
    step = np.full(ankles.shape[:2], np.nan)
    step[1:-1] = np.linalg.norm(ankles[2:] - ankles[:-2], axis=-1)
    there: Mask = np.asarray(np.isfinite(ankles).all(axis=2))
    known = there & np.isfinite(step)
    if not known.any():
        return there
    stands: Mask = known & (step <= np.quantile(step[known], _STANDING))
    return stands


def _plane(standing: Array, stature: float, tilt: float) -> tuple[Array, float, float]:
    """Return slope (2,), height and the standard error of the slope, rad, of the plane of ankles (K, 3).

    Robust: an ankle h above the plane counts 1 / (1 + (h/σ)²).
    """
    middle = np.median(standing, axis=0)
    x = np.column_stack([standing[:, :2] - middle[:2], np.ones(len(standing))])
    z = standing[:, 2] - middle[2]
    sigma = _UNEVEN * stature
    prior = np.diag([tilt**-2, tilt**-2, 0.0])
    solution, precision = np.zeros(3), prior
    for _ in range(_ROUNDS):
        weight = 1.0 / (1.0 + ((z - x @ solution) / sigma) ** 2)
        # ankles that stand for a while say the same again: a tenth of them counts as independent
        precision = prior + (x.T * (0.1 * weight / sigma**2)) @ x
        solution = np.linalg.solve(precision, (x.T * (0.1 * weight / sigma**2)) @ z)
    covariance = np.linalg.inv(precision)
    height = solution[2] + middle[2] - solution[:2] @ middle[:2]
    return solution[:2], float(height), float(np.sqrt(np.trace(covariance[:2, :2])))
