"""Poses as an xarray Dataset of the package movement, and in its NetCDF files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._atomic import atomic_path, make_room
from skelsplat._optional import require
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError
from skelsplat.io._guarded import read_guarded
from skelsplat.io.poses._pose_data import PoseData, Poses, checked, over_views, parts_of

if TYPE_CHECKING:
    import xarray as xr

_PLURAL = ("time", "space", "keypoints", "individuals")
_SINGULAR = ("time", "space", "keypoint", "individual")
_ROOM, _TEXT = 2**17, 64  # bytes of a file for its structure, and for a text and where it is


def to_xarray(
    data: PoseData,
    *,
    frame_rate: float | None = None,
    individual: str = "id_0",
    singular: bool = False,
    first: int | None = None,
) -> xr.Dataset:
    """Return the poses as a ``poses`` dataset of movement (https://movement.neuroinformatics.dev).

    ============== ============================================== ======================================
    position       (time, space, keypoints, individuals)          in ``attrs["unit"]``
    confidence     (time, keypoints, individuals)                 0 to 1
    uncertainty    (time, space, space_2, keypoints, individuals) posterior covariance, unit²; if known
    error_bar      as ``uncertainty``                             against an anatomical joint, unit²
    joint_bias     (time, keypoints, individuals)                 the difference of the two, per axis, unit
    status         (time, keypoints, individuals)                 ok, inferred, weak, unobserved, filled
    ============== ============================================== ======================================

    ``confidence`` is the mean weight of the joint's detections, 0 for a joint that is not ``ok``, and NaN if
    the data have no weights. ``time`` is in seconds from the first frame if the frame rate is known, else in
    frames; the coordinate ``frame`` has the frames' own numbers. Attributes: ``fps`` (if known),
    ``time_unit``, ``source_software``, ``ds_type``, ``unit``, ``processing``.

    ``singular`` names the dimensions ``keypoint`` and ``individual``, as movement does from version 0.17 on;
    ``first`` is the frame at which time begins.
    """
    xarray = require("xarray", "xarray datasets")
    time, space, keypoints, individuals = dims = _SINGULAR if singular else _PLURAL
    rate = frame_rate if frame_rate is not None else data.frame_rate
    begin = first if first is not None else data.frames[0] if len(data.frames) else 0
    steps = data.frames - begin
    by_joint = (time, keypoints, individuals)
    variables: dict[str, Any] = {
        "position": (dims, data.pose.transpose(0, 2, 1)[..., None]),
        "confidence": (by_joint, _confidence(data)[..., None]),
    }
    coordinates: dict[str, Any] = {
        time: steps if rate is None else steps / rate,
        space: ["x", "y", "z"],
        keypoints: list(data.joint_names),
        individuals: [individual],
        "frame": (time, data.frames),
    }
    if data.uncertainty.size:
        coordinates[f"{space}_2"] = ["x", "y", "z"]
        axes = (time, space, f"{space}_2", keypoints, individuals)
        for name in ("uncertainty", "error_bar"):
            variables[name] = (axes, getattr(data, name).transpose(0, 2, 3, 1)[..., None])
    for name, values in (("joint_bias", data.joint_bias), ("status", data.joint_status)):
        if values.size:
            variables[name] = (by_joint, values[..., None])
    attributes: dict[str, str | float] = {
        "source_software": f"SkelSplat {sk.__version__}",
        "ds_type": "poses",
        "time_unit": "frames" if rate is None else "seconds",
        **({} if rate is None else {"fps": rate}),
        "unit": data.unit,
        "processing": "\n".join(data.processing),
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, attributes)
    return dataset


def _confidence(data: PoseData) -> Array:
    """Return the mean weight over the views that detected the joint, (T, N)."""
    if not data.view_weights.size:
        return np.full(data.pose.shape[:2], np.nan)
    confidence = over_views(data.view_weights)[1]
    if data.joint_status.size:
        confidence[data.joint_status != "ok"] = 0.0
    return confidence


def write_netcdf(
    path: str | os.PathLike[str], data: Poses, *, frame_rate: float | None = None, singular: bool = False
) -> None:
    """Write the dataset of `to_xarray` as NetCDF 4, which movement and xarray open."""
    check_packages()
    _, frames, parts = parts_of(data)
    given: dict[str, Any] = {"frame_rate": frame_rate, "singular": singular}
    with atomic_path(path) as temporary:
        dataset = to_xarray(next(parts), **given)
        make_room(temporary, room_for(dataset, len(frames)))
        if isinstance(data, PoseData):
            dataset.to_netcdf(temporary, engine="h5netcdf")
            return
        time = (_SINGULAR if singular else _PLURAL)[0]
        dataset.to_netcdf(temporary, engine="h5netcdf", unlimited_dims=[time])
        with require("h5netcdf", "NetCDF files").File(temporary, "a") as file:
            for part in parts:
                further = to_xarray(part, **given, first=int(frames[0]))
                there = len(file.dimensions[time])
                file.resize_dimension(time, there + further.sizes[time])
                for name, values in further.variables.items():
                    if time in values.dims:
                        file.variables[name][there:] = values.to_numpy()


def room_for(dataset: xr.Dataset, steps: int) -> int:
    """Return how many bytes a file of a dataset takes at most once it has so many frames.

    A full disk ends HDF5, and the process with it.
    """
    texts = sum(values.size for values in dataset.variables.values() if values.dtype.kind in "OU")
    of_frames = (dataset.nbytes + _TEXT * texts) * steps // max(1, len(dataset["frame"]))
    return _ROOM + of_frames * 5 // 4


def check_packages() -> Any:
    """Return the package xarray, or raise `MissingPackageError` if it or another is not installed."""
    for module in ("h5py", "h5netcdf"):
        require(module, "NetCDF files")
    return require("xarray", "NetCDF files")


@checked
def read_netcdf(path: str | os.PathLike[str]) -> PoseData:
    """Read a ``poses`` dataset of one individual in three dimensions, with either naming of the dimensions.

    A joint without a position is ``unobserved`` unless it is ``weak``: movement removes positions alone.
    """
    source = Path(path)
    found = read_guarded("netcdf", source, "a complete NetCDF file")
    attributes, variables = found["attributes"], found["variables"]
    if "position" not in variables:
        raise DatasetError(source, "position", "this variable", ", ".join(variables) or "none")
    given, position = variables["position"]
    dims = next((names for names in (_PLURAL, _SINGULAR) if set(names) == set(given)), None)
    if dims is None:
        raise DatasetError(source, "position", f"dimensions {', '.join(_PLURAL)}", ", ".join(given))
    time, space, keypoints, individuals = dims
    names = {axis: [str(name) for name in variables.get(axis, ((), ()))[1]] for axis in (space, keypoints)}
    count, unit = position.shape[given.index(individuals)], attributes.get("unit")
    for field, expected, fits, got in (
        (space, "x, y, z", names[space] == ["x", "y", "z"], ", ".join(names[space])),
        (individuals, "one individual", count == 1, count),
        ("unit", "the attribute mm, cm or m", unit in MM_PER_UNIT, repr(unit)),
    ):
        if not fits:
            raise DatasetError(source, field, expected, got)
    wanted = {
        "pose": ("position", (time, keypoints, space)),
        "uncertainty": ("uncertainty", (time, keypoints, space, f"{space}_2")),
        "joint_bias": ("joint_bias", (time, keypoints)),
        "joint_status": ("status", (time, keypoints)),
    }
    try:
        arrays = {
            name: _of_one(variables[key], (*axes, individuals))
            for name, (key, axes) in wanted.items()
            if key in variables
        }
        if "joint_status" in arrays:
            known = np.isfinite(arrays["pose"]).all(axis=-1) | (arrays["joint_status"] == "weak")
            arrays["joint_status"] = np.where(known, arrays["joint_status"], "unobserved")
        return PoseData(
            joint_names=tuple(names[keypoints]),
            frames=variables["frame"][1] if "frame" in variables else np.arange(len(arrays["pose"])),
            unit=str(unit),
            frame_rate=float(attributes["fps"]) if "fps" in attributes else None,
            processing=tuple(str(attributes.get("processing", "")).splitlines()),
            **arrays,
        )
    except (ValueError, TypeError) as error:
        raise DatasetError(source, "variables", "arrays that fit each other", str(error)) from error


def _of_one(variable: tuple[list[str], Any], axes: tuple[str, ...]) -> Any:
    """Return the values of the only individual, whose axis comes last, over the axes before it."""
    given, values = variable
    return np.ascontiguousarray(np.transpose(values, [given.index(axis) for axis in axes])[..., 0])
