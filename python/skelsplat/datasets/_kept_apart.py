"""Detections and monocular poses that are kept apart from the truth.

They are a folder ``<subject>/<activity>[/<camera>]/poses.npz|json`` (the authors' layout), one npz
(``positions_2d`` as in VideoPose3D, or an array per key ``"S9/Directions 1"``) or one JSON
(``{"S9": {"Directions 1": [...]}}``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets._detections import (
    KEYS_2D,
    KEYS_3D,
    Wanted,
    as_detections,
    choose_detector,
    detector_name,
    first_key,
    frame_numbers,
    load_poses,
    poses_file,
    with_scores,
)
from skelsplat.datasets._files import FloatArray, as_numbers, find, load_json, load_npz, numbers
from skelsplat.exceptions import DatasetError

Spellings = Sequence[Sequence[str]]
"""For each view, the names that its folder may have."""


def read_apart(
    places: Sequence[tuple[Path, Sequence[str]]],
    wanted: Wanted,
    spellings: Spellings | None = None,
    *,
    by_frame: bool = True,
) -> tuple[FloatArray, NDArray[np.int64], Path]:
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

    Raises `DatasetError` if there is nothing, a view is missing, or frames or joints do not fit.
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


def _one_file(path: Path, wanted: Wanted, *, by_frame: bool) -> tuple[FloatArray, NDArray[np.int64]]:
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
) -> FloatArray:
    """Read world poses (T, V, N, 3): one per view, or one in all that is fused already (V = 1).

    `shape` is (T, N); `what` names them if they are missing; else as for `read_apart`.
    """
    together = poses_file(folder, stems)
    paths = [together] if together else _of_views(folder, stems, spellings)
    views = []
    for path, names in zip(paths, spellings, strict=False):
        if path is None:
            raise DatasetError(folder / names[0] / f"{stems[0]}.npz", "file", what, "no file")
        key, value = first_key(path, load_poses(path), ("coords3d_pred_world", *KEYS_3D))
        views.append(numbers(path, key, value, (*shape, 3)))
    return np.stack(views, axis=1)


def detections_of(
    root: Path, detector: str | None, given: Path | str | None
) -> tuple[Path | None, str | None]:
    """Return ``2d_DETECTOR/S0`` of a data set whose only subject is S0, or the folder `given`, and DETECTOR.

    If no detector is named it is chosen as for Human3.6M; None if there is none.

    Raises `DatasetError` if the folder is not there.
    """
    wanted = None if detector is None else detector_name(detector)
    if given is not None:
        return find([Path(given)], "folder of detections"), wanted
    there = {detector_name(path.name): path / "S0" for path in sorted(root.glob("2d_*")) if path.is_dir()}
    name = choose_detector(there, wanted, root)
    return (None, None) if name is None else (find([there[name]], f"detections of {name}"), name)


class Separate:
    """Detections that are kept apart from the truth.

    Parameters
    ----------
    path : Path
        A folder or a file, as the module's docstring says.
    spelling : callable
        Gives two names of the same activity the same text.
    """

    def __init__(self, path: Path, spelling: Callable[[str], str]) -> None:
        self.path = path
        self._spelling = spelling
        self._content: Any = None
        if path.is_file():
            self._content = _whole(path)
        elif not path.is_dir():
            raise DatasetError(path, "detections", "a folder, an npz or a JSON file", "nothing in this place")

    def read(self, subject: str, activity: str, wanted: Wanted) -> tuple[FloatArray, Path] | None:
        """Return the detections of a take and the file they are in, or None if it has none.

        Raises `DatasetError` if a view is missing, or frames or joints are not those wanted.
        """
        if self._content is None:
            folder = self._named(self.path / subject, activity)
            if folder is None:
                return None
            values, _, _ = read_apart([(folder, ["poses"])], wanted, by_frame=False)
            return values, folder
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
