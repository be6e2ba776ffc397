"""Whether all poses are in another program's convention, or lengths in another unit, tried on a recording.

=============  ===================================================================================
inverse        camera → world given for world → camera: R' = Rᵀ, t' = −Rᵀ t
axes           y up and z backward (OpenGL, Blender) for y down and z forward: F = diag(1, −1, −1),
               R' = F R, t' = F t
both           camera → world with these axes: R' = F Rᵀ, t' = −F Rᵀ t
=============  ===================================================================================
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, median
from skelsplat._skelsplat import implausible_extent
from skelsplat.cameras import MM_PER_UNIT, altered
from skelsplat.findings import Finding
from skelsplat.rig_check._scene import in_mm, is_gross, judge, some_frames

# what is left of the disagreement when the convention is right
_BETTER = 0.35
_AXES = np.diag([1.0, -1.0, -1.0])
# twice the distance from the middle joint that four joints in five keep within: 1.4 m standing, 0.8 m
# curled up
_PERSON_MM = (400.0, 3000.0)
# the largest body that need not be a person's; it may be as small as it likes
_ANYTHING_MM = 20_000.0
_TYPICAL_MM = 1300.0
_SHARE = 80.0
_LEAST_JOINTS = 8


def _inverse(R: Array, t: Array) -> tuple[Array, Array]:
    return R.T, -R.T @ t


def _axes(R: Array, t: Array) -> tuple[Array, Array]:
    return _AXES @ R, _AXES @ t


_CONVENTIONS: dict[str, tuple[str, Callable[[Array, Array], tuple[Array, Array]]]] = {
    "inverse": ("camera → world instead of world → camera", _inverse),
    "axes": ("with y up and z backward (OpenGL, Blender) instead of y down and z forward", _axes),
    "both": (
        "camera → world with y up and z backward (OpenGL, Blender)",
        lambda R, t: _axes(*_inverse(R, t)),
    ),
}


def find_convention(
    rig: sk.CameraRig, people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, sk.CameraRig]:
    """Say in which convention the poses of all cameras are, if not in this package's; and correct it.

    Of the detections (T, M, P, N, 2) of everybody. Returns None and the rig as given, or the finding and the
    rig with which the cameras agree.
    """
    some = people[some_frames(len(people))]
    before = judge(in_mm(rig), some, layout)
    if not is_gross(before):
        return None, rig
    rigs = {kind: _changed(rig, change) for kind, (_, change) in _CONVENTIONS.items()}
    tried = {kind: judge(in_mm(other), some, layout) for kind, other in rigs.items()}
    kind = min(tried, key=lambda name: tried[name].disagreement)
    after = tried[kind].disagreement
    if is_gross(tried[kind]) or not after <= _BETTER * before.disagreement:
        return None, rig
    words = _CONVENTIONS[kind][0]
    numbers = {"convention": words, "before_px": before.disagreement, "after_px": after}
    return Finding("pose_convention", "error", numbers=numbers), rigs[kind]


def _changed(rig: sk.CameraRig, change: Callable[[Array, Array], tuple[Array, Array]]) -> sk.CameraRig:
    poses = [change(np.asarray(camera.R), np.asarray(camera.t)) for camera in rig]
    made = [altered(camera, R=R, t=t) for camera, (R, t) in zip(rig, poses, strict=True)]
    return sk.CameraRig(made, unit=rig.unit)


def check_unit(rig: sk.CameraRig, detections: Array, layout: sk.Layout | None) -> tuple[Finding | None, str]:
    """Compare the size of the body in detections (T, M, N, 2) with a person's, unless it is known to be none.

    Plain triangulation, which knows no unit, is used, and sizes in every frame, so that neither a wrong unit
    nor a few wrong detections matter. Returns the finding, and the unit in which the rig is plausible.
    """
    points = np.asarray(sk.triangulate(detections[some_frames(len(detections))], rig, method="dlt"))
    size = median(np.array([_size(frame) for frame in points]))
    if not np.isfinite(size):
        return None, rig.unit
    size_mm = size * rig.mm_per_unit
    if layout is not None and not layout.human:  # an animal, a hand
        return _of_anything(size_mm, rig.unit), rig.unit
    if layout is None and size_mm < _PERSON_MM[0] and implausible_extent(points, rig) is None:
        return None, rig.unit  # anything small, before cameras that can be so close together
    return _of_person(size, rig.unit)


def _of_anything(size_mm: float, stated: str) -> Finding | None:
    if size_mm <= _ANYTHING_MM:
        return None
    return Finding("body_size", numbers={"stated": stated, "size_mm": size_mm})


def _of_person(size: float, stated: str) -> tuple[Finding | None, str]:
    size_mm = size * MM_PER_UNIT[stated]
    if _is_person(size_mm):
        return None, stated
    likely = min(MM_PER_UNIT, key=lambda unit: abs(np.log(size * MM_PER_UNIT[unit] / _TYPICAL_MM)))
    numbers = {"stated": stated, "size_mm": size_mm}
    if not _is_person(size * MM_PER_UNIT[likely]):
        return Finding("unit_unknown", "error", numbers=numbers), stated
    return Finding("unit_wrong", "error", numbers={**numbers, "likely": likely}), likely


def _size(points: Array) -> float:
    known = points[np.isfinite(points).all(axis=-1)]
    if len(known) < _LEAST_JOINTS:
        return float("nan")
    return 2.0 * float(np.percentile(np.linalg.norm(known - np.median(known, axis=0), axis=1), _SHARE))


def _is_person(size_mm: float) -> bool:
    return _PERSON_MM[0] <= size_mm <= _PERSON_MM[1]
