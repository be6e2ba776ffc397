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

IntArray = NDArray[np.intp]
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
        enough: Mask = self.seen.sum(axis=1) >= 2
        return enough

    def take(self, joints: IntArray) -> Observations:
        """Return some of the joints; ``leading`` is then their number."""
        own = {name: getattr(self, name)[joints] for name in ("pixels", "seen", "confidence")}
        return replace(self, leading=(len(joints),), **own)

    def points(self, values: Array) -> Array:
        """Give points (B, 3) the shape of the detections, (T, N, 3) or (N, 3)."""
        return values.reshape(*self.leading, 3)


def observe(detections: ArrayLike, cameras: Cameras) -> Observations:
    """Check the arguments of a baseline and remove lens distortion."""
    found = _checked(detections, len(cameras))
    single = found.ndim == 3
    frames = found[None] if single else found
    n_frames, n_views, n_joints, channels = frames.shape
    ideal = np.stack([c.undistort(frames[:, i, :, :2]) for i, c in enumerate(cameras)], axis=2)
    pixels = ideal.reshape(n_frames * n_joints, n_views, 2)
    seen: Mask = np.asarray(np.isfinite(pixels).all(axis=-1))
    confidence = np.ones(seen.shape)
    if channels == 3:
        confidence = np.swapaxes(frames[..., 2], 1, 2).reshape(seen.shape)
        seen &= confidence > 0
    return Observations(
        pixels=np.where(seen[..., None], pixels, 0.0),
        seen=seen,
        confidence=np.where(seen, confidence, 0.0),
        projections=np.stack([c.K @ np.column_stack([c.R, c.t]) for c in cameras]),
        leading=(n_joints,) if single else (n_frames, n_joints),
    )


def _checked(detections: ArrayLike, n_views: int) -> Array:
    """Return the detections as float64 of a shape and with confidences that make sense."""
    found = numbers(detections, "detections")
    if found.ndim not in (3, 4) or found.shape[-1] not in (2, 3):
        raise InvalidInputError(
            f"detections: expected shape (T, M, N, 2|3) or (M, N, 2|3), got {found.shape}"
        )
    if found.shape[-3] != n_views:
        raise InvalidInputError(
            f"detections: expected M = {n_views} views, one per camera, got {found.shape[-3]}"
        )
    far = np.abs(found[..., :2]) > _FARTHEST
    if (far & np.isfinite(found[..., :2])).any():
        expected = f"pixels from -{_FARTHEST:g} to {_FARTHEST:g}"
        raise InvalidInputError(f"detections: expected {expected}, got {found[..., :2][far][0]:g}")
    if found.shape[-1] == 3:
        confidence = found[..., 2]
        outside = confidence[np.isfinite(found[..., :2]).all(axis=-1) & ((confidence < 0) | (confidence > 1))]
        if outside.size:
            raise InvalidInputError(
                f"detections: expected confidences in [0, 1], got {float(outside.flat[0])!r}"
            )
    return found


def reproject(points: Array, projections: Array) -> Array:
    """Project points (B, 3) into every view: (B, M, 2) px; not finite on a camera's focal plane."""
    image = homogeneous(points, projections)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels: Array = image[..., :2] / image[..., 2:]
    return pixels


def homogeneous(points: Array, projections: Array) -> Array:
    """Return P X of points (B, 3) in every view, (B, M, 3)."""
    rows = projections.reshape(-1, 4)
    image: Array = (points @ rows[:, :3].T + rows[:, 3]).reshape(len(points), -1, 3)
    return image


def dlt(detections: ArrayLike, cameras: Cameras, *, confidence: bool = False) -> Array:
    """Triangulate every joint by the direct linear transform (Hartley & Zisserman, §12.2).

    A view that sees the joint at (u, v) gives the rows u·P₃ − P₁ and v·P₃ − P₂ of A; the point is the
    homogeneous vector of norm 1 with the least ‖A X‖. That norm depends on the world's origin and unit, so X
    is sought in a frame with its origin at the mean camera centre and the cameras' RMS distance from it as
    unit: then the answer on noisy pixels depends on neither. All T·N joints are solved in one call.

    Parameters
    ----------
    detections : (T, M, N, 2|3) or (M, N, 2|3) px
    cameras : CameraRig or sequence of Camera
    confidence : bool
        Multiply the rows by the confidence (algebraic triangulation with weights); False tells from it only
        what is missing.
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
