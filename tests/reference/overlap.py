"""The rendering loss in closed form: ∫(R−P)² of two bells over the plane (DESIGN §3)."""

from collections.abc import Sequence

import numpy as np

from reference.arrays import Array, Gaussians, View
from reference.gaussian import covariance_gradient, covariances
from reference.projection import projection_gradient
from reference.total import project_detected

ELLIPSE = 2 * np.log(255)
"""Area of the ellipse a ≥ 1/255 over the energy π√|Σ|."""


def integral(d: Array, render: Array, target: Array) -> float:
    """∫(R−P)² for bells of covariance `render` and `target` (2,2) whose centres are `d` (2,) apart."""
    both = render + target
    k = np.exp(-0.5 * d @ np.linalg.solve(both, d))
    det = np.linalg.det
    cross = np.sqrt(det(render) * det(target) / det(both)) * k
    return float(np.pi * np.sqrt(det(render)) + np.pi * np.sqrt(det(target)) - 4 * np.pi * cross)


def integral_gradient(d: Array, render: Array, target: Array) -> tuple[Array, Array]:
    """Gradient of `integral` in `d` (2,) and in `render` (2,2), term by term.

    d√|S| = ½√|S| S⁻¹; log cross = ½ log|S| − ½ log|S+T| − ½ dᵀ(S+T)⁻¹d + const.
    """
    inverse, both = np.linalg.inv(render), np.linalg.inv(render + target)
    cross = integral(d, render, target)
    own, other = np.pi * np.sqrt(np.linalg.det(render)), np.pi * np.sqrt(np.linalg.det(target))
    cross = own + other - cross  # 4π·√(…)·k
    d_log = 0.5 * inverse - 0.5 * both + 0.5 * np.outer(both @ d, both @ d)
    return cross * (both @ d), 0.5 * own * inverse - cross * d_log


def render_loss(
    gaussians: Gaussians, initial: Gaussians, detections: Array, views: Sequence[View]
) -> tuple[float, Gaussians]:
    """Mean over views of Σ_j ∫(R−P)² / Σ_j area of the target's ellipse, and its gradient."""
    sigma, values = covariances(gaussians), []
    gradient = Gaussians(*(np.zeros_like(group) for group in gaussians))
    for points, view in zip(detections, views, strict=True):
        targets = project_detected(initial, points, view)
        now = project_detected(gaussians, points, view)
        seen = np.flatnonzero(targets.seen)
        area = sum(ELLIPSE * np.pi * np.sqrt(np.linalg.det(targets.covariances2d[j])) for j in seen)
        values.append(
            sum(
                integral(now.means2d[j] - points[j, :2], now.covariances2d[j], targets.covariances2d[j])
                for j in seen
            )
            / area
        )
        for j in seen:
            d_mean2d, d_covariance2d = integral_gradient(
                now.means2d[j] - points[j, :2], now.covariances2d[j], targets.covariances2d[j]
            )
            d_mean, d_sigma = projection_gradient(
                d_mean2d, d_covariance2d, gaussians.means[j], sigma[j], view=view
            )
            d_log_scales, d_quaternion = covariance_gradient(
                d_sigma, gaussians.log_scales[j], gaussians.quaternions[j]
            )
            share = area * len(views)
            gradient.means[j] += d_mean / share
            gradient.log_scales[j] += d_log_scales / share
            gradient.quaternions[j] += d_quaternion / share
    return float(np.mean(values)), gradient
