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

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.datasets._detections import Wanted, detections_of, poses_file, read_apart, read_truth
from skelsplat.datasets._files import (
    Survey,
    Value,
    build_rig,
    camera_at_centre,
    flags,
    images_of,
    load_json,
    stacked,
)
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._verify import raise_errors, sample
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._files import frame_number
from skelsplat.layouts import OCCLUSION_PERSON15

N_CAMERAS = 8
FOUR_CAMERAS = (1, 3, 5, 7)
SIZE = (1280, 720)
N_JOINTS = OCCLUSION_PERSON15.n_joints

_LARGE_PX = 25.0  # of the truth from its own projection; rounding and lenses are far below
_PX_PER_SCALE = 200.0  # AdaFuse's unit of a box
_CAMERA_KEYS = ("R", "T", "fx", "fy", "cx", "cy", "k", "p")


def read(
    root: Path,
    survey: Survey,
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
    views : int or sequence of int
        8, 4 (cameras 1, 3, 5, 7), or numbers of cameras.
    split : str
        Of the pickle: ``"validation"`` or ``"train"``.
    step : int
        Takes every so many frames; 5 is the test of AdaFuse.
    """
    chosen = _cameras(views)
    if step < 1:
        raise InvalidInputError(f"step: expected an integer >= 1, got {step}")
    one_of("format", format, (None, "adafuse", "skelsplat"))
    survey.format = format or ("skelsplat" if (root / "3d_gt").is_dir() else "adafuse")
    if survey.format == "adafuse":
        tables = {split: _read_pickle(survey, root, split, chosen)}
    else:
        paths = sorted((root / "3d_gt" / "S0").glob("*/poses.npz"))
        if not paths:
            raise survey.lacks([root / "3d_gt" / "S0" / "ACTIVITY" / "poses.npz"], "truth")
        tables = {path.parent.name: _read_arrays(survey, root, path.parent, chosen) for path in paths}
    folder, name = detections_of(survey, root, detector, detections, "resnet50")
    takes: list[Take] = []
    for activity, table in tables.items():
        rows = np.arange(0, len(table.frames), step)
        values, path = None, None
        if folder is not None:
            values, places, path = _detections(survey, folder / activity, table, chosen)
            rows = rows[np.isin(rows, places)]
            values = values[np.searchsorted(places, rows)]
        if table.annotated is not None:
            _check_annotation(table, rows, chosen, table.annotated[rows])
        takes += _takes(table, rows, chosen, values, path)
    words = f"Occlusion-Person, cameras {', '.join(map(str, chosen))}, detections: {name or 'none'}"
    return Dataset("occlusion-person", OCCLUSION_PERSON15, tuple(takes), name, words, tuple(survey.notes))


def _cameras(views: int | Sequence[int]) -> tuple[int, ...]:
    named = {N_CAMERAS: tuple(range(N_CAMERAS)), len(FOUR_CAMERAS): FOUR_CAMERAS}
    chosen = named.get(views, ()) if isinstance(views, int) else tuple(views)
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(N_CAMERAS)):
        raise InvalidInputError(f"views: expected 4, 8 or different cameras of 0 to 7, got {views!r}")
    return chosen


@dataclass(frozen=True)
class _Table:
    """G frames in the order of the source, M chosen cameras."""

    path: Path
    activities: list[str]  # of each frame; names a take
    frames: Index  # (G,): numbers within the activity
    truth: Array  # (G, N, 3) mm
    cameras: list[list[Value]]  # G lists of M tables
    visible: Mask | None = None  # (G, M, N)
    boxes: Array | None = None  # (G, M, 4) px
    annotated: Array | None = None  # (G, M, N, 2) px: the truth in the images, as the source has it


def _read_pickle(survey: Survey, root: Path, split: str, views: Sequence[int]) -> _Table:
    """Read AdaFuse's pickle: one record per image."""
    name = f"unrealcv_{split}.pkl"
    places = [root / "unrealcv" / "annot" / name, root / "annot" / name, root / name]
    path = survey.find(places, f"annotation of the split {split}")
    images = images_of(path)
    whole = {who: found for who, found in images.items() if all(view in found for view in views)}
    if not whole:
        there = sorted(set().union(*images.values()))
        raise DatasetError(path, "camera_id", f"a frame in the cameras {list(views)}", f"cameras {there}")
    if len(whole) < len(images):
        survey.notes.append(f"{len(images) - len(whole)} frames left out, not in every camera")
    rows = [[found[view] for view in views] for found in whole.values()]
    truth = stacked(rows, "joints_gt", N_JOINTS, 3)
    apart = np.ptp(truth, axis=1).reshape(len(rows), -1).max(axis=1) > 1.0
    if apart.any():
        first = rows[int(np.argmax(apart))][0]["joints_gt"]
        raise first.error("the same joints in every camera of a frame", "others")
    centre, half = stacked(rows, "center", 2), _PX_PER_SCALE / 2 * stacked(rows, "scale", 2)
    return _Table(
        path,
        [f"S{who[0]}/action {who[1]} {who[2]}" for who in whole],
        np.array([who[3] for who in whole], dtype=np.int64),
        truth[:, 0],
        [[record["camera"] for record in row] for row in rows],
        flags(rows, "joints_vis_2d", N_JOINTS) > 0.5,
        np.concatenate([centre - half, centre + half], axis=-1),
        stacked(rows, "joints_2d", N_JOINTS, 2),
    )


def _read_arrays(survey: Survey, root: Path, folder: Path, views: Sequence[int]) -> _Table:
    """Read one activity of the SkelSplat authors' layout: ``poses.npz`` and ``cameras.json`` by frame."""
    inside = root / "cameras"
    places = [inside / folder.name / "cameras.json", inside / "cameras.json", root / "cameras.json"]
    by_frame = load_json(survey.find(places, "cameras by frame"))
    truth, joints, own = read_truth(survey, folder, N_JOINTS)
    if not all(name.isdecimal() for name in by_frame.table()):
        raise by_frame.error("a table of frame numbers", "other keys")
    numbered = {frame_number(by_frame.path, name, name): by_frame[name] for name in by_frame.keys}
    frames = np.array(sorted(numbered), dtype=np.int64) if own is None else own
    if unknown := set(frames.tolist()) - set(numbered):
        got = f"frame {min(unknown)}, which is not there"
        raise DatasetError(truth.path, "frames", f"frames of {by_frame.path}", got)
    if len(frames) != len(joints):
        raise truth.error(f"{len(frames)} frames as in {by_frame.path}", len(joints))
    cameras = [[_camera(numbered[frame], view) for view in views] for frame in frames.tolist()]
    return _Table(truth.path, [f"S0/{folder.name}"] * len(frames), frames, joints, cameras)


def _camera(there: Value, view: int) -> Value:
    """Return the table of a camera in the list of a frame."""
    cameras = there.entries()
    if view >= len(cameras):
        raise there.error(f"camera {view} (in a list of 8)", len(cameras))
    return cameras[view]


def _detections(
    survey: Survey, place: Path, table: _Table, views: Sequence[int]
) -> tuple[Array, Index, Path]:
    """Return detections (S, M, N, 3) of the chosen cameras, their rows in the table and their place."""
    together = poses_file(place) is not None
    cameras = tuple(str(view) for view in (range(N_CAMERAS) if together else views))
    rows = np.arange(len(table.frames), dtype=np.int64)
    values, places, path = read_apart(survey, place, Wanted(place.name, rows, cameras, OCCLUSION_PERSON15))
    return (values[:, list(views)] if together else values), places, path


def _takes(
    table: _Table, rows: Index, views: Sequence[int], detections: Array | None, source: Path | None
) -> list[Take]:
    """Group rows of the same activity and cameras into takes."""
    groups: dict[tuple[str, bytes], list[int]] = {}
    for place, row in enumerate(rows.tolist()):
        tables = table.cameras[row]
        numbers = [entry[key].array() for entry in tables for key in _CAMERA_KEYS if key in entry]
        same = b"".join(one.tobytes() for one in numbers)
        groups.setdefault((table.activities[row], same), []).append(place)
    counts: dict[str, int] = {}
    takes = []
    for (activity, _), places in groups.items():
        counts[activity] = counts.get(activity, 0) + 1
        mine = rows[places]
        named = zip(table.cameras[mine[0]], views, strict=True)
        cameras = [camera_at_centre(entry, size=SIZE, name=str(view)) for entry, view in named]
        subject, _, action = activity.partition("/")
        files = {"truth": table.path, "cameras": table.cameras[mine[0]][0].path}
        takes.append(
            Take(
                f"{activity}.{counts[activity]}",
                subject,
                action,
                build_rig(files["cameras"], cameras),
                table.frames[mine],
                table.truth[mine],
                None if detections is None else detections[places],
                boxes=None if table.boxes is None else table.boxes[mine],
                visible=None if table.visible is None else table.visible[mine],
                files=files if source is None else {**files, "detections": source},
            )
        )
    return takes


def _check_annotation(table: _Table, rows: Index, views: Sequence[int], annotated: Array) -> None:
    """Refuse cameras, units or sides with which the truth does not meet its own projections."""
    inside = ((annotated >= 0) & (annotated < np.array(SIZE))).all(axis=-1, keepdims=True)
    pixels = np.concatenate([np.where(inside, annotated, np.nan), inside.astype(np.float64)], axis=-1)
    takes = _takes(table, rows, views, pixels, table.path)
    raise_errors(Dataset("occlusion-person", OCCLUSION_PERSON15, tuple(takes)))
    for take in takes:
        error = sample(take).error()
        if error > _LARGE_PX:
            expected = "cameras (T their centres) that project joints_gt onto joints_2d"
            raise DatasetError(table.path, "camera", expected, f"{error:.0f} px between them in {take.key}")
