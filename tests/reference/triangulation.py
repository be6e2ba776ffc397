"""Initial poses: linear triangulation and the fusion of monocular poses (DESIGN §2, "Initial pose")."""

from collections.abc import Sequence

import numpy as np

from reference.arrays import Array, View
from reference.camera import pinhole, to_camera
from reference.total import detected


def conditioning(views: Sequence[View]) -> Array:
    """Similarity (4,4) from a frame centred on the cameras, with rms distance 1 to them, to the world.

    The unit norm that DLT puts on (X, 1) depends on origin and unit; in this frame the solution does not
    (Hartley & Zisserman, §4.4). All cameras of the rig count, whether they detect the joint or not.
    """
    centres = np.array([-view.R.T @ view.t for view in views])
    middle = centres.mean(axis=0)
    radius = np.sqrt(np.mean(np.sum((centres - middle) ** 2, axis=1)))
    T = np.diag([radius, radius, radius, 1.0])
    T[:3, 3] = middle
    return T


def triangulate_joint(detections: Array, weights: Array, views: Sequence[View]) -> Array:
    """One joint (3,) from ideal pixels (M,2) by DLT (Hartley & Zisserman, §12.2).

    Each view gives the rows w(u·P₃ − P₁) and w(v·P₃ − P₂) of A with P = K [R | t] T in pixels; the solution
    is A's last right singular vector, brought back by T (`conditioning`). NaN with fewer than two views.
    """
    rows, T = [], conditioning(views)
    for (u, v), weight, view in zip(detections, weights, views, strict=True):
        if weight > 0 and np.isfinite([u, v]).all():
            P = view.K @ np.column_stack([view.R, view.t]) @ T
            rows += [weight * (u * P[2] - P[0]), weight * (v * P[2] - P[1])]
    if len(rows) < 4:
        return np.full(3, np.nan)
    X = T @ np.linalg.svd(np.array(rows))[2][-1]
    return np.asarray(X[:3] / X[3])


def triangulate(detections: Array, views: Sequence[View], confidence: Array | None = None) -> Array:
    """Triangulate (N,3) from (M,N,2|3); weights are `confidence` (M,N), else the third channel, else 1."""
    if confidence is None:
        confidence = detections[..., 2] if detections.shape[-1] == 3 else np.ones(detections.shape[:2])
    return np.array(
        [triangulate_joint(detections[:, j, :2], confidence[:, j], views) for j in range(detections.shape[1])]
    )


def fuse_monocular(poses: Array, detections: Array, views: Sequence[View]) -> Array:
    """X_j = Σ_i w_ij X_ij with w_ij ∝ 1/(mean reprojection error of X_ij over the views that detect j)."""
    errors = np.full((len(views), *poses.shape[:2]), np.nan)
    for k, (points, view) in enumerate(zip(detections, views, strict=True)):
        pixels = pinhole(to_camera(poses, view.R, view.t), view.K)
        distances = np.linalg.norm(pixels - points[:, :2], axis=-1)
        errors[k] = np.where(detected(points), distances, np.nan)
    weights = 1 / np.nanmean(errors, axis=0)
    weights = weights / weights.sum(axis=0)
    return np.asarray(np.sum(weights[..., None] * poses, axis=0))
