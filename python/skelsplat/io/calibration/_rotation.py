"""Rotations as quaternions, vectors and matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_FULL_PRECISION = 1e-12


def matrix_from_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z) of any norm above zero."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def nearest_rotation(matrix: Array, tolerance: float) -> Array | None:
    """Rotation (3, 3) nearest to a matrix that is one up to the digits it was written with.

    None if an entry of RRᵀ − I is above `tolerance`. A reflection stays one; a matrix in full precision
    stays as it is, to the bit.
    """
    off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if off > tolerance:
        return None
    if off < _FULL_PRECISION:
        return matrix
    left, _, right = np.linalg.svd(matrix)
    nearest: Array = left @ right
    return nearest


def vector_from_matrix(rotation: Array) -> Array:
    """Rotation vector (3,) in radians, angle at most π, of a rotation matrix (3, 3).

    Goes through the quaternion, read off the row with the largest diagonal, so that no angle, π included,
    loses digits.
    """
    w, *xyz = _quaternion(rotation)
    axis = np.array(xyz)
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return np.zeros(3)
    # w < 0 is the same rotation the long way round
    angle = 2.0 * np.arctan2(sine, abs(w))
    vector: Array = axis * (np.copysign(angle, w) / sine)
    return vector


def _quaternion(rotation: Array) -> Array:
    """Quaternion (w, x, y, z), not normalised, of a rotation matrix."""
    # 4·q qᵀ for the unit quaternion q: its row with the largest diagonal is q up to a factor
    r = rotation
    outer = np.array(
        [
            [1.0 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1.0 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1.0 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1.0 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    row: Array = outer[int(np.argmax(np.diag(outer)))]
    return row
