"""``actorsGT.mat`` of Shelf and Campus: cells of actors, of frames, of joints in metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._optional import require
from skelsplat.datasets._files import FloatArray, opened
from skelsplat.exceptions import DatasetError

_MM_PER_M = 1000.0


def read_actors(path: Path, n_joints: int) -> list[tuple[NDArray[np.int64], FloatArray]]:
    """Return frames (T,), from 0, and joints (T, N, 3) mm of each actor, where it is labelled.

    Raises
    ------
    DatasetError
        If SciPy, which reads the file, is not installed, or the file is not as described.
    """
    content = _load(path)
    if "actor3D" not in content:
        there = ", ".join(key for key in content if not key.startswith("__")) or "nothing"
        raise DatasetError(path, "actor3D", "cells of actors", f"only {there}")
    actors = _cells(content["actor3D"])
    while len(actors) == 1 and _is_cell(actors[0]) and _is_cell(actors[0].ravel()[0]):
        actors = _cells(actors[0])  # the cell of actors may lie in cells of its own
    if not actors:
        raise DatasetError(path, "actor3D", "cells of actors", "none")
    found = [_actor(path, f"actor3D{{{k + 1}}}", actor, n_joints) for k, actor in enumerate(actors)]
    lengths = {length for length, _, _ in found}
    if len(lengths) > 1:
        raise DatasetError(path, "actor3D", "as many frames for every actor", sorted(lengths))
    return [(frames, joints) for _, frames, joints in found]


def _load(path: Path) -> dict[str, Any]:
    loadmat = require("scipy.io", str(path), "evaluation").loadmat
    with opened(path) as stream:
        try:
            return dict(loadmat(stream))
        except NotImplementedError as error:
            raise DatasetError(path, "file", "a MATLAB file before version 7.3", error) from error
        except Exception as error:  # a damaged file can make the reader raise nearly anything
            raise DatasetError(path, "file", "a complete MATLAB file", error) from error


def _is_cell(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object and value.size > 0


def _cells(value: Any) -> list[Any]:
    return list(value.ravel()) if _is_cell(value) else []


def _actor(path: Path, field: str, cells: Any, n_joints: int) -> tuple[int, NDArray[np.int64], FloatArray]:
    frames, poses = [], []
    values = _cells(cells)
    for k, value in enumerate(values):
        pose = np.asarray(value)
        while pose.dtype == object and pose.size == 1:
            pose = np.asarray(pose.ravel()[0])
        if pose.size < 3:  # not labelled: an empty matrix, or a single zero
            continue
        if pose.shape != (n_joints, 3) or pose.dtype.kind not in "fiu":
            raise DatasetError(
                path, f"{field}{{{k + 1}}}", f"joints ({n_joints}, 3), metres", f"shape {pose.shape}"
            )
        frames.append(k)
        poses.append(_MM_PER_M * pose.astype(np.float64))
    joints = np.stack(poses) if poses else np.empty((0, n_joints, 3))
    return len(values), np.array(frames, dtype=np.int64), joints
