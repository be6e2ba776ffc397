"""What marker files (TRC, C3D) have in common: names of the joints, axes, a frame rate.

The programs that read them go by names: Pose2Sim's filters, marker augmentation and OpenSim models know
``RHip``, ``LBigToe``. Its root is ``CHip`` in BODY_25 and ``Hip`` in HALPE_26.
"""

from __future__ import annotations

from skelsplat.exceptions import InvalidInputError
from skelsplat.io.poses._pose_data import PoseData, check_frame_rate
from skelsplat.layouts import BODY25

MARKER_NAMES = ("skelsplat", "pose2sim")
# the world's z axis up becomes the file's y axis up by this order of columns (Pose2Sim does the same)
Y_UP = [1, 2, 0]
_SIDES = {"left": "L", "right": "R"}


def known_frame_rate(data: PoseData, given: float | None, kind: str) -> float:
    """Return the frame rate that is given, or else that of the data; a file of this ``kind`` states one."""
    rate = given if given is not None else data.frame_rate
    if rate is None:
        expected = f"one for a {kind} file (the poses state none)"
        raise InvalidInputError(f"frame_rate: expected {expected}, got none")
    return check_frame_rate(rate)


def marker_names(joint_names: tuple[str, ...], convention: str) -> tuple[str, ...]:
    """Return the joints' names in a convention of `MARKER_NAMES`."""
    if convention not in MARKER_NAMES:
        raise InvalidInputError(f"marker_names: expected {' or '.join(MARKER_NAMES)}, got {convention!r}")
    if convention == "skelsplat":
        return joint_names
    root = "CHip" if joint_names == tuple(BODY25.joints) else "Hip"
    return tuple(root if name == "pelvis" else _pose2sim(name) for name in joint_names)


def _pose2sim(name: str) -> str:
    side, _, rest = name.partition("_")
    prefix = _SIDES.get(side, "") if rest else ""
    words = (rest if prefix else name).split("_")
    return prefix + "".join(word[:1].upper() + word[1:] for word in words)
