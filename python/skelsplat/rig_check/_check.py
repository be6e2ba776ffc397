"""The order of a check: geometry, unit, exchanged cameras, then what is wrong with single cameras."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat._arrays import numbers, whole_numbers
from skelsplat._skelsplat import check_people
from skelsplat.exceptions import InvalidInputError
from skelsplat.rig_check._causes import explain
from skelsplat.rig_check._convention import find_convention
from skelsplat.rig_check._files import mend_files
from skelsplat.rig_check._findings import CameraRow, Finding, RigReport, once_right
from skelsplat.rig_check._geometry import check_geometry
from skelsplat.rig_check._people import follow
from skelsplat.rig_check._recording import check_recording
from skelsplat.rig_check._scene import Array, Index, Scene, in_mm, median, scene_of
from skelsplat.rig_check._unit import check_unit

if TYPE_CHECKING:
    import numpy.typing as npt

# A camera whose detections are rejected this often, and this many times as often as the others', in so many
# frames or more (less is somebody in the way); two cameras that miss each other by this share of a diagonal.
_REJECTED, _RATIO, _LEAST_FRAMES, _APART = 1 / 3, 3.0, 5, 0.012
_OUTSIDE = 0.05
_MIN_CONFIDENCE = 0.3


def check_rig(
    rig: sk.CameraRig,
    people: npt.ArrayLike | None = None,
    *,
    frames: npt.ArrayLike | None = None,
    layout: str | sk.Layout | None = None,
    min_confidence: float = _MIN_CONFIDENCE,
) -> RigReport:
    """Look for what is wrong with a calibration, alone or with a recording.

    Without detections: lenses, cameras in one place, cameras that look away. With detections of a person
    also the convention of the poses (camera → world? OpenGL's axes?), the unit (is the body as large as a
    person; with a layout of one's own, between 1 mm and 20 m?), detections of other images than the
    calibration's (resized, turned, mirrored), exchanged cameras (every pair is tried), frame offsets between
    cameras, and cameras that were turned or moved; half of the cameras or more mean another recording. A
    cause is named when with it set right all cameras agree clearly better by leave-one-out reprojection; what
    is left over is named as a camera that disagrees. It takes three cameras to say which one is wrong, and
    where half of them are wrong nothing says which half.

    Parameters
    ----------
    rig : CameraRig
    people : (T, M, P, N, 3) or (T, M, N, 2 | 3), optional
        Detections, pixels and confidence; NaN where nobody or nothing is. Of several people the one is judged
        on whom the views agree.
    frames : (T,) int, optional
        Frame numbers, ascending; 0, 1, … when left out.
    layout : str or Layout, optional
        Lets a person stand in a view with left and right exchanged. Give an animal one
        of its own: without a layout, or with a built-in one, it has to be of a person's size.
    min_confidence : float
        Detections below it are not used.

    Returns
    -------
    RigReport
        `findings` in words and a row of numbers for every camera.

    Raises
    ------
    InvalidInputError
        If shapes do not fit, a confidence lies outside [0, 1], or there are fewer than two cameras beside
        detections.
    """
    findings = check_geometry(in_mm(rig))
    if people is None:
        return RigReport(tuple(findings))
    everyone = _checked(people, rig)
    numbers = _numbers(frames, len(everyone))
    shape = sk.layouts.get(layout) if isinstance(layout, str) else layout
    if everyone.shape[-1] == 3:
        everyone = np.where(everyone[..., 2:] >= min_confidence, everyone, np.nan)
    findings += _images(rig, everyone)
    return _with_detections(rig, everyone, numbers, shape, findings)


def _with_detections(
    rig: sk.CameraRig, people: Array, frames: Index, layout: sk.Layout | None, findings: list[Finding]
) -> RigReport:
    convention, rig = find_convention(rig, people, layout)
    unit, likely = check_unit(rig, follow(in_mm(rig), people, layout), layout)
    cameras = in_mm(sk.CameraRig(list(rig), unit=likely))
    given = follow(cameras, people, layout)
    if not np.isfinite(given).any():
        text = "There is no detection to judge the cameras by."
        return RigReport((*findings, Finding("detections", (), text)))
    as_given = scene_of(cameras, given, frames)
    files = mend_files(cameras, people, layout)
    earlier = list(files.findings)
    if earlier:
        given = follow(cameras, files.people, layout)
        unit, likely = check_unit(rig, given, layout)
        cameras = in_mm(sk.CameraRig(list(rig), unit=likely))
    if any(finding.kind == "images" for finding in earlier):
        findings = [finding for finding in findings if "outside" not in finding.numbers]
    causes, mended = explain(scene_of(cameras, given, frames), earlier)
    recording = check_recording(causes, mended)
    if recording is not None:  # what single cameras or their order would explain is chance then
        return RigReport((recording, *findings), tuple(_rows(as_given, as_given)))
    causes += _left_over(mended, [*earlier, *causes])
    if causes and likely == rig.unit:
        unit = None  # a body of no person's size, but the cameras do not agree on it
    found = [finding for finding in (convention, unit, *earlier) if finding is not None]
    return RigReport((*found, *findings, *causes), tuple(_rows(as_given, mended)))


def _checked(people: npt.ArrayLike, rig: sk.CameraRig) -> Array:
    array = numbers(people, "people")
    array = array[:, :, None] if array.ndim == 4 else array
    if len(rig) < 2:
        raise InvalidInputError(f"cameras: expected at least two beside detections, got {len(rig)}")
    if array.ndim != 5 or array.shape[1] != len(rig) or array.shape[4] not in (2, 3) or 0 in array.shape:
        expected = f"shape (T, {len(rig)}, P, N, 3) for {len(rig)} cameras"
        raise InvalidInputError(f"people: expected {expected}, got {array.shape}")
    if array.shape[4] == 3:
        check_people(array)
    return array


def _numbers(frames: npt.ArrayLike | None, count: int) -> Index:
    counts = np.arange(count) if frames is None else whole_numbers(frames, "frames")
    if counts.shape != (count,) or (np.diff(counts) <= 0).any():
        raise InvalidInputError(f"frames: expected {count} ascending numbers, got shape {counts.shape}")
    return counts


def _images(rig: sk.CameraRig, people: Array) -> list[Finding]:
    """Cameras with detections outside their images, or with none at all."""
    findings = []
    for i, (name, camera) in enumerate(zip(rig.names, rig, strict=True)):
        seen = people[:, i, ..., :2]
        seen = seen[np.isfinite(seen).all(axis=-1)]
        width, height = camera.size
        if not len(seen):
            findings.append(Finding("detections", (name,), f"{name} has no detections."))
            continue
        outside = float(((seen < -0.5) | (seen > [width - 0.5, height - 0.5])).any(axis=-1).mean())
        if outside > _OUTSIDE:
            text = (
                f"{name}: {100 * outside:.0f}% of the detections lie outside its image of {width} by "
                f"{height} px: are they of images of this size, not turned, x before y?"
            )
            findings.append(Finding("detections", (name,), text, {"outside": outside}))
    return findings


def _rows(scene: Scene, mended: Scene) -> list[CameraRow]:
    """Numbers of every camera, all together and each against the others; offsets are the mended scene's."""
    detections, rig = scene.judged_detections, list(scene.cameras)
    plain = np.asarray(sk.triangulate(detections, rig, method="dlt"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a unit doubt, which has been looked at
        result = sk.refine(None, detections, rig)
    rows = []
    for i, camera in enumerate(rig):
        there = np.isfinite(detections[:, i, :, 0])
        weight = result.view_weights[:, i][there]
        weight = weight[np.isfinite(weight)]
        rows.append(
            CameraRow(
                name=str(camera.name),
                used=int(there.sum()),
                dlt_px=median(scene.distances(i, plain)),
                robust_px=median(np.asarray(result.reprojection_error)[:, i]),
                weight=float(weight.mean()) if weight.size else float("nan"),
                rejected=float((weight < sk.REJECTED_WEIGHT).mean()) if weight.size else float("nan"),
                left_out_px=float(scene.left_out[i]) if scene.views > 2 else float("nan"),
                best_offset=mended.shifts[i],
                best_offset_px=float(mended.left_out[i]),
            )
        )
    return rows


def _left_over(scene: Scene, earlier: list[Finding]) -> list[Finding]:
    """Cameras that still disagree when everything that was found is set right."""
    rows = _rows(scene, scene)
    if scene.views == 2:
        return _two(scene, rows)
    findings = []
    for i, row in enumerate(rows):
        rejected = [other.rejected for other in rows if other is not row and np.isfinite(other.rejected)]
        usual = float(np.mean(rejected)) if rejected else 1.0
        frames = np.isfinite(scene.seen(i)).any(axis=(1, 2)).sum()
        if frames >= _LEAST_FRAMES and row.rejected >= max(_REJECTED, _RATIO * usual):
            text = (
                f"{row.name} disagrees with the other cameras and nothing that was tried explains it: "
                f"{100 * row.rejected:.0f}% of its detections are rejected, {100 * usual:.0f}% of theirs, "
                f"and they lie {scene.left_out[i]:.0f} px from where the others say"
                f"{once_right(earlier, row.name)}. Look at its image: what it sees, and whether its lens is "
                "the calibration's."
            )
            findings.append(
                Finding("disagrees", (row.name,), text, {"rejected": row.rejected, "others": usual})
            )
    return findings


def _two(scene: Scene, rows: list[CameraRow]) -> list[Finding]:
    error = median(np.array([row.dlt_px for row in rows]))
    limit = _APART * float(np.mean([np.hypot(*camera.size) for camera in scene.cameras])) / 2
    if not error > limit or len(scene.judged) < _LEAST_FRAMES:
        return []
    names = tuple(row.name for row in rows)
    text = (
        f"{names[0]} and {names[1]} disagree: no point is nearer than {error:.1f} px to what they see. With "
        "two cameras nothing says which is wrong, nor whether it is their calibration or their timing."
    )
    return [Finding("disagrees", names, text, {"px": error})]
