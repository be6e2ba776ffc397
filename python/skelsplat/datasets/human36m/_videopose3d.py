"""VideoPose3D's archives: ``data_3d_h36m.npz`` and ``data_2d_h36m_<detector>.npz``.

``positions_3d`` [subject][activity] (T, 32, 3), **metres**, world; ``positions_2d`` [subject][activity] a
list of one (T, 17, 2) per camera, pixels. S11 "Directions" is not in it. The cameras are not in it either:
``camera-parameters.json`` is needed beside it. Detections may run on after the truth has ended; the rest is
cut off, as VideoPose3D does.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import Wanted, as_detections, detector_name
from skelsplat.datasets._files import Survey, a_list, a_table, load_npz, numbers, require
from skelsplat.datasets._model import Take
from skelsplat.datasets.human36m._common import (
    CAMERAS,
    Options,
    Reading,
    activity_of,
    find_cameras,
    read_rig,
    take_of,
    wanted,
)
from skelsplat.exceptions import DatasetError
from skelsplat.layouts import H36M17

NAME = "videopose3d"
HAS = "data_3d_h36m.npz"
_MM = 1000.0

JOINTS_OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)
"""Place of each h36m17 joint among the 32 of the motion capture."""


def locate(root: Path) -> Path | None:
    """Return the folder with the archives: the root or ``data`` in it."""
    return next((folder for folder in (root, root / "data") if (folder / HAS).is_file()), None)


def takes(root: Path, options: Options, reading: Reading) -> Iterator[Take]:
    """Give the takes in the archives."""
    path = root / HAS
    positions = _table(path, "positions_3d")
    subjects = options.chosen(path, map(str, positions))
    cameras = find_cameras(root, options.cameras)
    rigs = {subject: read_rig(cameras, subject) for subject in subjects}
    without: Iterator[Take] = (
        _take(path, subject, str(activity), value, rigs[subject], cameras)
        for subject in subjects
        for activity, value in a_table(path, f"positions_3d.{subject}", positions[subject]).items()
    )
    own = reading.choose(_detectors(root), options, root)
    return without if own is None else _with_own(without, own, reading)


def survey(root: Path, options: Options, found: Survey) -> None:
    """Look for the files that `read` opens, apart from `options.detections`."""
    found.look([root / HAS], "the truth")
    found.look([find_cameras(root, options.cameras)], "the cameras")
    there = {} if options.detections else _detectors(root)
    if options.detections is None and (options.detector is not None or not there):
        name = options.detector or "<detector>"
        found.look([there.get(name, root / f"data_2d_h36m_{name}.npz")], "the detections")
    else:
        found.there += there.values()


def _detectors(root: Path) -> dict[str, Path]:
    return {detector_name(path.stem): path for path in sorted(root.glob("data_2d_h36m_*.npz"))}


def _table(path: Path, key: str) -> dict[Any, Any]:
    table = require(path, "", load_npz(path, (key,)), key)
    return a_table(path, key, table)


def _take(path: Path, subject: str, activity: str, value: Any, rig: CameraRig, cameras: Path) -> Take:
    field = f"positions_3d.{subject}.{activity}"
    truth = numbers(path, field, value, ("frames", "joints", 3))
    if truth.shape[1] == 32:
        truth = truth[:, list(JOINTS_OF_32)]
    if truth.shape[1] != H36M17.n_joints:
        raise DatasetError(path, field, "32 joints, or 17 of h36m17", truth.shape[1])
    return take_of(subject, activity, rig, _MM * truth, {"truth": path, "cameras": cameras})


def _with_own(takes: Iterator[Take], path: Path, reading: Reading) -> Iterator[Take]:
    """Add the detections in ``data_2d_h36m_<detector>.npz``; leave out takes that have none."""
    positions, cut = _table(path, "positions_2d"), 0

    def detected(take: Take) -> Take | None:
        nonlocal cut
        own = require(path, "positions_2d", positions, take.subject)
        views = a_table(path, f"positions_2d.{take.subject}", own).get(activity_of(take))
        if views is None:
            return None
        field = f"positions_2d.{take.subject}.{activity_of(take)}"
        detections, longer = _joined(path, field, a_list(path, field, views), wanted(take))
        cut += longer
        return take.with_detections(detections, path)

    yield from reading.detected(takes, detected)
    if cut:
        reading.notes.append(f"{path.name}: {cut} views cut where the truth ends")


def _joined(path: Path, field: str, views: list[Any], fits: Wanted) -> tuple[Array, int]:
    """Return (T, M, N, 3) from one (T or more, N, 2) per camera, and how many were longer."""
    if len(views) != len(CAMERAS):
        raise DatasetError(path, field, f"{len(CAMERAS)} cameras ({', '.join(CAMERAS)})", len(views))
    parts, longer = [], 0
    for name, view in zip(fits.views, views, strict=True):
        place = f"{field}, camera {name}"
        pixels = numbers(path, place, view, ("frames", "joints", 2))
        longer += len(pixels) > len(fits.frames)
        one = Wanted(fits.key, fits.frames, (name,), fits.layout)
        parts.append(as_detections(path, place, pixels[: len(fits.frames), None], one))
    return np.concatenate(parts, axis=1), longer
