"""Hierarchical scales of the detections' noise: the factors that minimise −2 log p, by Newton's method.

The mode of the first level, which has one group, is the expected variance, that of the others 1.
"""

from typing import NamedTuple

import numpy as np

from reference.arrays import Array

STEPS = 60


class Level(NamedTuple):
    """Group of each cell (C,), and how many residuals the mode of a factor counts for."""

    group: Array
    certainty: float


def objective(theta: Array, squares: Array, freedom: Array, expected: float, levels: list[Level]) -> float:
    """−2 log p of the logarithms of all factors, one level after another."""
    design, modes, certainty = _linear(expected, levels)
    log_variance = design @ theta
    of_cells = freedom * log_variance + squares * np.exp(-log_variance)
    return float(of_cells.sum() + (certainty * (theta + modes * np.exp(-theta))).sum())


def variances(squares: Array, freedom: Array, expected: float, levels: list[Level]) -> Array:
    """Find the variances (C,) at the minimum; every certainty is finite."""
    design, modes, certainty = _linear(expected, levels)
    theta = np.log(modes)
    for _ in range(STEPS):
        shown, kept = squares * np.exp(-design @ theta), certainty * modes * np.exp(-theta)
        gradient = design.T @ (freedom - shown) + certainty - kept
        step = np.linalg.solve(design.T @ (shown[:, None] * design) + np.diag(kept), -gradient)
        theta = theta + step * min(1.0, 1.0 / np.abs(step).max())
    return np.exp(design @ theta)


def _linear(expected: float, levels: list[Level]) -> tuple[Array, Array, Array]:
    """Which factors make up each variance (C,F), the factors' modes (F,) and their certainties (F,)."""
    blocks = [np.eye(int(group.max()) + 1)[group] for group, _ in levels]
    sizes = [block.shape[1] for block in blocks]
    modes = np.concatenate([[expected], np.ones(sum(sizes) - 1)])
    return np.hstack(blocks), modes, np.repeat([level.certainty for level in levels], sizes)
