"""The palette of `skelsplat.viz._style` in OpenCV's order of colours, and sizes for an image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skelsplat.viz import _style

Colour = tuple[int, int, int]

LIGHT: Colour = (247, 247, 247)
DARK: Colour = (24, 24, 24)
# Diagonal of a 1920 × 1080 image, for which the sizes are made.
_DIAGONAL = 2203.0
_HALFWAY = "#f7f7f7"  # between rejected and trusted, as in ColorBrewer's PiYG


def bgr(colour: str) -> Colour:
    """Return ``#rrggbb`` as (blue, green, red)."""
    red, green, blue = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return blue, green, red


def lighter(colour: Colour) -> Colour:
    """Return the colour halfway to `LIGHT`."""
    blue, green, red = ((own + light) // 2 for own, light in zip(colour, LIGHT, strict=True))
    return blue, green, red


BEFORE, REJECTED, SWAPPED = bgr(_style.BEFORE), bgr(_style.REJECTED), bgr(_style.SWAPPED)
UNUSED = bgr(_style.BEFORE)
_RAMP = np.array([bgr(colour) for colour in (_style.REJECTED, _HALFWAY, _style.DETECTION)], dtype=float)


def weight_colour(weight: float) -> Colour:
    """Return the colour of a detection of weight k in [0, 1]: rejected, light at ½, trusted."""
    blue, green, red = (round(float(np.interp(weight, [0.0, 0.5, 1.0], channel))) for channel in _RAMP.T)
    return blue, green, red


@dataclass(frozen=True)
class Sizes:
    """Line widths (whole pixels) and radii.

    Parameters
    ----------
    thin, limb
        Widths of ellipses, and of limbs.
    joint, hollow, edge
        Radius of a joint's dot, half the side of the square of one that is not ``"ok"``, and width of the
        edge of dots and discs.
    mark
        Radius of a detection's disc or cross.
    text
        Height of text.
    """

    thin: int
    limb: int
    joint: float
    hollow: float
    edge: float
    mark: float
    text: int

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
