"""The vertical of a world, from how the cameras are held."""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array

# Length of the cameras' mean upward direction below which they do not agree on a vertical: they look down.
_AGREED_UP = 0.3
# Cosine of the angle between that direction and the nearest axis, below which no axis is taken for vertical.
_NEAR_AXIS = 0.75


def world_up(rig: sk.CameraRig) -> Array:
    """Return the axis of the world nearest to the cameras' mean upward direction; z if they do not agree."""
    mean: Array = np.mean([-np.asarray(camera.R)[1] for camera in rig], axis=0)
    up = np.zeros(3)
    if np.linalg.norm(mean) < _AGREED_UP:
        up[2] = 1.0
        return up
    axis = int(np.argmax(np.abs(mean)))
    up[axis] = np.sign(mean[axis])
    return up


def vertical_known(rig: sk.CameraRig) -> bool:
    """Tell whether the cameras agree on a vertical that is close to an axis of the world (`world_up`)."""
    mean: Array = np.mean([-np.asarray(camera.R)[1] for camera in rig], axis=0)
    length = float(np.linalg.norm(mean))
    return length >= _AGREED_UP and float(np.abs(mean).max()) >= _NEAR_AXIS * length
