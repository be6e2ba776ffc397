"""Labels of learnable triangulation: ``human36m-multiview-labels-*.npy``, a pickled table of all frames.

``cameras`` (subject, camera) with R, t, K, dist; ``table`` with subject_idx, action_idx, frame_idx,
keypoints (17, 3) in mm and bbox_by_camera_tlbr (4, 4), all zero where the view is missing. Its 17 joints are
those of Human3.6M in another order. Actions are numbered: "Directions-1". There are no detections in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, Value, build_camera, build_rig, load_npy
from skelsplat.datasets._model import Take
from skelsplat.datasets.human36m._common import CAMERAS, SIZES, Options, action_of
from skelsplat.layouts import H36M17

NAME = "karfly"
HAS = "human36m-multiview-labels-*.npy"
DETECTOR = None

# Place of each h36m17 joint in the file's order: right ankle, knee, hip, left hip, knee, ankle, pelvis,
# spine, thorax, top of the head, right wrist, elbow, shoulder, left shoulder, elbow, wrist, nose.
ORDER = (6, 2, 1, 0, 3, 4, 5, 7, 8, 16, 9, 13, 14, 15, 12, 11, 10)


def locate(root: Path) -> Path | None:
    """Return the file of labels: the root itself, or the first in it (true boxes before others)."""
    if root.is_file():
        return root if root.suffix == ".npy" else None
    found = sorted(path for folder in (root, root / "extra") for path in folder.glob(HAS))
    return min(found, key=lambda path: "GT" not in path.name, default=None)


def takes(path: Path, options: Options, survey: Survey) -> Iterator[Take]:
    """Give the takes in the file of labels."""
    labels = load_npy(survey.found(path))
    subjects, actions = labels["subject_names"].texts(), labels["action_names"].texts()
    chosen = options.chosen(path, subjects)
    table, views = labels["table"], _views(labels)
    columns = [table[key] for key in ("subject_idx", "action_idx", "frame_idx")]
    for column in columns:
        if column.content.dtype.kind not in "iu":
            raise column.error("whole numbers", column.content.dtype)
    whose, what, when = (column.content for column in columns)
    keypoints = table["keypoints"].numbers("rows", H36M17.n_joints, 3)[:, list(ORDER)]
    boxes = _boxes(table["bbox_by_camera_tlbr"], views)
    for subject in chosen:
        rig = _rig(labels["cameras"], subjects.index(subject), views, subject)
        own = whose == subjects.index(subject)
        for index in np.unique(what[own]):
            if not 0 <= index < len(actions):
                raise columns[1].error(f"less than {len(actions)} (action_names)", index)
            activity, rows = actions[index], np.flatnonzero(own & (what == index))
            rows = rows[np.argsort(when[rows], kind="stable")]
            frames = when[rows].astype(np.int64)
            if (np.diff(frames) == 0).any():
                raise columns[2].error(f"each frame of {subject} {activity} once", "some twice")
            files = {"truth": path, "cameras": path}
            take = (f"{subject}/{activity}", subject, action_of(activity), rig, frames, keypoints[rows])
            yield Take(*take, boxes=boxes[rows], files=files)


def _views(labels: Value) -> list[int]:
    """Return the place of each camera in the file."""
    names = labels["camera_names"].texts()
    for name in CAMERAS:
        if name not in names:
            raise labels["camera_names"].error(f"camera {name}", f"only {', '.join(names)}")
    return [names.index(name) for name in CAMERAS]


def _rig(cameras: Value, row: int, views: list[int], subject: str) -> CameraRig:
    shape = np.shape(cameras.content) if isinstance(cameras.content, np.ndarray) else ()
    if len(shape) != 2 or row >= shape[0] or max(views) >= shape[1]:
        raise cameras.error("an entry per subject and camera", f"shape {shape}")
    built = []
    for name, column in zip(CAMERAS, views, strict=True):
        entry = Value(cameras.path, f"cameras[{subject}, {name}]", cameras.content[row, column])
        K, R = (entry[key].numbers(3, 3) for key in ("K", "R"))
        t, lens = (_flat(entry[key]).numbers(count) for key, count in (("t", 3), ("dist", 5)))
        built.append(build_camera(entry, K, R, t, lens, SIZES[name], name))
    return build_rig(cameras.path, built)


def _flat(value: Value) -> Value:
    return Value(value.path, value.place, value.array().ravel())


def _boxes(given: Value, views: list[int]) -> Array:
    """Return left, top, right, bottom from top, left, bottom, right; NaN where the view is missing."""
    boxes = given.numbers("rows", len(views), 4)[:, views][..., [1, 0, 3, 2]]
    boxes[(boxes == 0.0).all(axis=-1)] = np.nan
    return boxes
