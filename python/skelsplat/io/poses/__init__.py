"""Poses in files: npz and json (everything), csv (tidy), trc and c3d (motion capture), nc (movement).

And what is only written: skeletons with joint rotations (bvh, glb), and for scripts of other programs
Anipose's csv and FreeMoCap's npy. A format is a module and a row in `POSE_FORMATS`, under its extension; any
that is read is converted into any other.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Index
from skelsplat._atomic import atomic_path, atomic_write_text, make_room
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, FindingWarning, Subject
from skelsplat.io._arrays import npz_keys
from skelsplat.io._files import head
from skelsplat.io.poses._animation import check_animation, upward
from skelsplat.io.poses._bvh import write_bvh
from skelsplat.io.poses._c3d import c3d_is_y_up, check_c3d, read_c3d, write_c3d
from skelsplat.io.poses._csv import COLUMNS, csv_text, read_csv, rows_of, write_csv
from skelsplat.io.poses._glb import write_glb
from skelsplat.io.poses._json import is_json_poses, people_text, read_json, write_json
from skelsplat.io.poses._npz import read_npz, write_npz
from skelsplat.io.poses._opensim import OPENSIM_FILES as OPENSIM_FILES
from skelsplat.io.poses._opensim import check_opensim as check_opensim
from skelsplat.io.poses._opensim import write_opensim as write_opensim
from skelsplat.io.poses._others import write_anipose, write_freemocap
from skelsplat.io.poses._pose_data import ARRAYS, PoseData, Poses
from skelsplat.io.poses._trc import check_trc_names, read_trc, write_trc
from skelsplat.io.poses._xarray import check_packages, read_netcdf, room_for, to_xarray, write_netcdf


@dataclass(frozen=True)
class PoseFormat:
    """A kind of pose file: how it is read from a path, if it is, and written to one with options."""

    read: Callable[[str | os.PathLike[str]], PoseData] | None
    write: Callable[..., None]
    options: tuple[str, ...] = ()  # what `write` understands of the keywords of `write_pose`
    packages: tuple[str, ...] = ()  # modules of the extra "formats" that it needs


POSE_FORMATS: dict[str, PoseFormat] = {
    "npz": PoseFormat(read_npz, write_npz, ("run",)),
    "csv": PoseFormat(read_csv, write_csv),
    "trc": PoseFormat(read_trc, write_trc, ("frame_rate", "unit", "y_up", "marker_names")),
    "c3d": PoseFormat(read_c3d, write_c3d, ("frame_rate", "y_up", "marker_names"), ("ezc3d",)),
    "json": PoseFormat(read_json, write_json),
    "nc": PoseFormat(read_netcdf, write_netcdf, ("frame_rate", "singular"), ("xarray", "h5netcdf", "h5py")),
    "bvh": PoseFormat(None, write_bvh, ("frame_rate", "unit", "up", "limbs")),
    "glb": PoseFormat(None, write_glb, ("frame_rate", "up", "limbs"), ("pygltflib", "scipy")),
    "anipose.csv": PoseFormat(None, write_anipose),
    "npy": PoseFormat(None, write_freemocap),
}
READ = tuple(kind for kind, entry in POSE_FORMATS.items() if entry.read is not None)
_OWN_UNIT = ("trc", "c3d", "bvh", "glb", "npy")  # these formats do not take any unit


def pose_format(path: str | os.PathLike[str]) -> str:
    """Return the key of `POSE_FORMATS` that the extension of ``path`` names, or raise `InvalidInputError`."""
    fitting = [kind for kind in POSE_FORMATS if Path(path).name.lower().endswith(f".{kind}")]
    if not fitting:
        known = ", ".join(f".{name}" for name in POSE_FORMATS)
        raise InvalidInputError(f"path: expected a name that ends in {known}, got {Path(path).name!r}")
    return max(fitting, key=len)


def check_pose_format(kind: str, frames: Index | None = None, joint_names: Sequence[str] = ()) -> None:
    """Raise before long work if a package is missing for this kind of file, or frames or names do not fit."""
    for module in POSE_FORMATS[kind].packages:
        require(module, f".{kind} files")
    if kind == "c3d" and frames is not None:
        check_c3d(frames, joint_names)
    if kind == "trc":
        check_trc_names(joint_names)
    if kind in ("bvh", "glb") and frames is not None:
        check_animation(frames)


def write_pose(path: str | os.PathLike[str], data: Poses, **options: object) -> None:
    """Write poses in the format that the extension of ``path`` names, one of `POSE_FORMATS`.

    ``options`` are those of its writer: ``frame_rate`` (trc, c3d, nc, bvh, glb), ``y_up``, ``marker_names``
    (trc, c3d), ``unit`` (trc, bvh), ``up``, ``limbs`` (bvh, glb), ``singular`` (nc), ``run`` (npz); None
    stands for the default.
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
    """Read poses from a file in the format that its extension names: npz, csv, trc, c3d, json or nc."""
    read = POSE_FORMATS[pose_format(path)].read
    if read is None:
        known = ", ".join(f".{kind}" for kind in READ)
        raise InvalidInputError(f"path: expected {known}, got {Path(path).name!r}, which is only written")
    return read(path)


def convert_poses(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    fps: float | None = None,
    unit: str | None = None,
    y_up: bool = False,
    marker_names: str | None = None,
    singular: bool = False,
) -> PoseData:
    """Read the poses in ``source``, write them to ``target``, and return them.

    The extensions name the formats; a format keeps what it can hold. `fps` and `unit` are by default those of
    the source, but the unit is m in TRC and glTF, cm in BVH and mm in C3D; `fps` changes velocities with it.
    `y_up` (TRC, C3D; BVH and glTF have it anyway), `marker_names` (TRC, C3D) and `singular` (NetCDF) are
    those of the writers.
    """
    source, target = Path(source), Path(target)
    kind = pose_format(target)
    if target.resolve() == source.resolve():
        raise DatasetError(target, "target", "another file than the source", "the same")
    data = read_pose(source)
    if fps is not None:
        data = data.at_rate(fps)
    if unit is not None and kind not in _OWN_UNIT:
        data, unit = data.in_unit(unit), None
    animation = "up" in POSE_FORMATS[kind].options  # which has y up in any case
    y_up = y_up and not animation
    if y_up:
        _warn_if_turned(source)
    given: dict[str, object] = {"marker_names": marker_names, "unit": unit}
    given |= {"y_up": y_up or None, "singular": singular or None}
    if animation and pose_format(source) in ("trc", "c3d"):
        given["up"] = upward(data)
    try:
        write_pose(target, data, **given)
    except InvalidInputError as error:
        if error.argument in given:
            raise
        raise DatasetError.of_argument(source, error) from error
    return data


def write_people(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    """Write several people into one file, whose extension names the format.

    ``.csv`` has the columns of `write_csv` after one called ``person``, and times from the first frame of
    all. ``.json`` is an object with ``format`` ("skelsplat-people"), ``version`` (1) and ``people``, a list
    of the objects of `write_json`, each with ``person``. ``.nc`` is the dataset of `to_xarray` with an
    individual ``person_0``, … each, over the frames of all: where a person is not there, positions are NaN.

    ``people`` are by identity; all have the same joints.
    """
    kind = os.fspath(path).rpartition(".")[2].lower()
    if kind not in PEOPLE_FORMATS:
        known = ", ".join(f".{name}" for name in PEOPLE_FORMATS)
        raise InvalidInputError(f"path: expected a name that ends in {known}, got {os.fspath(path)!r}")
    if not people:
        raise InvalidInputError("people: expected at least one, got none")
    PEOPLE_FORMATS[kind](path, people)


def _write_csv(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    start = min((int(data.frames[0]) for data in people.values() if data.frames.size), default=0)
    rows = ([identity, *row] for identity, data in people.items() for row in rows_of(data, start))
    atomic_write_text(path, csv_text([("person", *COLUMNS), *rows]))


def _write_netcdf(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    xarray = check_packages()
    frames = np.unique(np.concatenate([data.frames for data in people.values()]))
    each = [to_xarray(_on_frames(data, frames), individual=f"person_{k}") for k, data in people.items()]
    dataset = xarray.concat(each, dim="individuals", data_vars="minimal", coords="minimal", join="exact")
    with atomic_path(path) as temporary:
        make_room(temporary, room_for(dataset, len(frames)))
        dataset.to_netcdf(temporary, engine="h5netcdf")


def _on_frames(data: PoseData, frames: Index) -> PoseData:
    """Return the poses over more frames; in the others joints are unobserved."""
    places = np.searchsorted(frames, data.frames)
    whole: dict[str, Any] = {"frames": frames}
    for name, (_, kind) in ARRAYS.items():
        own = getattr(data, name)
        if len(own) == len(data.frames):
            empty = {np.float64: np.nan, np.str_: "unobserved"}.get(kind, 0)
            dtype = "U10" if kind is np.str_ else own.dtype
            whole[name] = np.full((len(frames), *own.shape[1:]), empty, dtype)
            whole[name][places] = own
    return replace(data, **whole)


#: The formats that hold several people, by extension.
PEOPLE_FORMATS: dict[str, Callable[[str | os.PathLike[str], Mapping[int, PoseData]], None]] = {
    "csv": _write_csv,
    "json": lambda path, people: atomic_write_text(path, people_text(people)),
    "nc": _write_netcdf,
}


def is_pose_file(path: Path) -> bool:
    """Tell from the name, and for json, csv and npz from the content, whether ``path`` holds poses."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in READ or not path.is_file():
        return False
    if kind == "npz":
        return {"pose", "joint_names", "unit"} <= npz_keys(path)
    if kind == "json":
        return is_json_poses(head(path))
    # one with a person is refused by its reader, with a reason
    starts = ("frame,joint,", "frame,time,joint,", "person,frame,joint,", "person,frame,time,joint,")
    return kind != "csv" or head(path).startswith(starts)


def _warn_if_turned(source: Path) -> None:
    """Warn if the axes of a motion-capture file were turned before, or may have been."""
    kind = pose_format(source)
    if kind == "trc" or (kind == "c3d" and c3d_is_y_up(source)):
        states = "y is up already" if kind == "c3d" else "y may be up already (the format does not say)"
        sentence = f"{source}: {states}, so the axes are turned once more."
        doubt = Finding("axes_turned", "warning", Subject(files=(str(source),)), sentence=sentence)
        warnings.warn(FindingWarning(doubt), stacklevel=3)
