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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._skelsplat import Layout
from skelsplat.datasets._files import MissingFileError, Survey, Value, load_json, load_npz
from skelsplat.exceptions import DatasetError

KEYS_2D = ("poses", "poses2d", "detections")
"""Keys of 2D poses in the authors' files; the first that is there counts."""
KEYS_3D = ("poses", "poses3d")
KEY_WORLD = "coords3d_pred_world"  # world poses of a monocular estimator, beside its pixels
PREFERRED = ("metrabs", "resnet152", "cpn", "resnet50")
"""Which detector is read if the caller does not say: the first of these that is there, else by name."""

_DETECTORS = {"cpn_ft_h36m_dbb": "cpn", "resnet_152": "resnet152", "resnet_50": "resnet50"}

Places = Sequence[tuple[Path, Sequence[str]]]
"""Folders in which files may be, and the names that these may have; the first with files counts."""
Spellings = Sequence[Sequence[str]]
"""For each view, the names that its folder may have."""


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
    return re.sub(r"[^a-z0-9_]", "", _DETECTORS.get(name, name))


def detectors_of(root: Path) -> dict[str, Path]:
    """Return the folders ``2d_DETECTOR`` by the name of the detector."""
    return {detector_name(path.name): path for path in sorted(root.glob("2d_*")) if path.is_dir()}


def choose_detector(survey: Survey, there: dict[str, Path], wanted: str | None, usual: Path) -> str | None:
    """Return the detector to read; None if there is none, whose detections would be at `usual`."""
    if wanted is None:
        known = [name for name in PREFERRED if name in there]
        chosen = next(iter([*known, *sorted(there, key=lambda name: name == "gt")]), None)
        if chosen is None:
            survey.lacks([usual], "detections")
        return chosen
    if detector_name(wanted) not in there:
        survey.lacks([usual.parent / f"2d_{wanted}"], "detections")
        expected, got = f"detections of {detector_name(wanted)}", ", ".join(there) or "none"
        raise DatasetError(usual.parent, "detector", expected, f"only {got}")
    return detector_name(wanted)


def detections_of(
    survey: Survey, root: Path, detector: str | None, given: Path | str | None, usual: str
) -> tuple[Path | None, str | None]:
    """Return ``2d_DETECTOR/S0`` of a data set whose only subject is S0, or the folder `given`, and DETECTOR.

    If no detector is named it is chosen as for Human3.6M; None if there is none.
    """
    if given is not None:
        name = None if detector is None else detector_name(detector)
        return survey.find([Path(given)], "folder of detections"), name
    there = detectors_of(root)
    name = choose_detector(survey, there, detector, root / f"2d_{usual}")
    return None if name is None else survey.find([there[name] / "S0"], f"detections of {name}"), name


def as_detections(pixels: Value, wanted: Wanted) -> Array:
    """Return (T, M, N, 3) from pixels with or without confidence; missing = NaN, NaN, 0.

    Takes pixels that are not finite, the pixel (0, 0) and a confidence of 0 as missing; a confidence above 1
    counts as 1.
    """
    array = pixels.array()
    if array.ndim != 4 or array.shape[-1] not in (2, 3):
        raise pixels.error("pixels (frames, views, joints, 2 or 3)", f"shape {array.shape}")
    counts = (
        (len(wanted.frames), f"{len(wanted.frames)} frames as in the truth of {wanted.key}"),
        (len(wanted.views), f"{len(wanted.views)} views ({', '.join(wanted.views)})"),
        (wanted.layout.n_joints, f"{wanted.layout.n_joints} joints of {wanted.layout.name}"),
    )
    for got, (want, expected) in zip(array.shape, counts, strict=False):
        if got != want:
            raise pixels.error(expected, f"{got} (shape {array.shape})")
    confidence = np.nan_to_num(array[..., 2]) if array.shape[-1] == 3 else np.ones(array.shape[:-1])
    array = array[..., :2]
    missing = ~np.isfinite(array).all(axis=-1) | (array == 0.0).all(axis=-1) | (confidence <= 0.0)
    out = np.concatenate([array, np.clip(confidence, 0.0, 1.0)[..., None]], axis=-1)
    out[missing] = (np.nan, np.nan, 0.0)
    return out


def poses_file(folder: Path, stems: Sequence[str] = ("poses",)) -> Path | None:
    """Return the file of poses in a folder, npz or JSON, if there is one; the first stem counts."""
    paths = [folder / f"{stem}{ending}" for stem in stems for ending in (".npz", ".json")]
    return next((path for path in paths if path.is_file()), None)


def load_poses(path: Path) -> Value:
    """Return the table in an npz or JSON file."""
    content = load_npz(path) if path.suffix == ".npz" else load_json(path)
    content.table("a table of arrays")
    return content


def read_truth(
    survey: Survey, folder: Path, n_joints: int, stems: Sequence[str]
) -> tuple[Value, Array, Index | None]:
    """Return the joints (T, N, 3) of the file in a folder, as it has them and checked, and its ``frames``."""
    path = poses_file(folder, stems) or survey.find([folder / f"{stems[-1]}.npz"], "truth")
    content = load_poses(survey.found(path))
    truth = content.first(*KEYS_3D)
    return truth, truth.numbers("T", n_joints, 3), content["frames"].frames() if "frames" in content else None


def files_of_views(survey: Survey, places: Places, spellings: Spellings, what: str) -> list[Path]:
    """Return the one file with all views, or the file of each view."""
    for folder, stems in places:
        together = poses_file(folder, stems)
        if together is not None:
            return [survey.found(together)]
        paths = [
            next((path for name in names if (path := poses_file(folder / name, stems)) is not None), None)
            for names in spellings
        ]
        if any(paths):
            break
    else:
        folder, stems = places[0]
        raise survey.lacks([folder / f"{stems[0]}.npz"], what)
    errors: list[MissingFileError] = []
    for path, names in zip(paths, spellings, strict=True):
        if path is None:
            errors.append(survey.lacks([folder / names[0] / f"{stems[0]}.npz"], f"{what}, camera {names[0]}"))
    if errors:
        raise errors[0]
    return [survey.found(path) for path in paths if path is not None]


def read_apart(
    survey: Survey,
    places: Places,
    wanted: Wanted,
    spellings: Spellings | None = None,
    *,
    by_frame: bool = True,
) -> tuple[Array, Index, Path]:
    """Read the detections of a take.

    Parameters
    ----------
    survey : Survey
    places : Places
        ``STEM.npz`` or ``STEM.json`` with all views, or one folder per view with it.
    wanted : Wanted
        The take's frames, views and joints. A file without ``frames`` must have as many as these.
    spellings : Spellings, optional
        By default the names of the views.
    by_frame : bool
        Whether ``frames`` in a file counts, which may be some of the take's.

    Returns
    -------
    detections (S, M, N, 3), places in `wanted.frames` (S,), file or folder
    """
    names = spellings or [[name] for name in wanted.views]
    paths = files_of_views(survey, places, names, f"detections of {wanted.key}")
    if len(paths) == 1:
        return (*_one_file(paths[0], wanted, by_frame=by_frame), paths[0])
    parts = [
        _one_file(path, replace(wanted, views=(name,)), by_frame=by_frame)
        for path, name in zip(paths, wanted.views, strict=True)
    ]
    common = parts[0][1]
    for _, own in parts[1:]:
        common = np.intersect1d(common, own)
    if not len(common):
        raise DatasetError(paths[0], "frames", "frames that all views have", "none")
    views = [values[np.searchsorted(own, common)] for values, own in parts]
    return np.concatenate(views, axis=1), common, paths[0].parent.parent


def _one_file(path: Path, wanted: Wanted, *, by_frame: bool) -> tuple[Array, Index]:
    """Return the detections of a file and their places in the take's frames."""
    content = load_poses(path)
    pixels = content.first(*KEYS_2D)
    array = pixels.array()
    if len(wanted.views) == 1 and array.ndim == 3:
        array = array[:, None]
    if "scores" in content and array.shape[-1:] == (2,):
        scores = content["scores"].array()
        if scores.size != math.prod(array.shape[:-1]):
            raise content["scores"].error(f"shape {array.shape[:-1]}", scores.shape)
        array = np.concatenate([array, scores.reshape(*array.shape[:-1], 1)], axis=-1)
    pixels = replace(pixels, content=array)
    if "frames" not in content or not by_frame:
        return as_detections(pixels, wanted), np.arange(len(wanted.frames))
    frames = content["frames"].frames()
    detections = as_detections(pixels, replace(wanted, frames=frames))
    common, places, mine = np.intersect1d(wanted.frames, frames, return_indices=True)
    if not len(common):
        span = f"some of the frames of {wanted.key} ({wanted.frames[:1]} to {wanted.frames[-1:]})"
        raise DatasetError(path, "frames", span, f"{frames[:1]} to {frames[-1:]}")
    return detections[mine], np.asarray(places, dtype=np.int64)


def read_world(
    survey: Survey, places: Places, shape: tuple[int, int], spellings: Spellings, what: str = "world poses"
) -> Array:
    """Read world poses (T, V, N, 3): one per view, or one in all that is fused already (V = 1).

    `shape` is (T, N).
    """
    paths = files_of_views(survey, places, spellings, what)
    views = [load_poses(path).first(KEY_WORLD, *KEYS_3D).numbers(*shape, 3) for path in paths]
    return np.stack(views, axis=1)


class Separate:
    """Detections that are kept apart from the truth, in a folder or a file.

    `spelling` gives two names of the same activity the same text.
    """

    def __init__(self, path: Path, spelling: Callable[[str], str]) -> None:
        self.path = path
        self._spelling = spelling
        self._takes = None if path.is_dir() else _takes_of(path)

    def read(self, survey: Survey, subject: str, activity: str, wanted: Wanted) -> tuple[Array, Path] | None:
        """Return the detections of a take and the file they are in, or None if it has none."""
        same = self._spelling(activity)
        if self._takes is not None:
            named = ((name, at) for name, at in self._takes.get(subject, {}).items())
            pixels = next((at for name, at in named if self._spelling(str(name)) == same), None)
            return None if pixels is None else (as_detections(_stacked(pixels), wanted), self.path)
        folder = self.path / subject
        there = [path for path in sorted(folder.glob("*")) if path.is_dir()]
        exact = [path for path in there if path.name == activity]
        alike = [path for path in there if self._spelling(path.name) == same]
        if not exact and not alike:
            return None
        place = (exact or alike)[0]
        return read_apart(survey, [(place, ["poses"])], wanted, by_frame=False)[0], place


def _takes_of(path: Path) -> dict[Any, dict[Any, Value]]:
    """Return {subject: {activity: value}} of a file with all detections."""
    if not path.is_file():
        raise DatasetError(path, "detections", "a folder, an npz or a JSON file", "nothing in this place")
    content = load_json(path) if path.suffix == ".json" else load_npz(path)
    if path.suffix == ".json" or "positions_2d" in content:
        subjects = content if path.suffix == ".json" else content["positions_2d"]
        return {name: at.table("activities") for name, at in subjects.table("a table of subjects").items()}
    found: dict[Any, dict[Any, Value]] = {}
    for key, at in content.table().items():
        subject, slash, activity = key.partition("/")
        if slash:
            found.setdefault(subject, {})[activity] = at
    if not found:
        raise content.error("positions_2d, or subject/activity", ", ".join(content.keys) or "none")
    return found


def _stacked(pixels: Value) -> Value:
    """Return (T, M, N, 2 or 3) from that, or from a list of one array (T, N, 2 or 3) per view."""
    views = pixels.content
    if isinstance(views, np.ndarray) and views.dtype == object:
        views = list(views)
    if not (isinstance(views, list) and views and all(isinstance(view, np.ndarray) for view in views)):
        return pixels
    if len({view.shape for view in views}) > 1:
        raise pixels.error("as many frames in every view", f"shapes {[view.shape for view in views]}")
    return replace(pixels, content=np.stack(views, axis=1))
