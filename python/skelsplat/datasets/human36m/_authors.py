"""The layout of the method's authors: one folder per subject, activity and camera.

``3d_gt/<subject>/<activity>/poses.npz``, ``2d_<detector>/<subject>/<activity>/<camera>/poses.npz``,
``initial_guess/<name>/<subject>/<activity>[/<camera>]/poses.npz`` and ``cameras/camera-parameters.json``.
Poses are under the first key that is there of poses, poses2d (pixels) or poses, poses3d (world, mm).
Activities have the names of the original files, such as "SittingDown 1".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import (
    KEY_WORLD,
    KEYS_3D,
    choose_detector,
    detector_name,
    first_key,
    load_poses,
    poses_file,
    read_apart,
    read_world,
)
from skelsplat.datasets._files import Survey, numbers
from skelsplat.datasets._model import Take
from skelsplat.datasets.human36m._common import (
    CAMERAS,
    Options,
    Reading,
    find_cameras,
    read_rig,
    take_of,
    wanted,
)
from skelsplat.exceptions import DatasetError
from skelsplat.layouts import H36M17

NAME = "skelsplat"
HAS = "3d_gt/ and 2d_<detector>/"
_TRUTH = "3d_gt"


def locate(root: Path) -> Path | None:
    """Return the folder with ``3d_gt``: the root, or the one folder in it that has it."""
    if (root / _TRUTH).is_dir():
        return root
    inside = [path for path in _folders(root) if (path / _TRUTH).is_dir()]
    return inside[0] if len(inside) == 1 else None


def takes(root: Path, options: Options, reading: Reading) -> Iterator[Take]:
    """Give the takes beneath `root`, which holds ``3d_gt``."""
    cameras = find_cameras(root, options.cameras)
    subjects = options.chosen(root / _TRUTH, (path.name for path in _folders(root / _TRUTH)))
    rigs = {subject: read_rig(cameras, subject) for subject in subjects}
    without: Iterator[Take] = (
        _take(folder, subject, rigs[subject], cameras)
        for subject in subjects
        for folder in _folders(root / _TRUTH / subject)
    )
    place = reading.choose(_detectors(root), options, root)
    return without if place is None else reading.detected(without, partial(_with_own, place))


def survey(root: Path, options: Options, found: Survey) -> None:
    """Look for the files that `read` opens, apart from `options.detections`."""
    found.look([find_cameras(root, options.cameras)], "the cameras")
    detectors = _detectors(root)
    if options.detections is None and (options.detector is not None or not detectors):
        name = options.detector or "<detector>"
        found.look([detectors.get(name, root / f"2d_{name}")], "a folder of detections")
    detector = None if options.detections else options.detector or choose_detector(detectors, None, root)
    subjects = options.subjects or [path.name for path in _folders(root / _TRUTH)]
    for subject in subjects:
        found.look([root / _TRUTH / subject], f"the truth of {subject}")
        for folder in _folders(root / _TRUTH / subject):
            found.look([folder / "poses.npz", folder / "poses.json"], "the truth of a take")
            own = detectors[detector] / subject / folder.name if detector in detectors else None
            # Else they are together in one file, or the detector leaves the take out.
            if own is not None and own.is_dir() and poses_file(own) is None:
                for name in CAMERAS:
                    found.look([own / name / "poses.npz", own / name / "poses.json"], f"detections of {name}")


def _folders(path: Path) -> list[Path]:
    return sorted(entry for entry in path.iterdir() if entry.is_dir()) if path.is_dir() else []


def _detectors(root: Path) -> dict[str, Path]:
    return {detector_name(path.name): path for path in _folders(root) if path.name.startswith("2d_")}


def _take(folder: Path, subject: str, rig: CameraRig, cameras: Path) -> Take:
    path = poses_file(folder) or folder / "poses.npz"
    field, value = first_key(path, load_poses(path), KEYS_3D)
    truth = numbers(path, field, value, ("frames", "joints", 3))
    if truth.shape[1] != H36M17.n_joints:
        raise DatasetError(path, field, f"{H36M17.n_joints} joints of {H36M17.name}", truth.shape[1])
    return take_of(subject, folder.name, rig, truth, {"truth": path, "cameras": cameras})


def _with_own(place: Path, take: Take) -> Take | None:
    """Add the detections in ``2d_<detector>``; None if the take has none."""
    folder = place / Path(take.key)
    if not folder.is_dir():
        return None
    detections = read_apart([(folder, ["poses"])], wanted(take), by_frame=False)[0]
    return take.with_detections(detections, folder, monocular=_per_view(folder, take))


def _per_view(folder: Path, take: Take) -> Array | None:
    """Return the world poses of a monocular estimator that lie beside its pixels, (T, M, N, 3), if any do."""
    views = []
    for name in take.rig.names:
        path = poses_file(folder / name)
        content = load_poses(path) if path is not None else {}
        if path is None or KEY_WORLD not in content:
            return None
        views.append(numbers(path, KEY_WORLD, content[KEY_WORLD], (len(take), H36M17.n_joints, 3)))
    return np.stack(views, axis=1)


def with_monocular(take: Take, root: Path, name: str) -> Take:
    """Add the poses of ``initial_guess/<name>``: one per view, or one in all that is fused already."""
    folder = root / "initial_guess" / name / take.key
    shape, views = (len(take), H36M17.n_joints), [[view] for view in take.rig.names]
    poses = read_world(folder, ["poses"], shape, views, f"poses {name!r} of {take.key}")
    return replace(take, monocular=poses, files={**take.files, "monocular": folder})
