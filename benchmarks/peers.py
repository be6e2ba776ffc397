"""Triangulation of other libraries: OpenCV's, of two views, and SciPy's robust minimum, joint by joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.evaluation.baselines._observations import Cameras, homogeneous_to_world, observe

FloatArray = NDArray[np.float64]
# Scale of the Cauchy loss, px.
SCALE_PX = 5.0


def opencv_dlt(detections: ArrayLike, cameras: Cameras) -> Array:
    """Triangulate by ``cv2.triangulatePoints`` from the first two views that see the joint.

    OpenCV triangulates from two views only, so this is the whole answer of a stereo rig; with more views the
    others are not used. Joints are passed together for each pair of views.
    A joint that fewer than two views see is NaN.
    """
    import cv2

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


def scipy_cauchy(detections: FloatArray, rig: sk.CameraRig) -> FloatArray:
    """Run ``least_squares(loss="cauchy")`` on reprojection residuals (T, M, N, 2|3), starting from DLT."""
    matrices = np.stack([camera.K @ np.column_stack([camera.R, camera.t]) for camera in rig])
    poses = np.asarray(sk.triangulate(detections[..., :2], rig, method="dlt"))
    for t, j in np.argwhere(np.isfinite(poses).all(axis=-1)):
        pixels = detections[t, :, j, :2]
        seen = np.isfinite(pixels).all(axis=-1)
        poses[t, j] = _minimum(poses[t, j], pixels[seen], matrices[seen])
    return poses


def _minimum(start: FloatArray, pixels: FloatArray, matrices: FloatArray) -> FloatArray:
    from scipy.optimize import least_squares

    def image(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        point = matrices[:, :, :3] @ x + matrices[:, :, 3]
        return point[:, :2] / point[:, 2:], point[:, 2]

    def jacobian(x: FloatArray) -> FloatArray:
        at, depth = image(x)
        slopes = (matrices[:, :2, :3] - at[..., None] * matrices[:, 2:, :3]) / depth[:, None, None]
        return slopes.reshape(-1, 3)

    def residuals(x: FloatArray) -> FloatArray:
        return (image(x)[0] - pixels).ravel()

    solution: FloatArray = least_squares(residuals, start, jac=jacobian, loss="cauchy", f_scale=SCALE_PX).x
    return solution
