"""What BVH and glTF files have in common: a skeleton that moves, y up, at even times."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import layouts
from skelsplat._arrays import Array, Index, numbers
from skelsplat._skeleton import Animation, animate, is_person
from skelsplat._words import number
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.findings import Finding, warn
from skelsplat.io.poses._markers import joints_of, with_y_up
from skelsplat.io.poses._pose_data import PoseData, Poses, known_frame_rate, parts_of

Bones = Sequence[tuple[int, int]]

MOST_FRAMES = 100_000
"""Of an animation, which is held in memory."""
_Z = np.array([0.0, 0.0, 1.0])
# Numbers of frames that lack up to this multiple of those that are there are gaps.
_SPARSE = 10


def animated(
    data: Poses, kind: str, frame_rate: float | None, unit: str, up: ArrayLike | None, limbs: Bones | None
) -> Animation:
    """Return poses as an animation with lengths in ``unit``, and say what its constant bones cost.

    Other arguments are those of `skelsplat.io.poses.write_bvh`.
    """
    head, frames, parts = parts_of(data)
    rate = known_frame_rate(head, frame_rate, kind)
    check_animation(frames)
    one_of("unit", unit, MM_PER_UNIT)
    points = np.concatenate([part.pose for part in parts]) * (MM_PER_UNIT[head.unit] / MM_PER_UNIT[unit])
    step = _step(frames)
    every = np.full(((int(frames[-1]) - int(frames[0])) // step + 1, *points.shape[1:]), np.nan)
    every[(frames - frames[0]) // step] = points @ with_y_up(_Z if up is None else numbers(up, "up")).T
    joints = joints_of(head.joint_names)
    animation, seen = animate(every, joints, _bones(head, joints, limbs), rate / step)
    off = MM_PER_UNIT[unit] * np.linalg.norm(animation.places - seen, axis=2)
    median, most = (round(float(np.percentile(off, part)), 3) for part in (50, 95))
    words = "The bones of the animation have constant lengths: its joints are "
    words += f"{number(median)} mm from the poses' (median; 95 % within {number(most)} mm)."
    warn(Finding("bones_constant", "note", numbers={"median_mm": median, "most_mm": most}, sentence=words))
    return animation


def check_animation(frames: Index) -> None:
    """Raise `InvalidInputError` unless there are frames, not too many, and most of them."""
    span = (int(frames[-1]) - int(frames[0])) // _step(frames) + 1 if len(frames) else 0
    if not 0 < span <= min(MOST_FRAMES, _SPARSE * len(frames)) or (np.diff(frames) < 1).any():
        expected = f"up to {MOST_FRAMES:,} in order, of which a tenth is there"
        raise InvalidInputError(f"frames: expected {expected}, got {len(frames):,} of {span:,}")


def _step(frames: Index) -> int:
    """Return what the numbers of frames go up by."""
    return math.gcd(*np.diff(frames).tolist()) or 1


def upward(data: PoseData) -> Array | None:
    """Return y (3,) if a person's trunk is along y rather than z, as in most marker files, and say so."""
    joints = joints_of(data.joint_names)
    if not is_person(joints):
        return None
    index = [[joints.index(f"{side}_{end}") for side in ("left", "right")] for end in ("hip", "shoulder")]
    hips, shoulders = (data.pose[:, both].mean(axis=1) for both in index)
    trunk = shoulders - hips
    seen = trunk[np.isfinite(trunk).all(axis=1)]
    _, y, z = np.median(seen, axis=0).tolist() if len(seen) else (0.0, 0.0, 1.0)
    if abs(y) <= abs(z):
        return None
    sentence = "y is taken to be up, because the person's trunk points along it."
    warn(Finding("axes_turned", "note", sentence=sentence))
    return np.array([0.0, np.sign(y), 0.0])


def _bones(data: PoseData, joints: tuple[str, ...], limbs: Bones | None) -> Bones:
    """Return the pairs of joints that bones connect; of people, whose skeleton is known, none."""
    if is_person(joints):
        return []
    if limbs is not None:
        return limbs
    if len(data.bones):
        return [(int(a), int(b)) for a, b in data.bones]
    for layout in map(layouts.get, layouts.names):
        if tuple(layout.joints) == data.joint_names:
            return layout.limbs
    expected = "those of a person or of a built-in layout, or poses over time, which have bones"
    raise InvalidInputError(f"joint_names: expected {expected}, got {', '.join(data.joint_names[:4])}, …")
