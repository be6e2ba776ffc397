"""MeTRAbs predictions: one npz file per camera, ``<camera>.npz`` or ``<camera>/poses.npz``.

``poses2d`` (pixels; ``poses`` if that is missing) of shape (T, K, 2), (T, P, K, 2) with NaN for nobody, or
an array of T arrays (P, K, 2). ``frames`` (T,) and ``joint_names`` (K,) are read if they are there. MeTRAbs
gives a place to every joint and no confidence: it counts as 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import Array, as_numbers, load_npz, npz_keys
from skelsplat.io.detections._format import View, array_view, joints_of

_KEYS = ("poses2d", "poses")


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    arrays = load_npz(path, (*_KEYS, "frames", "joint_names"))
    key = "poses" if "poses2d" not in arrays.found and "poses" in arrays.found else "poses2d"
    people = joints_of(path, key, _people(path, key, arrays.take(key)), None, clip=False)
    frames, names = arrays.frames(len(people)), arrays.names("joint_names", people.shape[2])
    return array_view(path, key, people, frames=frames, names=names)


def _people(path: Path, key: str, value: Any) -> Array:
    """Return pixels (T, P, K, 2)."""
    array = np.asarray(value)
    if array.dtype == object and array.ndim == 1:
        return _stacked(path, key, [as_numbers(path, f"{key}[{t}]", part) for t, part in enumerate(array)])
    array = as_numbers(path, key, array)
    if array.ndim not in (3, 4) or array.shape[-1] != 2:
        raise DatasetError(path, key, "pixels of shape (T, K, 2) or (T, P, K, 2)", array.shape)
    return array if array.ndim == 4 else array[:, None]


def _stacked(path: Path, key: str, parts: list[Array]) -> Array:
    """Join arrays (P, K, 2) of the frames, padded with NaN."""
    people = [part for part in parts if part.size]
    joints = people[0].shape[1] if people and people[0].ndim == 3 else 0
    for t, part in enumerate(parts):
        if part.size and (part.ndim != 3 or part.shape[1:] != (joints, 2)):
            expected = f"shape (P, {joints}, 2) like the other frames" if joints else "shape (P, K, 2)"
            raise DatasetError(path, f"{key}[{t}]", expected, part.shape)
    most = max([1, *(len(part) for part in people)])
    out = np.full((len(parts), most, joints, 2), np.nan)
    for t, part in enumerate(parts):
        if part.size:
            out[t, : len(part)] = part
    return out


def matches(path: Path) -> bool:
    """Whether a file has one of MeTRAbs' arrays."""
    return not npz_keys(path).isdisjoint(_KEYS)
