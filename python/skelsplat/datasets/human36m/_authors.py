"""The layout of the method's authors: one folder per subject, activity and camera.

``3d_gt/<subject>/<activity>/poses.npz``, ``2d_<detector>/<subject>/<activity>/<camera>/poses.npz``,
``initial_guess/<name>/<subject>/<activity>[/<camera>]/poses.npz`` and ``cameras/camera-parameters.json``.
Poses are under the first key that is there of poses, poses2d (pixels) or poses, poses3d (world, mm).
Activities have the names of the original files, such as "SittingDown 1". Detections of other layouts may be
kept in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat.datasets._detections import (
    KEY_WORLD,
    detectors_of,
    poses_file,
    read_truth,
    read_world,
    with_detections,
)
from skelsplat.datasets._files import Survey, load_npz
from skelsplat.datasets._model import Take
from skelsplat.datasets.human36m._common import Options, activity_of, read_rig, spelling, take_of
from skelsplat.layouts import H36M17

NAME = "skelsplat"
HAS = "3d_gt/ and 2d_<detector>/"
USUAL = "2d_metrabs"
_TRUTH = "3d_gt"

detectors = detectors_of


def locate(root: Path) -> Path | None:
    """Return the folder with ``3d_gt``: the root, or the one folder in it that has it."""
    inside = [path for path in (root, *_folders(root)) if (path / _TRUTH).is_dir()]
    return inside[0] if root in inside or len(inside) == 1 else None


def takes(root: Path, options: Options, survey: Survey) -> Iterator[Take]:
    """Give the takes beneath `root`, which holds ``3d_gt``."""
    cameras = options.find_cameras(survey, root)
    subjects = options.chosen(root / _TRUTH, (path.name for path in _folders(root / _TRUTH)))
    rig_of = cache(lambda subject: read_rig(cameras, subject))

    def take(folder: Path) -> Take:
        subject = folder.parent.name
        truth, joints, _ = read_truth(survey, folder, H36M17.n_joints)
        files = {"truth": truth.path, "cameras": cameras}
        return take_of(subject, folder.name, rig_of(subject), joints, files)

    return survey.each(take, (folder for one in subjects for folder in _folders(root / _TRUTH / one)))


def _folders(path: Path) -> list[Path]:
    return sorted(entry for entry in path.iterdir() if entry.is_dir()) if path.is_dir() else []


def adding(root: Path, survey: Survey) -> Callable[[Take], Take]:
    """Return what gives a take its detections in ``<subject>/<activity>``, and poses beside them."""

    def add(take: Take) -> Take:
        activity = activity_of(take)
        alike = [one for one in _folders(root / take.subject) if spelling(one.name) == spelling(activity)]
        if not alike:
            return take
        folder = min(alike, key=lambda one: one.name != activity)
        found = with_detections(survey, take, H36M17, folder)
        return replace(found, monocular=_beside(folder, found))

    return add


def _beside(folder: Path, take: Take) -> Array | None:
    """Return the world poses of a monocular estimator that lie beside its pixels, (T, M, N, 3), if any do."""
    views = []
    for name in take.rig.names:
        path = poses_file(folder / name)
        if path is None or KEY_WORLD not in (content := load_npz(path)):
            return None
        views.append(content[KEY_WORLD].numbers(len(take), H36M17.n_joints, 3))
    return np.stack(views, axis=1)


def with_monocular(survey: Survey, root: Path, name: str) -> Callable[[Take], Take]:
    """Return what adds ``initial_guess/<name>``: one pose per view, or one in all that is fused already."""

    def add(take: Take) -> Take:
        folder = root / "initial_guess" / name / take.key
        poses = read_world(survey, folder, take, len(take), f"poses {name!r} of {take.key}")
        return replace(take, monocular=poses, files={**take.files, "monocular": folder})

    return add
