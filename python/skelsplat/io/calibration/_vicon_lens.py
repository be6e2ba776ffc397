"""Vicon's radial lens model as OpenCV coefficients.

Vicon maps a measured pixel to an ideal one, in pixels about a centre c of its own:

    ideal = c + (1 + k1 r² + k2 r⁴ + k3 r⁶)·(measured − c),      r = |measured − c|

OpenCV maps ideal to measured, in multiples of the focal length about the principal point, so that the
coefficients cannot be copied: k1, k2, p1, p2, k3 and the thin-prism terms s1..s4 are fitted over the image.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_GRID = 40


def ideal_pixels(pixels: Array, centre: Array, radial: Array, aspect: float) -> Array:
    """Ideal pixels of measured ones (n, 2); `aspect` is that of a pixel."""
    offset = (pixels - centre) * [1.0, aspect]
    squared = (offset**2).sum(axis=1, keepdims=True)
    scale = 1.0 + sum(k * squared ** (i + 1) for i, k in enumerate(radial))
    ideal: Array = offset * scale / [1.0, aspect] + centre
    return ideal


def is_plausible(size: tuple[int, int], centre: Array, radial: Array, aspect: float) -> bool:
    """Whether the ideal radius grows with the measured one all over the image, and not beyond twice it."""
    corners = np.array([[0.0, 0.0], [size[0], 0.0], [0.0, size[1]], [size[0], size[1]]])
    most = np.linalg.norm((corners - centre) * [1.0, aspect], axis=1).max()
    r = np.linspace(0.0, most, 200)
    scale = 1.0 + sum(k * r ** (2 * i + 2) for i, k in enumerate(radial))
    growth = 1.0 + sum((2 * i + 3) * k * r ** (2 * i + 2) for i, k in enumerate(radial))
    return bool((np.asarray(growth) > 0.1).all() and (np.asarray(scale) < 2.0).all())


def fit(K: Array, size: tuple[int, int], centre: Array, radial: Array, aspect: float) -> tuple[Array, float]:
    """Return OpenCV's 12 coefficients (k4 to k6 are 0) and the largest error of the fit in px.

    A polynomial: the rational terms would fit a strong lens better, but with large coefficients that cancel.
    """
    axes = [np.linspace(0.0, length - 1.0, _GRID) for length in size]
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    focal, principal = np.array([K[0, 0], K[1, 1]]), K[:2, 2]
    ideal = (ideal_pixels(pixels, centre, radial, aspect) - principal) / focal
    terms = np.concatenate(list(_terms(ideal) * focal[:, None, None]))
    right = (pixels - principal - ideal * focal).T.ravel()
    solution = np.linalg.lstsq(terms, right, rcond=None)[0]
    error = float(np.abs(terms @ solution - right).max())
    k1, k2, p1, p2, k3, *s = solution
    return np.array([k1, k2, p1, p2, k3, 0.0, 0.0, 0.0, *s]), error


def _terms(ideal: Array) -> Array:
    """Return what k1, k2, p1, p2, k3, s1, s2, s3, s4 multiply in x and in y, (2, n, 9)."""
    x, y = ideal.T
    r2 = x * x + y * y
    r4, r6, zero = r2**2, r2**3, np.zeros_like(x)
    along_x = [x * r2, x * r4, 2 * x * y, r2 + 2 * x * x, x * r6, r2, r4, zero, zero]
    along_y = [y * r2, y * r4, r2 + 2 * y * y, 2 * x * y, y * r6, zero, zero, r2, r4]
    return np.stack([np.stack(along_x, axis=1), np.stack(along_y, axis=1)])
