"""RANSAC over pairs of views, as two published evaluations run it. Every joint is a problem of its own.

Both draw ``n_iters`` pairs of views, triangulate the joint from each and keep the largest set of views that
agree; the joints of a batch are drawn and triangulated together. They differ in what agreement is:

=====================  ==========================================  ======================================
what                   ``ransac_iskakov``                          ``ransac_adafuse``
=====================  ==========================================  ======================================
error                  ½ · distance, in pixels of a 384 px crop    distance, in pixels of the image
threshold              15, that is 30 crop pixels                  20
the drawn pair         always in the set                           in the set if it agrees
fewer than two agree   cannot be                                   all views are used
after the final DLT    least squares, Huber loss                   nothing
=====================  ==========================================  ======================================
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Mask, generator, numbers, positive
from skelsplat.evaluation.baselines._minimise import Reprojections, huber, minimise
from skelsplat.evaluation.baselines._observations import Cameras, Observations, observe, reproject, solve
from skelsplat.exceptions import InvalidInputError


def ransac_iskakov(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    epsilon: float = 15.0,
    crop_scale: ArrayLike = 1.0,
    n_iters: int = 10,
    direct_optimization: bool = True,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Triangulate by the RANSAC of "Learnable Triangulation of Human Pose" (Iskakov et al., ICCV 2019).

    A view agrees if *half* its reprojection distance is below ``epsilon``: in crop pixels if ``crop_scale``
    is given, the pixels of the image per pixel of the crop (a number, (T, M), or (M,) for one frame; for
    published numbers the side of the person's square box / 384), else in pixels of the image, so that 15
    means a distance of 30 px. ``n_iters`` pairs are drawn, with replacement. After the DLT of the largest
    set, ``direct_optimization`` minimises the Huber loss, of threshold 1, of ½ · the distances in its views.
    """
    positive("epsilon", epsilon)
    positive("n_iters", n_iters, "integer")
    joints = observe(detections, cameras)
    scale = _per_joint(crop_scale, joints)
    inliers = _largest_set(joints, 2.0 * epsilon * scale, n_iters, generator(seed), forced=True)
    points = solve(joints, inliers.astype(np.float64))
    if direct_optimization:
        problem = Reprojections(joints.pixels, joints.projections, inliers * 0.5 / scale, by_view=True)
        points = minimise(points, problem, huber)
    return joints.points(points)


def ransac_adafuse(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    epsilon: float = 20.0,
    n_iters: int = 10,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Triangulate by the RANSAC that AdaFuse (Zhang et al., IJCV 2021) is compared with.

    A view agrees if its reprojection distance is below ``epsilon``, px. At most ``n_iters`` pairs are drawn,
    with replacement; the result is the DLT of the largest set, or of all views if fewer than two agree.
    """
    positive("epsilon", epsilon)
    positive("n_iters", n_iters, "integer")
    joints = observe(detections, cameras)
    tolerance = np.full(joints.seen.shape, float(epsilon))
    inliers = _largest_set(joints, tolerance, n_iters, generator(seed), forced=False)
    too_few = inliers.sum(axis=1) < 2
    inliers[too_few] = joints.seen[too_few]
    return joints.points(solve(joints, inliers.astype(np.float64)))


def _largest_set(
    joints: Observations, tolerance: Array, n_iters: int, rng: np.random.Generator, *, forced: bool
) -> Mask:
    """Return for each joint the largest set of agreeing views (B, M) that a drawn pair leads to.

    The first of several largest sets stays. A joint whose set holds every view that sees it is done: no other
    pair could lead to a larger one.
    """
    best = np.zeros_like(joints.seen)
    open_joints = np.flatnonzero(joints.determined)
    for _ in range(n_iters):
        if open_joints.size == 0:
            break
        some = joints.take(open_joints)
        pair = sample_pairs(some.seen, rng)
        agree = _distances(some, solve(some, pair.astype(np.float64))) < tolerance[open_joints]
        if forced:
            agree |= pair
        larger = agree.sum(axis=1) > best[open_joints].sum(axis=1)
        best[open_joints[larger]] = agree[larger]
        open_joints = open_joints[(best[open_joints] != some.seen).any(axis=1)]
    return best


def sample_pairs(seen: Mask, rng: np.random.Generator) -> Mask:
    """Draw two of the views that see each joint, uniformly: (B, M) with two True per row."""
    order = np.argsort(np.where(seen, rng.random(seen.shape), np.inf), axis=1)
    pair = np.zeros_like(seen)
    np.put_along_axis(pair, order[:, :2], True, axis=1)
    return pair


def _distances(joints: Observations, points: Array) -> Array:
    """Reprojection distance (B, M) px; infinite where the joint is missing or the point is at infinity."""
    distance = np.linalg.norm(reproject(points, joints.projections) - joints.pixels, axis=-1)
    return np.where(joints.seen & np.isfinite(distance), distance, np.inf)


def _per_joint(crop_scale: ArrayLike, joints: Observations) -> Array:
    """Spread ``crop_scale`` over the joints, (B, M)."""
    scale, n_views = numbers(crop_scale, "crop_scale"), joints.seen.shape[1]
    per_frame = (*joints.leading[:-1], n_views)
    if scale.shape not in ((), per_frame) or not (np.isfinite(scale) & (scale > 0)).all():
        expected = f"a finite number > 0 or an array {per_frame} of them"
        raise InvalidInputError(f"crop_scale: expected {expected}, got shape {scale.shape}")
    spread = np.broadcast_to(scale, per_frame)[..., None, :]
    return np.broadcast_to(spread, (*joints.leading, n_views)).reshape(-1, n_views)
