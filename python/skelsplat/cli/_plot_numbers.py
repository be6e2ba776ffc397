"""The numbers in the pictures of ``skelsplat plot``: chosen joints, lengths of limbs, errors by camera and joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from skelsplat.cli._plot_source import Pairs
    from skelsplat.io import PoseData

    Array = npt.NDArray[np.float64]

# Ends of the limbs, where errors show first.
_DISTAL = ("wrist", "ankle")
_FEW = 4


def chosen_joints(text: str | None, names: Sequence[str]) -> list[int]:
    """Return the joints of a list with commas, or of ``all``; by default wrists and ankles, or the first four.

    Raises
    ------
    typer.BadParameter
        If a name is no joint.
    """
    if text is None:
        distal = [k for k, name in enumerate(names) if any(part in name.lower() for part in _DISTAL)]
        return distal or list(range(min(_FEW, len(names))))
    if text.strip() == "all":
        return list(range(len(names)))
    wanted = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in wanted:
        if name not in names:
            known = ", ".join(names)
            raise typer.BadParameter(f"expected all or some of {known}, got {name!r}", param_hint="--joints")
    return [list(names).index(name) for name in wanted]


@dataclass(frozen=True)
class LimbLength:
    """A limb: its name without its side, its side (``""`` for the middle), its lengths (T,) in mm."""

    name: str
    side: str
    lengths: Array

    @property
    def known(self) -> Array:
        """The lengths that are known."""
        return self.lengths[np.isfinite(self.lengths)]

    @property
    def median(self) -> float:
        """Median over the frames, NaN without any."""
        return float(np.median(self.known)) if len(self.known) else float("nan")

    @property
    def deviation(self) -> float:
        """Standard deviation over the frames, NaN without any."""
        return float(np.std(self.known)) if len(self.known) else float("nan")


def limb_lengths(
    pose: Array, limbs: Pairs, left_right: Pairs, names: Sequence[str]
) -> list[list[LimbLength]]:
    """Return the limbs of poses (T, N, 3) in the order of the layout; left and right ones come together."""
    mirror = {a: b for left, right in left_right for a, b in ((left, right), (right, left))}
    left_joints = {left for left, _ in left_right}
    open_limbs = {frozenset(limb): limb for limb in limbs}
    groups = []
    for limb in limbs:
        if open_limbs.pop(frozenset(limb), None) is None:
            continue
        twin = open_limbs.pop(frozenset(mirror.get(joint, joint) for joint in limb), None)
        if twin is None:
            name = " – ".join(names[joint].replace("_", " ") for joint in limb)
            groups.append([LimbLength(name, "", _length(pose, limb))])
            continue
        pair = (limb, twin) if left_joints & set(limb) else (twin, limb)
        name = " – ".join(_without_side(names[joint]) for joint in pair[0])
        groups.append(
            [
                LimbLength(name, side, _length(pose, one))
                for side, one in zip(("left", "right"), pair, strict=True)
            ]
        )
    return groups


def _length(pose: Array, limb: tuple[int, int]) -> Array:
    a, b = limb
    lengths: Array = np.linalg.norm(pose[:, a] - pose[:, b], axis=-1)
    return lengths


def _without_side(name: str) -> str:
    return " ".join(part for part in name.split("_") if part not in ("left", "right"))


def error_maps(poses: PoseData, rejected_below: float) -> tuple[Array, Array]:
    """Return median error in px and share rejected, each (M + 1, N + 1); the last row and column are over all.

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
