"""Poses that are kept apart from the truth, in the layout of the method's authors, and names of detectors.

A folder ``…/<activity>`` has ``poses.npz`` with all views, or one folder per view with a ``poses.npz``; what
counts is the number at the end of a folder's name. What is missing or does not fit is a `DatasetError` that
names the file and the field.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._fields import Field
from skelsplat._skelsplat import Layout
from skelsplat.datasets._files import Survey, frames_in
from skelsplat.datasets._model import Take
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import npz_fields

# Keys of 2D poses in the authors' files, the first that is there counts; likewise of 3D poses.
KEYS_2D, KEYS_3D = ("poses", "poses2d", "detections"), ("poses", "poses3d")
KEY_WORLD = "coords3d_pred_world"  # world poses of a monocular estimator, beside its pixels
# Which detector is read if the caller does not say: the first of these that is there, else by name.
PREFERRED = ("metrabs", "resnet152", "cpn", "resnet50")
_DETECTORS = {"cpn_ft_h36m_dbb": "cpn", "resnet_152": "resnet152", "resnet_50": "resnet50"}
_STEMS = ("poses",)


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
        expected = " or ".join(there) or "none, as there are no detections"
        raise DatasetError(usual.parent, "detector", expected, f"{wanted!r}")
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


def with_detections(
    survey: Survey, take: Take, layout: Layout, folder: Path, stems: Sequence[str] = _STEMS
) -> Take:
    """Return the frames of a take that have detections in a folder, with these."""
    wanted = Wanted(take.key, take.frames, take.rig.names, layout)
    values, places, path = read_apart(survey, folder, wanted, stems)
    return take.select(places).with_detections(values, path)


def read_apart(
    survey: Survey, folder: Path, wanted: Wanted, stems: Sequence[str] = _STEMS
) -> tuple[Array, Index, Path]:
    """Read the detections in a folder.

    Returns them, (S, M, N, 3), their places in `wanted.frames` (S,), and the file or folder. A file with
    ``frames`` may have only some of these; without, it must have as many.
    """
    paths = files_of_views(survey, folder, wanted.views, f"detections of {wanted.key}", stems)
    if len(paths) == 1:
        return (*_one_file(paths[0], wanted), paths[0])
    files = zip(paths, wanted.views, strict=True)
    parts = [_one_file(path, replace(wanted, views=(name,))) for path, name in files]
    common = parts[0][1]
    for _, own in parts[1:]:
        common = np.intersect1d(common, own)
    if not len(common):
        raise DatasetError(paths[0], "frames", "frames that all views have", "none")
    views = [values[np.searchsorted(own, common)] for values, own in parts]
    return np.concatenate(views, axis=1), common, folder


def files_of_views(
    survey: Survey, folder: Path, views: Sequence[str], what: str, stems: Sequence[str] = _STEMS
) -> list[Path]:
    """Return the one file with all views, or the file of each view."""
    together = poses_file(folder, stems)
    if together is not None:
        return [survey.found(together)]
    inside = {_number(path.name): path for path in sorted(folder.glob("*")) if path.is_dir()}
    folders = [inside.get(_number(name), folder / name) for name in views]
    files = [poses_file(one, stems) for one in folders]
    if not any(files):
        raise survey.lacks([folder / f"{stems[0]}.npz"], what)
    expected = zip(files, folders, views, strict=True)
    return survey.find_all(
        (path or one / f"{stems[0]}.npz", f"{what}, camera {name}") for path, one, name in expected
    )


def _number(name: str) -> int | None:
    """Return the number at the end of a name: of ``00_03``, ``3``, ``cam3`` it is 3."""
    digits = re.search(r"\d{1,18}$", name)
    return None if digits is None else int(digits[0])


def poses_file(folder: Path, stems: Sequence[str] = _STEMS) -> Path | None:
    """Return the file of poses in a folder, if there is one; the first stem counts."""
    return next((path for stem in stems if (path := folder / f"{stem}.npz").is_file()), None)


def _one_file(path: Path, wanted: Wanted) -> tuple[Array, Index]:
    """Return the detections of a file and their places in the take's frames."""
    content = npz_fields(path)
    pixels = content.first(*KEYS_2D)
    array = pixels.array()
    if len(wanted.views) == 1 and array.ndim == 3:
        array = array[:, None]
    if "scores" in content and array.shape[-1:] == (2,):
        scores = content["scores"].array()
        if scores.size != math.prod(array.shape[:-1]):
            raise content["scores"].error(f"shape {array.shape[:-1]}", scores.shape)
        array = np.concatenate([array, scores.reshape(*array.shape[:-1], 1)], axis=-1)
    pixels = replace(pixels, value=array)
    if "frames" not in content:
        return as_detections(pixels, wanted), np.arange(len(wanted.frames))
    frames = frames_in(content)
    detections = as_detections(pixels, replace(wanted, frames=frames))
    common, places, mine = np.intersect1d(wanted.frames, frames, return_indices=True)
    if not len(common):
        span = f"some of the frames of {wanted.key} ({wanted.frames[:1]} to {wanted.frames[-1:]})"
        raise DatasetError(path, "frames", span, f"{frames[:1]} to {frames[-1:]}")
    return detections[mine], np.asarray(places, dtype=np.int64)


def as_detections(pixels: Field, wanted: Wanted) -> Array:
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


def read_truth(
    survey: Survey, folder: Path, n_joints: int, stems: Sequence[str] = _STEMS
) -> tuple[Field, Array, Index | None]:
    """Return the joints (T, N, 3) of the file in a folder, as it has them and checked, and its ``frames``."""
    path = poses_file(folder, stems) or survey.find([folder / f"{stems[-1]}.npz"], "truth")
    content = npz_fields(survey.found(path))
    truth = content.first(*KEYS_3D)
    frames = frames_in(content) if "frames" in content else None
    return truth, truth.array_of("T", n_joints, 3), frames


def read_world(
    survey: Survey, folder: Path, take: Take, n_frames: int, what: str, stems: Sequence[str] = _STEMS
) -> Array:
    """Read world poses (T, V, N, 3): one per view, or one in all that is fused already (V = 1)."""
    paths = files_of_views(survey, folder, take.rig.names, what, stems)
    poses = (npz_fields(path).first(KEY_WORLD, *KEYS_3D) for path in paths)
    return np.stack([one.array_of(n_frames, take.truth.shape[1], 3) for one in poses], axis=1)
