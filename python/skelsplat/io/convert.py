"""Pose files into other formats."""

from __future__ import annotations

import warnings
from dataclasses import replace
from os import PathLike
from pathlib import Path

from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import npz_keys
from skelsplat.io._files import head
from skelsplat.io.poses import (
    POSE_FORMATS,
    PoseData,
    c3d_is_y_up,
    is_json_poses,
    pose_format,
    read_pose,
    write_pose,
)

_CSV_START = "frame,joint,"
_OWN_UNIT = ("trc", "c3d")  # these formats do not take any unit


def convert_poses(
    source: str | PathLike[str],
    target: str | PathLike[str],
    *,
    fps: float | None = None,
    unit: str | None = None,
    y_up: bool = False,
    marker_names: str | None = None,
    singular: bool = False,
) -> PoseData:
    """Read the poses in ``source``, write them to ``target``, and return them.

    The extensions name the formats. A format keeps what it can hold: npz and json everything; csv positions,
    standard deviations and status; trc and c3d positions; nc positions, uncertainty and status.

    Parameters
    ----------
    source, target : str or Path
    fps : float, optional
        Frames per second; by default as the source states it.
    unit : str, optional
        Length unit to write: mm, cm or m; by default m in TRC, mm in C3D, else that of the source.
    y_up : bool
        Write a world with z up as y up (TRC, C3D).
    marker_names : str, optional
        Style of the joints' names (TRC, C3D), of `skelsplat.io.poses.MARKER_NAMES`; by default as in the
        source.
    singular : bool
        Name the dimensions of a NetCDF file as movement does from version 0.17 on.

    Raises
    ------
    InvalidInputError
        If an extension is unknown, an option is not one of the target's format, or the frame rate is missing.
    MissingPackageError
        If a format needs a package that is not installed.
    DatasetError
        If a file cannot be read or written, or both are the same.
    """
    source, target = Path(source), Path(target)
    kind = pose_format(target)
    if target.resolve() == source.resolve():
        raise DatasetError(target, "target", "another file than the source", "the same")
    if fps is not None and kind == "csv":
        raise InvalidInputError("fps: expected a file with a place for it, got .csv")
    data = read_pose(source)
    data = data if fps is None else replace(data, frame_rate=fps)
    given: dict[str, object] = {
        "y_up": y_up or None,
        "marker_names": marker_names,
        "singular": singular or None,
    }
    if kind in _OWN_UNIT:
        given["unit"] = unit
    elif unit is not None:
        data = data.in_unit(unit)
    if y_up:
        _warn_if_turned(source)
    try:
        write_pose(target, data, **given)
    except InvalidInputError as error:
        if data.frame_rate is None and str(error).startswith("frame_rate"):
            expected = f"one for a .{kind} file (--fps)"
            raise DatasetError(source, "frame rate", expected, "none in the file") from error
        raise
    return data


def is_pose_file(path: Path) -> bool:
    """Tell from the name, and for json, csv and npz from the content, whether ``path`` holds poses."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in POSE_FORMATS or not path.is_file():
        return False
    if kind == "npz":
        return {"pose", "joint_names", "unit"} <= npz_keys(path)
    if kind == "json":
        return is_json_poses(head(path))
    return kind != "csv" or head(path).startswith(_CSV_START)


def _warn_if_turned(source: Path) -> None:
    """Warn if the axes of a motion-capture file may have been turned before, or were."""
    kind = pose_format(source)
    if kind == "trc":
        text = "a TRC file does not state which axis is up; --y-up turns it once more if y is already"
    elif kind == "c3d" and c3d_is_y_up(source):
        text = "y is up in it already (POINT:Y_SCREEN); --y-up turns its axes once more"
    else:
        return
    warnings.warn(f"{source}: {text}", UserWarning, stacklevel=3)
