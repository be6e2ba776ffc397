"""The pictures of plot: pages (none: left out), a sentence on them, and numbers for ``--json``."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat import viz
from skelsplat._angles import JointAngles, known_angles
from skelsplat._arrays import Array, median, medians
from skelsplat.io import PoseData
from skelsplat.run.angles import angles_of_poses, by_title
from skelsplat.run.plots import Pairs, Source
from skelsplat.run.summary import error_maps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = tuple[list["Figure"], str, Any]

_UNSURE = ("weak", "inferred", "filled")  # joints of open depth, or not measured in their own frame
# How names of joints state a side: left_wrist, WristLeft, LWrist, EarLTip, wrist_l.
_SIDE = re.compile(r"(?i:left|right)|(?<![A-Z])[LR](?=[A-Z])|(?<=[_. ])[LRlr]$")
_SPREAD = "Median ± standard deviation over the frames (in brackets: relative to the median)."
_PALE = " Pale: an end is weak, inferred or filled; not counted, perhaps outside the panel."
_EQUAL = "The refinement kept {which} nearly equal on both sides (unless with symmetry_tier 0)."
_IN_TIME = "Solved over time, where bones keep their length: how they vary frame by frame is in report.html."
_KEPT_EQUAL = {1: "lower arms and legs", 2: "arms and legs", 3: "arms, legs and trunk"}  # by the tier
_ANGLE_BANDS = "Bands: error bars of 1 and 2 σ. All angles are 0 in upright standing{but}."
_NO_VERTICAL = "The vertical is not known: angles of trunk and pelvis are left out."
_NO_BARS = "; no error bands, the file has no error bars"
_COUNTED = "All detections used are counted, including the rejected ones. Grey: no detection used."


def trajectories(source: Source) -> Picture:
    """Draw the chosen joints over time."""
    poses, skeleton = source.poses, viz.Skeleton(source.limbs, source.left_right)
    variance = np.diagonal(poses.error_bar, axis1=-2, axis2=-1)
    sigma = np.sqrt(np.maximum(variance, 0.0)) if len(variance) else np.full(poses.pose.shape, np.nan)
    panels, numbers = [], []
    for joint in source.joints:
        name = poses.joint_names[joint]
        for axis in range(3):
            curve = viz.Curve(
                poses.pose[:, joint, axis],
                skeleton.side(joint),
                sigma=sigma[:, joint, axis],
                start=poses.init_pose[:, joint, axis] if len(poses.init_pose) else None,
                status=poses.joint_status[:, joint] if len(poses.joint_status) else None,
            )
            panels.append(viz.CurvePanel(f"{name.replace('_', ' ')}, {'xyz'[axis]}", "mm", [curve]))
        known = int(np.isfinite(poses.pose[:, joint]).all(axis=-1).sum())
        scatter = medians(sigma[:, joint].T).tolist()
        numbers.append({"joint": name, "frames_known": known, "sigma_median_mm": scatter})
    start_name = "frame by frame" if len(poses.velocity) else "start of the refinement"
    notes = poses.processing
    pages = viz.draw_curves(
        panels, _time(source), columns=3, title=source.title, notes=notes, start_name=start_name
    )
    bars = "" if np.isfinite(sigma).any() else _NO_BARS
    return pages, f"{len(numbers)} joint{'s' * (len(numbers) != 1)} over time{bars}.", numbers


def bones(source: Source) -> Picture:
    """Draw the lengths of all limbs over time."""
    if not source.limbs:
        return [], "the joints match no built-in layout, so the limbs are unknown (name the layout)", None
    poses = source.poses
    lengths = _limb_lengths(poses, source.limbs, source.left_right)
    limbs = [(name, bone) for name, bones in lengths for bone in bones]
    unsure = any(np.isfinite(bone.values).sum() > np.isfinite(bone.counted).sum() for _, bone in limbs)
    notes = [_SPREAD + _PALE if unsure else _SPREAD]
    notes += [_IN_TIME] if len(poses.velocity) else []
    notes += [_EQUAL.format(which=_KEPT_EQUAL[source.symmetry_tier])] if source.symmetry_tier else []
    numbers = []
    for name, bone in limbs:
        counted = int(np.isfinite(bone.counted).sum())
        lengths_mm = {"median_mm": bone.median, "sd_mm": bone.deviation, "frames_counted": counted}
        numbers.append({"limb": name, "side": bone.side or None, **lengths_mm})
    panels = [viz.bone_panel(name, bones) for name, bones in lengths]
    pages = viz.draw_curves(panels, _time(source), title=source.title, notes=[*notes, *poses.processing])
    return pages, f"lengths of {len(limbs)} limbs over time.", numbers


def errors(source: Source) -> Picture:
    """Draw the reprojection errors by camera and joint."""
    poses = source.poses
    if not (len(poses.reprojection_error) and len(poses.view_weights)):
        return [], "the file has no errors per camera; the folder of a run and its pose.npz have them", None
    median, share = error_maps(poses.reprojection_error, poses.view_weights)
    data = viz.ErrorMapData(median, share, poses.camera_names, poses.joint_names, source.title, (_COUNTED,))

    def margin(kind: str, names: Sequence[str], px: Array, part: Array) -> list[dict[str, Any]]:
        each = zip(names, px, part, strict=True)
        return [{kind: name, "median_px": error, "rejected_share": share} for name, error, share in each]

    numbers = {
        "median_px": median[-1, -1],
        "rejected_share": share[-1, -1],
        "cameras": margin("camera", poses.camera_names, median[:-1, -1], share[:-1, -1]),
        "joints": margin("joint", poses.joint_names, median[-1, :-1], share[-1, :-1]),
    }
    known = np.isfinite(median[-1, -1])
    words = f"median reprojection error {median[-1, -1]:.1f} px." if known else "no detection was used."
    return [viz.draw_error_map(data)], words, numbers


def angles(source: Source) -> Picture:
    """Draw the joint angles over time, all or those at the chosen joints."""
    poses, chosen = source.poses, {source.named[joint] for joint in source.joints}
    known = known_angles(source.named, source.angles, leaning=source.up is not None)
    if not known:
        return [], "the joints match no layout that has any (name the layout)", None
    names = [angle.name for angle in known if not source.chosen or angle.at & chosen]
    if not names:
        return [], f"no angle at {', '.join(sorted(chosen))}", None
    found = angles_of_poses(poses, source.up, source.named, source.angles)
    places = [found.names.index(name) for name in names]
    found = JointAngles(tuple(names), found.degrees[:, places], found.sigma[:, places])
    panels = []
    for title, sides in by_title(names).items():
        curves = [viz.Curve(found.degrees[:, k], side, sigma=found.sigma[:, k]) for side, k in sides]
        panels.append(viz.CurvePanel(title, "degrees", curves))
    with_bars = bool(np.isfinite(found.sigma).any())
    but = ", but for the layout's own" if source.angles else ""
    notes = [_ANGLE_BANDS.format(but=but)] if with_bars else []
    notes += [_NO_VERTICAL] if source.up is None else []
    numbers = []
    for name, degrees, sigma in zip(found.names, found.degrees.T, found.sigma.T, strict=True):
        count = int(np.isfinite(degrees).sum())
        medians_of = {"median_degrees": median(degrees), "sigma_median_degrees": median(sigma)}
        numbers.append({"angle": name, **medians_of, "frames_known": count})
    pages = viz.draw_curves(panels, _time(source), title=source.title, notes=[*notes, *poses.processing])
    return (
        pages,
        f"{len(numbers)} joint angle{'s' * (len(numbers) != 1)} over time{'' if with_bars else _NO_BARS}.",
        numbers,
    )


DRAW: dict[str, Callable[[Source], Picture]] = {
    "trajectories": trajectories,
    "bones": bones,
    "errors": errors,
    "angles": angles,
}


def _time(source: Source) -> viz.TimeAxis:
    return viz.TimeAxis(source.poses.frames, source.poses.frame_rate, source.zero)


def _limb_lengths(poses: PoseData, limbs: Pairs, left_right: Pairs) -> list[tuple[str, list[viz.Curve]]]:
    """Return the limbs in the order of the layout; a left one and its mirror image come together."""
    mirror = {a: b for left, right in left_right for a, b in ((left, right), (right, left))}
    left_joints = {left for left, _ in left_right}
    rest = {frozenset(limb): limb for limb in limbs}
    lengths = []
    for limb in limbs:
        if rest.pop(frozenset(limb), None) is None:
            continue
        twin = mirror.get(limb[0], limb[0]), mirror.get(limb[1], limb[1])
        if rest.pop(frozenset(twin), None) is None:
            lengths.append((_name_of(limb, poses.joint_names), [_bone(poses, limb, "")]))
            continue
        left, right = (limb, twin) if left_joints & set(limb) else (twin, limb)
        name = _name_of_both(left, right, poses.joint_names)
        lengths.append((name, [_bone(poses, left, "left"), _bone(poses, right, "right")]))
    return lengths


def _bone(poses: PoseData, limb: tuple[int, int], side: str) -> viz.Curve:
    a, b = limb
    lengths = np.linalg.norm(poses.pose[:, a] - poses.pose[:, b], axis=-1)
    sure = np.isfinite(lengths)
    if len(poses.joint_status):
        sure &= ~np.isin(poses.joint_status[:, limb], _UNSURE).any(axis=1)
    return viz.Curve(lengths, side, sure=sure)


def _name_of(limb: tuple[int, int], names: Sequence[str]) -> str:
    return " – ".join(names[joint].replace("_", " ") for joint in limb)


def _name_of_both(left: tuple[int, int], right: tuple[int, int], names: Sequence[str]) -> str:
    """Return the name of a limb without its side, or the names of both, if these differ in more than that."""
    plain = [" ".join(re.split(r"[\s_.-]+", _SIDE.sub(" ", name))).strip() for name in names]
    if _name_of(left, plain) == _name_of(right, plain) and all(plain[joint] for joint in left):
        return _name_of(left, plain)
    return f"{_name_of(left, names)} / {_name_of(right, names)}"
