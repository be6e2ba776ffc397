"""Detections and cameras as arrays, and linear triangulation of all joints at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import Array, Mask, numbers
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError

Cameras = CameraRig | Sequence[Camera]

# Squares of pixels times lengths stay doubles in the normal equations; LAPACK may not return from infinities.
_FARTHEST = 1e50


@dataclass(frozen=True, slots=True)
class Observations:
    """B = T·N joints, each seen by some of M views."""

    pixels: Array  # (B, M, 2) px: Ideal pixels; 0 where the joint is missing
    seen: Mask  # (B, M)
    confidence: Array  # (B, M): In [0, 1]; 0 where the joint is missing, 1 where none was given
    projections: Array  # (M, 3, 4): K [R | t], from the unit of the cameras to px
    leading: tuple[int, ...]  # (T, N), or (N,) for one frame

    @property
    def determined(self) -> Mask:
        """Whether at least two views see the joint, (B,)."""
        return np.asarray(self.seen.sum(axis=1) >= 2)

    def take(self, joints: NDArray[np.intp]) -> Observations:
        """Return some of the joints; ``leading`` is then their number."""
        own = {name: getattr(self, name)[joints] for name in ("pixels", "seen", "confidence")}
        return replace(self, leading=(len(joints),), **own)

    def points(self, values: Array) -> Array:
        """Give points (B, 3) the shape of the detections, (T, N, 3) or (N, 3)."""
        return values.reshape(*self.leading, 3)


def observe(detections: ArrayLike, cameras: Cameras) -> Observations:
    """Check the arguments of a baseline and remove lens distortion."""
    found, n_views = numbers(detections, "detections"), len(cameras)
    if found.ndim not in (3, 4) or found.shape[-1] not in (2, 3) or found.shape[-3] != n_views:
        expected = f"shape (T, M, N, 2|3) or (M, N, 2|3) with M = {n_views}, one view per camera"
        raise InvalidInputError(f"detections: expected {expected}, got {found.shape}")
    frames = found.reshape(-1, *found.shape[-3:])
    ideal = np.stack([c.undistort(frames[:, i, :, :2]) for i, c in enumerate(cameras)], axis=2)
    pixels = ideal.reshape(-1, n_views, 2)
    if (np.abs(pixels[np.isfinite(pixels)]) > _FARTHEST).any():
        raise InvalidInputError(f"detections: expected pixels up to ±{_FARTHEST:g}, got others")
    seen: Mask = np.asarray(np.isfinite(pixels).all(axis=-1))
    confidence = np.ones(seen.shape)
    if found.shape[-1] == 3:
        confidence = np.swapaxes(frames[..., 2], 1, 2).reshape(seen.shape)
        if ((confidence[seen] < 0) | (confidence[seen] > 1)).any():
            raise InvalidInputError("detections: expected confidences in [0, 1], got others")
        seen &= confidence > 0
    return Observations(
        pixels=np.where(seen[..., None], pixels, 0.0),
        seen=seen,
        confidence=np.where(seen, confidence, 0.0),
        projections=np.stack([c.K @ np.column_stack([c.R, c.t]) for c in cameras]),
        leading=found.shape[:-3] + found.shape[-2:-1],
    )


def reproject(points: Array, projections: Array) -> Array:
    """Project points (B, 3) into every view: (B, M, 2) px; not finite on a camera's focal plane."""
    image = homogeneous(points, projections)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(image[..., :2] / image[..., 2:])


def homogeneous(points: Array, projections: Array) -> Array:
    """Return P X of points (B, 3) in every view, (B, M, 3)."""
    rows = projections.reshape(-1, 4)
    return np.asarray(points @ rows[:, :3].T + rows[:, 3]).reshape(len(points), -1, 3)


def dlt(detections: ArrayLike, cameras: Cameras, *, confidence: bool = False) -> Array:
    """Triangulate every joint by the direct linear transform (Hartley & Zisserman, §12.2).

    A view that sees the joint at (u, v) gives the rows u·P₃ − P₁ and v·P₃ − P₂ of A, with ``confidence``
    multiplied by the detection's; the point is the homogeneous vector of norm 1 with the least ‖A X‖. That
    norm depends on the world's origin and unit, so X is sought in a frame with its origin at the mean camera
    centre and the cameras' RMS distance from it as unit.
    """
    joints = observe(detections, cameras)
    weights = joints.confidence if confidence else joints.seen.astype(np.float64)
    return joints.points(solve(joints, weights))


def solve(joints: Observations, weights: Array) -> Array:
    """Triangulate (B, 3) with the rows of view i of joint b multiplied by ``weights[b, i]``."""
    frame = rig_frame(joints.projections)
    projections = joints.projections @ frame
    # Rows in units of the focal length instead of px: the answer is the same, A is well scaled.
    projections = projections / np.abs(joints.projections[:, :2, :3]).max()
    A = joints.pixels[..., None] * projections[:, 2:] - projections[:, :2]
    A = (A * weights[..., None, None]).reshape(len(weights), 2 * weights.shape[1], 4)
    # Eigenvectors of AᵀA cost half of the singular vectors of A; rounding stays near 1e-16 · (σ₁/σ₃)², and
    # σ₁/σ₃ is below 1e3 unless all rays are parallel.
    null = np.linalg.eigh(np.swapaxes(A, 1, 2) @ A)[1][:, :, 0]
    points = homogeneous_to_world(null @ frame.T)
    points[np.count_nonzero(weights, axis=1) < 2] = np.nan
    return points


def rig_frame(projections: Array) -> Array:
    """Similarity (4, 4) to the world from a frame at the mean camera centre, of the cameras' RMS distance."""
    centres = -np.linalg.solve(projections[:, :, :3], projections[:, :, 3:])[..., 0]
    middle = centres.mean(axis=0)
    length = np.sqrt(np.mean(np.sum((centres - middle) ** 2, axis=1)))
    frame = np.diag([length if length > 0 else 1.0] * 3 + [1.0])
    frame[:3, 3] = middle
    return frame


def homogeneous_to_world(points: Array) -> Array:
    """Divide (B, 4) by the fourth coordinate; NaN for a point at infinity."""
    with np.errstate(divide="ignore", invalid="ignore"):
        divided = points[:, :3] / points[:, 3:]
    return np.where(np.isfinite(divided), divided, np.nan)
