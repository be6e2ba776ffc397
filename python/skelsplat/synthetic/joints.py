"""The simulated body in other joint layouts: joints of the same name, and eyes and ears on its rigid head."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import numbers
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.skeleton import JOINT_NAMES, N_JOINTS

FloatArray = NDArray[np.float64]

# Nose and head seen from the neck in the head's frame (x forward, z up), mm, as in `skeleton`.
_NOSE, _HEAD = (55.0, 105.0), (10.0, 215.0)
# Joints of the head that Human3.6M-17 has not: x forward, y left, z up from the neck, mm.
_ON_HEAD = {
    "left_eye": (45.0, 32.0, 140.0),
    "right_eye": (45.0, -32.0, 140.0),
    "left_ear": (0.0, 75.0, 125.0),
    "right_ear": (0.0, -75.0, 125.0),
}


def in_layout(points: ArrayLike, layout: Layout) -> FloatArray:
    """Joints of `layout` of simulated bodies.

    Parameters
    ----------
    points : (…, 17, 3)
        Human3.6M-17, as `skelsplat.synthetic.motion` gives them.
    layout : Layout
        One whose joints the simulated body has: those of Human3.6M-17, eyes and ears.

    Returns
    -------
    (…, N, 3) in the unit of `points`.

    Raises
    ------
    InvalidInputError
        If the shape is another or the body has not a joint of that name.
    """
    array = numbers(points, "points")
    if array.ndim < 2 or array.shape[-2:] != (N_JOINTS, 3):
        raise InvalidInputError(f"points: expected shape (..., {N_JOINTS}, 3), got {array.shape}")
    unknown = [name for name in layout.joints if name not in JOINT_NAMES and name not in _ON_HEAD]
    if unknown:
        raise InvalidInputError(f"layout: expected joints that the simulated body has, got {unknown[0]!r}")
    axes = _head_axes(array)
    columns = [
        array[..., JOINT_NAMES.index(name), :]
        if name in JOINT_NAMES
        else array[..., JOINT_NAMES.index("neck"), :] + np.asarray(_ON_HEAD[name]) @ axes
        for name in layout.joints
    ]
    return np.stack(columns, axis=-2)


def _head_axes(points: FloatArray) -> FloatArray:
    """Forward, left and up of the head (…, 3, 3) as rows, as long as the body is scaled."""
    neck, nose, head = (points[..., JOINT_NAMES.index(name), :] for name in ("neck", "nose", "head"))
    (a, b), (c, d) = _NOSE, _HEAD
    forward = (d * (nose - neck) - b * (head - neck)) / (a * d - b * c)
    up = (a * (head - neck) - c * (nose - neck)) / (a * d - b * c)
    left = np.cross(up, forward) / np.linalg.norm(up, axis=-1, keepdims=True)
    axes: FloatArray = np.stack([forward, left, up], axis=-2)
    return axes
