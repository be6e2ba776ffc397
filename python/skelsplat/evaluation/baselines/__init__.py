"""Triangulations that others use, in NumPy: what SkelSplat is measured against.

Each takes detections ``(T, M, N, 2|3)`` or ``(M, N, 2|3)`` and M cameras, and gives points ``(T, N, 3)`` or
``(N, 3)`` in the unit of the cameras. Missing detections (NaN, or confidence 0) take no part; a joint that
fewer than two views see is NaN. Lens distortion is removed first, so every pixel below is an ideal pixel of
the same K. Shapes that do not fit and confidences outside [0, 1] are an `skelsplat.InvalidInputError`.
"""

from skelsplat.evaluation.baselines._observations import dlt
from skelsplat.evaluation.baselines._robust import cauchy, ransac_adafuse, ransac_iskakov

__all__ = ["cauchy", "dlt", "ransac_adafuse", "ransac_iskakov"]
