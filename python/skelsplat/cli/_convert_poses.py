"""Pose files into other formats, for ``skelsplat convert``."""

from __future__ import annotations

import warnings
import zipfile
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skelsplat.cli._conversion import Kind, Request, Written
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._run_files import POSES as POSES_OF_RUN
from skelsplat.io.poses import POSE_FORMATS, c3d_is_y_up, is_json_poses, pose_format, read_pose, write_pose

if TYPE_CHECKING:
    from pathlib import Path

_CSV_START = "frame,joint,"
_HEAD_BYTES = 4096
_OWN_UNIT = ("trc", "c3d")  # these formats do not take any unit
POSE_SUFFIXES = tuple(f".{kind}" for kind in POSE_FORMATS)


@dataclass(frozen=True)
class PoseOptions:
    """What the user says about the target.

    Parameters
    ----------
    fps
        Frames per second; None: as the source states it.
    to_unit
        Length unit to write: mm, cm or m; None: m in TRC, mm in C3D, else that of the source.
    y_up
        Write a world with z up as y up (TRC, C3D).
    marker_names
        What joints are called (TRC, C3D); None: as in the source.
    singular
        Name the dimensions of a NetCDF file as movement does from version 0.17 on.
    """

    fps: float | None = None
    to_unit: str | None = None
    y_up: bool = False
    marker_names: str | None = None
    singular: bool = False


def is_pose_file(path: Path) -> bool:
    """Tell from the name, and for json, csv and npz from the content, whether ``path`` holds poses."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in POSE_FORMATS or not path.is_file():
        return False
    if kind == "npz":
        return {"pose.npy", "joint_names.npy", "unit.npy"} <= set(_members(path))
    if kind in ("json", "csv"):
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES).decode("utf-8-sig", errors="replace")
        return is_json_poses(head) if kind == "json" else head.startswith(_CSV_START)
    return True


def _members(path: Path) -> list[str]:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return []


def convert_poses(source: Path, target: Path, options: PoseOptions) -> Written:
    """Read the poses in ``source``, write them to ``target``, and say what was written.

    The extensions name the formats. A format keeps what it can hold: npz and json everything; csv positions,
    standard deviations and status; trc and c3d positions; nc positions, uncertainty and status.

    Raises
    ------
    InvalidInputError
        If an extension is unknown, an option is not one of the target's format, or the frame rate is missing.
    MissingPackageError
        If a format needs a package that is not installed.
    DatasetError
        If a file cannot be read or written, or both are the same.
    """
    kind = pose_format(target)
    if target.resolve() == source.resolve():
        raise DatasetError(target, "target", "another file than the source", "the same")
    if options.fps is not None and kind == "csv":
        raise InvalidInputError("fps: expected a file with a place for it, got .csv")
    data = read_pose(source)
    data = data if options.fps is None else replace(data, frame_rate=options.fps)
    given: dict[str, object] = {
        "y_up": options.y_up or None,
        "marker_names": options.marker_names,
        "singular": options.singular or None,
    }
    if kind in _OWN_UNIT:
        given["unit"] = options.to_unit
    elif options.to_unit is not None:
        data = data.in_unit(options.to_unit)
    if options.y_up:
        _warn_if_turned(source)
    try:
        write_pose(target, data, **given)
    except InvalidInputError as error:
        if data.frame_rate is None and str(error).startswith("frame_rate"):
            expected = f"one for a .{kind} file (--fps)"
            raise DatasetError(source, "frame rate", expected, "none in the file") from error
        raise
    frames, joints = data.pose.shape[:2]
    about = {"format": pose_format(source), "frames": frames, "joints": list(data.joint_names)}
    about |= {"frame_rate_hz": data.frame_rate}
    return Written(f"Wrote {frames} frames of {joints} joints to {target}.", about)


def _warn_if_turned(source: Path) -> None:
    """Warn if the axes of a motion-capture file may have been turned before, or were."""
    kind = pose_format(source)
    if kind == "trc":
        text = "a TRC file does not say which axis is up; --y-up turns it once more if y is already"
    elif kind == "c3d" and c3d_is_y_up(source):
        text = "y is up in it already (POINT:Y_SCREEN); --y-up turns its axes once more"
    else:
        return
    warnings.warn(f"{source}: {text}", UserWarning, stacklevel=2)


def _is_run(path: Path) -> bool:
    return is_pose_file(path / POSES_OF_RUN)


def _convert(request: Request) -> Written:
    source = request.source / POSES_OF_RUN if _is_run(request.source) else request.source
    return convert_poses(source, request.target, PoseOptions(**request.options))


POSES = Kind(
    "pose file",
    lambda path: is_pose_file(path) or _is_run(path),
    _convert,
    POSE_SUFFIXES,
    frozenset({"fps", "to_unit", "y_up", "marker_names", "singular"}),
)
