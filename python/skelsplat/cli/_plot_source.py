"""What ``skelsplat plot`` draws from: the folder of a run, or a file of poses."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

import skelsplat as sk
from skelsplat.cli._checks import one_of
from skelsplat.exceptions import DatasetError
from skelsplat.io import PoseData, read_pose, read_run

if TYPE_CHECKING:
    from pathlib import Path

    from skelsplat.cli._frame_range import FrameRange

Pairs = tuple[tuple[int, int], ...]
_PER_FRAME = tuple(
    entry.name
    for entry in fields(PoseData)
    if entry.name not in ("joint_names", "unit", "camera_names", "frame_rate", "processing")
)


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
    zero
        The first frame number of the whole recording, where time begins.
    symmetry_tier
        Which limbs the run kept equal left and right (`RefineConfig.symmetry_tier`); 0 if it is not known.
    """

    path: Path
    poses: PoseData
    limbs: Pairs
    left_right: Pairs
    zero: int
    symmetry_tier: int = 0

    @property
    def title(self) -> str:
        """Name, frames and frame rate in words."""
        frames, rate = self.poses.frames, self.poses.frame_rate
        several = f"{len(frames)} frames, {frames[0]} to {frames[-1]}"
        span = f"frame {frames[0]}" if len(frames) == 1 else several
        return f"{self.path.resolve().name}: {span}" + ("" if rate is None else f", {rate:g} Hz")


def read_source(path: Path, layout_name: str | None, chosen: FrameRange) -> Source:
    """Read a run or a file of poses and keep the ``chosen`` frames.

    Raises
    ------
    DatasetError, InvalidInputError
        If it cannot be read, holds no frame, or its frame numbers do not ascend.
    typer.BadParameter
        If the layout does not fit the joints, or no frame lies in the range.
    """
    named = None if layout_name is None else _named(layout_name)
    tier = 0
    if path.is_file():
        poses = read_pose(path)
        layout = _known_layout(poses.joint_names) if named is None else named
    else:
        run = read_run(path)
        poses, layout = run.poses, run.layout if named is None else named
        tier = _symmetry_tier(run.report["settings"])
    if not len(poses.frames):
        raise DatasetError(path, "frames", "at least one", "none")
    if (np.diff(poses.frames) < 1).any():
        raise DatasetError(path, "frames", "ascending numbers", "some that are not")
    limbs, left_right = _connections(layout, poses.joint_names)
    zero = int(poses.frames[0])
    poses = _between(poses, *chosen.within(poses.frames)).in_unit("mm")
    return Source(path, poses, limbs, left_right, zero, tier)


def _symmetry_tier(settings: dict[str, Any]) -> int:
    tier = settings.get("symmetry_tier")
    return tier if isinstance(tier, int) else 0


def _named(name: str) -> sk.Layout:
    return sk.layouts.get(one_of("--layout", name.lower(), sk.layouts.names))


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
        raise typer.BadParameter(f"expected {expected}, got {got}", param_hint="--layout")
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
