"""Widths and radii, in pixels, for an image of a given size."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Diagonal of a 1920 × 1080 image, for which the sizes are made.
_DIAGONAL = 2203.0


@dataclass(frozen=True)
class Sizes:
    """Line widths (whole pixels) and radii.

    Parameters
    ----------
    thin, limb
        Widths of ellipses, and of limbs.
    joint, hollow, edge
        Radius of a joint's dot, half the side of the square of one that is not reliable, and width of the
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
