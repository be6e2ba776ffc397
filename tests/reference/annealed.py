"""Annealed splatting by Gauss–Newton on dense matrices (DESIGN §3): noise, step, schedule, posterior.

With e the offset of a joint from a detection's ray and k = exp(−|e|²/4σ²) the pose minimises

    F = Σ c (2σ²/ŝ²)(1 − k) + ½ Σ (x−x⁰)ᵀ Π (x−x⁰) + ½ Σ κ (‖l‖−‖r‖)² / σ_sym²

by H δ = −∇F with the weights k and κ held. All lengths are mm; detections are (M,N), poses (N,3).
"""

from typing import NamedTuple

import numpy as np

from reference.arrays import Array, Mask
from reference.rays import Rays, information, offsets, pixel_mm, weights
from reference.symmetry import Pairs

PRIOR_PX, PRIOR_FREEDOM, REFUTED_FREEDOM = 3.0, 6.0, 3.0
SYMMETRY_REACH = 3.0
UPWARDS = 0.78
RESIDUAL_SHARE, SHARED_FREEDOM = 0.87, 5.0
BODY, LEAST_JOINTS = 2.0, 3
LEAST_SPREAD = 2.0


class Widening(NamedTuple):
    """Whether final kernels may exceed `Settings.end`, and which share of the residuals is noise."""

    follows_noise: bool = False
    noise_share: float = RESIDUAL_SHARE


class Settings(NamedTuple):
    """What `RefineConfig` has; `noise_mm` fixes the noise of a detection of mean weight."""

    widest: float = 320.0
    end: float = 30.0
    per_noise: float = 2.0
    factor: float = 0.5
    symmetry_sigma: float = 15.0
    max_steps: int = 50
    tolerance: float = 0.01
    noise_mm: float | None = None


class Problem(NamedTuple):
    """Rays, limb pairs, an independent start (x⁰ (N,3), Π (N,3,3)) or None, settings, widening."""

    rays: Rays
    pairs: Pairs = ()
    prior: tuple[Array, Array] | None = None
    settings: Settings = Settings()
    widening: Widening = Widening()


class Solution(NamedTuple):
    """Pose (N,3), final σ (N,), ŝ² for weight 1 (mm²), mm per pixel, and the steps it took."""

    points: Array
    sigma: Array
    variance: float
    pixel: float
    n_iter: int
    converged: bool


def noise_variance(problem: Problem, squares: Array, support: Array, sigma: float, pixel: float) -> float:
    """ŝ² from Σ c k |e|² and Σ k per joint (N,): two degrees a detection, three taken up by the joint.

    For normal e of variance s², E[k|e|²] / E[k] = 2 s² / (1 + s²/2σ²); it is undone up to a factor of 4. The
    prior of 3 px counts less in a frame that has refuted it.
    """
    weight = problem.rays.mean_weight
    if problem.settings.noise_mm is not None:
        return weight * problem.settings.noise_mm**2
    freedom = REFUTED_FREEDOM if problem.widening.follows_noise else PRIOR_FREEDOM
    prior = freedom * weight * (PRIOR_PX * pixel) ** 2
    shrunk = (prior + squares.sum()) / (freedom + np.maximum(2 * support - 3, 0).sum())
    return float(shrunk / max(1 - shrunk / (2 * weight * sigma**2), 0.25))


def limb_terms(x: Array, problem: Problem, usable: Mask) -> list[tuple[float, float, Array]]:
    """(κ/σ_sym², ‖l‖−‖r‖, its gradient (3N,)) of the pairs whose joints are all `usable` (N,)."""
    terms, sigma = [], problem.settings.symmetry_sigma
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


def bends(x: Array, problem: Problem, usable: Mask) -> Array:
    """Curvature of the longer limbs (N,3,3), 2 Λ |r| (I − u uᵀ)/l at both ends: no less than Λ r ∇²r."""
    out = np.zeros((len(x), 3, 3))
    pairs = [pair for pair in problem.pairs if all(usable[j] for limb in pair for j in limb)]
    for (precision, difference, _), (left, right) in zip(limb_terms(x, problem, usable), pairs, strict=True):
        ends = list(left if difference > 0 else right)
        length = np.linalg.norm(x[ends[0]] - x[ends[1]])
        u = (x[ends[0]] - x[ends[1]]) / length
        out[ends] += 2 * precision * abs(difference) / length * (np.eye(3) - np.outer(u, u))
    return out


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


def step(x: Array, problem: Problem, sigma: Array, variance: float, active: Mask) -> Array:
    """−(H + μI)⁻¹ ∇F per joint (N,3), with μ = 1/σ_start²."""
    rays = problem.rays
    w = weights(x, rays, sigma) * active
    e, _ = offsets(x, rays)
    blocks = information(w, rays) / variance
    gradient = np.einsum("mn,mna->na", w, np.where(w[..., None] > 0, e, 0.0)) / variance
    if problem.prior is not None:
        mean, precision = problem.prior
        blocks[active] += precision[active]
        gradient[active] += np.einsum("nab,nb->na", precision, x - mean)[active]
    terms = limb_terms(x, problem, active & np.isfinite(sigma))
    slope = gradient.ravel() + sum((p * r * g for p, r, g in terms), np.zeros(gradient.size))
    blocks = blocks + bends(x, problem, active & np.isfinite(sigma))
    mu = problem.settings.widest**-2
    return np.asarray(
        -np.linalg.solve(dense(blocks, terms) + mu * np.eye(len(slope)), slope).reshape(x.shape)
    )


def farthest_step(x: Array, rays: Rays) -> Array:
    """Half the way to the nearest camera that has the joint in front of it (N,)."""
    _, along = offsets(x, rays)
    ahead = (rays.weight > 0) & (along > 0)
    return 0.5 * np.where(ahead, along, np.inf).min(axis=0)


def residuals(x: Array, rays: Rays, sigma: Array) -> tuple[Array, Array]:
    """Σ c k |e|² and Σ k per joint (N,)."""
    w = weights(x, rays, sigma)
    square = np.sum(offsets(x, rays)[0] ** 2, axis=-1)
    there = rays.weight > 0
    k = np.divide(w, rays.weight, out=np.zeros_like(w), where=there)
    return np.where(w > 0, w * square, 0.0).sum(axis=0), k.sum(axis=0)


class Kernels(NamedTuple):
    """σ per joint (N,) to go on with, ŝ² for weight 1 (mm²), mm per pixel, and where σ is at its end (N,)."""

    sigma: Array
    variance: float
    pixel: float
    narrow: Mask


def narrowed(problem: Problem, now: Kernels, x: Array, active: Mask, moments: tuple[Array, Array]) -> Kernels:
    """Narrow the kernels after a step to `x`; `moments` are Σ c k |e|² and Σ k (N,) from before it.

    The first step knows no kernel; after it every joint begins at its farthest ray. The noise sets the end.
    """
    rays, settings = problem.rays, problem.settings
    variance, pixel = now.variance, now.pixel
    fresh = np.isinf(now.sigma)
    if fresh.any():
        pixel = pixel_mm(np.where(active[:, None], x, np.nan), rays) or pixel
        far = np.linalg.norm(offsets(x, rays)[0], axis=-1) * (rays.weight > 0)
        first = np.minimum(far.max(axis=0) * active, settings.widest)
        target = np.where(fresh, first, np.where(fresh, 0.0, now.sigma) * settings.factor)
    else:
        variance = noise_variance(problem, *moments, float(now.sigma.mean()), pixel)
        target = now.sigma * settings.factor
    wanted = settings.per_noise * np.sqrt(variance / rays.mean_weight)
    most = UPWARDS * wanted if problem.widening.follows_noise else 0.0
    end = min(wanted, max(most, settings.end))
    return Kernels(np.maximum(target, end), variance, pixel, now.sigma <= 1.05 * end)


def solve(problem: Problem, start: Array, sigma: Array) -> Solution:
    """Iterate from `start` (N,3) and kernels `sigma` (N,), infinite for plain least squares, until all rests.

    A joint in no limb pair is settled by its first short step under a narrow kernel, and moves no more.
    """
    rays, settings, N = problem.rays, problem.settings, len(start)
    seen = (rays.weight > 0).any(axis=0)
    active = np.isfinite(start).all(axis=1) & (seen | (problem.prior is not None))
    x, settled = np.where(active[:, None], start, 0.0), np.zeros(N, bool)
    coupled = np.isin(np.arange(N), np.array(problem.pairs, dtype=int).ravel())
    moments = (np.zeros(N), np.zeros(N))
    pixel = pixel_mm(np.where(active[:, None], start, np.nan), rays) or 1.0
    now = Kernels(sigma, noise_variance(problem, *moments, np.inf, pixel), pixel, np.zeros(N, bool))
    n_iter, converged = 0, False
    while n_iter < settings.max_steps and not converged:
        fresh = residuals(x, rays, now.sigma)
        moments = tuple(np.where(settled, m, active * f) for m, f in zip(moments, fresh, strict=True))
        small = settings.tolerance * np.sqrt(now.variance / rays.mean_weight)
        moving = active & ~settled
        delta = step(x, problem, now.sigma, now.variance, active) * moving[:, None]
        length = np.linalg.norm(delta, axis=1)
        x += delta * np.minimum(1.0, farthest_step(x, rays) / np.maximum(length, 1e-300))[:, None]
        settled |= moving & now.narrow & ~coupled & (length <= small)
        n_iter += 1
        then = narrowed(problem, now, x, active, moments)
        still = length.max(initial=0.0) <= settings.tolerance * np.sqrt(then.variance / rays.mean_weight)
        converged = bool(still and (then.narrow | settled | ~active).all())
        now = then._replace(sigma=np.where(settled, now.sigma, then.sigma))
    sigma = np.where(np.isinf(now.sigma), settings.end, now.sigma)
    moments = tuple(active * m for m in residuals(x, rays, sigma))
    variance = noise_variance(problem, *moments, float(sigma.mean()), now.pixel)
    return Solution(np.where(active[:, None], x, start), sigma, variance, now.pixel, n_iter, converged)


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


def posterior(problem: Problem, solution: Solution, body: Mask) -> Array:
    """Covariances (N,3,3) at the solution, NaN where nothing is known; `body` (N,): joints of fixed depth.

    The joint's own residuals correct the shared variance (worth 5 degrees), of which a share is noise; along
    a ray that nothing crosses the joint is known to the body's extent (`square_reach`).
    """
    x, rays = solution.points, problem.rays
    known = np.isfinite(x).all(axis=1)
    squares, support = residuals(np.nan_to_num(x), rays, solution.sigma)
    variance = (
        problem.widening.noise_share
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
