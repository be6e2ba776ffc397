"""Detections of any source as (T, M, N, 3), the files that hold arrays of poses, and names of detectors."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._skelsplat import Layout
from skelsplat.datasets._files import FloatArray, as_numbers, load_json, load_npz, numbers, require
from skelsplat.exceptions import DatasetError

KEYS_2D = ("poses", "poses2d")
"""Keys of 2D poses in the authors' files; the first that is there counts."""
KEYS_3D = ("poses", "poses3d")

_DETECTORS = {"cpn_ft_h36m_dbb": "cpn", "resnet_152": "resnet152", "resnet_50": "resnet50"}


@dataclass(frozen=True)
class Wanted:
    """What the detections of a take must fit: its frames, the names of its views, its joints."""

    key: str
    frames: NDArray[np.int64]
    views: tuple[str, ...]
    layout: Layout


def detector_name(text: str) -> str:
    """Return the short name of a detector: ``"2d_ResNet-152"`` → ``"resnet152"``."""
    name = re.sub(r"^(data_)?2d_(h36m_)?", "", text.lower())
    name = _DETECTORS.get(name, name)
    return re.sub(r"[^a-z0-9_]", "", name)


def as_detections(path: Path, field: str, value: Any, wanted: Wanted) -> FloatArray:
    """Return (T, M, N, 3) from pixels with or without confidence; missing = NaN, NaN, 0.

    Takes pixels that are not finite, the pixel (0, 0) and a confidence of 0 as missing; a confidence above 1
    counts as 1.

    Raises `DatasetError` if frames, views or joints are not those `wanted`.
    """
    array = as_numbers(path, field, value)
    if array.ndim != 4 or array.shape[-1] not in (2, 3):
        raise DatasetError(path, field, "pixels (frames, views, joints, 2 or 3)", f"shape {array.shape}")
    joints = f"{wanted.layout.n_joints} joints of {wanted.layout.name}"
    counts = (
        (array.shape[0], len(wanted.frames), f"{len(wanted.frames)} frames as in the truth of {wanted.key}"),
        (array.shape[1], len(wanted.views), f"{len(wanted.views)} views ({', '.join(wanted.views)})"),
        (array.shape[2], wanted.layout.n_joints, joints),
    )
    for got, want, expected in counts:
        if got != want:
            raise DatasetError(path, field, expected, f"{got} (shape {array.shape})")
    return _with_missing(array)


def _with_missing(array: FloatArray) -> FloatArray:
    pixels = array[..., :2]
    confidence = np.nan_to_num(array[..., 2]) if array.shape[-1] == 3 else np.ones(array.shape[:-1])
    missing = ~np.isfinite(pixels).all(axis=-1) | (pixels == 0.0).all(axis=-1) | (confidence <= 0.0)
    out = np.concatenate([pixels, np.clip(confidence, 0.0, 1.0)[..., None]], axis=-1)
    out[missing] = (np.nan, np.nan, 0.0)
    return out


PREFERRED = ("metrabs", "resnet152", "cpn", "resnet50")
"""Which detector is read if the caller does not say: the first of these that is there, else by name."""


def choose_detector(there: dict[str, Path], wanted: str | None, folder: Path) -> str | None:
    """Return the detector to read, None if there is none.

    Raises `DatasetError` if the wanted one is not there.
    """
    if wanted is not None:
        if wanted not in there:
            raise DatasetError(
                folder, "detector", f"detections of {wanted}", f"only {', '.join(there) or 'none'}"
            )
        return wanted
    known = [name for name in PREFERRED if name in there]
    return next(iter([*known, *sorted(there, key=lambda name: name == "gt")]), None)


def poses_file(folder: Path, stems: Sequence[str] = ("poses",)) -> Path | None:
    """Return the file of poses in a folder, npz or JSON, if there is one; the first stem counts."""
    paths = [folder / f"{stem}{ending}" for stem in stems for ending in (".npz", ".json")]
    return next((path for path in paths if path.is_file()), None)


def load_poses(path: Path) -> dict[str, Any]:
    """Return the table in an npz or JSON file."""
    content = load_npz(path) if path.suffix == ".npz" else load_json(path)
    if not isinstance(content, dict):
        raise DatasetError(path, "JSON", "a table of arrays", type(content).__name__)
    return content


def first_key(path: Path, content: dict[str, Any], keys: Sequence[str]) -> tuple[str, Any]:
    """Return the first of `keys` that the content of a file has, and what is under it."""
    for key in keys:
        if key in content:
            return key, content[key]
    there = ", ".join(content) or "nothing"
    raise DatasetError(path, keys[0], f"one of the keys {', '.join(keys)}", f"only {there}")


def with_scores(path: Path, array: FloatArray, content: dict[str, Any]) -> FloatArray:
    """Return pixels (…, 2) with the ``scores`` of their file as confidence, if it has them."""
    if "scores" not in content or array.shape[-1:] != (2,):
        return array
    scores = as_numbers(path, "scores", content["scores"])
    if scores.size != math.prod(array.shape[:-1]):
        raise DatasetError(path, "scores", f"shape {array.shape[:-1]}", scores.shape)
    return np.concatenate([array, scores.reshape(*array.shape[:-1], 1)], axis=-1)


def read_truth(path: Path, n_joints: int) -> tuple[str, FloatArray, NDArray[np.int64] | None]:
    """Return key and values of the joints (T, N, 3) of a file, and its ``frames`` (T,), if it has them."""
    content = load_npz(path)
    key = next((key for key in KEYS_3D if key in content), KEYS_3D[-1])
    truth = numbers(path, key, require(path, "", content, key), ("T", n_joints, 3))
    return key, truth, frame_numbers(path, content["frames"]) if "frames" in content else None


def frame_numbers(path: Path, value: Any, count: int | None = None) -> NDArray[np.int64]:
    """Return frame numbers, which ascend; as many as `count`, if that is known."""
    frames = np.asarray(value)
    fits = frames.ndim == 1 and frames.dtype.kind in "iu" and count in (None, len(frames))
    if not fits or (np.diff(frames) <= 0).any():
        expected = f"{'' if count is None else f'{count} '}whole numbers that ascend"
        raise DatasetError(path, "frames", expected, f"{frames.dtype} {frames.shape}")
    return frames.astype(np.int64)
