"""Occlusion-Person: rendered persons behind furniture, 8 cameras, 15 joints, cameras that differ by frame.

The layout of the method's authors: truth ``3d_gt/S0/ACTIVITY/poses.npz`` in mm, ``cameras/cameras.json``
({frame: 8 × {R, T, fx, fy, cx, cy}}, where T is the camera's centre: x_cam = R (X − T)), and detections
``2d_DETECTOR/S0/ACTIVITY[/CAMERA]/poses.npz``: a row per frame of the truth (or of ``frames``),
all eight cameras or one folder per camera. Frames with the same cameras make a take.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skelsplat._arrays import Index
from skelsplat._fields import Field
from skelsplat.datasets._detections import Wanted, detections_of, poses_file, read_apart, read_truth
from skelsplat.datasets._files import Survey, build_rig, camera_at_centre
from skelsplat.datasets._model import Dataset, Take
from skelsplat.exceptions import InvalidInputError
from skelsplat.io._files import frame_number, json_document
from skelsplat.layouts import OCCLUSION_PERSON15

N_CAMERAS = 8
FOUR_CAMERAS = (1, 3, 5, 7)
SIZE = (1280, 720)

_CAMERA_KEYS = ("R", "T", "fx", "fy", "cx", "cy", "k", "p")


def read(
    root: Path,
    survey: Survey,
    *,
    detector: str | None = None,
    detections: Path | str | None = None,
    views: int | Sequence[int] = N_CAMERAS,
    step: int = 5,
) -> Dataset:
    """Read Occlusion-Person: 8 or 4 views (cameras 1, 3, 5, 7) or numbers of cameras, every `step`-th frame.

    AdaFuse's test takes every fifth.
    """
    chosen = _cameras(views)
    if step < 1:
        raise InvalidInputError(f"step: expected an integer >= 1, got {step}")
    paths = sorted((root / "3d_gt" / "S0").glob("*/poses.npz"))
    if not paths:
        raise survey.lacks([root / "3d_gt" / "S0" / "ACTIVITY" / "poses.npz"], "truth")
    folder, name = detections_of(survey, root, detector, detections, "resnet50")
    takes: list[Take] = []
    for path in paths:
        takes += _activity(survey, root, path.parent, folder, chosen, step)
    words = f"Occlusion-Person, cameras {', '.join(map(str, chosen))}, detections: {name or 'none'}"
    return Dataset("occlusion-person", OCCLUSION_PERSON15, tuple(takes), name, words, tuple(survey.notes))


def _cameras(views: int | Sequence[int]) -> tuple[int, ...]:
    named = {N_CAMERAS: tuple(range(N_CAMERAS)), len(FOUR_CAMERAS): FOUR_CAMERAS}
    chosen = named.get(views, ()) if isinstance(views, int) else tuple(views)
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(N_CAMERAS)):
        raise InvalidInputError(f"views: expected 4, 8 or different cameras of 0 to 7, got {views!r}")
    return chosen


def _activity(
    survey: Survey, root: Path, folder: Path, detections: Path | None, views: Sequence[int], step: int
) -> list[Take]:
    """Return the takes of an activity: its frames with the same cameras."""
    inside, activity = root / "cameras", folder.name
    places = [inside / activity / "cameras.json", inside / "cameras.json", root / "cameras.json"]
    by_frame = json_document(survey.find(places, "cameras by frame"), "cameras by frame")
    truth, joints, _ = read_truth(survey, folder, OCCLUSION_PERSON15.n_joints)
    numbered = {frame_number(by_frame.path, name, name): at for name, at in by_frame.members().items()}
    frames = np.array(sorted(numbered), dtype=np.int64)
    if len(frames) != len(joints):
        raise truth.error(f"{len(frames)} frames as in {by_frame.path}", len(joints))
    files = {"truth": truth.path, "cameras": by_frame.path}
    rows, found = np.arange(0, len(frames), step), None
    if detections is not None:
        place = detections / activity
        together = poses_file(place) is not None
        names = tuple(str(view) for view in (range(N_CAMERAS) if together else views))
        wanted = Wanted(activity, np.arange(len(frames)), names, OCCLUSION_PERSON15)
        values, places_in, files["detections"] = read_apart(survey, place, wanted)
        rows = rows[np.isin(rows, places_in)]
        found = (values[:, list(views)] if together else values)[np.searchsorted(places_in, rows)]
    takes = []
    for k, (tables, where) in enumerate(_same_cameras(numbered, frames[rows], views), start=1):
        cameras = [
            camera_at_centre(table, size=SIZE, name=str(view))
            for table, view in zip(tables, views, strict=True)
        ]
        mine = rows[where]
        rig, seen = build_rig(by_frame.path, cameras), None if found is None else found[where]
        key = f"S0/{activity}.{k}"
        takes.append(Take(key, "S0", activity, rig, frames[mine], joints[mine], seen, files=files))
    return takes


def _same_cameras(
    numbered: dict[int, Field], frames: Index, views: Sequence[int]
) -> list[tuple[list[Field], list[int]]]:
    """Return the tables of the cameras, and which frames have these, in the order of the first of them."""
    groups: dict[bytes, tuple[list[Field], list[int]]] = {}
    for place, frame in enumerate(frames.tolist()):
        there = numbered[frame].entries()
        if max(views) >= len(there):
            raise numbered[frame].error(f"camera {max(views)} (in a list of 8)", len(there))
        tables = [there[view] for view in views]
        numbers = [table[key].array() for table in tables for key in _CAMERA_KEYS if key in table]
        same = b"".join(one.tobytes() for one in numbers)
        groups.setdefault(same, (tables, []))[1].append(place)
    return list(groups.values())
