"""AdaFuse's and H36M-toolbox's ``h36m_{validation,train}.pkl``: one record per image.

subject, action (2 to 16), subaction (1, 2), camera_id (0 to 3), image_id, joints_2d (17, 2), joints_3d
(17, 3), joints_vis, box and camera {R, T, fx, fy, cx, cy, k (3), p (2)} with **x_cam = R (X − T)**. Some
versions hold joints_3d in the camera's frame and some in the world; which it is shows when it is projected.
joints_2d is the projected truth, so without other detections the data are an oracle.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._arrays import Array
from skelsplat._skelsplat import project
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import Wanted, as_detections
from skelsplat.datasets._files import (
    Survey,
    as_numbers,
    load_records,
    require,
    shape_of,
    whole_number,
    within,
)
from skelsplat.datasets._model import Take
from skelsplat.datasets._rig import build_rig, camera_at_centre
from skelsplat.datasets._verify import body_size, is_human
from skelsplat.datasets.human36m._common import CAMERAS, NUMBERED, SIZES, Options, Reading
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import of_file
from skelsplat.layouts import H36M17

NAME = "adafuse"
HAS = "h36m_validation.pkl"
_TRAIN = "h36m_train.pkl"
_AGREE_MM = 5.0

Record = dict[str, Any]
Frames = dict[int, dict[int, Record]]


def locate(root: Path) -> Path | None:
    """Return the folder with the pickles: the root or ``annot`` in it; or the root if it is a pickle."""
    if root.is_file():
        return root if root.suffix == ".pkl" else None
    folders = (root, root / "annot", root / "h36m" / "annot")
    return next((f for f in folders if (f / HAS).is_file() or (f / _TRAIN).is_file()), None)


def takes(root: Path, options: Options, reading: Reading) -> Iterator[Take]:
    """Give the takes in the pickles."""
    grouped: dict[tuple[str, str], tuple[Path, Frames]] = {}
    for path in _paths(root, options):
        for place, record in enumerate(load_records(path, "a list of records")):
            key, frame, view = _place(path, f"[{place}]", record)
            _, frames = grouped.setdefault(key, (path, defaultdict(dict)))
            if view in frames[frame]:
                raise DatasetError(path, f"[{place}]", f"frame {frame} of {key} once per camera", "twice")
            frames[frame][view] = record
    subjects = options.chosen(root, {subject for subject, _ in grouped})
    if options.detections is None:
        reading.detector = "gt"
    for (subject, activity), (path, frames) in grouped.items():
        if subject in subjects:
            yield _take(path, subject, activity, frames, reading)


def survey(root: Path, options: Options, found: Survey) -> None:
    """Look for the files that `read` opens, apart from `options.detections`."""
    for path in _paths(root, options):
        found.look([path], "the annotations")


def _paths(root: Path, options: Options) -> list[Path]:
    """Return the pickles with the subjects wanted: S9 and S11 are the validation set."""
    if root.is_file():
        return [root]
    wanted = set(options.subjects or ("S1", "S9"))
    paths = [root / HAS] if wanted & {"S9", "S11"} else []
    return [*paths, root / _TRAIN] if wanted - {"S9", "S11"} else paths


def _place(path: Path, field: str, record: Any) -> tuple[tuple[str, str], int, int]:
    """Return subject and activity, frame, and view of a record."""
    keys = ("subject", "action", "subaction", "image_id", "camera_id")
    values = {key: whole_number(path, field, record, key) for key in keys}
    if values["action"] not in NUMBERED:
        raise DatasetError(path, within(field, "action"), "2 to 16", values["action"])
    if not 0 <= values["camera_id"] < len(CAMERAS):
        raise DatasetError(path, within(field, "camera_id"), "0 to 3", values["camera_id"])
    activity = f"{NUMBERED[values['action']]}-{values['subaction']}"
    return (f"S{values['subject']}", activity), values["image_id"], values["camera_id"]


def _take(path: Path, subject: str, activity: str, frames: Frames, reading: Reading) -> Take:
    """Return a take; frames that not all views have are left out."""
    key = f"{subject}/{activity}"
    views = {view for records in frames.values() for view in records}
    for view, name in enumerate(CAMERAS):
        if view not in views:
            raise DatasetError(path, f"{key}, camera_id", f"records of camera {view} ({name})", "none")
    complete = sorted(frame for frame, records in frames.items() if len(records) == len(CAMERAS))
    if 2 * len(complete) < len(frames):
        got = f"{len(complete)} of {len(frames)} frames in all four"
        raise DatasetError(path, f"{key}, image_id", "the same frames in every view", got)
    if len(complete) < len(frames):
        reading.notes.append(f"{key}: {len(frames) - len(complete)} frames left out, not seen by every view")
    rows = [[frames[frame][view] for view in range(len(CAMERAS))] for frame in complete]
    cameras = []
    for name, record in zip(CAMERAS, rows[0], strict=True):
        field, values = f"{key}, camera {name}", require(path, f"{key}, camera {name}", record, "camera")
        cameras.append(camera_at_centre(path, field, values, size=SIZES[name], name=name))
    rig = build_rig(path, cameras, "mm")
    given = _stack(path, key, rows, "joints_3d", 3)
    numbered = np.array(complete, dtype=np.int64)
    detections = _detections(path, key, rows, numbered)
    return Take(
        key,
        subject,
        activity.partition("-")[0],
        rig,
        numbered,
        _world(path, key, given, detections[..., :2], rig),
        detections=detections,
        boxes=_boxes(path, key, rows),
        files={"truth": path, "detections": path, "cameras": path},
    )


def _stack(path: Path, key: str, rows: list[list[Record]], name: str, axes: int) -> Array:
    """Return (T, M, 17, axes) of the records."""
    joints = H36M17.n_joints
    for records in rows:
        for record in records:
            shape = shape_of(require(path, key, record, name))
            if shape != (joints, axes):
                expected = f"{joints} joints of {H36M17.name} ({joints}, {axes})"
                raise DatasetError(path, f"{key}, {name}", expected, f"shape {shape}")
    return as_numbers(path, f"{key}, {name}", [[record[name] for record in records] for records in rows])


def _detections(path: Path, key: str, rows: list[list[Record]], frames: Any) -> Array:
    pixels = _stack(path, key, rows, "joints_2d", 2)
    seen: NDArray[Any] = np.ones(pixels.shape[:3])
    if all("joints_vis" in record for records in rows for record in records):
        marks = as_numbers(path, f"{key}, joints_vis", [[record["joints_vis"] for record in r] for r in rows])
        if marks.shape[:3] == seen.shape and marks.ndim in (3, 4):
            seen = (marks if marks.ndim == 3 else marks[..., 0]) > 0
    value = np.concatenate([pixels, seen[..., None]], axis=-1)
    return as_detections(path, f"{key}, joints_2d", value, Wanted(key, frames, CAMERAS, H36M17))


def _world(path: Path, key: str, given: Array, pixels: Array, rig: CameraRig) -> Array:
    """Return the poses (T, 17, 3) in the world from those in the records (T, M, 17, 3)."""
    moved = np.stack([(given[:, v] - c.t) @ c.R for v, c in enumerate(rig)], axis=1)
    try:
        in_camera, in_world = (_misfit(poses, pixels, rig) for poses in (moved, given))
    except InvalidInputError as error:  # numbers that nothing is projected from
        raise of_file(path, error) from error
    poses = given if in_world < in_camera else moved
    apart = float(np.abs(poses - poses[:, :1]).max())
    if not apart <= _AGREE_MM and is_human(body_size(given)):  # else it is the unit, and verified later
        got = f"poses that are {apart:.3g} mm apart"
        raise DatasetError(path, f"{key}, joints_3d", "the same pose in all views of a frame", got)
    return np.ascontiguousarray(poses[:, 0])


def _misfit(poses: Array, pixels: Array, rig: CameraRig) -> float:
    """Return the median distance of projected poses (T, M, 17, 3) from the pixels; infinite without any."""
    with np.errstate(over="ignore"):
        apart = [
            np.linalg.norm(project(poses[:, v], [camera])[0] - pixels[:, v], axis=-1)
            for v, camera in enumerate(rig)
        ]
    seen = np.concatenate([values[~np.isnan(values)] for values in apart])
    return float(np.median(seen)) if seen.size else float("inf")


def _boxes(path: Path, key: str, rows: list[list[Record]]) -> Array | None:
    """Return left, top, right, bottom, if the records have them."""
    boxes = [[record.get("box") for record in records] for records in rows]
    if any(shape_of(box) != (4,) for row in boxes for box in row):
        return None
    return as_numbers(path, f"{key}, box", boxes)
