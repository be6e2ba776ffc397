"""Robust non-linear triangulation of one joint after the other, by SciPy."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skelsplat.evaluation.baselines._linear import solve
from skelsplat.evaluation.baselines._observations import Cameras, FloatArray, observe
from skelsplat.evaluation.baselines._optional import require
from skelsplat.exceptions import InvalidInputError


def cauchy(detections: ArrayLike, cameras: Cameras, *, f_scale: float = 5.0) -> FloatArray:
    """Triangulate by DLT, then minimise the Cauchy loss of the reprojection residuals, joint by joint.

    ``scipy.optimize.least_squares(loss="cauchy")`` on the 2·M residuals û − u, v̂ − v of a joint, with their
    Jacobian: Σ f² ln(1 + r²/f²).

    Parameters
    ----------
    detections : (T, M, N, 2|3) or (M, N, 2|3) px
    cameras : CameraRig or sequence of Camera
    f_scale : float
        f in px, beyond which a residual counts as an outlier; about twice the detector's jitter.

    Returns
    -------
    (T, N, 3) or (N, 3)
        NaN with fewer than two views.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, a confidence outside [0, 1], an ``f_scale`` that is not positive.
    ImportError
        If SciPy is not installed.
    """
    positive("f_scale", f_scale)
    least_squares = require("scipy.optimize").least_squares
    joints = observe(detections, cameras)
    points = solve(joints, joints.seen.astype(np.float64))
    for b in np.flatnonzero(np.isfinite(points).all(axis=1)):
        seen = joints.seen[b]
        problem = Reprojection(joints.pixels[b, seen], joints.projections[seen])
        points[b] = least_squares(
            problem.offsets, points[b], jac=problem.offset_slopes, loss="cauchy", f_scale=f_scale
        ).x
    return joints.points(points)


def huber_on_half_distances(start: FloatArray, pixels: FloatArray, projections: FloatArray) -> FloatArray:
    """Minimise SciPy's Huber loss (threshold 1) of ½ · the reprojection distances of one joint.

    Parameters
    ----------
    start : (3,)
    pixels : (V, 2)
    projections : (V, 3, 4)
        In the same pixels.
    """
    least_squares = require("scipy.optimize").least_squares
    problem = Reprojection(pixels, projections)
    found: FloatArray = least_squares(
        problem.half_distances, start, jac=problem.half_distance_slopes, loss="huber", method="trf"
    ).x
    return found


class Reprojection:
    """Residuals of one joint in V views, and their derivatives in the point X (3,).

    Parameters
    ----------
    pixels : (V, 2) px
    projections : (V, 3, 4)
    """

    def __init__(self, pixels: FloatArray, projections: FloatArray) -> None:
        self._pixels = pixels
        self._matrix = projections[:, :, :3]
        self._shift = projections[:, :, 3]

    def offsets(self, X: FloatArray) -> FloatArray:
        """Components û − u, v̂ − v, (2V,) px."""
        return self._offsets(X)[0].ravel()

    def offset_slopes(self, X: FloatArray) -> FloatArray:
        """Differentiate ``offsets``, (2V, 3)."""
        return self._slopes(*self._offsets(X)).reshape(-1, 3)

    def half_distances(self, X: FloatArray) -> FloatArray:
        """½ ‖(û − u, v̂ − v)‖, (V,) px."""
        half: FloatArray = 0.5 * np.linalg.norm(self._offsets(X)[0], axis=1)
        return half

    def half_distance_slopes(self, X: FloatArray) -> FloatArray:
        """Differentiate ``half_distances``, (V, 3); zero where the distance is."""
        offsets, depth = self._offsets(X)
        distance = np.linalg.norm(offsets, axis=1, keepdims=True)
        direction = np.divide(offsets, distance, out=np.zeros_like(offsets), where=distance > 0)
        slopes: FloatArray = 0.5 * np.einsum("vk,vkx->vx", direction, self._slopes(offsets, depth))
        return slopes

    def _offsets(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        image = self._matrix @ X + self._shift
        return image[:, :2] / image[:, 2:] - self._pixels, image[:, 2]

    def _slopes(self, offsets: FloatArray, depth: FloatArray) -> FloatArray:
        """Quotient rule: ∂(p₁/p₃) = (∂p₁ − û ∂p₃) / p₃, (V, 2, 3)."""
        reprojected = (offsets + self._pixels)[..., None]
        slopes: FloatArray = (self._matrix[:, :2] - reprojected * self._matrix[:, 2:]) / depth[:, None, None]
        return slopes


def positive(name: str, value: float, *, kind: Literal["number", "integer"] = "number") -> None:
    """Raise `InvalidInputError` unless the argument ``name`` is finite and above zero."""
    if not (np.isfinite(value) and value > 0) or (kind == "integer" and value != int(value)):
        raise InvalidInputError(f"{name}: expected a positive {kind}, got {value!r}")
