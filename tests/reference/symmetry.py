"""L_sym = Σ (‖l₁−l₂‖ − ‖r₁−r₂‖)² over symmetric limbs (DESIGN §2 "Symmetry"; paper, eq. 4)."""

import numpy as np

from reference.arrays import Array, Mask

Limb = tuple[int, int]
Pairs = tuple[tuple[Limb, Limb], ...]


def observed_pairs(pairs: Pairs, observed: Mask) -> Pairs:
    """Keep the pairs whose four end points are all detected by some view; `observed` is (N,)."""
    return tuple(pair for pair in pairs if all(observed[j] for limb in pair for j in limb))


def symmetry(means: Array, pairs: Pairs) -> tuple[float, Array]:
    """L_sym in the squared unit of `means` (N,3), and its gradient (N,3): ∂‖a−b‖/∂a = (a−b)/‖a−b‖."""
    value, gradient = 0.0, np.zeros_like(means)
    for (l1, l2), (r1, r2) in pairs:
        left, right = means[l1] - means[l2], means[r1] - means[r2]
        difference = float(np.linalg.norm(left) - np.linalg.norm(right))
        value += difference**2
        left_pull = 2 * difference * left / np.linalg.norm(left)
        right_pull = -2 * difference * right / np.linalg.norm(right)
        gradient[l1] += left_pull
        gradient[l2] -= left_pull
        gradient[r1] += right_pull
        gradient[r2] -= right_pull
    return value, gradient
