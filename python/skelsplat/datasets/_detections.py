"""Detections of any source as (T, M, N, 3), and those that are kept apart from the truth.

Kept apart, they are a folder ``<subject>/<activity>[/<camera>]/poses.npz|json`` (the authors' layout), one
npz (``positions_2d`` as in VideoPose3D, or an array per key ``"S9/Directions 1"``) or one JSON
(``{"S9": {"Directions 1": [...]}}``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._skelsplat import Layout
from skelsplat.datasets._files import FloatArray, as_numbers, load_json, load_npz
from skelsplat.exceptions import DatasetError

KEYS_2D = ("poses", "poses2d")
"""Keys of 2D poses in the authors' files; the first that is there counts."""

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

    Raises
    ------
    DatasetError
        If frames, views or joints are not those `wanted`.
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


def same_name(text: str) -> str:
    """Return what two spellings of a folder's name have in common."""
    return re.sub(r"[\s_]+", " ", text.strip().lower())


class Separate:
    """Detections that are kept apart from the truth.

    Parameters
    ----------
    path : Path
        A folder or a file, as the module's docstring says.
    spelling : callable
        Gives two names of the same activity the same text.
    """

    def __init__(self, path: Path, spelling: Callable[[str], str] = same_name) -> None:
        self.path = path
        self._spelling = spelling
        self._content: Any = None
        if path.is_file():
            self._content = _whole(path)
        elif not path.is_dir():
            raise DatasetError(path, "detections", "a folder, an npz or a JSON file", "nothing in this place")

    def read(self, subject: str, activity: str, wanted: Wanted) -> tuple[FloatArray, Path] | None:
        """Return the detections of a take and the file they are in, or None if it has none.

        Raises
        ------
        DatasetError
            If a view is missing, or frames or joints are not those wanted.
        """
        if self._content is None:
            folder = self._named(self.path / subject, activity)
            return None if folder is None else (read_folder(folder, wanted), folder)
        takes = self._content.get(subject, {})
        if not isinstance(takes, dict):
            raise DatasetError(self.path, subject, "a table of activities", type(takes).__name__)
        for name, value in takes.items():
            if self._spelling(str(name)) == self._spelling(activity):
                field = f"{subject}.{name}"
                return as_detections(self.path, field, _stacked(self.path, field, value), wanted), self.path
        return None

    def _named(self, folder: Path, activity: str) -> Path | None:
        if (folder / activity).is_dir():
            return folder / activity
        same = self._spelling(activity)
        there = sorted(folder.iterdir()) if folder.is_dir() else []
        return next((path for path in there if path.is_dir() and self._spelling(path.name) == same), None)


def _whole(path: Path) -> dict[Any, Any]:
    """Return {subject: {activity: value}} of a file with all detections."""
    if path.suffix == ".json":
        content = load_json(path)
        if not isinstance(content, dict):
            raise DatasetError(path, "JSON", "a table of subjects", type(content).__name__)
        return content
    arrays = load_npz(path)
    if "positions_2d" in arrays:
        nested = arrays["positions_2d"]
        if not isinstance(nested, dict):
            raise DatasetError(path, "positions_2d", "a table of subjects", type(nested).__name__)
        return nested
    content = {}
    for key, value in arrays.items():
        subject, slash, activity = key.partition("/")
        if slash:
            content.setdefault(subject, {})[activity] = value
    if not content:
        raise DatasetError(path, "keys", "positions_2d, or subject/activity", ", ".join(arrays) or "none")
    return content


def _stacked(path: Path, field: str, value: Any) -> Any:
    """Return (T, M, N, 2 or 3) from that, or from a list of one array (T, N, 2 or 3) per view."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        value = list(value)
    if not (isinstance(value, list) and value and isinstance(value[0], np.ndarray)):
        return value
    lengths = [len(view) for view in value]
    if len({view.shape for view in value}) > 1:
        raise DatasetError(path, field, "as many frames in every view", f"frames {lengths}")
    return np.stack(value, axis=1)


def read_folder(folder: Path, wanted: Wanted, keys: Sequence[str] = KEYS_2D) -> FloatArray:
    """Return the detections in ``folder[/<camera>]/poses.npz|json``.

    Raises
    ------
    DatasetError
        If the folder of a view is missing, or its frames or joints are not those wanted.
    """
    together = poses_file(folder)
    if together is not None:
        field, value = first_key(together, load_poses(together), keys)
        return as_detections(together, field, value, wanted)
    views = []
    for name in wanted.views:
        path = poses_file(folder / name)
        if path is None:
            expected = f"detections of camera {name}"
            raise DatasetError(folder / name / "poses.npz", "file", expected, "no file (nor poses.json)")
        one_view = Wanted(wanted.key, wanted.frames, (name,), wanted.layout)
        views.append(_one_view(path, keys, one_view))
    return np.concatenate(views, axis=1)


def poses_file(folder: Path) -> Path | None:
    """Return the file of poses in a folder, if there is one."""
    paths = [folder / "poses.npz", folder / "poses.json"]
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


def _one_view(path: Path, keys: Sequence[str], wanted: Wanted) -> FloatArray:
    """Return (T, 1, N, 3) of one camera's file; scores beside the poses are their confidence."""
    content = load_poses(path)
    field, value = first_key(path, content, keys)
    array = as_numbers(path, field, value)
    if array.ndim == 3:
        array = array[:, None]
    return as_detections(path, field, with_scores(path, array, content), wanted)


def with_scores(path: Path, array: FloatArray, content: dict[str, Any]) -> FloatArray:
    """Return pixels (…, 2) with the ``scores`` of their file as confidence, if it has them."""
    if "scores" not in content or array.shape[-1:] != (2,):
        return array
    scores = as_numbers(path, "scores", content["scores"])
    if scores.size != math.prod(array.shape[:-1]):
        raise DatasetError(path, "scores", f"shape {array.shape[:-1]}", scores.shape)
    return np.concatenate([array, scores.reshape(*array.shape[:-1], 1)], axis=-1)
