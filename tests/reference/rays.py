"""Detections as rays (DESIGN §3): offsets, weights, and the point nearest to all of them. Lengths are mm."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from reference.arrays import Array, View


class Rays(NamedTuple):
    """Centres (M,1,3), directions (M,N,3), weights (M,N) with 0 where there is none, rad per px (M,N)."""

    centre: Array
    direction: Array
    weight: Array
    pixel: Array

    @property
    def mean_weight(self) -> float:
        """Mean over the detections."""
        return float(self.weight[self.weight > 0].mean()) if (self.weight > 0).any() else 1.0


def make_rays(detections: Array, views: Sequence[View], view_weights: Array | None = None) -> Rays:
    """Turn ideal pixels and confidences (M,N,3) into rays."""
    M, N = detections.shape[:2]
    direction, pixel = np.zeros((M, N, 3)), np.zeros((M, N))
    there = np.isfinite(detections).all(axis=-1) & (detections[..., 2] > 0)
    for i, view in enumerate(views):
        ideal = np.concatenate([np.nan_to_num(detections[i, :, :2]), np.ones((N, 1))], axis=1)
        through = ideal @ np.linalg.inv(view.K).T
        length = np.linalg.norm(through, axis=1)
        direction[i] = through / length[:, None] @ view.R
        pixel[i] = 1 / (length * np.sqrt(view.K[0, 0] * view.K[1, 1]))
    weight = np.where(there, detections[..., 2], 0.0)
    if view_weights is not None:
        weight = weight * view_weights[:, None]
    return Rays(np.array([[-view.R.T @ view.t] for view in views]), direction, weight, pixel)


def offsets(x: Array, rays: Rays) -> tuple[Array, Array]:
    """Offset e (M,N,3) from the ray to the joint, and the joint's distance along it (M,N)."""
    from_centre = x - rays.centre
    along = np.einsum("mna,mna->mn", from_centre, rays.direction)
    return from_centre - along[..., None] * rays.direction, along


def weights(x: Array, rays: Rays, sigma: Array) -> Array:
    """Weights c k (M,N) under kernels `sigma` (N,); 0 behind a camera."""
    e, along = offsets(x, rays)
    k = np.exp(-np.sum(e**2, axis=-1) / (4 * sigma**2))
    return np.where((rays.weight > 0) & (along > 0), rays.weight * k, 0.0)


def information(w: Array, rays: Rays) -> Array:
    """Σ w (I − d dᵀ) per joint (N,3,3)."""
    across = np.eye(3) - np.einsum("mna,mnb->mnab", rays.direction, rays.direction)
    return np.asarray(np.einsum("mn,mnab->nab", w, across))


def pixel_mm(x: Array, rays: Rays) -> float | None:
    """Mean size of a pixel at the joints, over the detections in front of their camera."""
    _, along = offsets(x, rays)
    there = (rays.weight > 0) & (along > 0)
    return float((along * rays.pixel)[there].mean()) if there.any() else None
