"""The usual SciPy solution: ``least_squares(loss="cauchy")`` on reprojection residuals, joint by joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import skelsplat as sk

FloatArray = NDArray[np.float64]
# Scale of the loss, px.
SCALE_PX = 5.0


def scipy_cauchy(detections: FloatArray, rig: sk.CameraRig) -> FloatArray:
    """Poses (T, N, 3) from detections (T, M, N, 2|3) of undistorted cameras, starting from DLT."""
    matrices = np.stack([camera.K @ np.column_stack([camera.R, camera.t]) for camera in rig])
    poses = np.asarray(sk.triangulate(detections[..., :2], rig, method="dlt"))
    for t, j in np.argwhere(np.isfinite(poses).all(axis=-1)):
        pixels = detections[t, :, j, :2]
        seen = np.isfinite(pixels).all(axis=-1)
        poses[t, j] = _solve(poses[t, j], pixels[seen], matrices[seen])
    return poses


def _solve(start: FloatArray, pixels: FloatArray, matrices: FloatArray) -> FloatArray:
    def image(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        point = matrices[:, :, :3] @ x + matrices[:, :, 3]
        return point[:, :2] / point[:, 2:], point[:, 2]

    def residuals(x: FloatArray) -> FloatArray:
        return (image(x)[0] - pixels).ravel()

    def jacobian(x: FloatArray) -> FloatArray:
        at, depth = image(x)
        slopes = (matrices[:, :2, :3] - at[..., None] * matrices[:, 2:, :3]) / depth[:, None, None]
        return slopes.reshape(-1, 3)

    found = least_squares(residuals, start, jac=jacobian, loss="cauchy", f_scale=SCALE_PX)
    solution: FloatArray = found.x
    return solution
