"""The few types that the twin's modules hand to each other."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


class View(NamedTuple):
    """A distortion-free camera: `K` (3,3) px, `R` (3,3), `t` (3,) world→camera, `size` (width, height) px."""

    K: Array
    R: Array
    t: Array
    size: tuple[int, int]


class Gaussians(NamedTuple):
    """A skeleton: `means` (N,3), `log_scales` (N,3) = ln σ, `quaternions` (N,4) as (w, x, y, z)."""

    means: Array
    log_scales: Array
    quaternions: Array


class Projected(NamedTuple):
    """A skeleton in one view: `means2d` (N,2) px, `covariances2d` (N,2,2) px², `depths` (N,), `seen` (N,)."""

    means2d: Array
    covariances2d: Array
    depths: Array
    seen: Mask
