"""Annealed splatting on dense matrices (DESIGN §3): the gradient at a pose, its noise and its posterior.

With e the offset of a joint from a detection's ray and k = exp(−|e|²/4σ²) the pose minimises

    F = Σ c (2σ²/ŝ²)(1 − k) + ½ Σ (x−x⁰)ᵀ Π (x−x⁰) + ½ Σ κ (‖l‖−‖r‖)² / σ_sym²

where ∇F = 0. All lengths are mm; detections are (M,N), poses (N,3).
"""

from typing import NamedTuple

import numpy as np

from reference.arrays import Array, Mask
from reference.rays import Rays, information, offsets, weights
from reference.symmetry import Pairs

PRIOR_PX, PRIOR_FREEDOM = 3.0, 6.0
SYMMETRY_REACH = 3.0
RESIDUAL_SHARE, SHARED_FREEDOM = 0.87, 5.0
BODY, LEAST_JOINTS = 2.0, 3
LEAST_SPREAD = 2.0


class Problem(NamedTuple):
    """Rays, limb pairs, an independent start (x⁰ (N,3), Π (N,3,3)) or None, and σ_sym."""

    rays: Rays
    pairs: Pairs = ()
    prior: tuple[Array, Array] | None = None
    symmetry_sigma: float = 15.0


class Solution(NamedTuple):
    """Pose (N,3), final σ (N,), ŝ² for weight 1 (mm²), and mm per pixel."""

    points: Array
    sigma: Array
    variance: float
    pixel: float


def noise_variance(rays: Rays, x: Array, sigma: Array, pixel: float) -> float:
    """ŝ² from Σ c k |e|² and Σ k per joint (N,): two degrees a detection, three taken up by the joint.

    For normal e of variance s², E[k|e|²] / E[k] = 2 s² / (1 + s²/2σ²); it is undone up to a factor of 4.
    """
    squares, support = residuals(x, rays, sigma)
    prior = PRIOR_FREEDOM * rays.mean_weight * (PRIOR_PX * pixel) ** 2
    shrunk = (prior + squares.sum()) / (PRIOR_FREEDOM + np.maximum(2 * support - 3, 0).sum())
    return float(shrunk / max(1 - shrunk / (2 * rays.mean_weight * sigma.mean() ** 2), 0.25))


def is_loud(rays: Rays, solution: Solution) -> Mask:
    """Whether a joint (N,) may have more noise: three times the squares that are expected, or more."""
    squares, support = residuals(solution.points, rays, solution.sigma)
    return np.asarray(squares > 3 * solution.variance * np.maximum(2 * support - 3, 0))


def limb_terms(x: Array, problem: Problem, usable: Mask) -> list[tuple[float, float, Array]]:
    """(κ/σ_sym², ‖l‖−‖r‖, its gradient (3N,)) of the pairs whose joints are all `usable` (N,)."""
    terms, sigma = [], problem.symmetry_sigma
    for (a, b), (c, d) in problem.pairs:
        if not all(usable[j] for j in (a, b, c, d)):
            continue
        left, right = x[a] - x[b], x[c] - x[d]
        gradient = np.zeros(x.shape)
        gradient[a] += left / np.linalg.norm(left)
        gradient[b] -= left / np.linalg.norm(left)
        gradient[c] -= right / np.linalg.norm(right)
        gradient[d] += right / np.linalg.norm(right)
        difference = np.linalg.norm(left) - np.linalg.norm(right)
        kept = np.exp(-0.5 * (difference / (SYMMETRY_REACH * sigma)) ** 2)
        terms.append((float(kept / sigma**2), float(difference), gradient.ravel()))
    return terms


def dense(blocks: Array, terms: list[tuple[float, float, Array]]) -> Array:
    """H (3N,3N): the joints' own blocks (N,3,3) and one rank-one matrix per limb pair."""
    n = len(blocks)
    H = np.zeros((n, 3, n, 3))
    for j in range(n):
        H[j, :, j] = blocks[j]
    flat = H.reshape(3 * n, 3 * n)
    for precision, _, g in terms:
        flat += precision * np.outer(g, g)
    return flat


def gradient(x: Array, problem: Problem, sigma: Array, variance: float) -> Array:
    """∇F per joint (N,3) of joints that are all seen or have a prior."""
    rays = problem.rays
    w, (e, _) = weights(x, rays, sigma), offsets(x, rays)
    slope = np.einsum("mn,mna->na", w, np.where(w[..., None] > 0, e, 0.0)) / variance
    if problem.prior is not None:
        mean, precision = problem.prior
        slope += np.einsum("nab,nb->na", precision, x - mean)
    terms = limb_terms(x, problem, np.ones(len(x), bool))
    return slope + sum((p * r * g for p, r, g in terms), np.zeros(slope.size)).reshape(slope.shape)


def residuals(x: Array, rays: Rays, sigma: Array) -> tuple[Array, Array]:
    """Σ c k |e|² and Σ k per joint (N,)."""
    w = weights(x, rays, sigma)
    square = np.sum(offsets(x, rays)[0] ** 2, axis=-1)
    there = rays.weight > 0
    k = np.divide(w, rays.weight, out=np.zeros_like(w), where=there)
    return np.where(w > 0, w * square, 0.0).sum(axis=0), k.sum(axis=0)


def square_reach(x: Array, body: Mask, nearest: Array, noise: float) -> Array:
    """ρ² (N,): to the body's extent or the nearest camera, and back to the body from beyond twice its extent.

    The body are the joints `body` (N,) if there are three, else all that are known, else nothing; joints
    within twice the `noise` (mm) are none.
    """
    known = np.isfinite(x).all(axis=1)
    members = body & known if np.count_nonzero(body & known) >= LEAST_JOINTS else known
    if np.count_nonzero(members) < LEAST_JOINTS:
        return nearest**2
    middle = x[members].mean(axis=0)
    spread = np.sqrt(np.mean(np.sum((x[members] - middle) ** 2, axis=1)))
    if spread <= LEAST_SPREAD * noise:
        return nearest**2
    beyond = np.maximum(np.linalg.norm(x - middle, axis=1) - BODY * spread, 0)
    return np.asarray(np.minimum(nearest, spread) ** 2 + beyond**2)


def posterior(problem: Problem, solution: Solution, body: Mask, share: float) -> Array:
    """Covariances (N,3,3) at the solution, NaN where nothing is known; `body` (N,): joints of fixed depth.

    The joint's own residuals correct the shared variance (worth 5 degrees), of which `share` is noise; along
    a ray that nothing crosses the joint is known to the body's extent (`square_reach`).
    """
    x, rays = solution.points, problem.rays
    known = np.isfinite(x).all(axis=1)
    squares, support = residuals(np.nan_to_num(x), rays, solution.sigma)
    variance = (
        share
        * (SHARED_FREEDOM * solution.variance + squares)
        / (SHARED_FREEDOM + np.maximum(2 * support - 3, 0))
    )
    blocks = information(weights(np.nan_to_num(x), rays, solution.sigma), rays) / variance[:, None, None]
    along = np.where(rays.weight > 0, np.abs(offsets(np.nan_to_num(x), rays)[1]), np.inf).min(axis=0)
    seen = np.isfinite(along) & known
    reach = square_reach(x, body, along, np.sqrt(solution.variance / rays.mean_weight))
    blocks[seen] += np.eye(3) / reach[seen, None, None]
    if problem.prior is not None:
        blocks += problem.prior[1]
    placed = support >= 1.5  # equal limbs leave two places on the ray of a joint that one view sees
    terms = limb_terms(x, problem, known & placed & (seen | (problem.prior is not None)))
    told = known & (np.trace(blocks, axis1=1, axis2=2) > 0)
    keep = np.repeat(told, 3)
    inverse = np.full((keep.size, keep.size), np.nan)
    inverse[np.ix_(keep, keep)] = np.linalg.inv(dense(blocks, terms)[np.ix_(keep, keep)])
    return np.array([inverse[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] for j in range(len(x))])
