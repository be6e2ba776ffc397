"""The numbers that plots show: lengths of limbs, errors by camera and joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skelsplat._arrays import Array, Mask

if TYPE_CHECKING:
    from skelsplat.io import PoseData

    Pairs = tuple[tuple[int, int], ...]

# Statuses of joints whose depth is open, or that were not measured.
_UNSURE = ("weak", "filled")


@dataclass(frozen=True)
class LimbLength:
    """A limb over time.

    Parameters
    ----------
    name, side
        The name without the side; the side is ``""`` in the middle.
    lengths : (T,)
        In mm; NaN where an end is unknown.
    sure : (T,)
        Where both ends are known and neither is weak or filled; the numbers count these frames.
    """

    name: str
    side: str
    lengths: Array
    sure: Mask

    @property
    def median(self) -> float:
        """Median, NaN without a frame that counts."""
        return float(np.median(self.lengths[self.sure])) if self.sure.any() else float("nan")

    @property
    def deviation(self) -> float:
        """Standard deviation, NaN with fewer than two frames that count."""
        return float(np.std(self.lengths[self.sure])) if self.sure.sum() > 1 else float("nan")


def limb_lengths(poses: PoseData, limbs: Pairs, left_right: Pairs) -> list[list[LimbLength]]:
    """Return the limbs in the order of the layout; a left one and its mirror image come together."""
    mirror = {a: b for left, right in left_right for a, b in ((left, right), (right, left))}
    left_joints = {left for left, _ in left_right}
    rest = {frozenset(limb): limb for limb in limbs}
    groups = []
    for limb in limbs:
        if rest.pop(frozenset(limb), None) is None:
            continue
        twin = rest.pop(frozenset(mirror.get(joint, joint) for joint in limb), None)
        if twin is None:
            name = " – ".join(poses.joint_names[joint].replace("_", " ") for joint in limb)
            groups.append([_limb(poses, limb, name)])
            continue
        left, right = (limb, twin) if left_joints & set(limb) else (twin, limb)
        name = " – ".join(_without_side(poses.joint_names[joint]) for joint in left)
        groups.append([_limb(poses, left, name, "left"), _limb(poses, right, name, "right")])
    return groups


def _limb(poses: PoseData, limb: tuple[int, int], name: str, side: str = "") -> LimbLength:
    a, b = limb
    lengths = np.linalg.norm(poses.pose[:, a] - poses.pose[:, b], axis=-1)
    sure = np.isfinite(lengths)
    if len(poses.joint_status):
        sure &= ~np.isin(poses.joint_status[:, limb], _UNSURE).any(axis=1)
    return LimbLength(name, side, lengths, sure)


def _without_side(name: str) -> str:
    return " ".join(part for part in name.split("_") if part not in ("left", "right"))


def error_maps(poses: PoseData, rejected_below: float) -> tuple[Array, Array]:
    """Return median error in px and share rejected, each (M + 1, N + 1); last row and column: over all.

    Both count the detections that were used, rejected ones among them; NaN where there is none.
    """
    errors, weights = poses.reprojection_error, poses.view_weights
    _, views, joints = errors.shape
    median, share = np.full((2, views + 1, joints + 1), np.nan)
    for i in range(views + 1):
        for j in range(joints + 1):
            cell = np.s_[:, slice(None) if i == views else i, slice(None) if j == joints else j]
            error, weight = (values[np.isfinite(values)] for values in (errors[cell], weights[cell]))
            if len(error):
                median[i, j] = np.median(error)
            if len(weight):
                share[i, j] = np.mean(weight < rejected_below)
    return median, share
