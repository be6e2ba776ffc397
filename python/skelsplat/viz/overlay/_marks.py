"""Colours, sizes, and lines and marks at parts of a pixel.

What lies too far outside for OpenCV's integers is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array
from skelsplat._optional import opencv
from skelsplat.viz import _style

Colour = tuple[int, int, int]
Image = npt.NDArray[np.uint8]

# Diagonal of a 1920 × 1080 image, for which the sizes are made.
_DIAGONAL = 2203.0
_SHIFT = 4  # coordinates count sixteenths of a pixel
_FAR = 1e6  # px; 16 times that is well below 2³¹
_MOST_DASHES = 300
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
DIAMOND = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
_TURN = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


def bgr(colour: str) -> Colour:
    """Return ``#rrggbb`` as (blue, green, red)."""
    red, green, blue = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return blue, green, red


LIGHT, DARK = bgr("#f7f7f7"), bgr("#181818")
BEFORE, REJECTED, SWAPPED = bgr(_style.BEFORE), bgr(_style.REJECTED), bgr(_style.SWAPPED)
_RAMP = np.array([REJECTED, LIGHT, bgr(_style.DETECTION)], dtype=float)  # as in ColorBrewer's PiYG


def weight_colour(weight: float, own: str | None = None) -> Colour:
    """Return the colour of a detection of weight k in [0, 1]: rejected, light at ½, trusted.

    With ``own``, the colour of a person: light at 0, ``own`` at 1.
    """
    ramp = _RAMP if own is None else np.linspace(LIGHT, bgr(own), 3)
    blue, green, red = (round(float(np.interp(weight, [0.0, 0.5, 1.0], channel))) for channel in ramp.T)
    return blue, green, red


@dataclass(frozen=True)
class Sizes:
    """Line widths (whole pixels) and radii."""

    thin: int  # of ellipses
    limb: int
    joint: float  # radius of its dot
    hollow: float  # half the side of the square of a joint that is not ``"ok"``
    edge: float  # width of the edge of dots and discs
    mark: float  # radius of a detection's disc or cross
    text: int  # height of text

    @classmethod
    def of(cls, width: int, height: int) -> Sizes:
        """Return the sizes for images of this width and height."""
        unit = math.hypot(width, height) / _DIAGONAL
        return cls(
            thin=max(1, round(unit)),
            limb=max(1, round(2.5 * unit)),
            joint=max(1.5, 2.5 * unit),
            hollow=max(2.5, 4.0 * unit),
            edge=max(0.5, unit),
            mark=max(2.5, 6.0 * unit),
            text=max(11, round(24 * unit)),
        )


def line(image: Image, points: Array, colour: Colour, width: int) -> None:
    """Draw a line through ``points`` (K, 2); nothing if one of them is unknown."""
    if drawable(points):
        opencv().polylines(image, [_fixed(points)], False, colour, width, opencv().LINE_AA, _SHIFT)


def polygon(image: Image, corners: Array, colour: Colour, width: int | None = None) -> None:
    """Draw a polygon (K, 2), filled or with a ``width`` its outline; nothing if a corner is unknown."""
    if drawable(corners) and width is None:
        opencv().fillPoly(image, [_fixed(corners)], colour, opencv().LINE_AA, _SHIFT)
    else:
        line(image, np.concatenate([corners, corners[:1]]), colour, width or 1)


def dashed(image: Image, ends: Array, colour: Colour, width: int, *, dash: float) -> None:
    """Draw a line (2, 2) in dashes of ``dash`` px with gaps as long; longer ones where they would be many."""
    if not drawable(ends):
        return
    count = min(max(1, round(float(np.linalg.norm(ends[1] - ends[0])) / (2 * dash))), _MOST_DASHES)
    stops = np.arange(count)[:, None] + np.array([0.25, 0.75])  # (count, 2) begin and end of each
    for share in stops / count:
        line(image, ends[0] + share[:, None] * (ends[1] - ends[0]), colour, width)


def dot(image: Image, centre: Array, radius: float, colour: Colour) -> None:
    """Draw a filled circle."""
    if drawable(centre):
        across, down = _fixed(centre)[0].tolist()
        size = round(radius * 2**_SHIFT)
        opencv().circle(image, (across, down), size, colour, opencv().FILLED, opencv().LINE_AA, _SHIFT)


def ellipse(
    image: Image, centre: Array, covariance: Array, colour: Colour, *, sigmas: float, width: int
) -> None:
    """Draw the points at ``sigmas`` standard deviations of a covariance (2, 2) about ``centre``.

    Nothing if they reach further than a quarter of the image's diagonal: that joint may be anywhere, and the
    ellipse would be a line across the image.
    """
    if not (drawable(centre) and drawable(covariance)):
        return
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors * np.sqrt(np.maximum(values, 0.0))
    if sigmas * np.sqrt(max(values[-1], 0.0)) > 0.25 * np.hypot(*image.shape[:2]):
        return
    polygon(image, centre + sigmas * _CIRCLE @ axes.T, colour, width)


def drawable(points: Array) -> bool:
    """Say whether all numbers are known and fit OpenCV's integers."""
    return bool((np.abs(points) < _FAR).all())  # False for NaN


def _fixed(points: Array) -> npt.NDArray[np.int32]:
    fixed: npt.NDArray[np.int32] = np.rint(np.atleast_2d(points) * 2**_SHIFT).astype(np.int32)
    return fixed
