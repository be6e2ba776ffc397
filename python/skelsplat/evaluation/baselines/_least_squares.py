"""Robust non-linear triangulation: the Cauchy loss from DLT, and the Huber loss that follows a RANSAC."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skelsplat.evaluation.baselines._linear import solve
from skelsplat.evaluation.baselines._minimise import Reprojections, cauchy_loss, huber, minimise
from skelsplat.evaluation.baselines._observations import (
    BoolArray,
    Cameras,
    FloatArray,
    Observations,
    observe,
)
from skelsplat.exceptions import InvalidInputError


def cauchy(detections: ArrayLike, cameras: Cameras, *, f_scale: float = 5.0) -> FloatArray:
    """Triangulate by DLT, then minimise the Cauchy loss of the reprojection residuals.

    The minimum of ½ Σ f² ln(1 + r²/f²) over the 2·M residuals û − u, v̂ − v of a joint, as
    ``scipy.optimize.least_squares(loss="cauchy")`` finds it, but for all joints at once.

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
    """
    positive("f_scale", f_scale)
    joints = observe(detections, cameras)
    weights = joints.seen.astype(np.float64)
    problem = Reprojections.of(joints, weights, by_view=False)
    return joints.points(minimise(solve(joints, weights), problem, cauchy_loss(f_scale)))


def huber_on_half_distances(
    start: FloatArray, joints: Observations, used: BoolArray, crop_scale: FloatArray
) -> FloatArray:
    """Minimise the Huber loss (threshold 1) of ½ · the reprojection distances in crop pixels.

    Parameters
    ----------
    start : (B, 3)
        Where it is NaN it stays so.
    joints : Observations
    used : (B, M)
        Views that take part.
    crop_scale : (B, M)
        Pixels of the image per pixel of the crop.
    """
    return minimise(start, Reprojections.of(joints, used * 0.5 / crop_scale, by_view=True), huber)


def positive(name: str, value: float, *, kind: Literal["number", "integer"] = "number") -> None:
    """Raise `InvalidInputError` unless the argument ``name`` is finite and above zero."""
    if not (np.isfinite(value) and value > 0) or (kind == "integer" and value != int(value)):
        raise InvalidInputError(f"{name}: expected a positive {kind}, got {value!r}")
