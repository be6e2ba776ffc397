"""An articulated adult in the Human3.6M-17 layout: bone lengths, joint limits, forward kinematics.

Body frame: x forward, y left, z up, mm. At zero angles the body stands upright, arms hanging.
Angles are in degrees, by name; those of limbs end in ``_l`` or ``_r`` and have the same sign on both sides:
positive flexion moves the limb as in walking or bending (knees backward, all else forward), positive
abduction moves it away from the body, positive rotation turns it outward.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import layouts
from skelsplat._arrays import Array, numbers
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import InvalidInputError

JOINT_NAMES = layouts.H36M17.joints
N_JOINTS = len(JOINT_NAMES)

PARENTS = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 9, 8, 11, 12, 8, 14, 15)
"""Index of each joint's parent; −1 at the root."""

ANKLE_HEIGHT_MM = 80.0
"""Height of the ankle joint above the floor when the foot stands on it."""

# Offset of each joint from its parent in the frame of the segment it belongs to (next table).
# Sizes of a 1.75 m adult.
_OFFSETS = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.0, -132.0, 0.0),
        (0.0, 0.0, -445.0),
        (0.0, 0.0, -440.0),
        (0.0, 132.0, 0.0),
        (0.0, 0.0, -445.0),
        (0.0, 0.0, -440.0),
        (0.0, 0.0, 235.0),
        (0.0, 0.0, 255.0),
        (55.0, 0.0, 105.0),
        (-45.0, 0.0, 110.0),
        (0.0, 150.0, -15.0),
        (0.0, 0.0, -280.0),
        (0.0, 0.0, -250.0),
        (0.0, -150.0, -15.0),
        (0.0, 0.0, -280.0),
        (0.0, 0.0, -250.0),
    ]
)

# The rigid segment that carries each joint, and each segment's parent.
_SEGMENT_OF = (
    "pelvis",
    "pelvis",
    "thigh_r",
    "shin_r",
    "pelvis",
    "thigh_l",
    "shin_l",
    "waist",
    "chest",
    "head",
    "head",
    "chest",
    "upper_arm_l",
    "forearm_l",
    "chest",
    "upper_arm_r",
    "forearm_r",
)

LIMITS_DEG: Mapping[str, tuple[float, float]] = {
    "lean": (-30.0, 60.0),
    "tilt": (-30.0, 30.0),
    "spine_flexion": (-20.0, 80.0),
    "spine_tilt": (-30.0, 30.0),
    "spine_rotation": (-45.0, 45.0),
    "neck_flexion": (-50.0, 50.0),
    "neck_rotation": (-75.0, 75.0),
    "hip_flexion": (-30.0, 125.0),
    "hip_abduction": (-25.0, 45.0),
    "hip_rotation": (-40.0, 45.0),
    "knee_flexion": (0.0, 150.0),
    "shoulder_flexion": (-60.0, 180.0),
    "shoulder_abduction": (-30.0, 180.0),
    "shoulder_rotation": (-80.0, 90.0),
    "elbow_flexion": (0.0, 150.0),
}
"""Lowest and highest angle of each degree of freedom; limbs have it once per side.

``lean`` and ``tilt`` incline the whole body about the pelvis: forward, and to the left. ``spine_*`` is the
bend from pelvis to chest, half of it at the waist; its tilt and rotation are positive to the left, as is
``neck_rotation``.
"""

# Nose and head seen from the neck in the head's frame (x forward, z up), mm, as in `skeleton`.
_NOSE, _HEAD = (55.0, 105.0), (10.0, 215.0)
# Joints of the head that Human3.6M-17 has not: x forward, y left, z up from the neck, mm.
_ON_HEAD = {
    "left_eye": (45.0, 32.0, 140.0),
    "right_eye": (45.0, -32.0, 140.0),
    "left_ear": (0.0, 75.0, 125.0),
    "right_ear": (0.0, -75.0, 125.0),
}

_SIDED = ("hip", "knee", "shoulder", "elbow")


def angle_names() -> tuple[str, ...]:
    """Names that `forward_kinematics` knows, sides included."""
    names: list[str] = []
    for name in LIMITS_DEG:
        names += [f"{name}_l", f"{name}_r"] if name.split("_")[0] in _SIDED else [name]
    return tuple(names)


def _rotation(axis: int, degrees: Array) -> Array:
    """Right-handed rotations (T, 3, 3) about axis 0, 1 or 2."""
    radians = np.deg2rad(degrees)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*radians.shape, 3, 3))
    out[..., axis, axis] = 1.0
    out[..., a, a] = out[..., b, b] = np.cos(radians)
    out[..., b, a] = np.sin(radians)
    out[..., a, b] = -out[..., b, a]
    return out


class _Angles:
    """Checked joint angles over T frames; absent names are 0."""

    def __init__(self, angles: Mapping[str, ArrayLike], n_frames: int) -> None:
        known = angle_names()
        self._values: dict[str, Array] = {}
        for name, given in angles.items():
            if name not in known:
                raise InvalidInputError(f"angles: expected names among {', '.join(known)}, got {name!r}")
            value = np.broadcast_to(numbers(given, f"angles[{name!r}]"), (n_frames,))
            low, high = LIMITS_DEG[name.removesuffix("_l").removesuffix("_r")]
            # Written so that NaN fails too; 1e-9 forgives rounding at the limit.
            if not ((value >= low - 1e-9) & (value <= high + 1e-9)).all():
                worst = value[int(np.argmax(np.maximum(low - value, value - high)))]
                raise InvalidInputError(f"angles[{name!r}]: expected {low} to {high} degrees, got {worst}")
            self._values[name] = value
        self._zero = np.zeros(n_frames)

    def __getitem__(self, name: str) -> Array:
        return self._values.get(name, self._zero)

    def ball(self, joint: str, side: str) -> Array:
        """Local rotation (T, 3, 3) of a hip or shoulder: rotation first, then flexion, then abduction."""
        mirror = 1.0 if side == "l" else -1.0
        return (
            _rotation(0, mirror * self[f"{joint}_abduction_{side}"])
            @ _rotation(1, -self[f"{joint}_flexion_{side}"])
            @ _rotation(2, mirror * self[f"{joint}_rotation_{side}"])
        )

    def half_spine(self) -> Array:
        """Local rotation (T, 3, 3) of the waist on the pelvis, and again of the chest on the waist."""
        return (
            _rotation(2, self["spine_rotation"] / 2)
            @ _rotation(0, -self["spine_tilt"] / 2)
            @ _rotation(1, self["spine_flexion"] / 2)
        )


def _segment_rotations(angles: _Angles, heading_deg: Array) -> dict[str, Array]:
    """World rotation (T, 3, 3) of every rigid segment."""
    pelvis = _rotation(2, heading_deg) @ _rotation(0, -angles["tilt"]) @ _rotation(1, angles["lean"])
    half = angles.half_spine()
    waist = pelvis @ half
    chest = waist @ half
    neck = _rotation(2, angles["neck_rotation"]) @ _rotation(1, angles["neck_flexion"])
    out = {"pelvis": pelvis, "waist": waist, "chest": chest, "head": chest @ neck}
    for side in "lr":
        out[f"thigh_{side}"] = pelvis @ angles.ball("hip", side)
        out[f"shin_{side}"] = out[f"thigh_{side}"] @ _rotation(1, angles[f"knee_flexion_{side}"])
        out[f"upper_arm_{side}"] = chest @ angles.ball("shoulder", side)
        bend = _rotation(1, -angles[f"elbow_flexion_{side}"])
        out[f"forearm_{side}"] = out[f"upper_arm_{side}"] @ bend
    return out


def forward_kinematics(
    angles: Mapping[str, ArrayLike],
    *,
    heading_deg: ArrayLike = 0.0,
    root: ArrayLike = (0.0, 0.0, 0.0),
    n_frames: int = 1,
    scale: float = 1.0,
) -> Array:
    """Joint positions of a body with the given angles.

    Parameters
    ----------
    angles : mapping of name to degrees, each (T,) or a number
        Names from `angle_names`; absent ones are 0.
    heading_deg : (T,) or float
        Direction that the pelvis faces, counter-clockwise from +x seen from above.
    root : (T, 3) or (3,) mm
        Position of the pelvis.
    n_frames : int
        T.
    scale : float
        Factor on all bone lengths.

    Returns
    -------
    (T, 17, 3) mm, Human3.6M-17.

    Raises
    ------
    InvalidInputError
        If an angle is unknown or outside its limits, or `scale` is not positive.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InvalidInputError(f"scale: expected a finite number > 0, got {scale!r}")
    heading = np.broadcast_to(numbers(heading_deg, "heading_deg"), (n_frames,))
    rotations = _segment_rotations(_Angles(angles, n_frames), heading)
    pose = np.empty((n_frames, N_JOINTS, 3))
    pose[:, 0] = numbers(root, "root")
    for joint in range(1, N_JOINTS):
        offset = rotations[_SEGMENT_OF[joint]] @ (scale * _OFFSETS[joint])
        pose[:, joint] = pose[:, PARENTS[joint]] + offset
    return pose


def _bodies(points: ArrayLike) -> Array:
    array = numbers(points, "points")
    if array.ndim < 2 or array.shape[-2:] != (N_JOINTS, 3):
        raise InvalidInputError(f"points: expected shape (..., {N_JOINTS}, 3), got {array.shape}")
    return array


def bone_lengths(points: ArrayLike) -> Array:
    """Length of the bone from each joint to its parent, (…, 16), joints 1 to 16, in the unit of `points`."""
    array = _bodies(points)
    lengths: Array = np.linalg.norm(array[..., 1:, :] - array[..., PARENTS[1:], :], axis=-1)
    return lengths


def in_layout(points: ArrayLike, layout: Layout) -> Array:
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
    array = _bodies(points)
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


def _head_axes(points: Array) -> Array:
    """Forward, left and up of the head (…, 3, 3) as rows, as long as the body is scaled."""
    neck, nose, head = (points[..., JOINT_NAMES.index(name), :] for name in ("neck", "nose", "head"))
    (a, b), (c, d) = _NOSE, _HEAD
    forward = (d * (nose - neck) - b * (head - neck)) / (a * d - b * c)
    up = (a * (head - neck) - c * (nose - neck)) / (a * d - b * c)
    left = np.cross(up, forward) / np.linalg.norm(up, axis=-1, keepdims=True)
    axes: Array = np.stack([forward, left, up], axis=-2)
    return axes
