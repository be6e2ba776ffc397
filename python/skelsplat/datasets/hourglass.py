"""Human3.6M with the hourglass detections of 3d-pose-baseline: four cameras, 16 joints, mm; one npz per take.

``S9_Walking_1.npz`` has ``subject`` and ``sequence`` ("Walking 1"); of each camera ``camera_names``, ``K``,
``R``, ``t`` (x_cam = R X + t, mm), ``dist`` and ``image_size`` (width, height); ``det2d`` (T, 4, 1, J, 3),
pixels and confidence of the ``det_joints``; ``gt3d`` (T, 1, G, 3), mm, of the ``gt_joints``; and ``pairs``
(P, 2), which joint of the one is which of the other. ``frames`` and ``fps`` are of the videos.

Joints go to their places in h36m17, whose spine has no detection and so no truth. MPII's upper neck and head
top take those of nose and head, but are other points than the motion capture has there, so that only the
table of joints shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._fields import Field
from skelsplat._skelsplat import Camera
from skelsplat.datasets._detections import Wanted, as_detections
from skelsplat.datasets._files import Survey, build_rig, frames_in, making
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets.human36m import SUBJECTS, action_of, order_of, subjects_of
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import array_names, npz_fields
from skelsplat.layouts import H36M17

LIMBS = tuple(
    f"{side}_{joint}"
    for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    for side in ("right", "left")
)
"""Joints of arms and legs, which the detector and the motion capture both have."""

_NAMES = {"thorax": "neck", "upper_neck": "nose", "head_top": "head"}
_SIDES = {"r": "right", "l": "left"}


def read(root: Path, survey: Survey, *, subjects: Sequence[str] | None = SUBJECTS) -> Dataset:
    """Read the takes of some `subjects`, None for all, in the order of the tables."""
    paths = sorted(root.glob("S*_*.npz"))
    if not paths:
        raise survey.lacks([root / "S9_Walking.npz"], "takes")
    chosen = subjects_of(root, (path.name.partition("_")[0] for path in paths), subjects)
    takes = [_take(survey.found(path)) for path in paths if path.name.partition("_")[0] in chosen]
    source = f"Human3.6M, real, {root.resolve().name}; detections of a stacked hourglass"
    return Dataset("human36m-hourglass", H36M17, tuple(sorted(takes, key=order_of)), "hourglass", source)


def _take(path: Path) -> Take:
    content = npz_fields(path)
    subject, activity = (_text(content[key]) for key in ("subject", "sequence"))
    names = _names(content["camera_names"])
    detected, frames = content["det2d"], frames_in(content)
    t, j, g = len(frames), len(_names(content["det_joints"])), len(_names(content["gt_joints"]))
    pixels = detected.array_of(t, len(names), 1, j, 3)[:, :, 0]
    points = content["gt3d"].array_of(t, 1, g, 3)[:, 0]
    seen = np.full((len(frames), len(names), H36M17.n_joints, 3), np.nan)
    truth = np.full((len(frames), H36M17.n_joints, 3), np.nan)
    for own, true in _pairs(content["pairs"], pixels, points):
        place = _place(content["det_joints"], own)
        seen[:, :, place], truth[:, place] = pixels[:, :, own], points[:, true]
    wanted = Wanted(path.stem, frames, names, H36M17)
    return Take(
        f"{subject}/{activity}",
        subject,
        action_of(activity),
        build_rig(path, _cameras(content, names)),
        frames,
        truth,
        as_detections(Field(path, detected.place, seen), wanted),
        fps=content["fps"].array_of().item(),
        files=dict.fromkeys(("truth", "detections", "cameras"), path),
    )


def _text(field: Field) -> str:
    value = np.asarray(field.value)
    if field.is_missing or value.shape != ():
        raise field.error("a text", field.shown)
    return array_names(field.path, field.place, value[None], 1)[0]


def _names(field: Field) -> tuple[str, ...]:
    return array_names(field.path, field.place, field.value, np.size(field.value))


def _pairs(field: Field, pixels: Array, points: Array) -> Index:
    """Return the pairs of places (P, 2) in both lists of joints."""
    pairs = field.array_of("P", 2).astype(np.int64)
    ends = [pixels.shape[2], points.shape[1]]
    if (pairs < 0).any() or (pairs >= ends).any():
        raise field.error(f"places below {ends[0]} and {ends[1]}", pairs.max(axis=0).tolist())
    return pairs


def _place(field: Field, own: int) -> int:
    """Return the place in h36m17 of a joint of the detector, as "r_hip"."""
    given = _names(field)[own]
    side, _, bare = given.partition("_")
    name = f"{_SIDES[side]}_{bare}" if side in _SIDES else _NAMES.get(given, given)
    if name not in H36M17.joints:
        raise DatasetError(field.path, f"{field.place}[{own}]", "a joint as r_hip, pelvis, thorax", given)
    return H36M17.joints.index(name)


def _cameras(content: Field, names: Sequence[str]) -> list[Camera]:
    m = len(names)
    parts = zip(
        names,
        content["K"].array_of(m, 3, 3),
        content["R"].array_of(m, 3, 3),
        content["t"].array_of(m, 3),
        content["dist"].array_of(m, 5),
        content["image_size"].array_of(m, 2).astype(int).tolist(),
        strict=True,
    )
    with making(content.path, "cameras", "cameras"):
        return [Camera(K, R, t, distortion=lens, size=size, name=name) for name, K, R, t, lens, size in parts]
