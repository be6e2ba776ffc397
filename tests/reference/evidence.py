"""What speaks for a pose: right and wrong detections of every view, joints integrated out (DESIGN §6)."""

from typing import NamedTuple

import numpy as np

from reference.annealed import Solution
from reference.arrays import Array, Mask
from reference.rays import Rays, information, offsets, weights

DISTINCT = 25.0
"""Δχ² from which a depth counts as known: five standard deviations."""
USUAL_PX = 3.0
REJECTED = 0.25
SHARES = np.array([0.01, 0.06, 0.3, 0.8])
SCALES = np.array([1.0, 0.5, 0.25])
LEAST_REACH, ASTRAY = 2.5, 0.1
BONE_REACH = 6.0
EXPONENTS, USUAL = np.array([1.0, 0.5, 0.0]), np.log(2)
PRIOR_DOF = 6.0


def over_infinity(x: Array, rays: Rays, w: Array) -> Array:
    """Δχ² (N,) by which rays of inverse variances `w` (M,N) per square radian prefer x (N,3) to infinity.

    Σ w |d − u|² for the best direction u, less Σ w sin² of the angles at which x is seen off the rays.
    """
    e, _ = offsets(x, rays)
    square = np.sum((x - rays.centre) ** 2, axis=-1)
    at_x = np.where(w > 0, w * np.sum(e**2, axis=-1) / square, 0.0).sum(axis=0)
    total = np.linalg.norm(np.einsum("mn,mna->na", w, rays.direction), axis=-1)
    return np.asarray(2 * (w.sum(axis=0) - total) - at_x)


def fixed_depth(solution: Solution, rays: Rays) -> Mask:
    """Whether the believed rays fix each joint's depth at the solution (N,)."""
    x = np.nan_to_num(solution.points)
    variance = max(solution.variance / solution.pixel**2, USUAL_PX**2 * rays.mean_weight)
    w = np.divide(
        weights(x, rays, solution.sigma),
        variance * rays.pixel**2,
        out=np.zeros_like(rays.pixel),
        where=rays.weight > 0,
    )
    known = np.isfinite(solution.points).all(axis=1)
    return np.asarray(known & (over_infinity(x, rays, w) >= DISTINCT))


class Evidence(NamedTuple):
    """log p of the detections up to a constant, and the share ε of wrong ones."""

    log: float
    wrong: float


def evidence(x: Array, rays: Rays, variance: float, widest: float) -> Evidence:
    """Right (normal, ŝ²/c̄) and wrong (normal, S²) detections of a pose x (N,3), each c/c̄ times.

    Summed over ε of each view and over S, at most `widest`; each joint adds −½ log det H_j.
    """
    e, along = offsets(x, rays)
    square, mean = np.sum(e**2, axis=-1), rays.mean_weight
    counts, spread = rays.weight / mean, variance / mean
    right = np.where(along > 0, np.exp(-0.5 * square / spread) / (2 * np.pi * spread), 0.0)
    s2 = (widest * SCALES) ** 2
    s2 = s2[(s2 >= LEAST_REACH**2 * spread) | (SCALES == 1)][:, None, None]
    far = (1 - ASTRAY) * np.exp(-0.5 * square / s2) / (2 * np.pi * s2)
    far += ASTRAY * widest / (2 * np.pi * (square + widest**2) ** 1.5)
    p = (1 - SHARES) * right[None, :, :, None] + SHARES * far[..., None]  # S, view, joint, ε
    log_p = (counts[..., None] * np.log(p)).sum(axis=2)
    of_view = np.logaddexp.reduce(log_p, axis=-1)
    share = np.exp(log_p - of_view[..., None]) @ SHARES
    of_scale = (of_view - np.log(len(SHARES))).sum(axis=1)
    log = np.logaddexp.reduce(of_scale)
    scales = np.exp(of_scale - log)
    wrong = (scales @ share)[:, None]
    near = (1 - wrong) * right
    r = near / (near + wrong * np.einsum("s,smn->mn", scales, far))
    H = information(r * rays.weight / variance, rays) + np.eye(3) / widest**2
    log += (
        -np.log(len(SCALES))
        - 0.5 * np.linalg.slogdet(H)[1].sum()
        + counts.sum() * np.log(2 * np.pi * widest**2)
    )
    return Evidence(float(log), float(1 - (counts * r).sum() / counts.sum()))


def against_bones(
    x: Array, rays: Rays, noise: float, widest: float, bones: list[tuple[int, int, float, float]]
) -> float:
    """−log p of bones (joint, joint, length, σ) at a pose x (N,3) under kernels as wide as the noise.

    A joint adds (Σk · ⅔/ŝ² + 1/W²)⁻¹, its variance in a direction: (I − d dᵀ) has the mean eigenvalue ⅔.
    """
    e, along = offsets(x, rays)
    seen = (along > 0) & (rays.weight > 0)
    k = np.where(seen, np.exp(-np.sum(e**2, axis=-1) / (4 * noise**2)), 0.0)
    own = 1 / (k.sum(axis=0) / (1.5 * noise**2) + 1 / widest**2)
    total = 0.0
    for a, b, length, sigma in bones:
        variance = sigma**2 + own[a] + own[b]
        square = (np.linalg.norm(x[a] - x[b]) - length) ** 2 / variance
        total += BONE_REACH**2 * (1 - np.exp(-0.5 * square / BONE_REACH**2)) + 0.5 * np.log(variance)
    return total


def view_factors(x: Array, rays: Rays, noise: float, pixel: float) -> Array:
    """Factors on the views' weights for joints x (N,3) on which three views agree under kernels of the noise.

    Restricted likelihood of w = c (c̄_i/c̄)^(γ−1), c̄ the geometric mean, summed over γ.
    """
    e, along = offsets(x, rays)
    agree = (along > 0) & (rays.weight > 0) & (np.exp(-np.sum(e**2, axis=-1) / (4 * noise**2)) >= REJECTED)
    agree &= agree.sum(axis=0) > 2
    sure = agree.any(axis=0)
    logs = np.log([w[w > 0].mean() for w in rays.weight])
    off = (logs - logs.mean())[:, None]
    log_p = []
    for gamma in EXPONENTS:
        given = rays.weight * np.exp((gamma - 1) * off)
        w = np.where(agree, given, 0.0)
        H = information(w, rays)[sure]
        across = np.eye(3) - np.einsum("mna,mnb->mnab", rays.direction, rays.direction)
        pull = np.einsum("mn,mnab,mnb->na", w, across, np.broadcast_to(rays.centre, rays.direction.shape))
        best = np.zeros_like(x)
        best[sure] = np.linalg.solve(H, pull[sure, :, None])[..., 0]
        squares = np.sum(w * np.sum(offsets(best, rays)[0] ** 2, axis=-1))
        squares += PRIOR_DOF * given[given > 0].mean() * (USUAL_PX * pixel) ** 2
        freedom = PRIOR_DOF + 2 * agree.sum() - 3 * sure.sum()
        log_p.append(
            np.log(w[agree]).sum()
            - 0.5 * np.linalg.slogdet(H)[1].sum()
            - 0.5 * freedom * np.log(squares)
            - 0.5 * (gamma / USUAL) ** 2 * np.sum(off**2)
        )
    share = np.exp(np.array(log_p) - np.logaddexp.reduce(log_p))
    return np.asarray(np.exp((share @ EXPONENTS - 1) * off[:, 0]))
