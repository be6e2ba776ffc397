"""What the floor minimises: heights of ankles above a plane with heavy tails, and the tilt as a prior."""

import numpy as np

from reference.arrays import Array

# Of ankles that stand for a while, one in ten says something new.
NEW = 0.1


def cost(plane: Array, ankles: Array, sigma: float, tilt: float) -> float:
    """Minus log posterior of the plane z = a x + b y + c, `plane` (a, b, c), under ankles (K, 3).

    Heights above it are Cauchy-like with the scale `sigma`; (a, b) ~ N(0, tilt²).
    """
    height = ankles[:, 2] - ankles[:, :2] @ plane[:2] - plane[2]
    return float(NEW / 2 * np.log1p((height / sigma) ** 2).sum() + (plane[:2] ** 2).sum() / (2 * tilt**2))


def covariance(plane: Array, ankles: Array, sigma: float, tilt: float) -> Array:
    """Covariance (3, 3) of the plane: an ankle counts as much as its weight says."""
    height = ankles[:, 2] - ankles[:, :2] @ plane[:2] - plane[2]
    information = np.diag([1 / tilt**2, 1 / tilt**2, 0.0])
    for (x, y, _), h in zip(ankles, height, strict=True):
        row = np.array([x, y, 1.0])
        information += NEW / (sigma**2 + h**2) * np.outer(row, row)
    return np.asarray(np.linalg.inv(information))
