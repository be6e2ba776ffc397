"""Tolerances of drawn images, with their derivation."""

import numpy as np

from reference.arrays import Array, Mask

IMAGE = 3e-5
"""Largest difference of a drawn pixel from the twin's.

The images are float32, drawn along rows by recurrences that start anew every 128 px. Each pixel adds about
two roundings of 6e-8, relative to values up to 1: 1.5e-5 at the end of a run, and twice that for safety.
"""


def decided(bells: Array) -> Mask:
    """Select the pixels (H,W) where rounding cannot move a joint's bell over the 1/255 cut.

    `bells` is (N,H,W), uncut, NaN where there is none. Elsewhere one side may draw 1/255 and the other
    nothing, and both are right.
    """
    return np.asarray(~np.any(np.abs(bells * 255 - 1) <= IMAGE, axis=0))
