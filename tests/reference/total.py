"""L = L_render + λ·L_sym and its gradient for every parameter (DESIGN §2; paper, eq. 3–5)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from reference import raster
from reference.arrays import Array, Gaussians, Mask, Projected, View
from reference.gaussian import covariance_gradient, covariances
from reference.projection import project_gaussians, projection_gradient
from reference.symmetry import Pairs, symmetry

SYMMETRY_WEIGHT = 1e-5
"""λ_sym, per mm²."""


class LossAndGradient(NamedTuple):
    """`loss` = `render` + λ·`symmetry`; `symmetry` in mm²; gradients per unit of the arrays."""

    loss: float
    render: float
    symmetry: float
    gradient: Gaussians


def detected(detections: Array) -> Mask:
    """Which detections (...,2|3) exist: finite, and confidence (if given) above 0 (DESIGN §1)."""
    found = np.isfinite(detections[..., :2]).all(axis=-1)
    if detections.shape[-1] == 3:
        found = found & (detections[..., 2] > 0)
    return np.asarray(found)


def project_detected(gaussians: Gaussians, detections: Array, view: View) -> Projected:
    """Project a skeleton; a joint counts as seen if it lies before the camera and is detected there."""
    projected = project_gaussians(gaussians.means, covariances(gaussians), view)
    return projected._replace(seen=projected.seen & detected(detections))


def targets(
    initial: Gaussians, detections: Array, views: Sequence[View], encoding: str = "one_hot"
) -> list[Array]:
    """Pseudo ground truth of every view, from the initial Gaussians and detections (M,N,2|3)."""
    images = []
    for points, view in zip(detections, views, strict=True):
        projected = project_detected(initial, points, view)
        images.append(raster.pseudo_ground_truth(points[:, :2], projected, view.size, encoding))
    return images


def view_loss(
    gaussians: Gaussians, detections: Array, view: View, target: Array, *, encoding: str
) -> tuple[float, Gaussians] | None:
    """Masked L2 of one view and its gradient; None if its mask is empty."""
    projected = project_detected(gaussians, detections, view)
    images, order = raster.splats(projected, view.size), raster.front_to_back(projected)
    result = raster.masked_l2(raster.encode(images, order, encoding), target)
    if result is None:
        return None
    value, d_channels = result
    d_images = raster.encode_gradient(d_channels, images, order, encoding)
    return value, splats_to_parameters(d_images, gaussians, projected, view)


def splats_to_parameters(
    d_images: Array, gaussians: Gaussians, projected: Projected, view: View
) -> Gaussians:
    """Carry ∂L/∂a (N,H,W) of one view back to means, log-scales and quaternions."""
    gradient = Gaussians(*(np.zeros_like(values) for values in gaussians))
    sigma = covariances(gaussians)
    for j in np.flatnonzero(projected.seen):
        d_mean2d, d_covariance2d = raster.splat_gradient(
            d_images[j], projected.means2d[j], projected.covariances2d[j]
        )
        d_mean, d_sigma = projection_gradient(
            d_mean2d, d_covariance2d, gaussians.means[j], sigma[j], view=view
        )
        gradient.means[j] = d_mean
        gradient.log_scales[j], gradient.quaternions[j] = covariance_gradient(
            d_sigma, gaussians.log_scales[j], gaussians.quaternions[j]
        )
    return gradient


def render_loss(
    gaussians: Gaussians, detections: Array, views: Sequence[View], images: Sequence[Array], *, encoding: str
) -> tuple[float, Gaussians]:
    """Mean of the views' masked L2 over the views with a non-empty mask, and its gradient."""
    parts = [
        view_loss(gaussians, points, view, target, encoding=encoding)
        for points, view, target in zip(detections, views, images, strict=True)
    ]
    found = [part for part in parts if part is not None]
    if not found:
        return 0.0, Gaussians(*(np.zeros_like(values) for values in gaussians))
    value = sum(part[0] for part in found) / len(found)
    gradients = [part[1] for part in found]
    return value, Gaussians(*(sum(group) / len(found) for group in zip(*gradients, strict=True)))


def loss_and_gradient(
    gaussians: Gaussians,
    detections: Array,
    views: Sequence[View],
    images: Sequence[Array],
    *,
    encoding: str = "one_hot",
    pairs: Pairs = (),
    symmetry_weight: float = SYMMETRY_WEIGHT,
    mm_per_unit: float = 1.0,
) -> LossAndGradient:
    """Evaluate the total loss over `views` with the constant `images` of `targets`, and every gradient.

    All of `pairs` count: leave out those with an undetected end point by `symmetry.observed_pairs`.
    """
    render, gradient = render_loss(gaussians, detections, views, images, encoding=encoding)
    squared, d_squared = symmetry(gaussians.means, pairs)
    in_mm2 = squared * mm_per_unit**2
    d_means = gradient.means + symmetry_weight * mm_per_unit**2 * d_squared
    loss = render + symmetry_weight * in_mm2
    return LossAndGradient(loss, render, in_mm2, gradient._replace(means=d_means))
