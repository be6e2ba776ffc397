"""Detections of any source as (T, M, N, 3), the files that hold them, and names of detectors.

What is missing or does not fit is a `DatasetError` that names the file and the field.

Detections and monocular poses that are kept apart from the truth are a folder
``<subject>/<activity>[/<camera>]/poses.npz|json`` (the authors' layout), one npz (``positions_2d`` as in
VideoPose3D, or an array per key ``"S9/Directions 1"``) or one JSON (``{"S9": {"Directions 1": [...]}}``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._skelsplat import Layout
from skelsplat.datasets._files import a_table, as_numbers, find, load_json, load_npz, numbers, require
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import frame_numbers

KEYS_2D = ("poses", "poses2d")
"""Keys of 2D poses in the authors' files; the first that is there counts."""
KEYS_3D = ("poses", "poses3d")
KEY_WORLD = "coords3d_pred_world"  # world poses of a monocular estimator, beside its pixels

_DETECTORS = {"cpn_ft_h36m_dbb": "cpn", "resnet_152": "resnet152", "resnet_50": "resnet50"}


@dataclass(frozen=True)
class Wanted:
    """What the detections of a take must fit: its frames, the names of its views, its joints."""

    key: str
    frames: Index
    views: tuple[str, ...]
    layout: Layout


def detector_name(text: str) -> str:
    """Return the short name of a detector: ``"2d_ResNet-152"`` → ``"resnet152"``."""
    name = re.sub(r"^(data_)?2d_(h36m_)?", "", text.lower())
    name = _DETECTORS.get(name, name)
    return re.sub(r"[^a-z0-9_]", "", name)


def as_detections(path: Path, field: str, value: Any, wanted: Wanted) -> Array:
    """Return (T, M, N, 3) from pixels with or without confidence; missing = NaN, NaN, 0.

    Takes pixels that are not finite, the pixel (0, 0) and a confidence of 0 as missing; a confidence above 1
    counts as 1.
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
    pixels = array[..., :2]
    confidence = np.nan_to_num(array[..., 2]) if array.shape[-1] == 3 else np.ones(array.shape[:-1])
    missing = ~np.isfinite(pixels).all(axis=-1) | (pixels == 0.0).all(axis=-1) | (confidence <= 0.0)
    out = np.concatenate([pixels, np.clip(confidence, 0.0, 1.0)[..., None]], axis=-1)
    out[missing] = (np.nan, np.nan, 0.0)
    return out


PREFERRED = ("metrabs", "resnet152", "cpn", "resnet50")
"""Which detector is read if the caller does not say: the first of these that is there, else by name."""


def choose_detector(there: dict[str, Path], wanted: str | None, folder: Path) -> str | None:
    """Return the detector to read, None if there is none."""
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
    return a_table(path, "JSON", content, "a table of arrays")


def first_key(path: Path, content: dict[str, Any], keys: Sequence[str]) -> tuple[str, Any]:
    """Return the first of `keys` that the content of a file has, and what is under it."""
    for key in keys:
        if key in content:
            return key, content[key]
    there = ", ".join(content) or "nothing"
    raise DatasetError(path, keys[0], f"one of the keys {', '.join(keys)}", f"only {there}")


def with_scores(path: Path, array: Array, content: dict[str, Any]) -> Array:
    """Return pixels (…, 2) with the ``scores`` of their file as confidence, if it has them."""
    if "scores" not in content or array.shape[-1:] != (2,):
        return array
    scores = as_numbers(path, "scores", content["scores"])
    if scores.size != math.prod(array.shape[:-1]):
        raise DatasetError(path, "scores", f"shape {array.shape[:-1]}", scores.shape)
    return np.concatenate([array, scores.reshape(*array.shape[:-1], 1)], axis=-1)


def read_truth(path: Path, n_joints: int) -> tuple[str, Array, Index | None]:
    """Return key and values of the joints (T, N, 3) of a file, and its ``frames`` (T,), if it has them."""
    content = load_npz(path)
    key = next((key for key in KEYS_3D if key in content), KEYS_3D[-1])
    truth = numbers(path, key, require(path, "", content, key), ("T", n_joints, 3))
    return key, truth, frame_numbers(path, content["frames"]) if "frames" in content else None


Spellings = Sequence[Sequence[str]]
"""For each view, the names that its folder may have."""


def read_apart(
    places: Sequence[tuple[Path, Sequence[str]]],
    wanted: Wanted,
    spellings: Spellings | None = None,
    *,
    by_frame: bool = True,
) -> tuple[Array, Index, Path]:
    """Read the detections of a take.

    Parameters
    ----------
    places : sequence of (folder, stems)
        The first with files counts: ``STEM.npz`` or ``STEM.json`` with all views, or one folder per view with
        it. Of several stems the first that is there counts.
    wanted : Wanted
        The take's frames, views and joints. A file without ``frames`` must have as many as these.
    spellings : Spellings, optional
        Without it the names of the views.
    by_frame : bool
        Whether ``frames`` in a file counts, which may be some of the take's.

    Returns
    -------
    detections (S, M, N, 3), places in `wanted.frames` (S,), file or folder
    """
    for folder, stems in places:
        together = poses_file(folder, stems)
        if together is not None:
            return (*_one_file(together, wanted, by_frame=by_frame), together)
        paths = _of_views(folder, stems, spellings or [[name] for name in wanted.views])
        if any(paths):
            break
    else:
        folder, stems = places[0]
        expected = f"detections of {wanted.key}"
        raise DatasetError(folder / f"{stems[0]}.npz", "file", expected, "nothing in this place")
    parts = []
    for path, name in zip(paths, wanted.views, strict=True):
        if path is None:
            missing = folder / name / f"{stems[0]}.npz"
            raise DatasetError(missing, "file", f"detections of camera {name}", "no file (nor JSON)")
        one_view = Wanted(wanted.key, wanted.frames, (name,), wanted.layout)
        parts.append(_one_file(path, one_view, by_frame=by_frame))
    common = parts[0][1]
    for _, own in parts[1:]:
        common = np.intersect1d(common, own)
    if not len(common):
        raise DatasetError(next(filter(None, paths)), "frames", "frames that all views have", "none")
    views = [values[np.searchsorted(own, common)] for values, own in parts]
    return np.concatenate(views, axis=1), common, folder


def _of_views(folder: Path, stems: Sequence[str], spellings: Spellings) -> list[Path | None]:
    """Return the file of each view."""
    return [
        next((path for name in names if (path := poses_file(folder / name, stems)) is not None), None)
        for names in spellings
    ]


def _one_file(path: Path, wanted: Wanted, *, by_frame: bool) -> tuple[Array, Index]:
    """Return the detections of a file and their places in the take's frames."""
    content = load_poses(path)
    key, value = first_key(path, content, (*KEYS_2D, "detections"))
    array = as_numbers(path, key, value)
    if len(wanted.views) == 1 and array.ndim == 3:
        array = array[:, None]
    array = with_scores(path, array, content)
    if "frames" not in content or not by_frame:
        return as_detections(path, key, array, wanted), np.arange(len(wanted.frames))
    frames = frame_numbers(path, content["frames"])
    detections = as_detections(path, key, array, Wanted(wanted.key, frames, wanted.views, wanted.layout))
    common, places, mine = np.intersect1d(wanted.frames, frames, return_indices=True)
    if not len(common):
        span = f"some of the frames of {wanted.key} ({wanted.frames[:1]} to {wanted.frames[-1:]})"
        raise DatasetError(path, "frames", span, f"{frames[:1]} to {frames[-1:]}")
    return detections[mine], np.asarray(places, dtype=np.int64)


def read_world(
    folder: Path,
    stems: Sequence[str],
    shape: tuple[int, int],
    spellings: Spellings,
    what: str = "world poses",
) -> Array:
    """Read world poses (T, V, N, 3): one per view, or one in all that is fused already (V = 1).

    `shape` is (T, N); `what` names them if they are missing; else as for `read_apart`.
    """
    together = poses_file(folder, stems)
    paths = [together] if together else _of_views(folder, stems, spellings)
    views = []
    for path, names in zip(paths, spellings, strict=False):
        if path is None:
            raise DatasetError(folder / names[0] / f"{stems[0]}.npz", "file", what, "no file")
        key, value = first_key(path, load_poses(path), (KEY_WORLD, *KEYS_3D))
        views.append(numbers(path, key, value, (*shape, 3)))
    return np.stack(views, axis=1)


def detections_of(
    root: Path, detector: str | None, given: Path | str | None
) -> tuple[Path | None, str | None]:
    """Return ``2d_DETECTOR/S0`` of a data set whose only subject is S0, or the folder `given`, and DETECTOR.

    If no detector is named it is chosen as for Human3.6M; None if there is none.
    """
    wanted = None if detector is None else detector_name(detector)
    if given is not None:
        return find([Path(given)], "folder of detections"), wanted
    there = {detector_name(path.name): path / "S0" for path in sorted(root.glob("2d_*")) if path.is_dir()}
    name = choose_detector(there, wanted, root)
    return (None, None) if name is None else (find([there[name]], f"detections of {name}"), name)


class Separate:
    """Detections that are kept apart from the truth, in a folder or a file.

    `spelling` gives two names of the same activity the same text.
    """

    def __init__(self, path: Path, spelling: Callable[[str], str]) -> None:
        self.path = path
        self._spelling = spelling
        self._content: Any = None
        if path.is_file():
            self._content = _whole(path)
        elif not path.is_dir():
            raise DatasetError(path, "detections", "a folder, an npz or a JSON file", "nothing in this place")

    def read(self, subject: str, activity: str, wanted: Wanted) -> tuple[Array, Path] | None:
        """Return the detections of a take and the file they are in, or None if it has none."""
        if self._content is None:
            folder = self._named(self.path / subject, activity)
            if folder is None:
                return None
            values, _, _ = read_apart([(folder, ["poses"])], wanted, by_frame=False)
            return values, folder
        takes = a_table(self.path, subject, self._content.get(subject, {}), "a table of activities")
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
        return a_table(path, "JSON", load_json(path), "a table of subjects")
    arrays = load_npz(path)
    if "positions_2d" in arrays:
        return a_table(path, "positions_2d", arrays["positions_2d"], "a table of subjects")
    content: dict[str, dict[str, Any]] = {}
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
