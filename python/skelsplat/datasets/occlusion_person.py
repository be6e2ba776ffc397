"""Occlusion-Person: rendered persons behind furniture, 8 cameras, 15 joints, cameras that differ by frame.

- Format ``"adafuse"``: ``unrealcv/annot/unrealcv_validation.pkl`` (or ``annot/…``);
- format ``"skelsplat"``: ``3d_gt/S0/ACTIVITY/poses.npz`` and ``cameras/cameras.json``
  ({frame: 8 × {R, T, fx, fy, cx, cy}}); the truth is in mm.

In both T is the camera's centre: x_cam = R (X − T). Frames with the same cameras make a take.
Detections are ``2d_DETECTOR/S0/ACTIVITY[/CAMERA]/poses.npz``, for the pickle ACTIVITY = ``validation``: a row
per frame in the order in which the truth first has them (with ``frames``, the rows that are given), all eight
cameras or one folder per camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.datasets._detections import Wanted, detections_of, read_apart, read_truth
from skelsplat.datasets._files import (
    Survey,
    as_numbers,
    find,
    load_json,
    load_records,
    numbers,
    require,
    whole_number,
    within,
)
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._rig import build_rig, camera_at_centre
from skelsplat.datasets._verify import raise_errors, sample
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._files import frame_number
from skelsplat.layouts import OCCLUSION_PERSON15

DESCRIPTION = "Occlusion-Person: rendered persons behind furniture in 8 cameras."

N_CAMERAS = 8
FOUR_CAMERAS = (1, 3, 5, 7)
SIZE = (1280, 720)
_LARGE_PX = 25.0
_CAMERA_KEYS = ("R", "T", "fx", "fy", "cx", "cy", "k", "p")
_FORMATS = ("adafuse", "skelsplat")


def read(
    root: Path,
    *,
    detector: str | None = None,
    detections: Path | str | None = None,
    views: int | Sequence[int] = N_CAMERAS,
    format: str | None = None,
    split: str = "validation",
    step: int = 5,
) -> Dataset:
    """Read Occlusion-Person.

    Parameters
    ----------
    root : Path
    detector : str or None
        Name of the detector, as in ``2d_DETECTOR``; chosen as for Human3.6M when left out.
    detections : Path or None
        A folder of detections outside the root, in place of ``2d_DETECTOR/S0``.
    views : int or sequence of int
        8, 4 (cameras 1, 3, 5, 7), or numbers of cameras.
    format : {"adafuse", "skelsplat"} or None
        None looks.
    split : str
        Of the pickle: ``"validation"`` or ``"train"``.
    step : int
        Takes every so many frames; 5 is the test of AdaFuse.

    Raises
    ------
    DatasetError
        If a file is missing or malformed; names the file and the field.
    InvalidInputError
        If an option's value is unknown.
    """
    chosen = _cameras(views)
    if step < 1:
        raise InvalidInputError(f"step: expected an integer >= 1, got {step}")
    folder, name = detections_of(root, detector, detections)
    takes: list[Take] = []
    notes: list[str] = []
    for activity, table in _tables(root, format, split, chosen):
        found = None if folder is None else _detections(folder, activity, table, chosen)
        rows = np.arange(0, len(table.frames), step)
        values, path = (None, None)
        if found is not None:
            values, places, path = found
            rows = rows[np.isin(rows, places)]
            values = values[np.searchsorted(places, rows)]
        if table.annotated is not None:
            _check_annotation(table, rows, chosen)
        takes += _takes(table, rows, chosen, values, path)
        notes += table.notes
    words = f"Occlusion-Person, cameras {', '.join(map(str, chosen))}, detections: {name or 'none'}"
    return Dataset("occlusion-person", OCCLUSION_PERSON15, tuple(takes), name, words, tuple(notes))


def survey(root: Path, options: Mapping[str, Any]) -> Survey:
    """Say which files are there, with the options of `read`."""
    _cameras(options["views"])
    found = Survey(format=_format(root, options["format"]))
    if found.format == "adafuse":
        found.look(_pickles(root, options["split"]), f"annotation of the split {options['split']}")
    else:
        found.look([root / "cameras" / "cameras.json", root / "cameras.json"], "cameras by frame")
        found.look(sorted((root / "3d_gt" / "S0").glob("*/poses.npz")) or [root / "3d_gt" / "S0"], "truth")
    found.look_for_detections(root, options["detector"], options["detections"], "resnet50")
    return found


def _cameras(views: int | Sequence[int]) -> tuple[int, ...]:
    named = {N_CAMERAS: tuple(range(N_CAMERAS)), len(FOUR_CAMERAS): FOUR_CAMERAS}
    chosen = named.get(views, ()) if isinstance(views, int) else tuple(views)
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(N_CAMERAS)):
        raise InvalidInputError(f"views: expected 4, 8 or different cameras of 0 to 7, got {views!r}")
    return chosen


def _format(root: Path, given: str | None) -> str:
    one_of("format", given, (None, *_FORMATS))
    return given or ("skelsplat" if (root / "3d_gt").is_dir() else "adafuse")


def _pickles(root: Path, split: str) -> list[Path]:
    name = f"unrealcv_{split}.pkl"
    return [root / "unrealcv" / "annot" / name, root / "annot" / name, root / name]


def _tables(root: Path, format: str | None, split: str, views: Sequence[int]) -> list[tuple[str, Table]]:
    """Return the tables by the folder that their detections have."""
    if _format(root, format) == "adafuse":
        path = find(_pickles(root, split), f"annotation of the split {split}")
        return [(split, read_pickle(path, views))]
    folders = sorted(path.parent for path in (root / "3d_gt" / "S0").glob("*/poses.npz"))
    if not folders:
        raise DatasetError(root / "3d_gt" / "S0" / "ACTIVITY" / "poses.npz", "file", "truth", "nothing there")
    places = [root / "cameras" / "cameras.json", root / "cameras.json"]
    found = []
    for folder in folders:
        cameras = find([root / "cameras" / folder.name / "cameras.json", *places], "cameras by frame")
        found.append((folder.name, read_arrays(folder, cameras, views)))
    return found


def _detections(folder: Path, activity: str, table: Table, views: Sequence[int]) -> tuple[Array, Index, Path]:
    """Return detections (S, M, N, 3) of the chosen cameras, their rows in the table and their place."""
    names = tuple(str(view) for view in range(N_CAMERAS))
    place = folder / activity
    rows = np.arange(len(table.frames), dtype=np.int64)
    together = (place / "poses.npz").is_file() or (place / "poses.json").is_file()
    cameras = names if together else tuple(str(view) for view in views)
    wanted = Wanted(activity, rows, cameras, OCCLUSION_PERSON15)
    spellings = [[name, f"cam{name}"] for name in cameras]
    values, places, path = read_apart([(place, ["poses"])], wanted, spellings)
    return (values[:, list(views)] if together else values), places, path


def _takes(
    table: Table, rows: Index, views: Sequence[int], detections: Array | None, source: Path | None
) -> list[Take]:
    """Group rows of the same activity and cameras into takes."""
    groups: dict[tuple[str, bytes], list[int]] = {}
    for place, row in enumerate(rows.tolist()):
        same = b"".join(_signature(table.cameras_path, *entry) for entry in table.cameras[row])
        groups.setdefault((table.activities[row], same), []).append(place)
    counts: dict[str, int] = {}
    files = {"truth": table.path, "cameras": table.cameras_path}
    takes = []
    for (activity, _), places in groups.items():
        counts[activity] = counts.get(activity, 0) + 1
        mine = rows[places]
        cameras = [
            camera_at_centre(table.cameras_path, *table.cameras[mine[0]][m], size=SIZE, name=str(view))
            for m, view in enumerate(views)
        ]
        subject, _, action = activity.partition("/")
        takes.append(
            Take(
                f"{activity}.{counts[activity]}",
                subject,
                action,
                build_rig(table.cameras_path, cameras, "mm"),
                table.frames[mine],
                table.truth[mine],
                None if detections is None else detections[places],
                boxes=None if table.boxes is None else table.boxes[mine],
                visible=None if table.visible is None else table.visible[mine],
                files=files if source is None else {**files, "detections": source},
            )
        )
    return takes


def _signature(path: Path, field: str, entry: Any) -> bytes:
    """Return bytes that are the same for the same camera."""
    keys = [key for key in _CAMERA_KEYS if isinstance(entry, dict) and key in entry]
    return b"".join(as_numbers(path, f"{field}.{key}", entry[key]).tobytes() for key in keys)


def _check_annotation(table: Table, rows: Index, views: Sequence[int]) -> None:
    """Refuse cameras, units or sides with which the truth does not meet its own projections."""
    assert table.annotated is not None
    annotated = table.annotated[rows]
    inside = ((annotated >= 0) & (annotated < np.array(SIZE))).all(axis=-1, keepdims=True)
    pixels = np.concatenate([np.where(inside, annotated, np.nan), inside.astype(np.float64)], axis=-1)
    takes = _takes(table, rows, views, pixels, table.path)
    raise_errors(Dataset("occlusion-person", OCCLUSION_PERSON15, tuple(takes)))
    for take in takes:
        error = sample(take).error()
        if error > _LARGE_PX:
            expected = "cameras (T their centres) that project joints_gt onto joints_2d"
            raise DatasetError(
                table.cameras_path, "camera", expected, f"{error:.0f} px between them in {take.key}"
            )


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
    frames: Index  # (G,) int64: Numbers within the activity
    truth: Array  # (G, N, 3) mm
    # list of G lists of M (field, table): What the source says of each camera, and where.
    cameras: list[list[tuple[str, Any]]]
    visible: Mask | None  # (G, M, N) bool or None
    boxes: Array | None  # (G, M, 4) px or None
    annotated: Array | None  # (G, M, N, 2) px or None: The truth in the images, as the source has it
    notes: list[str]


def read_pickle(path: Path, views: Sequence[int]) -> Table:
    """Read AdaFuse's pickle: one record per image, grouped here by subject, action, subaction and frame."""
    records = load_records(path, "a list of records, one per image")
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

    def stacked(key: str, shape: tuple[int, ...]) -> Array:
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


def _component(path: Path, k: int, record: Any, key: str, shape: tuple[int, ...]) -> Array:
    """Return the numbers of a record's key; flags may be repeated along a last axis, a scale be one."""
    value = np.asarray(require(path, f"[{k}]", record, key))
    if key == "joints_vis_2d" and value.ndim == 2:
        value = value[:, 0]
    if key == "scale" and value.size == 1:
        value = np.repeat(value.ravel(), 2)
    return numbers(path, within(f"[{k}]", key), value, shape)


def read_arrays(folder: Path, cameras: Path, views: Sequence[int]) -> Table:
    """Read one activity of the SkelSplat authors' layout: ``poses.npz`` and ``cameras.json`` by frame."""
    path = folder / "poses.npz"
    key, truth, own = read_truth(path, N_JOINTS)
    by_frame = load_json(cameras)
    if not isinstance(by_frame, dict) or not all(name.isdecimal() for name in by_frame):
        raise DatasetError(cameras, "JSON", "a table of frame numbers", type(by_frame).__name__)
    frames = np.array(sorted(frame_number(cameras, name, name) for name in by_frame), dtype=np.int64)
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
