"""Several people (DESIGN §8): scores of figures at a body and of pairs, support of a body. Lengths are mm."""

from collections.abc import Sequence

import numpy as np

from reference.arrays import Array, View
from reference.rays import Rays, make_rays, offsets

DOUBT = 1.5  # pseudo-joints that do not fit
LEAST_ANGLE = 1e-8  # sin² of two rays that meet
FARTHEST = 32.0  # |e|²/σ² from which k is 0
FITS, UNSEEN, INSIDE, KERNEL = 0.35, 0.3, 0.5, 0.7
STATURE, PROPORTION = (1600.0, 350.0), 0.3

# Length over stature of the bones of Human3.6M (Winter's table), ends without their sides.
RATIOS = {
    ("shoulder", "elbow"): 0.186,
    ("elbow", "wrist"): 0.146,
    ("hip", "knee"): 0.245,
    ("knee", "ankle"): 0.246,
    ("pelvis", "hip"): 0.075,
    ("neck", "shoulder"): 0.115,
    ("pelvis", "spine"): 0.144,
    ("spine", "neck"): 0.15,
    ("neck", "nose"): 0.11,
    ("nose", "head"): 0.09,
}


def bones(joints: Sequence[str], limbs: Sequence[tuple[int, int]]) -> list[tuple[int, int, float]]:
    """Bones with a known share of stature."""
    bare = [name.removeprefix("left_").removeprefix("right_") for name in joints]
    return [(a, b, RATIOS[bare[a], bare[b]]) for a, b in limbs if (bare[a], bare[b]) in RATIOS]


def figures(people: Array, views: Sequence[View]) -> list[Rays]:
    """Rays of every slot of a frame (M,P,N,3): P times (M,N)."""
    return [make_rays(people[:, p], views) for p in range(people.shape[1])]


def at_body(figure: Rays, body: Array, sigma: float, mirror: Array) -> Array:
    """Scores (M,) of a slot's figures at a body (N,3), the better one of both sides."""
    found = []
    for pose in (body, body[mirror]):
        e, along = offsets(pose, figure)
        known = (figure.weight > 0) & np.isfinite(pose[:, 0])
        far2 = np.sum(e**2, axis=-1)
        k = np.where((along > 0) & (far2 < FARTHEST * sigma**2), np.exp(-far2 / (4 * sigma**2)), 0.0)
        found.append(shrunk(np.where(known, figure.weight, 0.0), k, doubt(figure.weight)))
    return np.where(found[0] > 0.6, found[0], np.maximum(*found))


def doubt(weight: Array) -> Array:
    """Weight (M,) of the pseudo-joints: that of so many joints of mean confidence."""
    there = np.maximum((weight > 0).sum(axis=-1), 1)
    return DOUBT * weight.sum(axis=-1) / there


def shrunk(weight: Array, k: Array, prior: Array) -> Array:
    """Σ w k / (Σ w + prior); 0 without any."""
    total = weight.sum(axis=-1) + prior
    return np.divide(
        (weight * np.nan_to_num(k)).sum(axis=-1), total, out=np.zeros_like(total), where=total > 0
    )


def of_pair(a: Rays, i: int, b: Rays, k: int, sigma: float) -> float:
    """Score of a slot's figure in view i with another's in view k."""
    p, q = a.direction[i], b.direction[k]
    normal = np.cross(p, q)
    sin2 = np.sum(normal**2, axis=-1)
    between = b.centre[k, 0] - a.centre[i, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.abs(normal @ between) / np.sqrt(sin2)
        ahead = [np.sum(np.cross(between, way) * normal, axis=-1) / sin2 > 0 for way in (q, p)]
    both = (a.weight[i] > 0) & (b.weight[k] > 0)
    weight = np.where(both, a.weight[i] * b.weight[k], 0.0)
    meets = both & (sin2 >= LEAST_ANGLE) & ahead[0] & ahead[1]
    overlap = np.where(meets, np.exp(-0.25 * (np.where(meets, distance, 0.0) / sigma) ** 2), 0.0)
    means = doubt(a.weight)[i] / DOUBT * doubt(b.weight)[k] / DOUBT
    return float(shrunk(weight, overlap, np.asarray(DOUBT * means)))


def human(pose: Array, lengths: Sequence[tuple[int, int, float]]) -> float:
    """How well the bones (ends, share of stature) match one stature."""
    known = np.array([np.linalg.norm(pose[a] - pose[b]) / ratio for a, b, ratio in lengths])
    known = known[np.isfinite(known) & (known > 0)]
    if len(known) < 3:
        return 1.0
    fits = np.exp(-0.5 * (np.log(known[:, None] / known) / PROPORTION) ** 2).mean(axis=0)
    usual = np.exp(-0.125 * ((known - STATURE[0]) / STATURE[1]) ** 2)
    return float((np.maximum(usual, 0.01) * fits).max())


def support(
    slots: Sequence[Rays],
    pose: Array,
    views: Sequence[View],
    sigma: float,
    mirror: Array,
    lengths: Sequence[tuple[int, int, float]],
) -> float:
    """Support of a newcomer among free figures."""
    best = np.max([at_body(figure, pose, KERNEL * sigma, mirror) for figure in slots], axis=0)
    return human(pose, lengths) * sum(
        score if score >= FITS else (-UNSEEN if sees(view, pose) else 0.0)
        for score, view in zip(best, views, strict=True)
    )


def sees(view: View, pose: Array) -> bool:
    """Whether most of a body is inside the image."""
    known = pose[np.isfinite(pose[:, 0])]
    x = (known @ view.R.T + view.t) @ view.K.T
    inside = (x[:, 2] > 0) & (x[:, :2] >= 0).all(axis=-1) & (x[:, :2] < x[:, 2:] * view.size).all(axis=-1)
    return bool(len(known) and inside.sum() >= INSIDE * len(known))
