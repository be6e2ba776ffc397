"""Detections of everybody in view, of Shelf and Campus, in which nothing says who is who.

- ``2d_DETECTOR/S0/people.npz``: key ``people`` (T, M, P, N, 2 or 3), NaN where there is nothing, and
  ``frames`` (T,), from 0;
- ``pred_NAME_DETECTOR_coco.pkl`` as VoxelPose has it: {"CAMERA_FRAME": [{"pred": (17, 3)}, …]}.

With 17 joints they are COCO-17.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat.datasets._detections import detector_name
from skelsplat.datasets._files import a_list, a_table, as_numbers, load_npz, load_pickle, numbers, require
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import frame_numbers

FILE = "people.npz"


def pickles(root: Path, name: str) -> dict[str, Path]:
    """Return VoxelPose's files by the name of their detector."""
    folders = (root, root / name.capitalize())
    paths = [path for folder in folders for path in sorted(folder.glob(f"pred_{name}_*.pkl"))]
    short = (re.sub(rf"^pred_{name}_|(_coco)?\.pkl$", "", path.name) for path in paths)
    return {detector_name(text): path for text, path in zip(short, paths, strict=True)}


def read_everybody(
    path: Path, cameras: Sequence[str], n_joints: int, from_coco: Callable[[Array], Array]
) -> tuple[Index, Array]:
    """Read frames (T,) and detections (T, M, P, N, 3), NaN where there is nothing.

    Raises `DatasetError` if the file is missing or malformed.
    """
    frames, people = _of_npz(path, cameras) if path.suffix == ".npz" else _of_pickle(path, cameras)
    order = np.argsort(frames, kind="stable")
    frames, people = frames[order], people[order]
    if len(np.unique(frames)) < len(frames):
        raise DatasetError(path, "frames", "every frame once", "some twice")
    if people.shape[-1] == 2:
        people = np.concatenate([people, np.ones((*people.shape[:-1], 1))], axis=-1)
    missing = ~np.isfinite(people[..., :2]).all(axis=-1) | (people[..., :2] == 0.0).all(axis=-1)
    people[..., 2] = np.clip(people[..., 2], 0.0, 1.0)
    people[missing | ~(people[..., 2] > 0.0)] = np.nan
    if people.shape[-2] == 17:
        people = from_coco(people)
        people[np.isnan(people[..., 0])] = np.nan
    if people.shape[-2] != n_joints:
        raise DatasetError(path, "people", f"{n_joints} or 17 joints", people.shape[-2])
    return frames, people


def _of_npz(path: Path, cameras: Sequence[str]) -> tuple[Index, Array]:
    content = load_npz(path)
    people = as_numbers(path, "people", require(path, "", content, "people"))
    if people.ndim != 5 or people.shape[-1] not in (2, 3) or people.shape[1] != len(cameras):
        expected = f"pixels (frames, {len(cameras)} views, people, joints, 2 or 3)"
        raise DatasetError(path, "people", expected, f"shape {people.shape}")
    frames = frame_numbers(path, require(path, "", content, "frames"))
    if len(frames) != len(people):
        raise DatasetError(path, "frames", f"{len(people)} numbers", len(frames))
    return frames, people


def _of_pickle(path: Path, cameras: Sequence[str]) -> tuple[Index, Array]:
    found: dict[tuple[int, int], list[Array]] = {}
    for key, entries in a_table(path, "pickle", load_pickle(path)).items():
        place = re.fullmatch(r"(\d+)_(\d+)", str(key))
        if place is None:
            raise DatasetError(path, f"{key!r}", "keys CAMERA_FRAME, such as '0_300'", "this key")
        if place[1] in cameras:
            where = int(place[2]), cameras.index(place[1])
            found[where] = [
                _pose(path, str(key), k, entry) for k, entry in enumerate(a_list(path, str(key), entries))
            ]
    if not found:
        raise DatasetError(path, "pickle", f"entries of the cameras {', '.join(cameras)}", "none")
    frames = np.array(sorted({frame for frame, _ in found}), dtype=np.int64)
    most = max(map(len, found.values()))
    people = np.full((len(frames), len(cameras), most, 17, 3), np.nan)
    for (frame, view), poses in found.items():
        for k, pose in enumerate(poses):
            people[np.searchsorted(frames, frame), view, k] = pose
    return frames, people


def _pose(path: Path, key: str, k: int, entry: Any) -> Array:
    field = f"{key}[{k}]"
    return numbers(path, f"{field}.pred", require(path, field, entry, "pred"), (17, 3))
