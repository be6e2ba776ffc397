"""Poses in files: npz and json (everything), csv (tidy), trc and c3d (motion capture), nc (movement).

A format is a module of this package and a row in `POSE_FORMATS`, under its extension.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skelsplat._optional import require
from skelsplat.exceptions import InvalidInputError
from skelsplat.io.poses._c3d import c3d_is_y_up, check_c3d_frames, read_c3d, write_c3d
from skelsplat.io.poses._csv import read_csv, write_csv
from skelsplat.io.poses._json import is_json_poses, read_json, to_json, write_json
from skelsplat.io.poses._markers import MARKER_NAMES
from skelsplat.io.poses._npz import read_npz, write_npz
from skelsplat.io.poses._pose_data import PoseData
from skelsplat.io.poses._trc import read_trc, write_trc
from skelsplat.io.poses._xarray import read_netcdf, to_xarray, write_netcdf

__all__ = [
    "MARKER_NAMES",
    "POSE_FORMATS",
    "PoseData",
    "c3d_is_y_up",
    "check_pose_format",
    "is_json_poses",
    "pose_format",
    "read_c3d",
    "read_csv",
    "read_json",
    "read_netcdf",
    "read_npz",
    "read_pose",
    "read_trc",
    "to_json",
    "to_xarray",
    "write_c3d",
    "write_csv",
    "write_json",
    "write_netcdf",
    "write_npz",
    "write_pose",
    "write_trc",
]


@dataclass(frozen=True)
class PoseFormat:
    """A kind of pose file.

    Attributes
    ----------
    read, write : callable
        path → `PoseData`; (path, `PoseData`, options) → None.
    options : tuple of str
        What ``write`` understands of the keywords of `write_pose`.
    packages : tuple of str
        Modules of the extra ``formats`` that it needs.
    """

    read: Callable[[str | os.PathLike[str]], PoseData]
    write: Callable[..., None]
    options: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()


POSE_FORMATS: dict[str, PoseFormat] = {
    "npz": PoseFormat(read_npz, write_npz),
    "csv": PoseFormat(read_csv, write_csv),
    "trc": PoseFormat(read_trc, write_trc, ("frame_rate", "unit", "y_up", "marker_names")),
    "c3d": PoseFormat(read_c3d, write_c3d, ("frame_rate", "y_up", "marker_names"), ("ezc3d",)),
    "json": PoseFormat(read_json, write_json),
    "nc": PoseFormat(
        read_netcdf, write_netcdf, ("frame_rate", "individual", "singular"), ("xarray", "h5netcdf", "h5py")
    ),
}


def pose_format(path: str | os.PathLike[str]) -> str:
    """Return the key of `POSE_FORMATS` that the extension of ``path`` names, or raise `InvalidInputError`."""
    suffix = Path(path).suffix.lower().removeprefix(".")
    if suffix not in POSE_FORMATS:
        known = ", ".join(f".{name}" for name in POSE_FORMATS)
        raise InvalidInputError(f"path: expected a name that ends in {known}, got {Path(path).name!r}")
    return suffix


def check_pose_format(kind: str, frames: npt.NDArray[np.int64] | None = None) -> None:
    """Raise before long work if a file of this kind cannot be written.

    It may need a package that is not installed, or the frame numbers do not fit into such a file.
    """
    for module in POSE_FORMATS[kind].packages:
        require(module, f".{kind} files")
    if kind == "c3d" and frames is not None:
        check_c3d_frames(frames)


def write_pose(path: str | os.PathLike[str], data: PoseData, **options: object) -> None:
    """Write poses in the format that the extension of ``path`` names.

    Parameters
    ----------
    path : path
        Ends in ``.npz``, ``.csv``, ``.trc``, ``.c3d``, ``.json`` or ``.nc``.
    data : PoseData
    **options
        ``frame_rate`` (trc, c3d, nc: instead of that of ``data``), ``y_up`` (trc, c3d: write z up as y up),
        ``marker_names`` (trc, c3d: ``"pose2sim"`` for ``RHip`` instead of ``right_hip``),
        ``unit`` (trc: ``"m"``, the default, or ``"mm"``), ``individual`` and ``singular`` (nc); see the
        writer of each format. None stands for the default.

    Raises
    ------
    InvalidInputError
        If the extension is unknown, an option is not one of the format's, or the data lack what it needs.
    MissingPackageError
        If the format needs a package that is not installed.
    DatasetError
        If the path cannot be written.
    """
    kind = pose_format(path)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in POSE_FORMATS[kind].options:
            having = [f".{other}" for other, entry in POSE_FORMATS.items() if name in entry.options]
            expected = f"a {' or '.join(having)} file for it" if having else "no such option"
            raise InvalidInputError(f"{name}: expected {expected}, got .{kind}")
    POSE_FORMATS[kind].write(path, data, **given)


def read_pose(path: str | os.PathLike[str]) -> PoseData:
    """Read poses from a file in the format that its extension names: npz, csv, trc, c3d, json or nc.

    Raises
    ------
    InvalidInputError
        If the extension is unknown.
    MissingPackageError
        If the format needs a package that is not installed.
    DatasetError
        If the file cannot be read or does not follow its format.
    """
    return POSE_FORMATS[pose_format(path)].read(path)
