"""The palette of `skelsplat.viz._style` in OpenCV's order of colours."""

from __future__ import annotations

import numpy as np

from skelsplat.viz import _style

Colour = tuple[int, int, int]

LIGHT: Colour = (247, 247, 247)
DARK: Colour = (24, 24, 24)
_HALFWAY = "#f7f7f7"  # between rejected and believed, as in ColorBrewer's PiYG


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
    """Return the colour of a detection of weight k in [0, 1]: rejected, light at ½, believed."""
    blue, green, red = (round(float(np.interp(weight, [0.0, 0.5, 1.0], channel))) for channel in _RAMP.T)
    return blue, green, red
