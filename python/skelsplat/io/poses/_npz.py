"""The npz file: every array of a refinement, under the names of `PoseData`."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._atomic import atomic_write
from skelsplat.io._arrays import Arrays, Made, array_names, frame_numbers, load_plain_npz, npz_keys, npz_rows
from skelsplat.io._arrays import write_npz as write_arrays
from skelsplat.io.poses._pose_data import ARRAYS, PoseData, PoseParts, Poses, checked, parts_of

_KEYS = tuple(entry.name for entry in fields(PoseData))
_NAMES = ("joint_names", "camera_names", "processing")
_KIND = "an npz file"
_REQUIRED = ("pose", "joint_names", "frames", "unit")


def write_npz(path: str | os.PathLike[str], data: Poses, *, run: str | None = None) -> None:
    """Write all of `data` as a compressed npz file, of which no key needs pickle.

    Keys: the attributes of `PoseData` under their names; ``error_bar``, which is not read; ``version``, that
    of this package. ``frame_rate`` is NaN if unknown. ``run``, if given, names the run whose folder the file
    is a part of.
    """
    head, frames, _ = parts_of(data)
    arrays: dict[str, Any] = {key: np.asarray(getattr(head, key)) for key in _KEYS}
    arrays["frames"] = frames
    if head.uncertainty.size:
        arrays["error_bar"] = head.error_bar
    if isinstance(data, PoseParts):
        arrays |= data.rows
        if "uncertainty" in data.rows:
            shape, bars = data.rows["uncertainty"].shape, lambda: (part.error_bar for part in data)
            arrays["error_bar"] = Made(shape, np.dtype(np.float64), bars)
    for key in _NAMES:
        arrays[key] = np.array(getattr(head, key), dtype=np.str_)
    arrays["frame_rate"] = np.array(np.nan if head.frame_rate is None else head.frame_rate)
    arrays["version"] = np.array(sk.__version__)
    if run is not None:
        arrays["run"] = np.array(run)
    with atomic_write(path) as stream:
        write_arrays(stream, arrays)


@checked
def read_npz(path: str | os.PathLike[str]) -> PoseData:
    """Read a file of `write_npz`; of its keys, pose, joint_names, frames and unit have to be there."""
    return _pose_data(Path(path), load_plain_npz(Path(path), _KIND))


def read_npz_range(path: Path, first: int, last: int) -> PoseData:
    """Read a file as `read_npz`, of its frames those from ``first`` to ``last`` alone."""
    frames = frame_numbers(path, Arrays(path, load_plain_npz(path, _KIND, ("frames",))).take("frames"))
    own = slice(int(np.searchsorted(frames, first)), int(np.searchsorted(frames, last, "right")))

    @checked
    def read(_: str | os.PathLike[str]) -> PoseData:
        found = load_plain_npz(path, _KIND, {*_KEYS} - {*ARRAYS})
        found |= {key: npz_rows(path, key, len(frames), own) for key in npz_keys(path) & {*ARRAYS}}
        return _pose_data(path, {**found, "frames": frames[own]})

    return read(path)


def _pose_data(source: Path, found: dict[str, Any]) -> PoseData:
    read = Arrays(source, found)
    for key in _REQUIRED:
        read.take(key)
    arrays = {key: found[key] for key in _KEYS if key in found}
    (arrays["unit"],) = array_names(source, "unit", np.atleast_1d(arrays["unit"]), 1)
    for key in _NAMES:
        if key in arrays:
            texts = np.atleast_1d(arrays[key])
            arrays[key] = array_names(source, key, texts, texts.size, unique=key != "processing")
    arrays["frame_rate"] = read.rate()
    return PoseData(**arrays)
