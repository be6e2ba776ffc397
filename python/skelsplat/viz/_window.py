"""The part of a camera's image that holds the person."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

Window = tuple[tuple[int, int], tuple[int, int]]

_PAD = 0.08  # of the person's longer side, around the crop
_MIN_CROP_PX = 40.0


def person_window(points: Array, size: tuple[int, int]) -> Window:
    """Return the first and last column and the first and last row of the part of the image to show.

    It holds every one of ``points`` (K, 2) that lies in the image of ``size`` (width, height), with a margin;
    the whole image if none does.
    """
    width, height = size
    inside = (points >= -0.5).all(axis=1) & (points < np.array([width, height]) - 0.5).all(axis=1)
    if not inside.any():
        return (0, width - 1), (0, height - 1)
    low, high = points[inside].min(axis=0), points[inside].max(axis=0)
    centre = (low + high) / 2
    margin = _PAD * max(float((high - low).max()), _MIN_CROP_PX)
    side = np.maximum(high - low, _MIN_CROP_PX) + 2 * margin
    return _span(centre[0], side[0], width), _span(centre[1], side[1], height)


def aspect(window: Window) -> float:
    """Return height over width of a window."""
    (left, right), (top, bottom) = window
    return (bottom - top + 1) / (right - left + 1)


def _span(centre: float, length: float, limit: int) -> tuple[int, int]:
    """Return the first and last pixel of ``length`` px about ``centre``, within an image of ``limit`` px."""
    first = int(np.floor(centre - length / 2))
    last = int(np.ceil(centre + length / 2))
    return max(first, 0), min(last, limit - 1)
