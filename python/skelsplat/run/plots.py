"""Figures of a run, or of a file of poses, in print size: trajectories, bone lengths, errors.

>>> from skelsplat.run.plots import read_source, write_plots
>>> write_plots(read_source("out"), "figures", formats=("pdf",))  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io import PoseData, read_pose, read_run
from skelsplat.run.folder import output_folder
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.plot_numbers import LimbLength, error_maps, limb_lengths

if TYPE_CHECKING:
    from skelsplat.viz import Skeleton, TimeAxis

PICTURES = ("trajectories", "bones", "errors")
Pairs = tuple[tuple[int, int], ...]
_PER_FRAME = tuple(
    entry.name
    for entry in fields(PoseData)
    if entry.name not in ("joint_names", "unit", "camera_names", "frame_rate", "processing")
)
# Without a choice of joints: the ends of the limbs, where errors show first, or else so many of the first.
_DISTAL, _FEW = ("wrist", "ankle"), 4
_SPREAD = "Median ± standard deviation over the frames (in brackets: relative to the median). Dashed: median."
_PALE = "Pale: frames in which an end is weak or filled; they are not counted, and may lie outside the panel."
_EQUAL = (
    "The refinement kept {which} nearly equal on the left and right, so their difference means nothing; "
    "to study it, refine with --symmetry-tier 0."
)
_KEPT_EQUAL = {1: "lower arms and legs", 2: "arms and legs", 3: "arms, legs and trunk"}  # by the tier
_COUNTED = "All detections used are counted, including the rejected ones. Grey: no detection used."


@dataclass(frozen=True)
class Source:
    """Poses and how their joints are connected.

    Parameters
    ----------
    path
        Where they come from.
    poses
        In mm, the chosen frames alone.
    limbs, left_right
        Pairs of joint indices; no limbs where no layout is known.
    joints
        Those whose trajectories are drawn.
    zero
        The first frame number of the whole recording, where time begins.
    symmetry_tier
        Which limbs the run kept equal left and right (`RefineConfig.symmetry_tier`); 0 if it is not known.
    """

    path: Path
    poses: PoseData
    limbs: Pairs
    left_right: Pairs
    joints: tuple[int, ...]
    zero: int
    symmetry_tier: int = 0

    @property
    def title(self) -> str:
        """Name, frames and frame rate in words."""
        frames, rate = self.poses.frames, self.poses.frame_rate
        several = f"{len(frames)} frames, {frames[0]} to {frames[-1]}"
        span = f"frame {frames[0]}" if len(frames) == 1 else several
        return f"{self.path.resolve().name}: {span}" + ("" if rate is None else f", {rate:g} Hz")


def read_source(
    path: str | PathLike[str],
    *,
    layout: str | None = None,
    range: FrameRange | None = None,
    joints: str | None = None,
) -> Source:
    """Read the folder of a run, or a file of poses.

    Parameters
    ----------
    path : str or Path
    layout : str, optional
        Name of the joint layout, for limbs and sides; by default that of the run, or the built-in layout with
        exactly the joints of the file.
    range : FrameRange, optional
        The frames to keep; all by default.
    joints : str, optional
        Joints whose trajectories are drawn, with commas, or ``"all"``; wrists and ankles by default, or the
        first four joints.

    Raises
    ------
    DatasetError, InvalidInputError
        If it cannot be read, holds no frame, its frame numbers do not ascend, the layout does not fit the
        joints, no frame lies in the range or a name is no joint.
    """
    path, chosen = Path(path), range or FrameRange()
    named = None if layout is None else sk.layouts.get(layout.lower())
    tier = 0
    if path.is_file():
        poses = read_pose(path)
        known = _known_layout(poses.joint_names) if named is None else named
    else:
        run = read_run(path)
        poses, known = run.poses, run.layout if named is None else named
        tier = _symmetry_tier(run.report["settings"])
    if not len(poses.frames):
        raise DatasetError(path, "frames", "at least one", "none")
    if (np.diff(poses.frames) < 1).any():
        raise DatasetError(path, "frames", "ascending numbers", "some that are not")
    limbs, left_right = _connections(known, poses.joint_names)
    zero = int(poses.frames[0])
    poses = _between(poses, *chosen.within(poses.frames)).in_unit("mm")
    return Source(path, poses, limbs, left_right, _chosen_joints(joints, poses.joint_names), zero, tier)


def _symmetry_tier(settings: dict[str, Any]) -> int:
    tier = settings.get("symmetry_tier")
    return tier if isinstance(tier, int) else 0


def _known_layout(joints: tuple[str, ...]) -> sk.Layout | None:
    """Return the built-in layout with exactly these joints in this order."""
    return next((layout for layout in map(sk.layouts.get, sk.layouts.names) if layout.joints == joints), None)


def _connections(layout: sk.Layout | None, joints: tuple[str, ...]) -> tuple[Pairs, Pairs]:
    """Return limbs and mirror images as places among ``joints``; without a layout, names tell the sides."""
    place = {name: k for k, name in enumerate(joints)}
    if layout is None:
        mirrored = ((name, name.replace("left", "right", 1)) for name in joints if name.startswith("left"))
        return (), tuple((place[left], place[right]) for left, right in mirrored if right in place)
    if set(layout.joints) <= set(joints):
        places = [place[name] for name in layout.joints]
    elif layout.n_joints == len(joints):
        places = list(range(len(joints)))
    else:
        expected = f"a layout of the {len(joints)} joints in the file ({', '.join(joints[:4])}, …)"
        got = f"{layout.name} with {layout.n_joints}"
        raise InvalidInputError(f"layout: expected {expected}, got {got}")
    limbs, mirrored_pairs = (
        tuple((places[a], places[b]) for a, b in pairs) for pairs in (layout.limbs, layout.left_right)
    )
    return limbs, mirrored_pairs


def _between(poses: PoseData, first: int, last: int) -> PoseData:
    frames = poses.frames
    keep = (frames >= first) & (frames <= last)
    arrays = {name: getattr(poses, name) for name in _PER_FRAME}
    return replace(
        poses, **{name: array[keep] for name, array in arrays.items() if len(array) == len(frames)}
    )


def _chosen_joints(text: str | None, names: Sequence[str]) -> tuple[int, ...]:
    """Return the places of the joints in a list with commas, or of those drawn by default."""
    if text is None:
        distal = [k for part in _DISTAL for k, name in enumerate(names) if part in name.lower()]
        return tuple(distal or np.arange(len(names))[:_FEW].tolist())
    if text.strip() == "all":
        return tuple(np.arange(len(names)).tolist())
    wanted = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in wanted:
        if name not in names:
            raise InvalidInputError(f"joints: expected all or some of {', '.join(names)}, got {name!r}")
    return tuple(list(names).index(name) for name in wanted)


@dataclass(frozen=True)
class Drawn:
    """One picture: its files, a sentence on what it shows, and its numbers for ``--json``.

    Without files, ``sentence`` says why it was left out.
    """

    name: str
    files: list[Path] = field(default_factory=list)
    sentence: str = ""
    numbers: Any = None


def write_plots(
    source: Source,
    folder: str | PathLike[str],
    *,
    only: Sequence[str] = PICTURES,
    formats: Sequence[str] = ("png",),
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Drawn]:
    """Draw figures of ``source`` into ``folder``.

    Parameters
    ----------
    source : Source
    folder : str or Path
        It is made if it is missing.
    only : sequence of str
        Some of "trajectories", "bones", "errors".
    formats : sequence of str
        "png", "pdf" or both.
    progress : callable, optional
        Called with a word, the number of figures that are done, and of all.

    Returns
    -------
    list of Drawn
        One for each of ``only``; those that there is nothing to draw for say why.

    Raises
    ------
    DatasetError
        If there is nothing to draw for any, or a file cannot be written.
    MissingPackageError
        If matplotlib is not installed.
    """
    require("matplotlib", "figures", "viz")
    with output_folder(Path(folder)):
        drawn: list[Drawn] = []
        for name in only:
            drawn.append(_DRAW[name](source, Path(folder) / name, formats))
            if progress is not None:
                progress("drawing", len(drawn), len(only))
        if not any(picture.files for picture in drawn):
            reasons = "; ".join(f"{picture.name}: {picture.sentence}" for picture in drawn)
            raise DatasetError(source.path, "figures", "something to draw", f"none ({reasons})")
    return drawn


def _draw_trajectories(source: Source, stem: Path, formats: Sequence[str]) -> Drawn:
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
        joints=source.joints,
        title=source.title,
        notes=poses.processing,
    )
    files = viz.write_trajectories(stem, data, skeleton=_skeleton(source), formats=formats)
    known = np.asarray(np.isfinite(poses.pose).all(axis=-1))
    numbers = [
        {
            "joint": poses.joint_names[joint],
            "frames_known": int(known[:, joint].sum()),
            "sigma_median_mm": [_median(sigma[:, joint, axis]) for axis in range(3)],
        }
        for joint in source.joints
    ]
    words = f"{len(source.joints)} {'joint' if len(source.joints) == 1 else 'joints'}"
    bars = "" if np.isfinite(sigma).any() else "; no error bands, the file has no error bars"
    return Drawn("trajectories", files, f"{words} over time{bars}.", numbers)


def _draw_bones(source: Source, stem: Path, formats: Sequence[str]) -> Drawn:
    """Draw the lengths of all limbs over time."""
    from skelsplat import viz  # as in _draw_trajectories

    if not source.limbs:
        why = "the joints match no built-in layout, so the limbs are unknown (--layout names the layout)"
        return Drawn("bones", sentence=why)
    groups = limb_lengths(source.poses, source.limbs, source.left_right)
    panels = [viz.BonePanel(group[0].name, [_bone(limb) for limb in group]) for group in groups]
    limbs = [limb for group in groups for limb in group]
    unsure = any((np.isfinite(limb.lengths) & ~limb.sure).any() for limb in limbs)
    which = _KEPT_EQUAL.get(source.symmetry_tier)
    equal = [] if which is None else [_EQUAL.format(which=which)]
    notes = (f"{_SPREAD} {_PALE}" if unsure else _SPREAD, *equal, *source.poses.processing)
    data = viz.BoneData(panels, _time(source), source.title, notes)
    files = viz.write_bones(stem, data, formats=formats)
    return Drawn("bones", files, _about_bones(limbs), [_limb_numbers(limb) for limb in limbs])


def _draw_errors(source: Source, stem: Path, formats: Sequence[str]) -> Drawn:
    """Draw the reprojection errors by camera and joint."""
    from skelsplat import viz  # as in _draw_trajectories

    poses = source.poses
    if not (len(poses.reprojection_error) and len(poses.view_weights)):
        why = "the file has no errors per camera; the folder of a run and its pose.npz have them"
        return Drawn("errors", sentence=why)
    median, share = error_maps(poses, sk.REJECTED_WEIGHT)
    data = viz.ErrorMapData(median, share, poses.camera_names, poses.joint_names, source.title, (_COUNTED,))
    files = viz.write_error_map(stem, data, formats=formats)
    numbers = {
        "median_px": _number(median[-1, -1]),
        "rejected_share": _number(share[-1, -1]),
        "cameras": _margin("camera", poses.camera_names, median[:-1, -1], share[:-1, -1]),
        "joints": _margin("joint", poses.joint_names, median[-1, :-1], share[-1, :-1]),
    }
    return Drawn("errors", files, _about_errors(source, median, share), numbers)


_DRAW = {"trajectories": _draw_trajectories, "bones": _draw_bones, "errors": _draw_errors}


def _time(source: Source) -> TimeAxis:
    from skelsplat import viz  # as in _draw_trajectories

    return viz.TimeAxis(source.poses.frames, source.poses.frame_rate, source.zero)


def _skeleton(source: Source) -> Skeleton:
    from skelsplat import viz  # as in _draw_trajectories

    return viz.Skeleton(limbs=source.limbs, left_right=source.left_right)


def _bone(limb: LimbLength) -> Any:
    from skelsplat import viz  # as in _draw_trajectories

    return viz.Bone(limb.side, limb.lengths, limb.sure, limb.median, limb.deviation)


def _about_bones(limbs: Sequence[LimbLength]) -> str:
    shares = {
        f"{limb.side} {limb.name}".strip(): 100 * limb.deviation / limb.median
        for limb in limbs
        if limb.median > 0 and np.isfinite(limb.deviation)
    }
    if not shares:
        return "no limb has a reliable length in at least two frames."
    worst = max(shares, key=lambda name: shares[name])
    return (
        f"standard deviation of the limbs' lengths {min(shares.values()):.1f} to {shares[worst]:.1f} %, "
        f"median {np.median(list(shares.values())):.1f} %; largest: {worst}."
    )


def _about_errors(source: Source, median: Array, share: Array) -> str:
    if not np.isfinite(median[-1, -1]):
        return "no detection was used."
    camera = int(np.nanargmax(median[:-1, -1]))
    joint = int(np.nanargmax(median[-1, :-1]))
    rejected = "" if not np.isfinite(share[-1, -1]) else f", {100 * share[-1, -1]:.0f} % rejected"
    return (
        f"median {median[-1, -1]:.1f} px{rejected}; largest: {source.poses.camera_names[camera]} "
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
