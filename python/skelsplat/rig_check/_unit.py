"""Whether a body measured in the calibration's unit has the size of a person, or of any body."""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.rig_check._findings import Finding
from skelsplat.rig_check._scene import Array, median

# twice the distance from the middle joint that four joints in five keep within: 1.4 m standing, 0.8 m
# curled up
_PERSON_MM = (400.0, 3000.0)
# of a body that need not be a person's
_ANYTHING_MM = (1.0, 20_000.0)
_TYPICAL_MM = 1300.0
_SHARE = 80.0
_FRAMES = 30
_LEAST_JOINTS = 8


def check_unit(rig: sk.CameraRig, detections: Array, layout: sk.Layout | None) -> tuple[Finding | None, str]:
    """Compare the size of the body in detections (T, M, N, 2) with a person's, if the layout is a person's.

    Plain triangulation, which knows no unit, is used, and sizes in every frame, so that neither a wrong unit
    nor a few wrong detections matter. Returns the finding, and the unit in which the rig is plausible.
    """
    some = np.unique(np.linspace(0, len(detections) - 1, min(_FRAMES, len(detections))).round().astype(int))
    points = np.asarray(sk.triangulate(detections[some], rig, method="dlt"))
    size = median(np.array([_size(frame) for frame in points]))
    if not np.isfinite(size):
        return None, rig.unit
    if _may_be_anything(layout):
        return _of_anything(size * rig.mm_per_unit, rig.unit), rig.unit
    return _of_person(size, rig.unit)


def _may_be_anything(layout: sk.Layout | None) -> bool:
    """Whether the layout is the user's own: an animal, a hand. The built-in ones are people's."""
    return layout is not None and all(layout != sk.layouts.get(name) for name in sk.layouts.names)


def _of_anything(size_mm: float, stated: str) -> Finding | None:
    if _ANYTHING_MM[0] <= size_mm <= _ANYTHING_MM[1]:
        return None
    text = f"In {stated} the body measures about {_length(size_mm)}: is that the calibration's unit?"
    return Finding("unit", (), text, {"stated": stated, "size_mm": size_mm})


def _of_person(size: float, stated: str) -> tuple[Finding | None, str]:
    size_mm = size * MM_PER_UNIT[stated]
    if _is_person(size_mm):
        return None, stated
    likely = min(MM_PER_UNIT, key=lambda unit: abs(np.log(size * MM_PER_UNIT[unit] / _TYPICAL_MM)))
    measured = f"In {stated} the person measures about {_length(size_mm)}"
    numbers = {"stated": stated, "size_mm": size_mm}
    if not _is_person(size * MM_PER_UNIT[likely]):
        text = f"{measured}, which no unit of mm, cm or m mends: was the calibration scaled?"
        return Finding("unit", (), text, numbers), stated
    text = f'{measured}: the unit of the calibration is most likely "{likely}".'
    return Finding("unit", (), text, {**numbers, "likely": likely}), likely


def _size(points: Array) -> float:
    known = points[np.isfinite(points).all(axis=-1)]
    if len(known) < _LEAST_JOINTS:
        return float("nan")
    return 2.0 * float(np.percentile(np.linalg.norm(known - np.median(known, axis=0), axis=1), _SHARE))


def _is_person(size_mm: float) -> bool:
    return _PERSON_MM[0] <= size_mm <= _PERSON_MM[1]


def _length(mm: float) -> str:
    if mm >= 1000.0:
        return f"{mm / 1000.0:.3g} m"
    return f"{mm / 10.0:.3g} cm" if mm >= 10.0 else f"{mm:.3g} mm"
