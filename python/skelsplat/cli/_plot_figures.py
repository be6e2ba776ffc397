"""The three pictures of ``skelsplat plot``: arrays for `skelsplat.viz`, and what is said about each."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat.cli._plot_numbers import LimbLength, error_maps, limb_lengths

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    from skelsplat.cli._plot_source import Source
    from skelsplat.viz import Skeleton, TimeAxis

    Array = npt.NDArray[np.float64]

_SPREAD = "Median ± standard deviation over the frames (in brackets: part of the median). Dashed: median."
_PALE = "Pale, not counted, and cut off where far away: frames in which an end is weakly seen or filled."
_EQUAL = (
    "The refinement kept {which} nearly equal left and right, so that their difference is no finding; "
    "refine with --symmetry-tier 0 to study it."
)
_KEPT_EQUAL = {1: "lower arms and legs", 2: "arms and legs", 3: "arms, legs and trunk"}  # by the tier
_COUNTED = "All detections that were used are counted, the rejected ones too. Grey: none was used."


@dataclass(frozen=True)
class Drawn:
    """One picture: its files, a sentence on what it shows, and its numbers for ``--json``.

    Without files, ``sentence`` says why it was left out.
    """

    name: str
    files: list[Path] = field(default_factory=list)
    sentence: str = ""
    numbers: Any = None


@dataclass(frozen=True)
class Order:
    """Where to and in which formats, and the joints whose trajectories are drawn."""

    folder: Path
    formats: Sequence[str]
    joints: Sequence[int]


def draw_trajectories(source: Source, order: Order) -> Drawn:
    """Draw the chosen joints over time."""
    from skelsplat import viz  # matplotlib takes long to load, and --help does without

    poses = source.poses
    shape = poses.pose.shape
    variance = np.diagonal(poses.uncertainty, axis1=-2, axis2=-1)
    sigma = np.sqrt(np.maximum(variance, 0.0)) if len(poses.uncertainty) else np.full(shape, np.nan)
    data = viz.TrajectoryData(
        pose=poses.pose,
        sigma=sigma,
        start=poses.init_pose if len(poses.init_pose) else np.full(shape, np.nan),
        status=poses.joint_status if len(poses.joint_status) else np.full(shape[:2], "", dtype="<U10"),
        time=_time(source),
        joint_names=poses.joint_names,
        joints=order.joints,
        title=source.title,
        notes=poses.processing,
    )
    stem = order.folder / "trajectories"
    files = viz.write_trajectories(stem, data, skeleton=_skeleton(source), formats=order.formats)
    known = np.asarray(np.isfinite(poses.pose).all(axis=-1))
    numbers = [
        {
            "joint": poses.joint_names[joint],
            "frames_known": int(known[:, joint].sum()),
            "sigma_median_mm": [_median(sigma[:, joint, axis]) for axis in range(3)],
        }
        for joint in order.joints
    ]
    words = f"{len(order.joints)} {'joint' if len(order.joints) == 1 else 'joints'}"
    bars = "" if np.isfinite(sigma).any() else "; no error bands, the file has no error bars"
    return Drawn("trajectories", files, f"{words} over time{bars}.", numbers)


def draw_bones(source: Source, order: Order) -> Drawn:
    """Draw the lengths of all limbs over time."""
    from skelsplat import viz  # as in draw_trajectories

    if not source.limbs:
        why = "the joints are those of no built-in layout, so its limbs are not known (--layout, if they are)"
        return Drawn("bones", sentence=why)
    groups = limb_lengths(source.poses, source.limbs, source.left_right)
    panels = [viz.BonePanel(group[0].name, [_bone(limb) for limb in group]) for group in groups]
    limbs = [limb for group in groups for limb in group]
    unsure = any((np.isfinite(limb.lengths) & ~limb.sure).any() for limb in limbs)
    which = _KEPT_EQUAL.get(source.symmetry_tier)
    equal = [] if which is None else [_EQUAL.format(which=which)]
    notes = (f"{_SPREAD} {_PALE}" if unsure else _SPREAD, *equal, *source.poses.processing)
    data = viz.BoneData(panels, _time(source), source.title, notes)
    files = viz.write_bones(order.folder / "bones", data, formats=order.formats)
    return Drawn("bones", files, _about_bones(limbs), [_limb_numbers(limb) for limb in limbs])


def draw_errors(source: Source, order: Order) -> Drawn:
    """Draw the reprojection errors by camera and joint."""
    from skelsplat import viz  # as in draw_trajectories

    poses = source.poses
    if not (len(poses.reprojection_error) and len(poses.view_weights)):
        why = "the file has no errors of single cameras; the folder of a run and its pose.npz have them"
        return Drawn("errors", sentence=why)
    median, share = error_maps(poses, sk.REJECTED_WEIGHT)
    data = viz.ErrorMapData(median, share, poses.camera_names, poses.joint_names, source.title, (_COUNTED,))
    files = viz.write_error_map(order.folder / "errors", data, formats=order.formats)
    numbers = {
        "median_px": _number(median[-1, -1]),
        "rejected_share": _number(share[-1, -1]),
        "cameras": _margin("camera", poses.camera_names, median[:-1, -1], share[:-1, -1]),
        "joints": _margin("joint", poses.joint_names, median[-1, :-1], share[-1, :-1]),
    }
    return Drawn("errors", files, _about_errors(source, median, share), numbers)


PICTURES = {"trajectories": draw_trajectories, "bones": draw_bones, "errors": draw_errors}


def _time(source: Source) -> TimeAxis:
    from skelsplat import viz  # as in draw_trajectories

    return viz.TimeAxis(source.poses.frames, source.poses.frame_rate, source.zero)


def _skeleton(source: Source) -> Skeleton:
    from skelsplat import viz  # as in draw_trajectories

    return viz.Skeleton(limbs=source.limbs, left_right=source.left_right)


def _bone(limb: LimbLength) -> Any:
    from skelsplat import viz  # as in draw_trajectories

    return viz.Bone(limb.side, limb.lengths, limb.sure, limb.median, limb.deviation)


def _about_bones(limbs: Sequence[LimbLength]) -> str:
    shares = {
        f"{limb.side} {limb.name}".strip(): 100 * limb.deviation / limb.median
        for limb in limbs
        if limb.median > 0 and np.isfinite(limb.deviation)
    }
    if not shares:
        return "no limb has a length that is sure in two frames or more."
    worst = max(shares, key=lambda name: shares[name])
    return (
        f"standard deviation of the limbs' lengths {min(shares.values()):.1f} to {shares[worst]:.1f} %, "
        f"median {np.median(list(shares.values())):.1f} %; most: {worst}."
    )


def _about_errors(source: Source, median: Array, share: Array) -> str:
    if not np.isfinite(median[-1, -1]):
        return "no detection was used."
    camera = int(np.nanargmax(median[:-1, -1]))
    joint = int(np.nanargmax(median[-1, :-1]))
    rejected = "" if not np.isfinite(share[-1, -1]) else f", {100 * share[-1, -1]:.0f} % rejected"
    return (
        f"median {median[-1, -1]:.1f} px{rejected}; most: {source.poses.camera_names[camera]} "
        f"{median[camera, -1]:.1f} px, {source.poses.joint_names[joint]} {median[-1, joint]:.1f} px."
    )


def _limb_numbers(limb: LimbLength) -> dict[str, Any]:
    return {
        "limb": limb.name,
        "side": limb.side or None,
        "median_mm": _number(limb.median),
        "sd_mm": _number(limb.deviation),
        "frames_counted": int(limb.sure.sum()),
    }


def _margin(kind: str, names: Sequence[str], median: Array, share: Array) -> list[dict[str, Any]]:
    return [
        {kind: name, "median_px": _number(error), "rejected_share": _number(part)}
        for name, error, part in zip(names, median, share, strict=True)
    ]


def _median(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
