"""Lengths of bones in one frame: their loss, and the most likely combination of places of doubtful joints.

A bone of length l and σ costs 36 (1 − exp(−(‖x_a−x_b‖−l)²/(72 σ²))), a joint Σ c (2σ²/ŝ²)(1 − k) over its
rays. Bones that close a circle are left out. All lengths are mm.
"""

from typing import NamedTuple

import numpy as np

from reference.arrays import Array, Mask
from reference.consensus import meeting_points, one_joint
from reference.rays import Rays, nearest_points, offsets, weights

REACH = 6.0

Bone = tuple[int, int, float, float]
"""Joints, l and σ."""


class Search(NamedTuple):
    """Pose (N,3), bones, joints to be found (N,), joints that are known (N,), their kernels (N,), ŝ²."""

    points: Array
    bones: list[Bone]
    doubtful: Mask
    placed: Mask
    sigma: Array
    variance: float


def bone_loss(a: Array, b: Array, bone: Bone) -> Array:
    """Loss of a bone between places a (…,3) and b (…,3)."""
    *_, mean, sigma = bone
    off = np.linalg.norm(a - b, axis=-1) - mean
    return np.asarray(REACH**2 * (1 - np.exp(-0.5 * (off / (REACH * sigma)) ** 2)))


def ray_loss(x: Array, rays: Rays, j: int, search: Search) -> Array:
    """F (K,) of the rays of joint `j` at places x (K,3)."""
    one, sigma = one_joint(rays, j), search.sigma[[j]]
    k = np.array([weights(at[None], one, sigma).sum() for at in x])
    return np.asarray(2 * sigma[0] ** 2 / search.variance * (one.weight.sum() - k))


def on_sphere(rays: Rays, view: int, j: int, centre: Array, radius: float) -> list[Array]:
    """Points of a ray at `radius` from `centre` before the camera, or the nearest if it passes by."""
    one = one_joint(rays, j)
    e, along = offsets(centre[None], one)
    half = np.sqrt(max(radius**2 - float(np.sum(e[view, 0] ** 2)), 0.0))
    reached = (along[view, 0] + half * np.unique([-1, 1] if half else [0])).tolist()
    return [one.centre[view, 0] + r * one.direction[view, 0] for r in reached if r > 0]


def places(rays: Rays, j: int, search: Search) -> Array:
    """Where joint `j` may be (K,3): where it is, two rays meet, or one meets the sphere of a bone."""
    found, sigma = [search.points[j]], float(search.sigma[j])
    if search.doubtful[j]:
        one, meetings = one_joint(rays, j), meeting_points(rays, j, sigma)
        for view in np.flatnonzero(one.weight[:, 0] > 0):
            for at in (at for views, at, _ in meetings if views[0] == view):
                for _ in range(2):
                    then = nearest_points(one, weights(at[None], one, np.array([sigma])))[0]
                    at = then if np.isfinite(then).all() else at
                found.append(at)
            for a, b, mean, _ in search.bones:
                if j in (a, b) and search.placed[a + b - j]:
                    found += on_sphere(rays, int(view), j, search.points[a + b - j], mean)
    all_found = np.array(found)
    return all_found[np.isfinite(all_found).all(axis=1)]


def tree(bones: list[Bone], n: int) -> list[tuple[int, int, Bone]]:
    """Child, parent and bone from the roots outwards: the last joint that was reached is continued first."""
    order, reached = [], set()
    for root in range(n):
        ends = [root] if root not in reached else []
        reached.add(root)
        while ends:
            parent = ends.pop()
            for bone in bones:
                child = bone[0] + bone[1] - parent
                if parent in bone[:2] and child not in reached:
                    reached.add(child)
                    order.append((child, parent, bone))
                    ends.append(child)
    return order


def most_likely(rays: Rays, search: Search) -> Array:
    """Pose (N,3) of the least sum of losses over the combinations of places, from the leaves to the roots."""
    n = len(search.points)
    where = [places(rays, j, search) for j in range(n)]
    cost = [ray_loss(x, rays, j, search) for j, x in enumerate(where)]
    order, choice = tree(search.bones, n), {}
    for child, parent, bone in reversed(order):
        if len(where[child]) and len(where[parent]):
            both = cost[child] + bone_loss(where[parent][:, None], where[child], bone)
            choice[child] = both.argmin(axis=1)
            cost[parent] = cost[parent] + both.min(axis=1)
    chosen = [int(c.argmin()) if len(c) else -1 for c in cost]
    for child, parent, _ in order:
        if child in choice:
            chosen[child] = int(choice[child][chosen[parent]])
    return np.array(
        [x[k] if k >= 0 else start for x, k, start in zip(where, chosen, search.points, strict=True)]
    )
