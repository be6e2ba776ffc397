"""What joints are called in marker files, where the programs that read them go by names.

Pose2Sim's filters, marker augmentation and OpenSim models know ``RHip``, ``LBigToe``. Its root is ``CHip`` in
BODY_25 and ``Hip`` in HALPE_26.
"""

from __future__ import annotations

from skelsplat.exceptions import InvalidInputError
from skelsplat.layouts import BODY25

MARKER_NAMES = ("skelsplat", "pose2sim")
_SIDES = {"left": "L", "right": "R"}


def marker_names(joint_names: tuple[str, ...], convention: str) -> tuple[str, ...]:
    """Return the joints' names in a convention of `MARKER_NAMES`.

    Raises
    ------
    InvalidInputError
        If the convention is unknown.
    """
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
