"""The order of a check: geometry, unit, exchanged cameras, then what is wrong with single cameras.

Geometry is what a calibration shows by itself: lenses, places and directions that no recording has.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import combinations

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array, Index, median, numbers, whole_numbers
from skelsplat._frozen import frozen, frozen_finding, without_frozen
from skelsplat._words import listed, percent
from skelsplat.association import checked_people
from skelsplat.cameras import altered
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Subject
from skelsplat.rig_check._causes import ONCE, explain
from skelsplat.rig_check._report import ReadAs, RigReport, rows_of, solved, with_remedies
from skelsplat.rig_check._scene import Scene, follow_person, in_mm, scene_of_everybody
from skelsplat.rig_check._whole import check_unit, correct_files, find_convention

# Detections of a camera are rejected this often, and so many times as often as others', in so many frames.
_REJECTED = 1 / 3
_RATIO = 3.0
_LEAST_FRAMES = 5
# A camera that was knocked turns and moves by less than this; one set up again is further off.
_FAR_DEG = 2.5
_FAR_MM = 150.0
_FAR_OFF = 0.03  # of the diagonal: two and a half times what poor detections are off
_OUTSIDE = 0.05
_SWAPPED_SHARE = 0.1  # of a camera's frames, five times that of sound recordings
_SWAPPED_FRAMES = 3
_COPIED = 200  # coordinates that two cameras share
_MIN_CONFIDENCE = 0.3
_VIEW_DEG = (3.0, 150.0)  # degrees: a long telephoto lens and a wide one without a fisheye model
_LIKE_OTHERS = 3.0  # a narrower view is no fault where others are about as narrow: under a microscope
_OFF_CENTRE = 0.3  # a crop hardly puts the principal point out of the middle 60 % of the image
_ASPECT = 1.2
_SAME_PLACE = 1e-3  # centres closer than this part of the rig's width are one place
_PARALLEL_DEG = 10.0  # axes that differ by less do not meet anywhere in particular


def check_rig(
    rig: sk.CameraRig,
    people: npt.ArrayLike | None = None,
    *,
    frames: npt.ArrayLike | None = None,
    layout: str | sk.Layout | None = None,
    read_as: ReadAs | None = None,
) -> RigReport:
    """Look for what is wrong with a calibration, alone or with a recording.

    Alone: lenses, cameras in one place or that look away. With detections also the convention of the poses,
    unit, other images, exchanged cameras, frame offsets, swapped sides, and cameras that were turned or
    moved; half of the cameras or more mean another recording. A cause is named if with it corrected all
    cameras agree clearly better by leave-one-out reprojection, what is left over as a camera that disagrees.
    It takes three cameras to tell which one is wrong. An `InvalidInputError` if shapes, confidences or the
    layout do not fit, or there are fewer than two cameras.

    Parameters
    ----------
    rig : CameraRig
    people : (T, M, P, N, 3) or (T, M, N, 2 | 3), optional
        Detections, NaN where nobody or nothing is; those of a confidence below 0.3 are not used. Of several
        people, all count on whom three views agree.
    frames : (T,) int, optional
        Frame numbers, ascending; 0, 1, … when left out.
    layout : str or Layout, optional
        Tells left from right. Give an animal one of its own: otherwise it has to be of a person's size.
    read_as : ReadAs, optional
        How the detections were read from files, for the remedies; by default from files of the cameras' names
        without offsets.
    """
    findings = _check_geometry(rig)
    if people is None:
        return RigReport(tuple(findings))
    everyone, counts = _checked(rig, people, frames)
    shape = sk.layouts.get(layout) if isinstance(layout, str) else layout
    if shape is not None and shape.n_joints != everyone.shape[3]:
        raise InvalidInputError(f"layout: expected one of {everyone.shape[3]} joints, got {shape.n_joints}")
    if everyone.shape[-1] == 3:
        everyone = np.where(everyone[..., 2:] >= _MIN_CONFIDENCE, everyone, np.nan)
    findings += _images(rig, everyone)
    repeated = frozen(everyone)
    findings += filter(None, [frozen_finding(rig.names, repeated, counts)])
    same = list(same_detections(rig.names, everyone))
    if same:  # what the cameras' places would explain is chance then
        return RigReport((*same, *findings))
    everyone, files = without_frozen(everyone, repeated), read_as or ReadAs()
    seeing = np.flatnonzero(np.isfinite(everyone[..., :2]).any(axis=(0, 2, 3, 4)))
    if len(seeing) == 2 < len(rig):  # no third one tells which is wrong then
        rig = rig.of([altered(rig[int(i)], name=rig.names[i]) for i in seeing])
        everyone, files = everyone[:, seeing], replace(files, labels=())
    return with_remedies(_with_detections(rig, everyone, counts, shape, findings), files)


def _with_detections(
    rig: sk.CameraRig, people: Array, frames: Index, layout: sk.Layout | None, findings: list[Finding]
) -> RigReport:
    convention, rig = find_convention(rig, people, layout)
    unit, cameras, person = _in_likely_unit(rig, in_mm(rig), people, layout)
    if not np.isfinite(person).any():
        sentence = "There are no detections to check the cameras with."
        return RigReport((*findings, Finding("no_detections", "error", sentence=sentence)))
    as_given = scene = scene_of_everybody(cameras, people, frames, layout)
    earlier, right = correct_files(cameras, people, layout)
    if earlier:
        unit, cameras, _ = _in_likely_unit(rig, cameras, right, layout)
        scene = scene_of_everybody(cameras, right, frames, layout)
    if any(finding.kind == "images_changed" for finding in earlier):
        findings = [finding for finding in findings if finding.kind != "image_sizes_differ"]
    causes, corrected = explain(scene, earlier, layout)
    recording = _check_recording(causes, corrected)
    if recording is not None:  # what single cameras or their order would explain is chance then
        return RigReport((recording, *findings), tuple(rows_of(as_given, as_given)))
    result = solved(corrected, layout)
    causes += _left_over(corrected, result, [*earlier, *causes])
    if causes and unit is not None and unit.numbers["likely"] is None:
        unit = None  # a body of no person's size, but the cameras do not agree on it
    found = [finding for finding in (convention, unit, *earlier) if finding is not None]
    causes += find_swapped(rig.names, result, layout)
    return RigReport((*found, *findings, *causes), tuple(rows_of(as_given, corrected)))


def _in_likely_unit(
    rig: sk.CameraRig, cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, tuple[sk.Camera, ...], Array]:
    """Return the finding on the unit, the cameras in mm by the likely one, and the person it is judged by."""
    person = follow_person(cameras, people, layout)[..., :2]
    unit, likely = check_unit(rig, person, layout)
    return unit, in_mm(sk.CameraRig(list(rig), unit=likely)), person


def _checked(rig: sk.CameraRig, people: npt.ArrayLike, frames: npt.ArrayLike | None) -> tuple[Array, Index]:
    array = numbers(people, "people")
    array = checked_people(array[:, :, None] if array.ndim == 4 else array, rig, values=(2, 3))
    if 0 in array.shape:
        raise InvalidInputError(f"people: expected frames and people, got shape {array.shape}")
    counts = np.arange(len(array)) if frames is None else whole_numbers(frames, "frames")
    if counts.shape != (len(array),) or (np.diff(counts) <= 0).any():
        raise InvalidInputError(f"frames: expected {len(array)} ascending numbers, got shape {counts.shape}")
    return array, counts


def _images(rig: sk.CameraRig, people: Array) -> Iterator[Finding]:
    """Find cameras with detections outside their images, or with none at all."""
    for i, name in enumerate(rig.names):
        subject, (width, height) = Subject((name,)), rig[i].size
        seen = people[:, i, ..., :2]
        seen = seen[np.isfinite(seen).all(axis=-1)]
        if not len(seen):
            yield Finding("no_detections", subject=subject, sentence=f"{name} has no detections.")
            continue
        outside = float(((seen < -0.5) | (seen > [width - 0.5, height - 0.5])).any(axis=-1).mean())
        if outside > _OUTSIDE:
            share = {"outside": outside, "width": width, "height": height}
            sentence = f"{name}: {outside:.0%} of the detections lie outside its image of {width} by "
            sentence += f"{height} px. Are they from images of this size, not rotated, x before y?"
            yield Finding("image_sizes_differ", subject=subject, numbers=share, sentence=sentence)


def same_detections(names: Sequence[str], people: Array) -> Iterator[Finding]:
    """Name cameras whose detections (T, M, …, 2 or more) are copies of each other's."""
    alike: dict[bytes, list[str]] = {}
    for name, view in zip(names, np.moveaxis(people[..., :2], 1, 0), strict=True):
        if np.isfinite(view).sum() >= _COPIED:
            alike.setdefault(sha256(view.tobytes()).digest(), []).append(name)
    for cameras in (tuple(cameras) for cameras in alike.values() if len(cameras) > 1):
        sentence = f"{', '.join(cameras)} have the same detections to the last digit, so they are those of "
        sentence += "one camera. Was a folder or a file copied or linked?"
        yield Finding("detections_same", "error", Subject(cameras), sentence=sentence)


def find_swapped(names: Sequence[str], result: sk.Refinement, layout: sk.Layout | None) -> Iterator[Finding]:
    """Name cameras with left and right swapped in some frames: half of what has a side, and kept."""
    if layout is None or len(names) == 2:
        return
    sides = [joint for pair in layout.left_right for joint in pair]
    weights = np.asarray(result.view_weights)[..., sides]
    used = np.isfinite(weights).sum(axis=2)
    swapped = (np.asarray(result.swapped)[..., sides] & (weights >= sk.REJECTED_WEIGHT)).sum(axis=2)
    frames = ((used > 0) & (2 * swapped >= used)).sum(axis=0).tolist()
    for name, count, of in zip(names, frames, (used > 0).sum(axis=0).tolist(), strict=True):
        if count >= max(_SWAPPED_FRAMES, _SWAPPED_SHARE * of):
            sentence = f"{name}: left and right are swapped in {count / of:.0%} of its frames, compared with "
            sentence += "the other cameras. Refining swaps these detections back. Does the detector confuse "
            sentence += "the sides here?"
            share = {"share_of_frames": count / of}
            yield Finding("sides_swapped", "warning", Subject((name,)), share, sentence=sentence)


def _left_over(scene: Scene, result: sk.Refinement, earlier: list[Finding]) -> Iterator[Finding]:
    """Name cameras that still disagree when everything that was found is corrected."""
    if len(scene.cameras) == 2:
        error = median(scene.left_out)
        if error > scene.gross_px / 2 and len(scene.judged) >= _LEAST_FRAMES:
            sentence = f"{listed(scene.names)} disagree: every 3D point is at least {error:.1f} px from "
            sentence += "their detections. With two cameras, it is impossible to tell which is wrong, and "
            sentence += "whether calibration or timing is."
            subject = Subject(tuple(scene.names))
            yield Finding("camera_disagrees", subject=subject, numbers={"px": error}, sentence=sentence)
        return
    weights = [view[np.isfinite(view)] for view in np.moveaxis(np.asarray(result.view_weights), 1, 0)]
    shares = np.array([(view < sk.REJECTED_WEIGHT).mean() if view.size else np.nan for view in weights])
    for i, name in enumerate(scene.names):
        others = np.delete(shares, i)
        usual = float(np.mean(others[np.isfinite(others)])) if np.isfinite(others).any() else 1.0
        frames = np.isfinite(scene.seen(i)).any(axis=(1, 2)).sum()
        if frames >= _LEAST_FRAMES and shares[i] >= max(_REJECTED, _RATIO * usual):
            rejected, error, once = float(shares[i]), float(scene.left_out[i]), ONCE if earlier else ""
            numbers = {"rejected": rejected, "others": usual, "px": error}
            sentence = f"{name} disagrees with the other cameras, and no tested cause explains it: "
            sentence += f"{percent(rejected)} of its detections are rejected, {percent(usual)} of theirs, "
            sentence += f"and they lie {error:.0f} px from where the others place them{once}. Check that its "
            sentence += "file belongs to this recording, shows the same person and stays synchronised, and "
            sentence += "that lens and focal length are those calibrated."
            yield Finding("camera_disagrees", subject=Subject((name,)), numbers=numbers, sentence=sentence)


def _check_recording(causes: Sequence[Finding], corrected: Scene) -> Finding | None:
    """Doubt the recording if half of the cameras are far turned or moved, or agree with nothing."""
    names = corrected.names
    if len(names) < 3 or len(corrected.judged) < _LEAST_FRAMES:
        return None
    far = [
        one
        for one in causes
        if one.kind == "camera_moved" and (one.numbers["degrees"] >= _FAR_DEG or one.numbers["mm"] >= _FAR_MM)
    ]
    moved = {name for one in far for name in one.subject.cameras}
    limits = _FAR_OFF * np.array([np.hypot(*camera.size) for camera in corrected.cameras])
    lost = corrected.left_out > limits
    wrong = tuple(name for name, off in zip(names, lost, strict=True) if off or name in moved)
    if 2 * len(wrong) < len(names):
        return None
    sentence = "Calibration and detections probably do not belong together (another recording, another rig, "
    sentence += f"or cameras that were moved): {len(wrong)} of {len(names)} cameras ({', '.join(wrong)}) are "
    sentence += "not where the calibration places them. It is impossible to tell which cameras are right."
    return Finding("recording_other", "error", Subject(wrong), {"of": len(names)}, sentence=sentence)


def _check_geometry(rig: sk.CameraRig) -> list[Finding]:
    """Return findings on lenses, on cameras in one place, and on cameras that look away from the others."""
    findings = unusual_lenses(rig)
    if len(rig) < 2:
        return findings
    centres = np.stack([camera.centre for camera in rig])
    return [*findings, *_same_place(rig.names, centres), *_directions(rig, centres)]


def unusual_lenses(rig: sk.CameraRig) -> list[Finding]:
    """Return findings on lenses that hardly any camera has for its image size."""
    narrowest = min(_VIEW_DEG[0], float(np.median([_view(camera) for camera in rig])) / _LIKE_OTHERS)
    return [one for i in range(len(rig)) for one in _lens(rig.names[i], rig[i], narrowest)]


def _view(camera: sk.Camera) -> float:
    """Return the field of view along the longer side, degrees."""
    wide, high = camera.size / np.asarray(camera.K)[[0, 1], [0, 1]]
    return float(np.degrees(2 * np.arctan(max(wide, high) / 2)))


def _lens(name: str, camera: sk.Camera, narrowest: float) -> Iterator[Finding]:
    K, (width, height) = np.asarray(camera.K), camera.size
    (fx, fy), (x, y), view = K[[0, 1], [0, 1]].tolist(), K[:2, 2].tolist(), _view(camera)
    faults = []
    if not camera.fisheye and not narrowest <= view <= _VIEW_DEG[1]:
        faults.append(f"a focal length of {fx:.4g} px is a field of view of {view:.3g}°")
    off = np.abs((K[:2, 2] - [(width - 1) / 2, (height - 1) / 2]) / [width, height])
    if (off > _OFF_CENTRE).any():
        faults.append(f"the principal point ({x:.0f}, {y:.0f}) is far from the middle")
    if not 1 / _ASPECT < fx / fy < _ASPECT:
        faults.append(f"focal lengths of {fx:.4g} and {fy:.4g} px mean pixels that are not square")
    if faults:
        numbers = {"width": width, "height": height, "fx": fx, "fy": fy, "x": x, "y": y, "degrees": view}
        sentence = f"{name}: on images of {width} by {height} px, {', and '.join(faults)}. Is this the image "
        sentence += "size of the calibration, width before height?"
        yield Finding("calibration_unusual", subject=Subject((name,)), numbers=numbers, sentence=sentence)


def _same_place(names: tuple[str, ...], centres: Array) -> Iterator[Finding]:
    width = np.linalg.norm(centres[:, None] - centres, axis=-1).max()
    for i, j in combinations(range(len(names)), 2):
        if np.linalg.norm(centres[i] - centres[j]) <= _SAME_PLACE * width:
            sentence = f"{names[i]} and {names[j]} are in the same place; two views from one place give no "
            sentence += "depth. Is one a copy of the other?"
            yield Finding("calibration_unusual", subject=Subject((names[i], names[j])), sentence=sentence)


def _directions(rig: sk.CameraRig, centres: Array) -> Iterator[Finding]:
    """Find cameras behind which the point lies that the optical axes come nearest to."""
    axes = np.stack([np.asarray(camera.R)[2] for camera in rig])
    if np.abs(axes @ axes.T).min() > np.cos(np.radians(_PARALLEL_DEG)):
        return
    # the point with the least sum of squared distances from the axes
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), (across @ centres[:, :, None]).sum(axis=0)[:, 0])
    depths = ((point - centres) * axes).sum(axis=1)
    away = tuple(name for name, depth in zip(rig.names, depths, strict=True) if depth < 0)
    if len(away) == len(rig):
        sentence = "All cameras look away from the point where their axes come closest. Are rotation and "
        sentence += "translation camera → world instead of world → camera, or does z point backwards?"
        yield Finding("calibration_unusual", sentence=sentence)
    elif away and len(away) <= len(rig) // 2:
        sentence = f"{listed(away)} look{'s' * (len(away) == 1)} away from where the other cameras look."
        yield Finding("calibration_unusual", subject=Subject(away), sentence=sentence)
