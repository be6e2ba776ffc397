"""Shelf and Campus: several people, few cameras, 14 joints.

- ``calibration_NAME.json`` as VoxelPose wrote it: {"0": {k, p, R, T, fx, fy, cx, cy}}, mm, x_cam = R (X − T);
- truth ``actorsGT.mat``, key ``actor3D``: cells of actors, of frames, of (14, 3) **metres**, empty where an
  actor is not labelled;
- detections of everybody, in which nothing says who is who: ``2d_DETECTOR/S0/people.npz``, key ``people``
  (T, M, P, N, 3), NaN where there is nothing, and ``frames`` (T,), from 0; or
  ``pred_NAME_DETECTOR_coco.pkl`` as VoxelPose has it: {"CAMERA_FRAME": [{"pred": (17, 3)}, …]}. 17 joints
  are COCO-17 and become the 14, neck and head top interpolated from shoulders and ears.

Each actor is a take; frames are those in which it is labelled. The takes have the detections that are nearest
to the projected truth (oracle association).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index, corners
from skelsplat._fields import Field
from skelsplat._optional import require
from skelsplat._skelsplat import project
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import choose_detector, detector_name, detectors_of
from skelsplat.datasets._files import Survey, build_rig, camera_at_centre, frames_in
from skelsplat.datasets._model import Dataset, PeopleTake, Take
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import npz_fields
from skelsplat.io._files import json_document
from skelsplat.io._guarded import read_guarded, unpickle
from skelsplat.layouts import COCO17, SHELF14

Actors = Sequence[tuple[Index, Array]]
"""Frames (T,), from 0, and joints (T, N, 3) mm of each actor, where it is labelled."""

_EVALUATED = 3  # the first actors
_FPS = 25.0
_MM_PER_M = 1000.0
# A detection may be somebody's if its joints are this near to the projected ones on average, as a share of
# the diagonal of the person's box in the view; and if they have so many joints in common.
_NEAR, _FEWEST_JOINTS = 0.2, 4
_FORBIDDEN_PX = 1e6  # more than any allowed pairs cost together
_FROM_COCO = (16, 14, 12, 11, 13, 15, 10, 8, 6, 5, 7, 9)
"""The 12 limb joints of SHELF14 in COCO-17."""


def _read(
    scene: str,
    size: tuple[int, int],
    n_cameras: int,
    root: Path,
    survey: Survey,
    *,
    detector: str | None = None,
    detections: Path | str | None = None,
) -> Dataset:
    """Read the data set; `detections` is a file of everybody."""
    file, inside = f"calibration_{scene}.json", root / scene.capitalize()
    places = [root / file, inside / file, root / "cameras" / file]
    calibration = survey.find(places, f"calibration of {scene}")
    truth = survey.find([root / "actorsGT.mat", inside / "actorsGT.mat"], f"truth of {scene}")
    content, names = json_document(calibration, "cameras"), [str(k) for k in range(n_cameras)]
    cameras = [camera_at_centre(content.member(name, "a camera"), size=size, name=name) for name in names]
    rig, actors = build_rig(calibration, cameras), _actors(truth)
    everybody, name = _detections(scene, root, survey, detector, detections)
    files = {"truth": truth, "cameras": calibration}
    scenes = () if everybody is None else (_people(everybody, rig, actors, files),)
    if scenes:
        takes = scenes[0].apart("S0")
    else:
        takes = tuple(
            Take(f"S0/actor{k}", "S0", f"actor{k}", rig, frames, joints, fps=_FPS, files=files)
            for k, (frames, joints) in enumerate(actors[:_EVALUATED])
            if len(frames)
        )
    words = f"{scene.capitalize()}, one take per actor, detections: {name or 'none'}"
    return Dataset(scene, SHELF14, takes, name, words, scenes=scenes)


read_shelf = partial(_read, "shelf", (1032, 776), 5)
read_campus = partial(_read, "campus", (360, 288), 3)


def _detections(
    scene: str, root: Path, survey: Survey, detector: str | None, given: Path | str | None
) -> tuple[Path | None, str | None]:
    """Return the file of everybody, if there is one, and the detector."""
    wanted = None if detector is None else detector_name(detector)
    if given is not None:
        return survey.find([Path(given)], "detections of everybody"), wanted
    there = {name: path / "S0" / "people.npz" for name, path in detectors_of(root).items()}
    for folder in (root, root / scene.capitalize()):
        for path in sorted(folder.glob(f"pred_{scene}_*.pkl")):
            found = re.sub(rf"^pred_{scene}_|(_coco)?\.pkl$", "", path.name)
            there[detector_name(found)] = path
    name = choose_detector(survey, there, detector, root / f"pred_{scene}_DETECTOR_coco.pkl")
    return None if name is None else survey.find([there[name]], f"detections of {name}"), name


def from_coco(detections: Array) -> Array:
    """Return SHELF14 detections (…, 14, 3) of COCO-17 ones (…, 17, 3).

    The neck (bottom of the head) is half-way between the middles of shoulders and ears; the top of the head
    is as far beyond the ears. Both are missing, and as uncertain as the worst, if shoulders or ears are.
    """
    limbs = detections[..., _FROM_COCO, :]
    ears, shoulders = (detections[..., pair, :].mean(axis=-2) for pair in ([3, 4], [5, 6]))
    confidence = detections[..., [3, 4, 5, 6], 2].min(axis=-1)
    bottom = 0.5 * (shoulders + ears)
    head = np.stack([bottom, 2.0 * ears - bottom], axis=-2)
    head[..., 2] = confidence[..., None]
    head[np.isnan(head[..., 0])] = (np.nan, np.nan, 0.0)
    return np.concatenate([limbs, head], axis=-2)


def nearest_slots(truth: Array, rig: CameraRig, people: Array) -> Index:
    """Return which of the detections (T, M, P, N, 3) is nearest to each person's truth (Q, T, N, 3).

    In each view the pairs of least total distance in pixels; a pair that is too far apart is none. Needs
    SciPy. (Q, T, M), −1 = none.
    """
    assign = require("scipy.optimize", "oracle association", "evaluation").linear_sum_assignment
    out = np.full((*truth.shape[:2], len(rig)), -1, dtype=np.int64)
    projected = np.stack([np.asarray(project(one, rig)) for one in truth])  # (Q, M, T, N, 2)
    low, high = corners(projected)
    size = np.linalg.norm(high - low, axis=-1)
    for view in range(len(rig)):
        for t, found in enumerate(people[:, view, ..., :2]):
            gap = np.linalg.norm(projected[:, view, t, None] - found, axis=-1)  # (Q, P, N)
            common = np.isfinite(gap)
            count = common.sum(axis=-1)
            mean = np.where(common, gap, 0.0).sum(axis=-1) / np.maximum(count, 1)
            allowed = (count >= _FEWEST_JOINTS) & (mean <= _NEAR * size[:, view, t, None])
            person, slot = assign(np.where(allowed, mean, _FORBIDDEN_PX))
            fits = allowed[person, slot]
            out[person[fits], t, view] = slot[fits]
    return out


def _people(path: Path, rig: CameraRig, actors: Actors, files: Mapping[str, Path]) -> PeopleTake:
    """Read the detections of everybody; actors who are not evaluated need not be found."""
    frames, people = _everybody(path, rig.names)
    truth = np.full((len(actors), len(frames), SHELF14.n_joints, 3), np.nan)
    for own, (labelled, joints) in zip(truth, actors, strict=True):
        _, here, there = np.intersect1d(frames, labelled, return_indices=True)
        own[here] = joints[there]
    names = tuple(f"actor{k}" for k in range(len(actors)))
    return PeopleTake(
        key="S0",
        rig=rig,
        frames=frames,
        people=people,
        truth=truth,
        names=names,
        slots=nearest_slots(truth, rig, people),
        fps=_FPS,
        waived=names[_EVALUATED:],
        files={**files, "detections": path},
    )


def _everybody(path: Path, cameras: Sequence[str]) -> tuple[Index, Array]:
    """Read frames (T,) and detections (T, M, P, 14, 3), NaN where there is nothing."""
    if path.suffix == ".npz":
        content = npz_fields(path)
        frames = frames_in(content)
        people = content["people"].array_of(len(frames), len(cameras), "people", "joints", 3)
    else:
        frames, people = _of_pickle(path, cameras)
    missing = ~np.isfinite(people[..., :2]).all(axis=-1) | (people[..., :2] == 0.0).all(axis=-1)
    people[..., 2] = np.clip(people[..., 2], 0.0, 1.0)
    people[missing | ~(people[..., 2] > 0.0)] = np.nan
    if people.shape[-2] == COCO17.n_joints:
        people = from_coco(people)
        people[np.isnan(people[..., 0])] = np.nan
    if people.shape[-2] != SHELF14.n_joints:
        raise DatasetError(path, "people", "14 or 17 joints", people.shape[-2])
    return frames, people


def _of_pickle(path: Path, cameras: Sequence[str]) -> tuple[Index, Array]:
    content = Field(path, "", unpickle(path))
    found: dict[tuple[int, int], list[Array]] = {}
    for key, entries in content.members().items():
        place = re.fullmatch(r"(\d+)_(\d+)", str(key))
        if place is None:
            raise DatasetError(path, f"{key!r}", "keys CAMERA_FRAME, such as '0_300'", "this key")
        if place[1] in cameras:
            where = int(place[2]), cameras.index(place[1])
            found[where] = [entry["pred"].array_of(COCO17.n_joints, 3) for entry in entries.entries()]
    if not found:
        raise content.error(f"entries of the cameras {', '.join(cameras)}", "none")
    frames = np.array(sorted({frame for frame, _ in found}), dtype=np.int64)
    most = max(map(len, found.values()))
    people = np.full((len(frames), len(cameras), most, COCO17.n_joints, 3), np.nan)
    for (frame, view), poses in found.items():
        for k, pose in enumerate(poses):
            people[np.searchsorted(frames, frame), view, k] = pose
    return frames, people


def _actors(path: Path) -> Actors:
    """Read the truth."""
    require("scipy.io", str(path), "evaluation")
    expected = "a complete MATLAB file before version 7.3"
    content = Field(path, "", read_guarded("mat", path, expected, names=None))
    actors = _cells(content.member("actor3D", "cells of actors").value)
    while len(actors) == 1 and _cells(actors[0]) and _cells(_cells(actors[0])[0]):
        actors = _cells(actors[0])  # the cell of actors may lie in cells of its own
    lengths = sorted({len(_cells(actor)) for actor in actors})
    if len(lengths) != 1:
        raise content["actor3D"].error("cells of actors with as many frames", f"{lengths} frames")
    return [_actor(path, f"actor3D{{{k + 1}}}", _cells(actor)) for k, actor in enumerate(actors)]


def _cells(value: Any) -> list[Any]:
    is_cell = isinstance(value, np.ndarray) and value.dtype == object
    return list(value.ravel()) if is_cell else []


def _actor(path: Path, field: str, cells: Sequence[Any]) -> tuple[Index, Array]:
    frames, poses = [], []
    for k, value in enumerate(cells):
        pose = np.asarray(value)
        while pose.dtype == object and pose.size == 1:
            pose = np.asarray(pose.ravel()[0])
        if pose.size >= 3:  # else not labelled: an empty matrix, or a single zero
            frames.append(k)
            joints = Field(path, f"{field}{{{k + 1}}}", pose).array_of(SHELF14.n_joints, 3)
            with np.errstate(over="ignore"):  # refused with the take
                poses.append(_MM_PER_M * joints)
    truth = np.stack(poses) if poses else np.empty((0, SHELF14.n_joints, 3))
    return np.array(frames, dtype=np.int64), truth
