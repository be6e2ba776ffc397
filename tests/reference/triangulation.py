"""Initial poses: triangulation, linear or by consensus, and the fusion of monocular poses (DESIGN §2)."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from reference.arrays import Array, Mask, View
from reference.camera import pinhole, to_camera
from reference.total import detected


def conditioning(views: Sequence[View]) -> Array:
    """Similarity (4,4) from a frame centred on the cameras, with rms distance 1 to them, to the world.

    The unit norm that DLT puts on (X, 1) depends on origin and unit; in this frame the solution does not
    (Hartley & Zisserman, §4.4). `views` are those whose detections are used; coinciding ones keep the unit.
    """
    centres = np.array([-view.R.T @ view.t for view in views])
    middle = centres.mean(axis=0)
    radius = np.sqrt(np.mean(np.sum((centres - middle) ** 2, axis=1)))
    radius = radius if radius > 0 else 1.0
    T = np.diag([radius, radius, radius, 1.0])
    T[:3, 3] = middle
    return T


def triangulate_joint(detections: Array, weights: Array, views: Sequence[View]) -> Array:
    """One joint (3,) from ideal pixels (M,2) by DLT (Hartley & Zisserman, §12.2).

    Each view gives the rows w(u·P₃ − P₁) and w(v·P₃ − P₂) of A with P = K [R | t] T in pixels; the solution
    is A's last right singular vector, brought back by T (`conditioning`). NaN with fewer than two views.
    """
    used = (weights > 0) & np.isfinite(detections).all(axis=1)
    if np.count_nonzero(used) < 2:
        return np.full(3, np.nan)
    rows, T = [], conditioning([view for view, use in zip(views, used, strict=True) if use])
    for (u, v), weight, view, use in zip(detections, weights, views, used, strict=True):
        if use:
            P = view.K @ np.column_stack([view.R, view.t]) @ T
            rows += [weight * (u * P[2] - P[0]), weight * (v * P[2] - P[1])]
    X = T @ np.linalg.svd(np.array(rows))[2][-1]
    return np.asarray(X[:3] / X[3])


def triangulate(detections: Array, views: Sequence[View], confidence: Array | None = None) -> Array:
    """Triangulate (N,3) from (M,N,2|3); weights are `confidence` (M,N), else the third channel, else 1."""
    weights = weights_of(detections, confidence)
    return np.array(
        [triangulate_joint(detections[:, j, :2], weights[:, j], views) for j in range(detections.shape[1])]
    )


def weights_of(detections: Array, confidence: Array | None) -> Array:
    """Confidences (M,N): the argument, else the third channel, else 1; 0 where a pixel is missing."""
    if confidence is None:
        confidence = detections[..., 2] if detections.shape[-1] == 3 else np.ones(detections.shape[:2])
    return np.where(np.isfinite(detections[..., :2]).all(axis=-1), confidence, 0.0)


PAIRS_TRIED = 10
INLIER_PX = 20.0


def splitmix64(state: int) -> Iterator[int]:
    """64-bit numbers of SplitMix64 (Steele, Lea & Flood, 2014)."""
    while True:
        state = (state + 0x9E3779B97F4A7C15) % 2**64
        z = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB % 2**64
        yield z ^ (z >> 31)


def tried_pairs(detecting: Sequence[int], joint: int) -> list[tuple[int, int]]:
    """All pairs, ordered by the later view, or ten by Floyd's sampling seeded with the joint's index."""
    pairs = sorted(combinations(detecting, 2), key=lambda pair: pair[::-1])
    if len(pairs) <= PAIRS_TRIED:
        return pairs
    drawn: list[int] = []
    for last, number in zip(range(len(pairs) - PAIRS_TRIED, len(pairs)), splitmix64(joint), strict=False):
        candidate = number % (last + 1)
        drawn.append(last if candidate in drawn else candidate)
    return [pairs[k] for k in drawn]


def reprojection_errors(point: Array, detections: Array, views: Sequence[View]) -> Array:
    """Distances (M,) in px between a point's projections and its detections (M,2); ∞ behind a camera."""
    in_camera = np.array([to_camera(point, view.R, view.t) for view in views])
    found = np.array([pinhole(x, view.K) for x, view in zip(in_camera, views, strict=True)])
    return np.where(in_camera[:, 2] > 0, np.linalg.norm(found - detections, axis=1), np.inf)


def ransac_joint(detections: Array, weights: Array, views: Sequence[View], joint: int) -> tuple[Array, Mask]:
    """One joint (3,) over the inliers of the best pair, and the rejected views (M,)."""
    index = np.arange(len(views))
    used, best = weights > 0, (2, -np.inf)
    for pair in tried_pairs(index[weights > 0].tolist(), joint):
        point = triangulate_joint(detections, np.where(np.isin(index, pair), weights, 0), views)
        errors = reprojection_errors(point, detections, views)
        inliers = (errors <= INLIER_PX) & (weights > 0)
        score = (int(inliers.sum()), -float(errors[inliers].sum()))
        if score > best:
            used, best = inliers, score
    return triangulate_joint(detections, np.where(used, weights, 0), views), (weights > 0) & ~used


def ransac(detections: Array, views: Sequence[View], confidence: Array | None = None) -> tuple[Array, Mask]:
    """Points (N,3) from the largest set of views that agree (Fischler & Bolles, 1981), and rejected (M,N)."""
    weights = weights_of(detections, confidence)
    joints = range(detections.shape[1])
    found = [ransac_joint(detections[:, j, :2], weights[:, j], views, j) for j in joints]
    return np.array([point for point, _ in found]), np.array([rejected for _, rejected in found]).T


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
