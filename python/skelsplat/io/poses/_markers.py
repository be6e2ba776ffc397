"""What marker files (TRC, C3D) and OpenSim call joints, and the axes they want."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skelsplat import layouts
from skelsplat._angles import TOES
from skelsplat._arrays import Array
from skelsplat._skeleton import is_person
from skelsplat.exceptions import one_of
from skelsplat.io.poses._pose_data import PoseData

MARKER_NAMES = ("skelsplat", "pose2sim")
# the world's z axis up becomes the file's y axis up by this order of columns (Pose2Sim does the same)
Y_UP = [1, 2, 0]
_SIDES = {"left": "L", "right": "R"}
# Pose2Sim's names of joints on a side
_POSE2SIM = {
    **dict.fromkeys(TOES, "BigToe"),
    "thumb2": "Thumb",
    "forefinger1": "Index",
    "pinky_finger1": "Pinky",
}
# markers that are the middle of two others
_MIDDLES = {"Neck": ("RShoulder", "LShoulder")}


@dataclass(frozen=True)
class IkSetup:
    """The markers of one of Pose2Sim's models in OpenSim, with their weights in its inverse kinematics."""

    weights: Mapping[str, float]
    root: str = "Hip"  # what it calls the pelvis


def _both(weight: float, *names: str) -> dict[str, float]:
    return {side + name: weight for side in "LR" for name in names}


_BODY = _both(1.0, "Elbow", "Wrist", "Knee", "Ankle") | _both(2.0, "Shoulder", "Hip")
_FEET = _both(1.0, "BigToe", "SmallToe", "Heel")
_HANDS = ("Thumb", "Index", "Pinky")
_NOSE, _HEAD, _NECK, _EYES = {"Nose": 0.1}, {"Head": 0.1}, {"Neck": 0.2}, _both(0.05, "Eye")
_HALPE26 = _NOSE | _HEAD | _NECK | {"Hip": 1.0} | _BODY | _FEET

IK_SETUPS = {
    "HALPE_26": IkSetup(_HALPE26),
    "COCO_17": IkSetup(_NOSE | _NECK | _BODY),
    "BODY_25": IkSetup(_NOSE | _NECK | {"CHip": 2.0} | _BODY | _FEET, root="CHip"),
    "BODY_25B": IkSetup(_NOSE | _HEAD | _NECK | _BODY | _FEET),
    "HALPE_136": IkSetup(_HALPE26 | _both(0.2, *_HANDS)),
    "COCO_133": IkSetup(_NOSE | _EYES | _BODY | _FEET | _both(0.2, *_HANDS)),
    "BLAZEPOSE": IkSetup(_NOSE | _EYES | _BODY | _both(1.0, "BigToe", "Heel") | _both(0.05, *_HANDS)),
}
"""By the names of its pose models."""


def ik_model(joint_names: Sequence[str]) -> str:
    """Return the model of `IK_SETUPS` that shares most markers with joints and lacks fewest."""

    def fit(model: str) -> int:
        setup = IK_SETUPS[model]
        shared = setup.weights.keys() & {_pose2sim(name, setup.root) for name in joint_names}
        return 2 * len(shared) - len(setup.weights)

    return max(IK_SETUPS, key=fit)


def with_y_up(up: Array) -> Array:
    """Return the rotation (3, 3) of a world with this axis up (3,), or down, into one with y up.

    Where z is up, that is `Y_UP`.
    """
    axis = int(np.argmax(np.abs(up)))
    turn: Array = np.eye(3)[[(axis + 2) % 3, axis, (axis + 1) % 3]]
    if up[axis] < 0:
        turn[1:] *= -1.0
    return turn


def marker_names(joint_names: Sequence[str], convention: str) -> tuple[str, ...]:
    """Return the joints' names in a convention of `MARKER_NAMES`, those that `as_markers` adds at the end.

    Pose2Sim knows ``RHip``, ``LBigToe``.
    """
    one_of("marker_names", convention, MARKER_NAMES)
    if convention == "skelsplat":
        return tuple(joint_names)
    setup = IK_SETUPS[ik_model(joint_names)]
    names = tuple(_pose2sim(name, setup.root) for name in joint_names)
    added = (name for name, ends in _MIDDLES.items() if name in setup.weights and {*ends} <= {*names})
    return (*names, *(name for name in added if name not in names))


def joints_of(markers: Sequence[str]) -> tuple[str, ...]:
    """Return what the markers of a person are called as joints, if Pose2Sim names them; else the same."""
    if is_person(markers):
        return tuple(markers)
    known: dict[str, str] = {}
    for layout in (one for one in map(layouts.get, layouts.names) if one.human):
        known = dict(zip(marker_names(layout.joints, "pose2sim"), layout.joints, strict=False)) | known
    joints = tuple(known.get(name, name) for name in markers)
    return joints if is_person(joints) else tuple(markers)


def as_markers(data: PoseData, convention: str) -> PoseData:
    """Return the poses with `marker_names`; what marker files do not hold is left out.

    Pose2Sim's inverse kinematics of some models want the middle of the shoulders, where no joint is.
    """
    names = marker_names(data.joint_names, convention)
    if convention == "skelsplat":
        return data
    pose, bar, filled = data.pose, data.error_bar, data.joint_status == "filled"
    for added in names[len(data.joint_names) :]:
        ends = [names.index(end) for end in _MIDDLES[added]]
        pose = np.concatenate([pose, pose[:, ends].mean(axis=1, keepdims=True)], axis=1)
        if bar.size:
            bar = np.concatenate([bar, bar[:, ends].sum(axis=1, keepdims=True) / 4], axis=1)
        if filled.size:
            filled = np.concatenate([filled, filled[:, ends].any(axis=1, keepdims=True)], axis=1)
    status = np.where(filled, "filled", "")
    return PoseData(
        pose,
        names,
        data.frames,
        data.unit,
        uncertainty=bar,
        joint_status=status,
        frame_rate=data.frame_rate,
        processing=data.processing,
    )


def _pose2sim(name: str, root: str) -> str:
    if name == "pelvis":
        return root
    side, _, rest = name.partition("_")
    prefix = _SIDES.get(side, "") if rest else ""
    if prefix and rest in _POSE2SIM:
        return prefix + _POSE2SIM[rest]
    words = (rest if prefix else name).split("_")
    return prefix + "".join(word[:1].upper() + word[1:] for word in words)
