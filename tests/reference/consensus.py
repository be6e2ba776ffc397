"""Where the detections alone put the joints: robust triangulation, large noise, ties (DESIGN §3)."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from reference.annealed import Problem, Settings, Solution, Widening, residuals, solve
from reference.arrays import Array, Mask
from reference.rays import Rays, information, nearest_points, offsets, weights

DISTINCT = 25.0
"""Δχ² from which a depth counts as known: five standard deviations."""
USUAL_PX = 3.0
REJECTED = 0.25
APART = 4.0
ROUNDS, FIRST_SHARE, LEAST_REACH, SHARED = 3, 0.1, 2.5, 2.0
ANYWHERE = (1.5, 1.0)
AGREES, LEAST_COMMON = 0.2, 6
NARROW = 0.966
LEAST_FREEDOM = 6


def over_infinity(x: Array, rays: Rays, w: Array) -> Array:
    """Δχ² (N,) by which rays of inverse variances `w` (M,N) per square radian prefer x (N,3) to infinity.

    Σ w |d − u|² for the best direction u, less Σ w sin² of the angles at which x is seen off the rays.
    """
    e, _ = offsets(x, rays)
    square = np.sum((x - rays.centre) ** 2, axis=-1)
    at_x = np.where(w > 0, w * np.sum(e**2, axis=-1) / square, 0.0).sum(axis=0)
    total = np.linalg.norm(np.einsum("mn,mna->na", w, rays.direction), axis=-1)
    return np.asarray(2 * (w.sum(axis=0) - total) - at_x)


def starts(rays: Rays) -> Array:
    """Points nearest to all rays (N,3), where usual noise does not leave their depth open.

    Otherwise, of three rays and more, the best meeting point of two, if those that agree on it fix its depth.
    """
    x = nearest_points(rays, rays.weight)
    there = rays.weight > 0
    w = np.divide(1.0, (USUAL_PX * rays.pixel) ** 2, out=np.zeros_like(rays.pixel), where=there)
    fixed = over_infinity(np.nan_to_num(x), rays, w) >= DISTINCT
    ahead = ((offsets(np.nan_to_num(x), rays)[1] > 0) & there).any(axis=0)
    out = np.where((fixed & ahead)[:, None], x, np.nan)
    for j in np.flatnonzero(np.isfinite(x).all(axis=1) & ~(fixed & ahead) & (there.sum(axis=0) > 2)):
        best, one = best_pair(rays, j, Settings().end), one_joint(rays, j)
        if best is not None:
            w_one = w[:, [j]] * np.exp(
                -0.25 * np.sum(offsets(best[0][None], one)[0] ** 2, axis=-1) / Settings().end ** 2
            )
            w_one *= offsets(best[0][None], one)[1] > 0
            out[j] = best[0] if over_infinity(best[0][None], one, w_one)[0] >= DISTINCT else np.nan
    return out


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


def one_joint(rays: Rays, j: int) -> Rays:
    """Take the rays of joint `j` alone."""
    return Rays(rays.centre, rays.direction[:, [j]], rays.weight[:, [j]], rays.pixel[:, [j]])


def meeting_points(rays: Rays, j: int, sigma: float) -> list[tuple[tuple[int, int], Array, float]]:
    """Pairs of rays of joint `j` that pass within 2σ in front of both cameras: views, point, Σ c k there."""
    one, found = one_joint(rays, j), []
    for a, b in combinations(np.flatnonzero(one.weight[:, 0] > 0), 2):
        apart = np.sum((one.direction[a, 0] - one.direction[b, 0]) ** 2)
        if apart < 2 * DISTINCT * (USUAL_PX * (one.pixel[a, 0] + one.pixel[b, 0]) / 2) ** 2:
            continue
        chosen = np.isin(np.arange(len(one.weight)), (a, b))[:, None].astype(float)
        x = nearest_points(one, chosen)
        e, along = offsets(x, one)
        meets = (np.linalg.norm(e, axis=-1) <= 2 * sigma) & (along > 0)
        if np.isfinite(x).all() and meets[[a, b]].all():
            found.append(((a, b), x[0], float(weights(x, one, np.array([sigma])).sum())))
    return found


def best_pair(rays: Rays, j: int, sigma: float) -> tuple[Array, float] | None:
    """Meeting point of two rays of joint `j` on which Σ c k is largest, and that sum."""
    found = meeting_points(rays, j, sigma)
    return max(((x, agreed) for _, x, agreed in found), key=lambda f: f[1], default=None)


def rivals(rays: Rays, j: int, x: Array, sigma: float, slack: float) -> list[tuple[Array, float]]:
    """Other places of joint `j` with at most `slack` detections less than x (3,), and their share of votes.

    A pair of rays proposes one if x rejects one of the two; within 4σ of x or of a better one it is the same.
    """
    one = one_joint(rays, j)
    if not (one.weight > 0).any():
        return []
    k = np.divide(
        weights(x[None], one, np.array([sigma])),
        one.weight,
        out=np.ones_like(one.weight),
        where=one.weight > 0,
    )[:, 0]
    here = float((k * one.weight[:, 0]).sum())
    enough = here - max(slack * one.weight[one.weight > 0].mean(), 0.25 * here)
    found: list[tuple[Array, float]] = []
    against = one.weight[(k < REJECTED) & (one.weight[:, 0] > 0), 0].sum()
    if against + 2 * one.weight.max() < enough:
        return []
    places = []
    for views, at, _ in meeting_points(rays, j, sigma):
        if (k[list(views)] < REJECTED).any():
            for _ in range(2):
                at = nearest_points(one, weights(at[None], one, np.array([sigma])))[0]
            places.append((at, float(weights(at[None], one, np.array([sigma])).sum())))
    for at, votes in sorted(places, key=lambda place: -place[1]):
        if votes >= enough and all(
            np.linalg.norm(at - y) > APART * sigma for y in (x, *(y for y, _ in found))
        ):
            found.append((at, votes))
    total = here + sum(votes for _, votes in found)
    return [(at, votes / total) for at, votes in found]


class Evidence(NamedTuple):
    """log p of the detections up to a constant, and the share ε of wrong ones."""

    log: float
    wrong: float


def evidence(
    solution: Solution, rays: Rays, widest: float, prior: tuple[Array, Array] | None = None
) -> Evidence:
    """Sum log p over right (normal, ŝ²/c) and wrong (normal, `widest`²) detections, joints integrated out.

    ε per view and S by three rounds of expectation and maximisation; each joint adds −½ log det H_j.
    """
    known = np.isfinite(solution.points).all(axis=1)
    x = np.nan_to_num(solution.points)
    e, along = offsets(x, rays)
    square, there = np.sum(e**2, axis=-1), (rays.weight > 0) & known
    variance = np.divide(solution.variance, rays.weight, out=np.ones_like(square), where=rays.weight > 0)
    right = np.where(along > 0, np.exp(-0.5 * square / variance) / (2 * np.pi * variance), 0.0)
    wrong = np.full((len(square), 1), FIRST_SHARE)
    apart2, least = widest**2, LEAST_REACH**2 * solution.variance / rays.mean_weight
    for n in range(ROUNDS + 1):
        anywhere = np.exp(-0.5 * square / apart2) / (2 * np.pi * apart2)
        p = np.maximum((1 - wrong) * right + wrong * anywhere, np.finfo(float).tiny)
        r = (1 - wrong) * right / p
        if n < ROUNDS:
            far = (1 - r)[there].sum()
            squares = ((1 - r) * square)[there].sum()
            share = (far + 1) / (there.sum() + 2)
            own = np.where(there, 1 - r, 0.0).sum(axis=1, keepdims=True)
            wrong = (own + SHARED * share) / (there.sum(axis=1, keepdims=True) + SHARED)
            apart2 = max(min((squares + 2 * widest**2) / (2 * (far + 1)), widest**2), least)
    H = information(np.where(there, r / variance, 0.0), rays) + np.eye(3) / widest**2
    logs = np.where(there, np.log(p), 0.0)
    log = 0.0
    for j in np.flatnonzero(known):
        off = there[:, j] & (r[:, j] < 0.5)
        scales = solution.variance, apart2, widest**2
        another = another_place(rays, j, off, x[j], scales, wrong[off, 0])
        log += float(logs[~off, j].sum() + max(logs[off, j].sum(), another))
    if prior is not None:
        apart = (x - prior[0])[known]
        log -= 0.5 * float(np.einsum("na,nab,nb", apart, prior[1][known], apart))
        H[known] += prior[1][known]
    return Evidence(log - 0.5 * float(np.linalg.slogdet(H[known])[1].sum()), float(share))


def another_place(
    rays: Rays, j: int, off: Mask, x: Array, scales: tuple[float, float, float], wrong: Array
) -> float:
    """Sum log p of the wrong rays `off` (M,) of joint `j` if they agree on another place, else −inf.

    `scales` are the variances ŝ², S² and W² in mm², `wrong` ε of the views `off`.
    """
    variance, apart2, widest2 = scales
    if np.count_nonzero(off) < 2:
        return -np.inf
    one = one_joint(rays, j)
    one = one._replace(weight=np.where(off[:, None], one.weight, 0.0))
    best = best_pair(one, 0, 2 * float(np.sqrt(variance / one.weight[off].mean())))
    if best is None:
        return -np.inf
    y = best[0]
    e, along = offsets(y, one)
    square, c = np.sum(e**2, axis=-1)[off, 0], one.weight[off, 0]
    near = np.exp(-0.5 * square * c / variance) * c / (2 * np.pi * variance) * (along[off, 0] > 0)
    anywhere = np.exp(-0.5 * square / apart2) / (2 * np.pi * apart2)
    p = np.maximum(wrong * (near + anywhere), np.finfo(float).tiny)
    w = np.zeros_like(one.weight)
    w[off, 0] = wrong * near / p * c * widest2 / variance
    H = information(w, one)[0] + np.eye(3)
    apart = float(np.sum((y - x) ** 2)) / widest2
    return float(np.log(p).sum() - 0.5 * apart - 0.5 * np.linalg.slogdet(H)[1])


class Located(NamedTuple):
    """Joints placed by their detections, how far kernels followed the noise, ŝ under the configured ones."""

    solution: Solution
    widening: Widening
    narrow_noise: float


def locate(rays: Rays, settings: Settings, margins: tuple[float, float]) -> Located:
    """Triangulate each joint, under kernels that follow the noise where that is likelier."""

    def noise(solution: Solution) -> float:
        return float(np.sqrt(solution.variance / rays.mean_weight))

    wide = Widening(follows_noise=True)
    if settings.noise_mm is not None:
        solution = under(rays, settings, margins, wide)
        return Located(solution, wide, noise(solution))
    narrow = under(rays, settings, margins, Widening())
    kept = Located(narrow, Widening(), noise(narrow))
    if settings.per_noise * kept.narrow_noise < settings.end:
        return kept
    found, scale = under(rays, settings, margins, wide), anywhere(rays, settings)
    if noise(found) > settings.widest or views_agree(rays, AGREES * noise(found)):
        return kept
    now = evidence(found, rays, scale)
    if now.log <= evidence(narrow, rays, scale).log:
        return kept
    return Located(found, Widening(True, (1 - now.wrong) * of_few(rays)), kept.narrow_noise)


def views_agree(rays: Rays, sigma: float) -> bool:
    """Whether the rays of any two views pass each other within noise `sigma` (mm) at the median joint."""
    for a, b in combinations(range(len(rays.weight)), 2):
        both = (rays.weight[[a, b]] > 0).all(axis=0)
        apart = np.sum((rays.direction[a] - rays.direction[b]) ** 2, axis=-1)
        both &= apart >= 2 * DISTINCT * (USUAL_PX * (rays.pixel[a] + rays.pixel[b]) / 2) ** 2
        if np.count_nonzero(both) < LEAST_COMMON:
            continue
        normal = np.cross(rays.direction[a, both], rays.direction[b, both])
        distance = np.abs(normal @ (rays.centre[b, 0] - rays.centre[a, 0])) / np.linalg.norm(normal, axis=1)
        if np.sort(distance)[len(distance) // 2] < 0.6745 * np.sqrt(2) * sigma:
            return True
    return False


def can_outvote(rays: Rays) -> bool:
    """Whether three views see any joint."""
    return bool(((rays.weight > 0).sum(axis=0) > 2).any())


def anywhere(rays: Rays, settings: Settings) -> float:
    """How far off wrong detections are taken to be, mm."""
    return settings.widest * ANYWHERE[int(can_outvote(rays))]


def of_few(rays: Rays) -> float:
    """Variance of Student's t with one degree of freedom per joint, where two views see each."""
    freedom = rays.weight.shape[1]
    return 1.0 if can_outvote(rays) or freedom < LEAST_FREEDOM else freedom / (freedom - 2)


def under(rays: Rays, settings: Settings, margins: tuple[float, float], widening: Widening) -> Solution:
    """Triangulate each joint; where no majority agrees in the end, pairs of rays are judged by all.

    Such a joint moves to the best pair's point if that has more than `margins` (for three views, for more)
    detections of mean weight more.
    """
    problem = Problem(rays, settings=settings, widening=widening)
    found = solve(problem, starts(rays), np.full(rays.weight.shape[1], np.inf))
    points, there = found.points.copy(), rays.weight > 0
    support = residuals(np.nan_to_num(points), rays, found.sigma)[1]
    for j, views in enumerate(there.sum(axis=0)):
        if views < 3 or support[j] >= 0.5 * views + 0.25:
            continue
        now = weights(points, rays, found.sigma)[:, j].sum()
        best = best_pair(rays, j, float(found.sigma[j]))
        margin = margins[int(views > 3)]
        if best is not None and best[1] > now + margin * rays.weight[there[:, j], j].mean():
            points[j] = best[0]
    if not np.array_equal(points, found.points, equal_nan=True):
        again = solve(problem, points, found.sigma)
        found = again._replace(n_iter=found.n_iter + again.n_iter)
    open_depth = parallel(rays, found.points, found.sigma)
    return found._replace(points=np.where(open_depth[:, None], np.nan, found.points))


def parallel(rays: Rays, x: Array, sigma: Array) -> Mask:
    """Whether all rays of a joint lie within 15° of the first, and those that agree on x leave it open."""
    there = rays.weight > 0
    first = np.take_along_axis(rays.direction, there.argmax(axis=0)[None, :, None], axis=0)
    narrow = (~there | (np.sum(rays.direction * first, axis=-1) > NARROW)).all(axis=0)
    w = np.divide(1.0, (USUAL_PX * rays.pixel) ** 2, out=np.zeros_like(rays.pixel), where=there)
    e, along = offsets(np.nan_to_num(x), rays)
    k = np.exp(-0.25 * np.sum(e**2, axis=-1) / sigma**2) * (along > 0) * there
    w *= np.where((k >= REJECTED).sum(axis=0) > 1, k, 1.0)
    return np.asarray(narrow & ~(over_infinity(np.nan_to_num(x), rays, w) >= DISTINCT))
