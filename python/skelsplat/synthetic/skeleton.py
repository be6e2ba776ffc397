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

ANKLE_HEIGHT_MM = 80.0  # of the ankle joint above the floor when the foot stands on it

# Of each joint its parent, the rigid segment that carries it, and its offset from the parent in the segment's
# frame, for a 1.75 m adult.
_BODY = (
    (-1, "pelvis", (0.0, 0.0, 0.0)),
    (0, "pelvis", (0.0, -132.0, 0.0)),
    (1, "thigh_r", (0.0, 0.0, -445.0)),
    (2, "shin_r", (0.0, 0.0, -440.0)),
    (0, "pelvis", (0.0, 132.0, 0.0)),
    (4, "thigh_l", (0.0, 0.0, -445.0)),
    (5, "shin_l", (0.0, 0.0, -440.0)),
    (0, "waist", (0.0, 0.0, 235.0)),
    (7, "chest", (0.0, 0.0, 255.0)),
    (8, "head", (55.0, 0.0, 105.0)),
    (9, "head", (-45.0, 0.0, 110.0)),
    (8, "chest", (0.0, 150.0, -15.0)),
    (11, "upper_arm_l", (0.0, 0.0, -280.0)),
    (12, "forearm_l", (0.0, 0.0, -250.0)),
    (8, "chest", (0.0, -150.0, -15.0)),
    (14, "upper_arm_r", (0.0, 0.0, -280.0)),
    (15, "forearm_r", (0.0, 0.0, -250.0)),
)
PARENTS = tuple(parent for parent, _, _ in _BODY)
"""Index of each joint's parent; −1 at the root."""

_LIMB_LIMITS_DEG = {
    "hip_flexion": (-30.0, 125.0),
    "hip_abduction": (-25.0, 45.0),
    "hip_rotation": (-40.0, 45.0),
    "knee_flexion": (0.0, 150.0),
    "shoulder_flexion": (-60.0, 180.0),
    "shoulder_abduction": (-30.0, 180.0),
    "shoulder_rotation": (-80.0, 90.0),
    "elbow_flexion": (0.0, 150.0),
}
LIMITS_DEG: Mapping[str, tuple[float, float]] = {
    "lean": (-30.0, 60.0),
    "tilt": (-30.0, 30.0),
    "spine_flexion": (-20.0, 80.0),
    "spine_tilt": (-30.0, 30.0),
    "spine_rotation": (-45.0, 45.0),
    "neck_flexion": (-50.0, 50.0),
    "neck_rotation": (-75.0, 75.0),
    **{f"{name}_{side}": limits for name, limits in _LIMB_LIMITS_DEG.items() for side in "lr"},
}
"""Lowest and highest angle of each degree of freedom.

``lean`` and ``tilt`` incline the whole body about the pelvis: forward, and to the left. ``spine_*`` is the
bend from pelvis to chest, half of it at the waist; tilt and rotations are positive to the left.
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


def _ball(angles: dict[str, Array], joint: str, side: str) -> Array:
    """Local rotation (T, 3, 3) of a hip or shoulder: rotation first, then flexion, then abduction."""
    mirror = 1.0 if side == "l" else -1.0
    return (
        _rotation(0, mirror * angles[f"{joint}_abduction_{side}"])
        @ _rotation(1, -angles[f"{joint}_flexion_{side}"])
        @ _rotation(2, mirror * angles[f"{joint}_rotation_{side}"])
    )


def _segment_rotations(angles: dict[str, Array], heading_deg: Array) -> dict[str, Array]:
    """World rotation (T, 3, 3) of every rigid segment."""
    pelvis = _rotation(2, heading_deg) @ _rotation(0, -angles["tilt"]) @ _rotation(1, angles["lean"])
    half_spine = (  # of the waist on the pelvis, and again of the chest on the waist
        _rotation(2, angles["spine_rotation"] / 2)
        @ _rotation(0, -angles["spine_tilt"] / 2)
        @ _rotation(1, angles["spine_flexion"] / 2)
    )
    waist = pelvis @ half_spine
    chest = waist @ half_spine
    neck = _rotation(2, angles["neck_rotation"]) @ _rotation(1, angles["neck_flexion"])
    out = {"pelvis": pelvis, "waist": waist, "chest": chest, "head": chest @ neck}
    for side in "lr":
        out[f"thigh_{side}"] = pelvis @ _ball(angles, "hip", side)
        out[f"shin_{side}"] = out[f"thigh_{side}"] @ _rotation(1, angles[f"knee_flexion_{side}"])
        out[f"upper_arm_{side}"] = chest @ _ball(angles, "shoulder", side)
        bend = _rotation(1, -angles[f"elbow_flexion_{side}"])
        out[f"forearm_{side}"] = out[f"upper_arm_{side}"] @ bend
    return out


def forward_kinematics(
    angles: Mapping[str, Array | float],
    heading_deg: Array | float = 0.0,
    *,
    n_frames: int = 1,
    scale: float = 1.0,
) -> Array:
    """Joints (T, 17, 3) mm, Human3.6M-17, of a body with its pelvis at the origin.

    `angles` are degrees (T,) by names from `LIMITS_DEG`; absent ones are 0. `heading_deg` (T,) is the
    direction that the pelvis faces, counter-clockwise from +x seen from above.
    """
    every = {name: np.broadcast_to(angles.get(name, 0.0), (n_frames,)) for name in LIMITS_DEG}
    rotations = _segment_rotations(every, np.broadcast_to(heading_deg, (n_frames,)))
    pose = np.zeros((n_frames, N_JOINTS, 3))
    for joint, (parent, segment, offset) in enumerate(_BODY[1:], start=1):
        pose[:, joint] = pose[:, parent] + rotations[segment] @ (scale * np.array(offset))
    return pose


def in_layout(points: ArrayLike, layout: Layout) -> Array:
    """Joints (…, N, 3) of `layout` of simulated bodies (…, 17, 3), as `skelsplat.synthetic.motion` gives.

    The body has the joints of Human3.6M-17, eyes and ears.
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


def _head_axes(points: Array) -> Array:
    """Forward, left and up of the head (…, 3, 3) as rows, as long as the body is scaled."""
    neck, nose, head = (points[..., JOINT_NAMES.index(name), :] for name in ("neck", "nose", "head"))
    (a, b), (c, d) = _NOSE, _HEAD
    forward = (d * (nose - neck) - b * (head - neck)) / (a * d - b * c)
    up = (a * (head - neck) - c * (nose - neck)) / (a * d - b * c)
    left = np.cross(up, forward) / np.linalg.norm(up, axis=-1, keepdims=True)
    return np.stack([forward, left, up], axis=-2)
