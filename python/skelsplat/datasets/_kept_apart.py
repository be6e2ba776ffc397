"""Detections in files apart from the truth, one folder or file per take, with or without frame numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets._detections import KEYS_2D, Wanted, as_detections, detector_name, load_poses
from skelsplat.datasets._files import FloatArray
from skelsplat.datasets._places import find
from skelsplat.exceptions import DatasetError, InvalidInputError

KEYS = (*KEYS_2D, "detections")


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
    paths = [
        next((path for name in names if (path := _file(folder / name, stems)) is not None), None)
        for names in spellings
    ]
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


def _file(folder: Path, stems: Sequence[str]) -> Path | None:
    paths = [folder / f"{stem}{ending}" for stem in stems for ending in (".npz", ".json")]
    return next((path for path in paths if path.is_file()), None)


def _one_file(path: Path, wanted: Wanted) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the detections of a file and their places in the take's frames."""
    content = load_poses(path)
    key = next((key for key in KEYS if key in content), None)
    if key is None:
        raise DatasetError(
            path, KEYS[0], f"one of the keys {', '.join(KEYS)}", f"only {', '.join(content) or 'nothing'}"
        )
    value: Any = np.asarray(content[key]) if not isinstance(content[key], list) else content[key]
    if len(wanted.views) == 1 and np.ndim(value) == 3:
        value = np.asarray(value)[:, None]
    if "frames" not in content:
        return as_detections(path, key, value, wanted), np.arange(len(wanted.frames))
    frames = np.asarray(content["frames"])
    if frames.ndim != 1 or frames.dtype.kind not in "iu" or (np.diff(frames) <= 0).any():
        raise DatasetError(path, "frames", "whole numbers that ascend", f"{frames.dtype} {frames.shape}")
    own = Wanted(wanted.key, frames.astype(np.int64), wanted.views, wanted.layout)
    detections = as_detections(path, key, value, own)
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

    None if neither is named and there is no detector.

    Raises
    ------
    DatasetError
        If the folder is not there.
    InvalidInputError
        If there are several detectors and none is named.
    """
    if given is not None:
        return find([Path(given)], "folder of detections")
    if detector is not None:
        want = detector_name(detector)
        same = [path for path in sorted(root.glob("2d_*")) if detector_name(path.name) == want]
        return find([path / "S0" for path in same] or [root / f"2d_{detector}" / "S0"], "detections")
    there = sorted(root.glob("2d_*"))
    if len(there) > 1:
        names = ", ".join(detector_name(path.name) for path in there)
        raise InvalidInputError(f"detector: expected one of {names}, got none")
    return there[0] / "S0" if there else None
