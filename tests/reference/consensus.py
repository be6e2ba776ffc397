"""Robust triangulation: every joint annealed, and by pairs of rays where no majority agrees (DESIGN §3)."""

from itertools import combinations

import numpy as np

from reference.annealed import Problem, Settings, Solution, residuals, solve
from reference.arrays import Array
from reference.rays import Rays, nearest_points, offsets, weights


def best_pair(rays: Rays, j: int, sigma: float) -> tuple[Array, float] | None:
    """Point between two rays of joint `j`, within 2σ of both, on which Σ c k is largest, and that sum."""
    one = Rays(rays.centre, rays.direction[:, [j]], rays.weight[:, [j]], rays.pixel[:, [j]])
    best = None
    for pair in combinations(np.flatnonzero(one.weight[:, 0] > 0), 2):
        chosen = np.isin(np.arange(len(one.weight)), pair)[:, None].astype(float)
        x = nearest_points(one, chosen)
        e, along = offsets(x, one)
        meets = (np.linalg.norm(e, axis=-1) <= 2 * sigma) & (along > 0)
        agreed = float(weights(x, one, np.array([sigma])).sum())
        if np.isfinite(x).all() and meets[list(pair)].all() and (best is None or agreed > best[1]):
            best = x[0], agreed
    return best


def locate(rays: Rays, settings: Settings, margins: tuple[float, float]) -> Solution:
    """Triangulate each joint; where no majority agrees in the end, pairs of rays are judged by all.

    Such a joint moves to the best pair's point if that has more than `margins` (for three views, for more)
    detections of mean weight more.
    """
    problem = Problem(rays, settings=settings)
    found = solve(problem, nearest_points(rays, rays.weight), np.full(rays.weight.shape[1], np.inf))
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
    if np.array_equal(points, found.points, equal_nan=True):
        return found
    again = solve(problem, points, found.sigma)
    return again._replace(n_iter=found.n_iter + again.n_iter)
