"""Linear triangulation: the direct linear transform over all joints at once, and OpenCV's of two views."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._optional import require
from skelsplat.evaluation.baselines._observations import Cameras, FloatArray, Observations, observe


def dlt(detections: ArrayLike, cameras: Cameras, *, confidence: bool = False) -> FloatArray:
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

    Returns
    -------
    (T, N, 3) or (N, 3)
        NaN with fewer than two views.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, a confidence outside [0, 1].
    """
    joints = observe(detections, cameras)
    weights = joints.confidence if confidence else joints.seen.astype(np.float64)
    return joints.points(solve(joints, weights))


def solve(joints: Observations, weights: FloatArray) -> FloatArray:
    """Triangulate (B, 3) with the rows of view i of joint b multiplied by ``weights[b, i]``."""
    frame = rig_frame(joints.projections)
    projections = joints.projections @ frame
    # Rows in units of the focal length instead of px: the answer is the same, A is well scaled.
    projections = projections / np.abs(joints.projections[:, :2, :3]).max()
    A = joints.pixels[..., None] * projections[:, 2:] - projections[:, :2]
    A = (A * weights[..., None, None]).reshape(len(weights), -1, 4)
    # Eigenvectors of AᵀA cost half of the singular vectors of A; rounding stays near 1e-16 · (σ₁/σ₃)², and
    # σ₁/σ₃ is below 1e3 unless all rays are parallel.
    null = np.linalg.eigh(np.swapaxes(A, 1, 2) @ A)[1][:, :, 0]
    points = homogeneous_to_world(null @ frame.T)
    points[np.count_nonzero(weights, axis=1) < 2] = np.nan
    return points


def rig_frame(projections: FloatArray) -> FloatArray:
    """Similarity (4, 4) to the world from a frame at the mean camera centre, of the cameras' RMS distance."""
    centres = -np.linalg.solve(projections[:, :, :3], projections[:, :, 3:])[..., 0]
    middle = centres.mean(axis=0)
    length = np.sqrt(np.mean(np.sum((centres - middle) ** 2, axis=1)))
    frame = np.diag([length if length > 0 else 1.0] * 3 + [1.0])
    frame[:3, 3] = middle
    return frame


def homogeneous_to_world(points: FloatArray) -> FloatArray:
    """Divide (B, 4) by the fourth coordinate; NaN for a point at infinity."""
    with np.errstate(divide="ignore", invalid="ignore"):
        divided = points[:, :3] / points[:, 3:]
    return np.where(np.isfinite(divided), divided, np.nan)


def opencv_dlt(detections: ArrayLike, cameras: Cameras) -> FloatArray:
    """Triangulate by ``cv2.triangulatePoints`` from the first two views that see the joint.

    OpenCV triangulates from two views only, so this is the whole answer of a stereo rig; with more views the
    others are not used. Joints are passed together for each pair of views.

    Parameters
    ----------
    detections : (T, M, N, 2|3) or (M, N, 2|3) px
    cameras : CameraRig or sequence of Camera

    Returns
    -------
    (T, N, 3) or (N, 3)
        NaN with fewer than two views.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, a confidence outside [0, 1].
    MissingPackageError
        If OpenCV is not installed.
    """
    cv2 = require("cv2", "OpenCV's triangulation", "evaluation")
    joints = observe(detections, cameras)
    points = np.full((len(joints.seen), 3), np.nan)
    first_two = np.argsort(~joints.seen, axis=1, kind="stable")[:, :2]
    determined = joints.determined
    for a, b in np.unique(first_two[determined], axis=0):
        own = determined & (first_two == (a, b)).all(axis=1)
        found = cv2.triangulatePoints(
            joints.projections[a], joints.projections[b], joints.pixels[own, a].T, joints.pixels[own, b].T
        )
        points[own] = homogeneous_to_world(found.T)
    return joints.points(points)
