"""Robust triangulation: RANSAC over pairs of views, and least squares with a robust loss.

Both published RANSACs draw 10 pairs of views for every joint, with replacement, triangulate it from each and
keep the largest set of views that agree. They differ in what agreement is:

=====================  ==========================================  ======================================
what                   ``ransac_iskakov``                          ``ransac_adafuse``
=====================  ==========================================  ======================================
error                  ½ · distance, in pixels of a 384 px crop    distance, in pixels of the image
threshold              15, that is 30 crop pixels                  20
the drawn pair         always in the set                           in the set if it agrees
fewer than two agree   cannot be                                   all views are used
after the final DLT    least squares, Huber loss                   nothing
=====================  ==========================================  ======================================

The minimiser takes damped Newton steps, all joints side by side. Each minimises F(X) = ½ Σ_g ρ(‖r_g(X)‖²),
where a group g is one view (both coordinates of its reprojection residual) or one coordinate of it, and ρ is
a robust loss. With s = ‖r‖² the gradient is Σ ρ′ Jᵀr and the matrix of a step is
Σ Jᵀ(ρ′(I − r̂r̂ᵀ) + max(0, ρ′ + 2sρ″) r̂r̂ᵀ)J: the curvature of the loss is kept where it is not negative
(Triggs et al. 1999, §4.3), that of the projection is left out. It is damped by the matrix of the reweighted
least squares, Σ ρ′ JᵀJ (Levenberg–Marquardt); a step is taken if F falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import Array, Mask, generator
from skelsplat.evaluation.baselines._observations import (
    Cameras,
    Observations,
    homogeneous,
    observe,
    reproject,
    rig_frame,
    solve,
)

_PAIRS = 10
_F_SCALE_PX = 5.0  # f of Cauchy's loss, about twice the detector's jitter: beyond it is an outlier
_MAX_STEPS = 200
_SETTLED_PX = 1e-7  # a step that moves no reprojection by more is the last
_LEVEL = 1e-13  # so is one that lowers F by a smaller share
_FARTHEST = 100.0  # in units of the cameras' RMS distance from their middle
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e9


def ransac_iskakov(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    crop_scale: ArrayLike = 1.0,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Triangulate by the RANSAC of "Learnable Triangulation of Human Pose" (Iskakov et al., ICCV 2019).

    ``crop_scale`` is how many pixels of the image a pixel of the crop is, a number or (T, M): for published
    numbers the side of the person's square box / 384. The final Huber loss, of threshold 1, is that of
    ½ · the distances in the views of the largest set.
    """
    joints = observe(detections, cameras)
    scale = _per_joint(crop_scale, joints)
    inliers = _largest_set(joints, 30.0 * scale, generator(seed), forced=True)
    points = solve(joints, inliers.astype(np.float64))
    problem = Reprojections(joints.pixels, joints.projections, inliers * 0.5 / scale, by_view=True)
    return joints.points(minimise(points, problem, huber))


def ransac_adafuse(detections: ArrayLike, cameras: Cameras, *, seed: int | np.random.Generator = 0) -> Array:
    """Triangulate by the RANSAC that AdaFuse (Zhang et al., IJCV 2021) is compared with."""
    joints = observe(detections, cameras)
    inliers = _largest_set(joints, np.full(joints.seen.shape, 20.0), generator(seed), forced=False)
    too_few = inliers.sum(axis=1) < 2
    inliers[too_few] = joints.seen[too_few]
    return joints.points(solve(joints, inliers.astype(np.float64)))


def _largest_set(joints: Observations, tolerance: Array, rng: np.random.Generator, *, forced: bool) -> Mask:
    """Return for each joint the largest set of agreeing views (B, M) that a drawn pair leads to.

    The first of several largest sets stays. A joint whose set holds every view that sees it is done: no other
    pair could lead to a larger one.
    """
    best = np.zeros_like(joints.seen)
    open_joints = np.flatnonzero(joints.determined)
    for _ in range(_PAIRS):
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
    n_views = joints.seen.shape[1]
    per_frame = np.broadcast_to(np.asarray(crop_scale), (*joints.leading[:-1], n_views))
    return np.broadcast_to(per_frame[..., None, :], (*joints.leading, n_views)).reshape(-1, n_views)


def cauchy(detections: ArrayLike, cameras: Cameras) -> Array:
    """Triangulate by DLT, then minimise the Cauchy loss of the reprojection residuals.

    The minimum of ½ Σ f² ln(1 + r²/f²) over the 2·M residuals û − u, v̂ − v of a joint, as
    ``scipy.optimize.least_squares(loss="cauchy", f_scale=5)`` finds it, but for all joints at once.
    """
    joints = observe(detections, cameras)
    weights = joints.seen.astype(np.float64)
    problem = Reprojections(joints.pixels, joints.projections, weights, by_view=False)
    return joints.points(minimise(solve(joints, weights), problem, cauchy_loss))


Loss = Callable[[Array], tuple[Array, Array, Array]]
"""s → ρ(s), ρ′(s) and max(0, ρ′(s) + 2 s ρ″(s))."""


def huber(s: Array) -> tuple[Array, Array, Array]:
    """Huber's loss of threshold 1: s up to 1, then 2√s − 1."""
    inside = s <= 1.0
    root = np.sqrt(np.maximum(s, 1.0))
    return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root, inside.astype(np.float64)


def cauchy_loss(s: Array) -> tuple[Array, Array, Array]:
    """Cauchy's loss f² ln(1 + s/f²)."""
    f2 = _F_SCALE_PX**2
    slope = 1.0 / (1.0 + s / f2)
    return f2 * np.log1p(s / f2), slope, np.maximum(0.0, (1.0 - s / f2) * slope**2)


@dataclass(frozen=True, slots=True)
class Reprojections:
    """Residuals scale · (π(X) − u) of B joints in M views, and their derivatives."""

    pixels: Array  # (B, M, 2) px
    projections: Array  # (M, 3, 4)
    scale: Array  # (B, M): Factor on both coordinates; 0 for a view that takes no part
    by_view: bool  # A group is a view (2 numbers), else a coordinate (1 number)

    def part(self, which: NDArray[np.intp]) -> Reprojections:
        """Return the problem of some of the joints."""
        return Reprojections(self.pixels[which], self.projections, self.scale[which], self.by_view)

    def residuals(self, X: Array) -> Array:
        """Return the residuals (B, G, D) of points X (B, 3); not finite on a camera's focal plane."""
        offsets = reproject(X, self.projections) - self.pixels
        scale = self.scale[..., None]
        return self._grouped(np.where(scale > 0, scale * offsets, 0.0))

    def slopes(self, X: Array) -> Array:
        """Differentiate `residuals`, (B, G, D, 3): ∂(p₁/p₃) = (∂p₁ − û ∂p₃) / p₃."""
        image = homogeneous(X, self.projections)
        depth = image[..., 2:, None]
        reprojected = image[..., :2, None] / depth
        rows = self.projections[:, :, :3]
        slopes = (rows[:, :2] - reprojected * rows[:, 2:]) / depth
        return self._grouped(slopes * self.scale[..., None, None])

    def _grouped(self, values: Array) -> Array:
        """(B, M, 2, …) → (B, M, 2, …) or (B, 2M, 1, …)."""
        return values if self.by_view else values.reshape(len(values), -1, 1, *values.shape[3:])


def minimise(start: Array, problem: Reprojections, loss: Loss) -> Array:
    """Minimise every joint's F from `start` (B, 3); a start that is NaN stays so.

    Joints leave the batch when a step moves no reprojection, or F cannot be lowered in double precision.
    Where rays diverge F can fall all the way to infinity: a joint that goes beyond `_FARTHEST` keeps its
    start.
    """
    points = start.copy()
    open_joints = np.flatnonzero(np.isfinite(start).all(axis=1))
    damping = np.full(len(start), _FIRST_DAMPING)
    value = np.full(len(start), np.inf)
    value[open_joints] = _value(points[open_joints], problem.part(open_joints), loss)
    for _ in range(_MAX_STEPS):
        if open_joints.size == 0:
            break
        some = problem.part(open_joints)
        step, moved = _step(points[open_joints], some, loss, damping[open_joints])
        trial = points[open_joints] + step
        reached = _value(trial, some, loss)
        better = reached <= value[open_joints]
        level = better & (value[open_joints] - reached <= _LEVEL * value[open_joints])
        points[open_joints[better]] = trial[better]
        value[open_joints[better]] = reached[better]
        damping[open_joints] = np.maximum(
            np.where(better, damping[open_joints] / 10.0, damping[open_joints] * 10.0), _LEAST_DAMPING
        )
        settled = level | (better & (moved <= _SETTLED_PX)) | (damping[open_joints] >= _MOST_DAMPING)
        open_joints = open_joints[~settled]
    frame = rig_frame(problem.projections)
    ran_away = np.linalg.norm(points - frame[:3, 3], axis=1) > _FARTHEST * frame[0, 0]
    return np.where(ran_away[:, None], start, points)


def _value(X: Array, problem: Reprojections, loss: Loss) -> Array:
    """F of every joint, (B,); infinite where a residual is not finite."""
    squares = np.sum(problem.residuals(X) ** 2, axis=-1)
    value = 0.5 * loss(np.where(np.isfinite(squares), squares, 0.0))[0].sum(axis=-1)
    return np.where(np.isfinite(squares).all(axis=-1), value, np.inf)


def _step(X: Array, problem: Reprojections, loss: Loss, damping: Array) -> tuple[Array, Array]:
    """Return the damped step (B, 3) and by how many weighted px it moves the reprojections, (B,)."""
    r, J = problem.residuals(X), problem.slopes(X)
    s = np.sum(r**2, axis=-1)
    _, slope, along = loss(s)
    rows = J.reshape(len(X), -1, 3)
    weighted = np.swapaxes((J * slope[..., None, None]).reshape(rows.shape), 1, 2)
    gradient = weighted @ r.reshape(len(X), -1, 1)
    reweighted = weighted @ rows
    radial = (r[..., None, :] @ J)[..., 0, :]
    # ρ′(I − r̂r̂ᵀ) + along r̂r̂ᵀ = ρ′ I − (ρ′ − along) r rᵀ / s; at r = 0 both losses have along = ρ′.
    excess = np.divide(slope - along, s, out=np.zeros_like(s), where=s > 0)
    matrix = reweighted - np.swapaxes(radial * excess[..., None], 1, 2) @ radial
    step = -_solved(matrix + damping[:, None, None] * reweighted, gradient[..., 0])
    squared = (step[:, None] @ reweighted @ step[..., None])[:, 0, 0]
    return step, np.sqrt(np.maximum(squared, 0.0))


def _solved(matrices: Array, right: Array) -> Array:
    """Solve 3×3 systems (B, 3, 3) by cofactors; no step where a matrix is singular."""
    a, b, c = matrices[:, 0], matrices[:, 1], matrices[:, 2]
    cofactors = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-1)
    determinant = np.sum(a * cofactors[..., 0], axis=-1)[:, None]
    solution = (cofactors @ right[..., None])[..., 0]
    return np.asarray(np.divide(solution, determinant, out=np.zeros_like(solution), where=determinant > 0))


def _cross(a: Array, b: Array) -> Array:
    """Cross products (B, 3); `numpy.cross` takes longer than all else on few joints."""
    first, second = [1, 2, 0], [2, 0, 1]
    return np.asarray(a[:, first] * b[:, second] - a[:, second] * b[:, first])
