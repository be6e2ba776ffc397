"""What may be wrong with all cameras at once: convention of the poses, unit, images, order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, permutations
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, median
from skelsplat._skelsplat import implausible_extent
from skelsplat._words import capitalised, metric, px
from skelsplat.cameras import MM_PER_UNIT, altered
from skelsplat.findings import Finding, Subject
from skelsplat.rig_check._scene import Scene, in_mm, judge, some_frames

Change = Callable[[Array, tuple[int, int]], Array]

_BETTER = 0.35  # what is right leaves less than this part of the disagreement
_RATHER = 0.7  # or less than this, if the exchanged cameras themselves lose half
_HALF = 0.5
_CLEAR = 1.5  # a rival explanation leaves little more
_SAME = 1.05  # in a symmetric rig, what orders or mirrored images leave differs by noise
_ALL_ORDERS = 4  # of so many cameras all orders are tried, of more those that exchange two
_FACTORS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 8 / 3, 3.0, 4.0)
_AXES = np.diag([1.0, -1.0, -1.0])
# twice the distance from the middle joint that four joints in five keep within: 1.4 m standing
_PERSON_MM = (400.0, 3000.0)
_ANYTHING_MM = 20_000.0  # the largest body that need not be a person's; it may be as small as it likes
_TYPICAL_MM = 1300.0
_SHARE = 80.0
_LEAST_JOINTS = 8

_OPENGL = "y up and z backward (OpenGL, Blender)"
_CONVENTIONS: dict[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "camera → world instead of world → camera": lambda R, t: (R.T, -R.T @ t),
    f"with {_OPENGL} instead of y down and z forward": lambda R, t: (_AXES @ R, _AXES @ t),
    f"camera → world with {_OPENGL}": lambda R, t: (_AXES @ R.T, _AXES @ (-R.T @ t)),
}


def find_convention(
    rig: sk.CameraRig, people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, sk.CameraRig]:
    """Find out whether all poses are in another convention, by people (T, M, P, N, 2); correct the rig."""
    some = people[some_frames(len(people))]
    before = judge(in_mm(rig), some, layout)
    if not before.is_gross:
        return None, rig
    tried = []
    for words, change in _CONVENTIONS.items():
        poses = [change(np.asarray(camera.R), np.asarray(camera.t)) for camera in rig]
        made = [altered(camera, R=R, t=t) for camera, (R, t) in zip(rig, poses, strict=True)]
        other = sk.CameraRig(made, unit=rig.unit)
        tried.append((judge(in_mm(other), some, layout), words, other))
    right, words, other = min(tried, key=lambda one: one[0].disagreement)
    given, after = before.disagreement, right.disagreement
    if right.is_gross or not after <= _BETTER * given:
        return None, rig
    sentence = f"The poses of all cameras appear to be {words}: read that way, the cameras agree to "
    sentence += f"{after:.1f} px instead of {given:.0f} px. Convert the calibration before using it."
    numbers = {"convention": words, "before_px": given, "after_px": after}
    return Finding("pose_convention", "error", numbers=numbers, sentence=sentence), other


def check_unit(rig: sk.CameraRig, detections: Array, layout: sk.Layout | None) -> tuple[Finding | None, str]:
    """Compare the size of the body in detections (T, M, N, 2) with a person's; return the likely unit."""
    points = np.asarray(sk.triangulate(detections[some_frames(len(detections))], rig, method="dlt"))
    size = median(np.array([_size(frame) for frame in points]))
    size_mm, unit, likely = size * rig.mm_per_unit, rig.unit, None
    person = layout is None or layout.human  # not an animal, a hand
    if not np.isfinite(size) or (_is_person(size_mm) if person else size_mm <= _ANYTHING_MM):
        return None, unit
    if layout is None and size_mm < _PERSON_MM[0] and implausible_extent(points, rig) is None:
        return None, unit  # anything small, before cameras that can be so close together
    question = "Is that the unit of the calibration?"
    if person:
        best = min(MM_PER_UNIT, key=lambda name: abs(np.log(size * MM_PER_UNIT[name] / _TYPICAL_MM)))
        likely = best if _is_person(size * MM_PER_UNIT[best]) else None
        question = "None of mm, cm and m explains that. Was the calibration scaled?"
    if likely is not None:
        question = f'The unit of the calibration is most likely "{likely}".'
    numbers = {"stated": unit, "size_mm": size_mm, "likely": likely}
    sentence = f"With unit {unit}, the body measures about {metric(size_mm)}. {question}"
    return Finding(
        "unit_wrong", "error" if person else "warning", numbers=numbers, sentence=sentence
    ), likely or unit


def _size(points: Array) -> float:
    known = points[np.isfinite(points).all(axis=-1)]
    if len(known) < _LEAST_JOINTS:
        return float("nan")
    return 2.0 * float(np.percentile(np.linalg.norm(known - np.median(known, axis=0), axis=1), _SHARE))


def _is_person(size_mm: float) -> bool:
    return _PERSON_MM[0] <= size_mm <= _PERSON_MM[1]


def _arranged(axes: tuple[int, int], flipped: tuple[bool, bool]) -> Change:
    """Return the change to x and y taken from these axes, counted from the image's other side if flipped."""

    def change(points: Array, size: tuple[int, int]) -> Array:
        taken = [points[..., axis] for axis in axes]
        ends = zip(taken, size, flipped, strict=True)
        return np.stack([length - 1.0 - value if flip else value for value, length, flip in ends], axis=-1)

    return change


def resizer(factor: float) -> Change:
    """Return the change that undoes resizing by 1 / factor; integers are pixel centres."""
    return lambda points, size: (points + 0.5) * factor - 0.5  # noqa: ARG005


# what the images are → how the detections become those of the calibration's images
CHANGES: dict[str, Change] = {
    "upside down": _arranged((0, 1), (True, True)),
    "mirrored": _arranged((0, 1), (True, False)),
    "turned clockwise by a quarter": _arranged((1, 0), (False, True)),
    "turned anticlockwise by a quarter": _arranged((1, 0), (True, False)),
}
# the same of all cameras, with the factor on lengths
_FOR_ALL: dict[str, tuple[Change, float]] = {
    **{words: (change, 1.0) for words, change in CHANGES.items()},
    "given with y before x": (_arranged((1, 0), (False, False)), 1.0),
    "given in parts of width and height": (lambda points, size: points * np.array(size) - 0.5, 1.0),
    **{f"of images {1 / factor:.3g} times as large": (resizer(factor), factor) for factor in _FACTORS},
}


def correct_files(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[list[Finding], Array]:
    """Find other images and exchanged cameras, and return people (T, M, P, N, 2) with them corrected.

    Few exchanged cameras look nearly like turned or mirrored images in a symmetric rig, or by chance like
    images of another size: an exchange alone is tried next to the images, and the rival is mentioned.
    """
    images, upright, factor = _find_images(cameras, people, layout)
    exchange, corrected = _find_exchange(cameras, upright, layout)
    findings = [finding for finding in (images, exchange) if finding is not None]
    if images is None or len(cameras) > _ALL_ORDERS:
        return findings, corrected
    alone, exchanged = _find_exchange(cameras, people, layout)
    if alone is None:
        return findings, corrected
    # in pixels of the detections as they were given: small images make small errors
    error = judge(cameras, corrected[some_frames(len(people))], layout).disagreement / factor
    ways = [(error, findings, corrected), (float(alone.numbers["after_px"]), [alone], exchanged)]
    if error > _SAME * ways[1][0]:
        ways.reverse()
    (least, found, right), (other, rival, _) = ways
    if other < _CLEAR * least:
        found = [_mentioning(found[0], [finding.numbers for finding in rival]), *found[1:]]
    return found, right


def _mentioning(finding: Finding, rival: Sequence[Mapping[str, Any]]) -> Finding:
    """Return a finding that says what would explain the disagreement almost as well."""
    other = [{key: one[key] for key in ("images", "folders") if key in one} for one in rival]
    numbers = {**finding.numbers, "rivals": [*finding.numbers.get("rivals", ()), other]}
    words = " and ".join(map(_explanation, other))
    sentence = f"{finding.sentence} Almost as good an explanation: {words}."
    return replace(finding, numbers=numbers, sentence=sentence)


def _explanation(numbers: Mapping[str, Any]) -> str:
    """Return a clause on all cameras: other images, or folders that are exchanged."""
    if "images" in numbers:
        return f"the detections of all cameras are {numbers['images']}"
    each = [
        f"those of {owner} belong to {name}" for name, owner in numbers["folders"].items() if owner != name
    ]
    return f"the detections (or calibrations) of cameras are exchanged: {', '.join(each)}"


def _find_images(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, Array, float]:
    """Find out whether all detections are of other images; return people corrected, and the factor."""
    some = people[some_frames(len(people))]
    before = judge(cameras, some, layout)
    if not before.is_gross:
        return None, people, 1.0
    tried = {
        words: judge(cameras, _applied(some, cameras, change), layout).disagreement / factor
        for words, (change, factor) in _FOR_ALL.items()
    }
    words = min(tried, key=lambda name: tried[name])
    given, after = before.disagreement, tried[words]
    if not after < _BETTER * given:
        return None, people, 1.0
    numbers = {"images": words, "before_px": given, "after_px": after}
    error = f"error {px(given, 0)}, {px(after)} after the correction"
    sentence = f"The detections of all cameras are {words} ({error})."
    change, factor = _FOR_ALL[words]
    finding = Finding("images_changed", "error", numbers=numbers, sentence=sentence)
    return finding, _applied(people, cameras, change), factor


def _applied(people: Array, cameras: Sequence[sk.Camera], change: Change) -> Array:
    changed = people.copy()
    for i, camera in enumerate(cameras):
        changed[:, i, ..., :2] = change(people[:, i, ..., :2], camera.size)
    return changed


def _find_exchange(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, Array]:
    """Find out which folder of detections belongs to which camera; return people in that order."""
    some = people[some_frames(len(people))]
    before = judge(cameras, some, layout)
    if not before.is_gross:
        return None, people
    suspects = np.flatnonzero(~(before.left_out <= before.gross_px)).tolist()
    orders = list(_orders(suspects, len(cameras)))
    tried = {order: judge(cameras, some[:, list(order)], layout) for order in orders}
    least = min((scene.disagreement for scene in tried.values()), default=float("inf"))

    def rank(order: tuple[int, ...]) -> tuple[bool, int, float]:  # fewest exchanges of what leaves the same
        same = tried[order].disagreement <= _SAME * least
        return (not same, len(_exchanged(order)) if same else 0, tried[order].disagreement)

    ranked = sorted(orders, key=rank)
    if not ranked or not _is_right(before, tried[ranked[0]], ranked[0]):
        return None, people
    best, given, after = ranked[0], before.disagreement, tried[ranked[0]].disagreement
    names = before.names

    def folders(order: tuple[int, ...]) -> dict[str, Any]:  # by camera, whose folder has its detections
        return {"folders": {names[i]: names[folder] for i, folder in enumerate(order)}}

    numbers = {**folders(best), "before_px": given, "after_px": after}
    error = f"error {px(given, 0)}, {px(after)} after the correction"
    sentence = f"{capitalised(_explanation(numbers))} ({error})."
    subject = Subject(tuple(names[i] for i in _exchanged(best)))
    finding = Finding("cameras_exchanged", "error", subject, numbers, sentence=sentence)
    rivals = [order for order in ranked[1:] if tried[order].disagreement < _CLEAR * after]
    if rivals:
        finding = _mentioning(finding, [folders(rivals[0])])
    return finding, people[:, list(best)]


def _exchanged(order: tuple[int, ...]) -> list[int]:
    return [i for i, folder in enumerate(order) if folder != i]


def _is_right(before: Scene, after: Scene, order: tuple[int, ...]) -> bool:
    """Whether an order sets all right, or those that it exchanges: another may see strangers."""
    moved = _exchanged(order)
    old, new = before.left_out[moved], after.left_out[moved]
    if after.disagreement < _BETTER * before.disagreement:
        return not (new >= _RATHER * old).any()  # NaN, a camera that saw nobody, does not count
    allowed = min(_RATHER * before.disagreement, 2 * before.gross_px)
    return bool(after.disagreement < allowed and (new < _HALF * old).all())


def _orders(suspects: list[int], count: int) -> Iterator[tuple[int, ...]]:
    """Orders other than the given one: all of few cameras, of more the exchanges of two that disagree."""
    if count <= _ALL_ORDERS:
        yield from list(permutations(range(count)))[1:]
        return
    for i, j in combinations(suspects, 2):
        order = list(range(count))
        order[i], order[j] = j, i
        yield tuple(order)
