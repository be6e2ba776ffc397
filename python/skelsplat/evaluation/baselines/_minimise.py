"""Robust non-linear triangulation of many joints at once: damped Newton steps, all joints side by side.

Every joint minimises F(X) = ½ Σ_g ρ(‖r_g(X)‖²), where a group g is one view (both coordinates of its
reprojection residual) or one coordinate of it, and ρ is a robust loss. With s = ‖r‖² the gradient is
Σ ρ′ Jᵀr and the matrix of a step is Σ Jᵀ(ρ′(I − r̂r̂ᵀ) + max(0, ρ′ + 2sρ″) r̂r̂ᵀ)J: the curvature of the loss
is kept where it is not negative (Triggs et al. 1999, §4.3), that of the projection is left out. It is damped
by the matrix of the reweighted least squares, Σ ρ′ JᵀJ (Levenberg–Marquardt); a step is taken if F falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import Array, positive
from skelsplat.evaluation.baselines._observations import (
    Cameras,
    homogeneous,
    observe,
    reproject,
    rig_frame,
    solve,
)

_MAX_STEPS = 200
# A step that moves no reprojection by more than this many px is the last.
_SETTLED_PX = 1e-7
# So is one that lowers F by a smaller share.
_LEVEL = 1e-13
# In units of the cameras' RMS distance from their middle.
_FARTHEST = 100.0
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e9

Loss = Callable[[Array], tuple[Array, Array, Array]]
"""s → ρ(s), ρ′(s) and max(0, ρ′(s) + 2 s ρ″(s))."""


def huber(s: Array) -> tuple[Array, Array, Array]:
    """Huber's loss of threshold 1: s up to 1, then 2√s − 1."""
    inside = s <= 1.0
    root = np.sqrt(np.maximum(s, 1.0))
    return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root, inside.astype(np.float64)


def cauchy_loss(f_scale: float) -> Loss:
    """Return Cauchy's loss f² ln(1 + s/f²)."""
    f2 = f_scale**2

    def loss(s: Array) -> tuple[Array, Array, Array]:
        slope = 1.0 / (1.0 + s / f2)
        return f2 * np.log1p(s / f2), slope, np.maximum(0.0, (1.0 - s / f2) * slope**2)

    return loss


def cauchy(detections: ArrayLike, cameras: Cameras, *, f_scale: float = 5.0) -> Array:
    """Triangulate by DLT, then minimise the Cauchy loss of the reprojection residuals.

    The minimum of ½ Σ f² ln(1 + r²/f²) over the 2·M residuals û − u, v̂ − v of a joint, as
    ``scipy.optimize.least_squares(loss="cauchy")`` finds it, but for all joints at once. ``f_scale`` is f in
    px, beyond which a residual counts as an outlier; about twice the detector's jitter.
    """
    positive("f_scale", f_scale)
    joints = observe(detections, cameras)
    weights = joints.seen.astype(np.float64)
    problem = Reprojections(joints.pixels, joints.projections, weights, by_view=False)
    return joints.points(minimise(solve(joints, weights), problem, cauchy_loss(f_scale)))


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
        used = self.scale[..., None] > 0
        return self._grouped(np.where(used, self.scale[..., None] * offsets, 0.0))

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
    step = np.divide(solution, determinant, out=np.zeros_like(solution), where=determinant > 0)
    return np.asarray(step)


def _cross(a: Array, b: Array) -> Array:
    """Cross products (B, 3); `numpy.cross` takes longer than all else on few joints."""
    first, second = [1, 2, 0], [2, 0, 1]
    return np.asarray(a[:, first] * b[:, second] - a[:, second] * b[:, first])
