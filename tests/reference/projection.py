"""EWA projection of 3D Gaussians, Σ² = J W Σ Wᵀ Jᵀ + h·I (DESIGN §2; paper, eq. 2 and supplement A)."""

from typing import NamedTuple

import numpy as np

from reference.arrays import Array, Projected, View
from reference.camera import pinhole, to_camera

LOW_PASS_PX2 = 0.3
"""h, the constant that the paper adds "to prevent numerical issues"."""
MIN_DEPTH = 1e-3
"""A joint at this camera depth or nearer (unit of the arrays) is not seen."""
MARGIN = 0.15
"""The field of view is widened by this part of the image's width (height) on each side: 30 % of the half."""


class Ratio(NamedTuple):
    """x/z or y/z as it stands in J, and whether the clamp left it alone."""

    value: float
    free: bool


def clamped_ratio(ratio: float, focal: float, centre: float, extent: int) -> Ratio:
    """Clamp x/z (or y/z) to the widened field of view of an image of `extent` pixels."""
    low = (-0.5 - centre) / focal - MARGIN * extent / focal
    high = (extent - 0.5 - centre) / focal + MARGIN * extent / focal
    return Ratio(min(max(ratio, low), high), low < ratio < high)


def clamped_ratios(point: Array, view: View) -> tuple[Ratio, Ratio]:
    """Both ratios of a camera-frame point (3,)."""
    x, y, z = point
    K, (width, height) = view.K, view.size
    return clamped_ratio(x / z, K[0, 0], K[0, 2], width), clamped_ratio(y / z, K[1, 1], K[1, 2], height)


def jacobian(point: Array, view: View) -> Array:
    """J (2,3), the pinhole's derivative at a camera-frame point (supplement A), with clamped ratios."""
    (u, _), (v, _) = clamped_ratios(point, view)
    fx, fy, z = view.K[0, 0], view.K[1, 1], point[2]
    return np.array([[fx / z, 0.0, -fx * u / z], [0.0, fy / z, -fy * v / z]])


def exact_jacobian(point: Array, view: View) -> Array:
    """Return the derivative (2,3) of the projected mean itself: no clamp."""
    (x, y, z), fx, fy = point, view.K[0, 0], view.K[1, 1]
    return np.array([[fx / z, 0.0, -fx * x / z**2], [0.0, fy / z, -fy * y / z**2]])


def project_covariance(mean: Array, covariance: Array, view: View) -> Array:
    """Σ² (2,2) in px²."""
    T = jacobian(to_camera(mean, view.R, view.t), view) @ view.R
    return np.asarray(T @ covariance @ T.T + LOW_PASS_PX2 * np.eye(2))


def project_gaussians(means: Array, covariances: Array, view: View) -> Projected:
    """Every joint in one view; entries of joints that are not seen are NaN."""
    points = to_camera(means, view.R, view.t)
    seen = points[:, 2] > MIN_DEPTH
    means2d = np.full((len(means), 2), np.nan)
    covariances2d = np.full((len(means), 2, 2), np.nan)
    means2d[seen] = pinhole(points[seen], view.K)
    for j in np.flatnonzero(seen):
        covariances2d[j] = project_covariance(means[j], covariances[j], view)
    return Projected(means2d, covariances2d, points[:, 2], seen)


def jacobian_partials(point: Array, view: View) -> Array:
    """∂J/∂(x, y, z) (3,2,3) of the clamped J; a clamped ratio is a constant.

    J₀₂ = −fx·u/z with u = x/z: ∂u/∂x = 1/z, ∂u/∂z = −u/z. The second row is the same with y.
    """
    z = point[2]
    partials = np.zeros((3, 2, 3))
    for row, ratio in enumerate(clamped_ratios(point, view)):
        f = view.K[row, row]
        by_own, by_z = (1 / z, -ratio.value / z) if ratio.free else (0.0, 0.0)
        partials[2, row, row] = -f / z**2
        partials[row, row, 2] = -f * by_own / z
        partials[2, row, 2] = f * ratio.value / z**2 - f * by_z / z
    return partials


def projection_gradient(
    d_mean2d: Array, d_covariance2d: Array, mean: Array, covariance: Array, *, view: View
) -> tuple[Array, Array]:
    """Carry ∂L/∂m (2,) and ∂L/∂Σ² (2,2, symmetric) back to the mean (3,) and Σ (3,3).

    With T = J W: ∂L/∂Σ = Tᵀ G T, ∂L/∂T = 2 G T Σ, ∂L/∂J = ∂L/∂T Wᵀ. The mean moves m and,
    through J, the shape.
    """
    point = to_camera(mean, view.R, view.t)
    T = jacobian(point, view) @ view.R
    d_covariance = T.T @ d_covariance2d @ T
    d_jacobian = 2 * d_covariance2d @ T @ covariance @ view.R.T
    through_shape = np.array([np.sum(d_jacobian * partial) for partial in jacobian_partials(point, view)])
    d_point = exact_jacobian(point, view).T @ d_mean2d + through_shape
    return view.R.T @ d_point, d_covariance
