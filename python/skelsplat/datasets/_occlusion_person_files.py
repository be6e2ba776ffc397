"""The two layouts of Occlusion-Person on disk, as one table with a row per frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets._detections import read_truth
from skelsplat.datasets._files import (
    FloatArray,
    load_json,
    load_pickle,
    numbers,
    require,
    whole_number,
    within,
)
from skelsplat.exceptions import DatasetError
from skelsplat.layouts import OCCLUSION_PERSON15

N_JOINTS = OCCLUSION_PERSON15.n_joints
_PX_PER_SCALE = 200.0
# What the images of one frame have in common.
_FRAME_KEYS = ("subject", "action", "subaction", "image_id")


@dataclass(frozen=True)
class Table:
    """G frames in the order of the source, M chosen cameras."""

    # path, cameras_path: Where truth and cameras are from.
    path: Path
    cameras_path: Path
    activities: list[str]  # of each frame; names a take
    frames: NDArray[np.int64]  # (G,) int64: Numbers within the activity
    truth: FloatArray  # (G, N, 3) mm
    # list of G lists of M (field, table): What the source says of each camera, and where.
    cameras: list[list[tuple[str, Any]]]
    visible: NDArray[np.bool_] | None  # (G, M, N) bool or None
    boxes: FloatArray | None  # (G, M, 4) px or None
    annotated: FloatArray | None  # (G, M, N, 2) px or None: The truth in the images, as the source has it
    notes: list[str]


def read_pickle(path: Path, views: Sequence[int]) -> Table:
    """Read AdaFuse's pickle: one record per image, grouped here by subject, action, subaction and frame.

    Raises `DatasetError` if a chosen camera is nowhere, the views of a frame have different truths, or a
    record is malformed.
    """
    records = load_pickle(path)
    if not isinstance(records, list) or not records:
        raise DatasetError(path, "pickle", "a list of records, one per image", type(records).__name__)
    groups: dict[tuple[int, ...], dict[int, int]] = {}
    for k, record in enumerate(records):
        field = f"[{k}]"
        *who, view = (whole_number(path, field, record, key) for key in (*_FRAME_KEYS, "camera_id"))
        groups.setdefault(tuple(who), {})[view] = k
    there = set().union(*groups.values())
    for view in views:
        if view not in there:
            raise DatasetError(path, "camera_id", f"camera {view}", f"only {sorted(there)}")
    whole = {who: places for who, places in groups.items() if all(view in places for view in views)}
    lost = len(groups) - len(whole)
    notes = [f"{lost} frames left out, not in every camera"] if lost else []
    return _table(path, records, [(who, [whole[who][view] for view in views]) for who in whole], notes)


def _table(
    path: Path, records: list[Any], rows: list[tuple[tuple[int, ...], list[int]]], notes: list[str]
) -> Table:
    if not rows:
        raise DatasetError(path, "camera_id", "a frame that is in every camera", "none")

    def stacked(key: str, shape: tuple[int, ...]) -> FloatArray:
        return np.stack([[_component(path, k, records[k], key, shape) for k in places] for _, places in rows])

    truth = stacked("joints_gt", (N_JOINTS, 3))
    apart = np.ptp(truth, axis=1).reshape(len(rows), -1).max(axis=1) > 1.0
    if apart.any():
        k = rows[int(np.argmax(apart))][1][0]
        raise DatasetError(path, f"[{k}].joints_gt", "the same joints in every camera of a frame", "others")
    centre, scale = stacked("center", (2,)), stacked("scale", (2,))
    half = _PX_PER_SCALE / 2 * scale
    return Table(
        path,
        path,
        [f"S{who[0]}/action {who[1]} {who[2]}" for who, _ in rows],
        np.array([who[3] for who, _ in rows], dtype=np.int64),
        truth[:, 0],
        [
            [(f"[{k}].camera", require(path, f"[{k}]", records[k], "camera")) for k in places]
            for _, places in rows
        ],
        stacked("joints_vis_2d", (N_JOINTS,)) > 0.5,
        np.concatenate([centre - half, centre + half], axis=-1),
        stacked("joints_2d", (N_JOINTS, 2)),
        notes,
    )


def _component(path: Path, k: int, record: Any, key: str, shape: tuple[int, ...]) -> FloatArray:
    """Return the numbers of a record's key; flags may be repeated along a last axis, a scale be one."""
    value = np.asarray(require(path, f"[{k}]", record, key))
    if key == "joints_vis_2d" and value.ndim == 2:
        value = value[:, 0]
    if key == "scale" and value.size == 1:
        value = np.repeat(value.ravel(), 2)
    return numbers(path, within(f"[{k}]", key), value, shape)


def read_arrays(folder: Path, cameras: Path, views: Sequence[int]) -> Table:
    """Read one activity of the SkelSplat authors' layout: ``poses.npz`` and ``cameras.json`` by frame.

    Raises `DatasetError` if a chosen camera is missing or the frames of both do not match.
    """
    path = folder / "poses.npz"
    key, truth, own = read_truth(path, N_JOINTS)
    by_frame = load_json(cameras)
    if not isinstance(by_frame, dict) or not all(name.isdigit() for name in by_frame):
        raise DatasetError(cameras, "JSON", "a table of frame numbers", type(by_frame).__name__)
    frames = np.array(sorted(int(name) for name in by_frame), dtype=np.int64)
    if own is not None:
        unknown = np.setdiff1d(own, frames)
        if len(unknown):
            got = f"frame {unknown[0]}, which is not there"
            raise DatasetError(path, "frames", f"frames of {cameras}", got)
        frames = own
    if len(frames) != len(truth):
        raise DatasetError(path, key, f"{len(frames)} frames as in {cameras}", f"{len(truth)}")
    names = {int(name): name for name in by_frame}
    tables = [
        [_entry(cameras, names[frame], by_frame[names[frame]], view) for view in views]
        for frame in frames.tolist()
    ]
    activities = [f"S0/{folder.name}"] * len(frames)
    return Table(path, cameras, activities, frames, truth, tables, None, None, None, [])


def _entry(path: Path, frame: str, there: Any, view: int) -> tuple[str, Any]:
    """Return where the table of a camera is, and the table; cameras are in a list or by number."""
    if isinstance(there, dict):
        return f"{frame}.{view}", require(path, frame, there, str(view))
    if not isinstance(there, list) or view >= len(there):
        count = len(there) if isinstance(there, list) else type(there).__name__
        raise DatasetError(path, frame, f"camera {view} (in a list of 8)", count)
    return f"{frame}[{view}]", there[view]
