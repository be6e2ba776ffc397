"""AdaFuse's and H36M-toolbox's ``h36m_{validation,train}.pkl``: one record per image.

subject, action (2 to 16), subaction (1, 2), camera_id (0 to 3), image_id, joints_2d (17, 2), joints_3d
(17, 3), joints_vis, box and camera {R, T, fx, fy, cx, cy, k (3), p (2)} with **x_cam = R (X − T)**. Some
versions hold joints_3d in the camera's frame and some in the world; which it is shows when it is projected.
joints_2d is the projected truth, so without other detections the data are an oracle.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._skelsplat import project
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import Wanted, as_detections
from skelsplat.datasets._files import (
    Survey,
    Value,
    build_rig,
    camera_at_centre,
    flags,
    images_of,
    making,
    stacked,
)
from skelsplat.datasets._model import Take
from skelsplat.datasets._verify import body_size, is_human
from skelsplat.datasets.human36m._common import CAMERAS, NUMBERED, SIZES, SUBJECTS, Options
from skelsplat.exceptions import DatasetError
from skelsplat.layouts import H36M17

NAME = "adafuse"
HAS = "h36m_validation.pkl"
DETECTOR = "gt"
_TRAIN = "h36m_train.pkl"
_AGREE_MM = 5.0

Frames = dict[int, dict[int, Value]]


def locate(root: Path) -> Path | None:
    """Return the folder with the pickles: the root or ``annot`` in it; or the root if it is a pickle."""
    if root.is_file():
        return root if root.suffix == ".pkl" else None
    folders = (root, root / "annot", root / "h36m" / "annot")
    return next((f for f in folders if (f / HAS).is_file() or (f / _TRAIN).is_file()), None)


def takes(root: Path, options: Options, survey: Survey) -> Iterator[Take]:
    """Give the takes in the pickles: S9 and S11 are the validation set."""
    asked = set(options.subjects or ("S1", "S9"))
    files = {root / HAS: asked & set(SUBJECTS), root / _TRAIN: asked - set(SUBJECTS)}
    paths = [root] if root.is_file() else [path for path, some in files.items() if some]
    grouped: dict[tuple[str, str], tuple[Path, Frames]] = {}
    for path in paths:
        for (who, action, subaction, frame), views in images_of(survey.find([path], "annotations")).items():
            record = next(iter(views.values()))
            if action not in NUMBERED:
                raise record["action"].error("2 to 16", action)
            if not set(views) <= set(range(len(CAMERAS))):
                raise record["camera_id"].error("0 to 3", sorted(views))
            key = f"S{who}", f"{NUMBERED[action]}-{subaction}"
            grouped.setdefault(key, (path, {}))[1][frame] = views
    subjects = options.chosen(root, {subject for subject, _ in grouped})
    for (subject, activity), (path, frames) in grouped.items():
        if subject in subjects:
            yield _take(path, subject, activity, frames, survey)


def _take(path: Path, subject: str, activity: str, frames: Frames, survey: Survey) -> Take:
    """Return a take; frames that not all views have are left out."""
    key = f"{subject}/{activity}"
    complete = sorted(frame for frame, records in frames.items() if len(records) == len(CAMERAS))
    if 2 * len(complete) < len(frames):
        got = f"{len(complete)} of {len(frames)} frames in all four"
        raise DatasetError(path, f"{key}, image_id", "the same frames in every view", got)
    if len(complete) < len(frames):
        survey.notes.append(f"{key}: {len(frames) - len(complete)} frames left out, not seen by every view")
    rows = [[frames[frame][view] for view in range(len(CAMERAS))] for frame in complete]
    cameras = [
        camera_at_centre(record["camera"], size=SIZES[name], name=name)
        for name, record in zip(CAMERAS, rows[0], strict=True)
    ]
    rig, numbered = build_rig(path, cameras), np.array(complete, dtype=np.int64)
    given = Value(path, f"{key}, joints_3d", stacked(rows, "joints_3d", H36M17.n_joints, 3))
    pixels = stacked(rows, "joints_2d", H36M17.n_joints, 2)
    seen = flags(rows, "joints_vis", H36M17.n_joints) > 0
    value = Value(path, f"{key}, joints_2d", np.concatenate([pixels, seen[..., None]], axis=-1))
    detections = as_detections(value, Wanted(key, numbered, CAMERAS, H36M17))
    return Take(
        key,
        subject,
        activity.partition("-")[0],
        rig,
        numbered,
        _world(given, detections[..., :2], rig),
        detections=detections,
        boxes=stacked(rows, "box", 4),
        files={"truth": path, "detections": path, "cameras": path},
    )


def _world(given: Value, pixels: Array, rig: CameraRig) -> Array:
    """Return the poses (T, 17, 3) in the world from those in the records (T, M, 17, 3)."""
    poses: Array = given.content
    moved = np.stack([(poses[:, v] - c.t) @ c.R for v, c in enumerate(rig)], axis=1)
    with making(given.path, given.place, "poses that can be projected"):
        in_camera, in_world = (_misfit(some, pixels, rig) for some in (moved, poses))
    chosen = poses if in_world < in_camera else moved
    apart = float(np.abs(chosen - chosen[:, :1]).max())
    if not apart <= _AGREE_MM and is_human(body_size(poses)):  # else it is the unit, and verified later
        raise given.error("the same pose in all views of a frame", f"poses that are {apart:.3g} mm apart")
    return np.ascontiguousarray(chosen[:, 0])


def _misfit(poses: Array, pixels: Array, rig: CameraRig) -> float:
    """Return the median distance of projected poses (T, M, 17, 3) from the pixels; infinite without any."""
    with np.errstate(over="ignore"):
        apart = [
            np.linalg.norm(project(poses[:, v], [camera])[0] - pixels[:, v], axis=-1)
            for v, camera in enumerate(rig)
        ]
    seen = np.concatenate([values[~np.isnan(values)] for values in apart])
    return float(np.median(seen)) if seen.size else float("inf")
