"""Detections and monocular poses in files apart from the truth, one folder or file per take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets._detections import (
    KEYS_2D,
    Wanted,
    as_detections,
    detector_name,
    first_key,
    load_poses,
    with_scores,
)
from skelsplat.datasets._files import FloatArray, as_numbers, find, numbers
from skelsplat.datasets.human36m._options import choose_detector
from skelsplat.exceptions import DatasetError

KEYS = (*KEYS_2D, "detections")
KEYS_WORLD = ("coords3d_pred_world", "poses", "poses3d")


def read_apart(
    folder: Path, stems: Sequence[str], wanted: Wanted, spellings: Sequence[Sequence[str]]
) -> tuple[FloatArray, NDArray[np.int64], Path] | None:
    """Read the detections of a take.

    Parameters
    ----------
    folder : Path
        Holds ``STEM.npz`` or ``STEM.json`` with all views, or one folder per view with it.
    stems : sequence of str
        File names without ending, the first that is there counts.
    wanted : Wanted
        The take's frames, views and joints. A file without ``frames`` must have as many as these.
    spellings : sequence of sequences of str
        For each view, the names its folder may have.

    Returns
    -------
    detections (S, M, N, 3), places in `wanted.frames` (S,), file or folder; None if there is nothing.

    Raises
    ------
    DatasetError
        If a view is missing, or frames or joints do not fit.
    """
    together = _file(folder, stems)
    if together is not None:
        return (*_one_file(together, wanted), together)
    paths = [_of_view(folder, stems, names) for names in spellings]
    if all(path is None for path in paths):
        return None
    parts = []
    for path, name in zip(paths, wanted.views, strict=True):
        if path is None:
            expected = f"detections of camera {name}"
            raise DatasetError(folder / name / f"{stems[0]}.npz", "file", expected, "no file")
        parts.append((path, *_one_file(path, Wanted(wanted.key, wanted.frames, (name,), wanted.layout))))
    common = parts[0][2]
    for _, _, places in parts[1:]:
        common = np.intersect1d(common, places)
    views = [values[np.searchsorted(places, common)] for _, values, places in parts]
    return np.concatenate(views, axis=1), _not_empty(parts[0][0], common), folder


def read_world(
    folder: Path, stems: Sequence[str], shape: tuple[int, int], spellings: Sequence[Sequence[str]]
) -> FloatArray:
    """Read world poses (T, V, N, 3): one per view, or one in all that is fused already (V = 1).

    `shape` is (T, N); the other parameters are those of `read_apart`.

    Raises
    ------
    DatasetError
        If there are none, those of a view are missing, or the shape is another.
    """
    together = _file(folder, stems)
    paths = [together] if together else [_of_view(folder, stems, names) for names in spellings]
    views = []
    for path, names in zip(paths, spellings, strict=False):
        if path is None:
            raise DatasetError(folder / names[0] / f"{stems[0]}.npz", "file", "world poses", "no file")
        key, value = first_key(path, load_poses(path), KEYS_WORLD)
        views.append(numbers(path, key, value, (*shape, 3)))
    return np.stack(views, axis=1)


def _of_view(folder: Path, stems: Sequence[str], names: Sequence[str]) -> Path | None:
    return next((path for name in names if (path := _file(folder / name, stems)) is not None), None)


def _file(folder: Path, stems: Sequence[str]) -> Path | None:
    paths = [folder / f"{stem}{ending}" for stem in stems for ending in (".npz", ".json")]
    return next((path for path in paths if path.is_file()), None)


def _one_file(path: Path, wanted: Wanted) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the detections of a file and their places in the take's frames."""
    content = load_poses(path)
    key, value = first_key(path, content, KEYS)
    array = as_numbers(path, key, value)
    if len(wanted.views) == 1 and array.ndim == 3:
        array = array[:, None]
    array = with_scores(path, array, content)
    if "frames" not in content:
        return as_detections(path, key, array, wanted), np.arange(len(wanted.frames))
    frames = np.asarray(content["frames"])
    if frames.ndim != 1 or frames.dtype.kind not in "iu" or (np.diff(frames) <= 0).any():
        raise DatasetError(path, "frames", "whole numbers that ascend", f"{frames.dtype} {frames.shape}")
    own = Wanted(wanted.key, frames.astype(np.int64), wanted.views, wanted.layout)
    detections = as_detections(path, key, array, own)
    common, places, mine = np.intersect1d(wanted.frames, frames, return_indices=True)
    if not len(common):
        span = f"some of the frames of {wanted.key} ({wanted.frames[:1]} to {wanted.frames[-1:]})"
        raise DatasetError(path, "frames", span, f"{frames[:1]} to {frames[-1:]}")
    return detections[mine], np.asarray(places, dtype=np.int64)


def _not_empty(path: Path, common: NDArray[np.int64]) -> NDArray[np.int64]:
    if not len(common):
        raise DatasetError(path, "frames", "frames that all views have", "none")
    return common


def detections_folder(root: Path, detector: str | None, given: Path | str | None) -> Path | None:
    """Return ``2d_DETECTOR/S0`` of a data set whose only subject is S0, or the folder `given`.

    If no detector is named it is chosen as for Human3.6M; None if there is none.

    Raises
    ------
    DatasetError
        If the folder is not there.
    """
    if given is not None:
        return find([Path(given)], "folder of detections")
    there = {detector_name(path.name): path / "S0" for path in sorted(root.glob("2d_*")) if path.is_dir()}
    name = choose_detector(there, None if detector is None else detector_name(detector), root)
    return None if name is None else find([there[name]], f"detections of {name}")
