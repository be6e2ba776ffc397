"""Figures of a run, or of a file of poses, in print size: trajectories, bone lengths, errors, angles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._angles import Angle, own_angles
from skelsplat._arrays import Array
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io import PoseData, read_layout, read_pose, read_run
from skelsplat.io.poses._markers import MARKER_NAMES, marker_names
from skelsplat.io.poses._pose_data import ARRAYS
from skelsplat.run.angles import vertical_of
from skelsplat.run.folder import output_folder
from skelsplat.run.frame_range import FrameRange

PICTURES = {  # what each shows
    "trajectories": "positions with bands of ±1 and ±2 standard deviations",
    "bones": "lengths of the limbs, left next to right",
    "errors": "median reprojection error and share of rejected detections, camera by joint",
    "angles": "joint angles with the same bands",
}
USUAL = ("trajectories", "bones", "errors")  # unless told otherwise
Pairs = tuple[tuple[int, int], ...]
_DISTAL, _FEW = ("wrist", "ankle"), 4  # without a choice: where errors show first, or so many of the first


@dataclass(frozen=True)
class Source:
    """Poses and how their joints are connected."""

    path: Path  # where they come from
    poses: PoseData  # in mm, the chosen frames alone
    limbs: Pairs  # joint indices; none where no layout is known
    left_right: Pairs
    joints: tuple[int, ...]  # those whose trajectories are drawn
    zero: int  # the first frame number of the whole recording, where time begins
    symmetry_tier: int | None  # which limbs the run kept equal left and right; None if it is not known
    named: tuple[str, ...]  # what the layout calls the joints
    up: Array | None  # the axis of the world that is vertical (3,); None if it is not known
    angles: tuple[Angle, ...]  # the layout's own
    chosen: bool  # joints were chosen: of angles, those at these joints are drawn

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
    layout: str | PathLike[str] | sk.Layout | None = None,
    range: FrameRange | None = None,
    joints: str | None = None,
) -> Source:
    """Read the folder of a run, or a file of poses, in a range of frames.

    The layout is by default that of the run, or the built-in one with the joints of the file; ``joints`` are
    names with commas or ``"all"``, by default wrists and ankles, or the first four. A `DatasetError` or an
    `InvalidInputError` if it cannot be read, or layout, range or joints do not fit.
    """
    path, chosen = Path(path), range or FrameRange()
    known = None if layout is None else read_layout(layout)
    tier, up = None, None
    if path.is_file():
        poses = read_pose(path)
        known = known or _known_layout(poses.joint_names)
    else:
        run = read_run(path, within=chosen.to_read)
        poses, known = run.poses, known or run.layout
        tier, up = run.report["settings"].get("symmetry_tier"), vertical_of(run.rig)
    frames, names = poses.frames, poses.joint_names
    if not len(frames):
        raise DatasetError(path, "frames", "at least one", "none")
    if (np.diff(frames) < 1).any():
        raise DatasetError(path, "frames", "ascending numbers", "some that are not")
    first, last = chosen.within(frames)
    keep = (frames >= first) & (frames <= last)
    held = {name: getattr(poses, name) for name in (*ARRAYS, "frames")}
    arrays: dict[str, Any] = {name: array[keep] for name, array in held.items() if len(array)}
    limbs, left_right = _connections(known, names)
    zero = int(frames[0]) if path.is_file() else run.ends[0]
    called = names if known is None or set(known.joints) <= set(names) else tuple(known.joints)
    called += names[len(called) :]  # of markers that are no joints
    poses = replace(poses, **arrays).in_unit("mm")
    own = () if known is None else own_angles(known)
    drawn = _chosen_joints(joints, names)
    some = joints is not None and len(drawn) < len(names)
    return Source(path, poses, limbs, left_right, drawn, zero, tier, called, up, own, some)


def _known_layout(joints: tuple[str, ...]) -> sk.Layout | None:
    """Return the built-in layout with exactly these joints in this order, in any style of `MARKER_NAMES`."""
    layouts = map(sk.layouts.get, sk.layouts.names)
    return next((layout for layout in layouts if joints in _in_styles(layout)), None)


def _in_styles(layout: sk.Layout) -> list[tuple[str, ...]]:
    return [marker_names(tuple(layout.joints), style) for style in MARKER_NAMES]


def _connections(layout: sk.Layout | None, joints: tuple[str, ...]) -> tuple[Pairs, Pairs]:
    """Return limbs and mirror images as places among ``joints``; without a layout, names tell the sides."""
    if layout is None:
        return (), sk.layouts.mirrored_names(joints)
    named = next((names for names in _in_styles(layout) if set(names) <= set(joints)), None)
    if named is None and layout.n_joints != len(joints):
        expected = f"a layout of the {len(joints)} joints in the file ({', '.join(joints[:4])}, …)"
        raise InvalidInputError(f"layout: expected {expected}, got {layout.name} with {layout.n_joints}")
    place = [joints.index(name) for name in named or joints]
    limbs, mirrored = (
        tuple((place[a], place[b]) for a, b in pairs) for pairs in (layout.limbs, layout.left_right)
    )
    return limbs, mirrored


def _chosen_joints(text: str | None, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return the places of the joints in a list with commas, or of those drawn by default."""
    every = tuple(range(len(names)))
    if text is None:
        distal = [k for part in _DISTAL for k in every if part in names[k].lower()]
        return tuple(distal) or every[:_FEW]
    if text.strip() == "all":
        return every
    wanted = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in (one for one in wanted if one not in names):
        raise InvalidInputError(f"joints: expected all or some of {', '.join(names)}, got {name!r}")
    return tuple(names.index(name) for name in wanted)


@dataclass(frozen=True)
class Drawn:
    """One picture: files, a sentence on it or on why it is left out, and numbers for ``--json``."""

    name: str
    files: list[Path]
    sentence: str
    numbers: Any


def write_plots(
    source: Source,
    folder: str | PathLike[str],
    *,
    only: Sequence[str] = USUAL,
    formats: Sequence[str] = ("png",),
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Drawn]:
    """Draw figures of ``source``, some of `PICTURES`, into ``folder``, as "png", "pdf" or both.

    ``progress`` is called with a word, the figures that are done, and all. A `DatasetError` if there is
    nothing to draw, or a file cannot be written; a `MissingPackageError` if matplotlib is not installed.
    """
    require("matplotlib", "figures", "viz")
    from skelsplat.run.plot_pictures import DRAW  # matplotlib takes long to load, and --help does without
    from skelsplat.viz import write_pages

    with output_folder(Path(folder)):
        drawn: list[Drawn] = []
        for name in only:
            pages, sentence, numbers = DRAW[name](source)
            files = write_pages(pages, Path(folder) / name, formats) if pages else []
            drawn.append(Drawn(name, files, sentence, numbers))
            if progress is not None:
                progress("drawing", len(drawn), len(only))
        if not any(picture.files for picture in drawn):
            reasons = "; ".join(f"{picture.name}: {picture.sentence}" for picture in drawn)
            raise DatasetError(source.path, "figures", "something to draw", f"none ({reasons})")
    return drawn
