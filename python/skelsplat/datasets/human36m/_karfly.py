"""Labels of learnable triangulation: ``human36m-multiview-labels-*.npy``, a pickled table of all frames.

``cameras`` (subject, camera) with R, t, K, dist; ``table`` with subject_idx, action_idx, frame_idx,
keypoints (17, 3) in mm and bbox_by_camera_tlbr (4, 4), all zero where the view is missing. Its 17 joints are
those of Human3.6M in another order. Actions are numbered: "Directions-1". There are no detections in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._arrays import Array
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, a_list, as_numbers, load_npy, numbers, require, shape_of, within
from skelsplat.datasets._model import Take
from skelsplat.datasets._rig import build_camera, build_rig
from skelsplat.datasets.human36m._common import CAMERAS, SIZES, Options, Reading, action_of
from skelsplat.exceptions import DatasetError
from skelsplat.layouts import H36M17

NAME = "karfly"
HAS = "human36m-multiview-labels-*.npy"

# Place of each h36m17 joint in the file's order: right ankle, knee, hip, left hip, knee, ankle, pelvis,
# spine, thorax, top of the head, right wrist, elbow, shoulder, left shoulder, elbow, wrist, nose.
ORDER = (6, 2, 1, 0, 3, 4, 5, 7, 8, 16, 9, 13, 14, 15, 12, 11, 10)


def locate(root: Path) -> Path | None:
    """Return the file of labels: the root itself, or the first in it (true boxes before others)."""
    if root.is_file():
        return root if root.suffix == ".npy" else None
    found = sorted(path for folder in (root, root / "extra") for path in folder.glob(HAS))
    return min(found, key=lambda path: "GT" not in path.name, default=None)


def takes(path: Path, options: Options, _: Reading) -> Iterator[Take]:
    """Give the takes in the file of labels."""
    labels = load_npy(path)
    names = [str(name) for name in _list(path, labels, "subject_names")]
    subjects = options.chosen(path, names)
    table = _table(path, labels)
    for subject in subjects:
        yield from _takes(path, labels, subject, table[table["subject_idx"] == names.index(subject)])


def survey(path: Path, _: Options, found: Survey) -> None:
    """Look for the files that `read` opens, apart from `options.detections`."""
    found.look([path], "the labels")


def _list(path: Path, labels: Any, key: str) -> list[Any]:
    return a_list(path, key, require(path, "", labels, key))


def _table(path: Path, labels: Any) -> NDArray[Any]:
    """Return the table; its joints are those wanted."""
    table = require(path, "", labels, "table")
    keypoints = require(path, "table", table, "keypoints")
    if keypoints.shape[1:] != (H36M17.n_joints, 3):
        raise DatasetError(
            path, "table.keypoints", f"{H36M17.n_joints} joints (rows, 17, 3)", keypoints.shape
        )
    for key in ("subject_idx", "action_idx", "frame_idx"):
        if require(path, "table", table, key).dtype.kind not in "iu":
            raise DatasetError(path, within("table", key), "whole numbers", table[key].dtype)
    return np.asarray(table)


def _takes(path: Path, labels: Any, subject: str, rows: NDArray[Any]) -> Iterator[Take]:
    """Give the takes of a subject."""
    actions = _list(path, labels, "action_names")
    rig = _rig(path, labels, subject)
    views = _views(path, labels)
    for index in np.unique(rows["action_idx"]):
        if not 0 <= index < len(actions):
            raise DatasetError(path, "table.action_idx", f"less than {len(actions)} (action_names)", index)
        activity = str(actions[index])
        own = rows[rows["action_idx"] == index]
        own = own[np.argsort(own["frame_idx"], kind="stable")]
        frames = own["frame_idx"].astype(np.int64)
        if (np.diff(frames) == 0).any():
            raise DatasetError(
                path, "table.frame_idx", f"each frame of {subject} {activity} once", "some twice"
            )
        yield Take(
            f"{subject}/{activity}",
            subject,
            action_of(activity),
            rig,
            frames,
            as_numbers(path, "table.keypoints", own["keypoints"][:, list(ORDER)]),
            boxes=_boxes(path, own, views),
            files={"truth": path, "cameras": path},
        )


def _views(path: Path, labels: Any) -> list[int]:
    """Return the place of each camera in the file."""
    names = [str(name) for name in _list(path, labels, "camera_names")]
    for name in CAMERAS:
        if name not in names:
            raise DatasetError(path, "camera_names", f"camera {name}", f"only {', '.join(names)}")
    return [names.index(name) for name in CAMERAS]


def _rig(path: Path, labels: Any, subject: str) -> CameraRig:
    cameras = require(path, "", labels, "cameras")
    if not isinstance(cameras, np.ndarray) or cameras.ndim != 2:
        raise DatasetError(path, "cameras", "an array (subjects, cameras)", f"shape {shape_of(cameras)}")
    row = [str(name) for name in labels["subject_names"]].index(subject)
    built = []
    for name, column in zip(CAMERAS, _views(path, labels), strict=True):
        field = f"cameras[{subject}, {name}]"
        if row >= cameras.shape[0] or column >= cameras.shape[1]:
            raise DatasetError(path, field, "an entry per subject and camera", f"shape {cameras.shape}")
        entry = cameras[row, column]
        K = numbers(path, within(field, "K"), require(path, field, entry, "K"), (3, 3))
        R = numbers(path, within(field, "R"), require(path, field, entry, "R"), (3, 3))
        t = numbers(path, within(field, "t"), _flat(path, field, entry, "t"), (3,))
        lens = numbers(path, within(field, "dist"), _flat(path, field, entry, "dist"), (5,))
        size = SIZES[name]
        built.append(build_camera(path, field, K=K, R=R, t=t, distortion=lens, size=size, name=name))
    return build_rig(path, built, "mm")


def _flat(path: Path, field: str, entry: Any, key: str) -> Array:
    return as_numbers(path, within(field, key), require(path, field, entry, key)).ravel()


def _boxes(path: Path, rows: NDArray[Any], views: list[int]) -> Array | None:
    """Return left, top, right, bottom from top, left, bottom, right; NaN where the view is missing."""
    field = "bbox_by_camera_tlbr"
    if field not in (rows.dtype.names or ()):
        return None
    boxes = as_numbers(path, f"table.{field}", rows[field])
    if boxes.ndim != 3 or boxes.shape[2] < 4 or boxes.shape[1] <= max(views):
        raise DatasetError(path, f"table.{field}", "(rows, cameras, 4)", boxes.shape)
    boxes = boxes[:, views][..., [1, 0, 3, 2]]
    boxes[(boxes == 0.0).all(axis=-1)] = np.nan
    return boxes
