"""From a calibration and a recording to cameras that agree with it, by `skelsplat.adjust_cameras`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._clocks import parted, rounded
from skelsplat._words import options
from skelsplat.association import take_people
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Remedy, Severity, Subject, collected_warnings, warn
from skelsplat.io import DetectionSet
from skelsplat.io.detections import cameras_called
from skelsplat.rig_check import ReadAs, RigReport, check_rig
from skelsplat.run.by_everybody import adjust_by_everybody
from skelsplat.run.job import Job
from skelsplat.run.person import EVERYBODY, check_slot, pick_places
from skelsplat.run.read import Inputs, Opened, named_offsets, open_recording, read_everybody
from skelsplat.run.solve import spread

# Frames are put at even times, missing ones between them, unless so many times as many are missing.
_MOST_EMPTY = 8
# Multiples of its error bar from which a clock is off.
_SHOWN = 4.0


@dataclass(frozen=True)
class AdjustedCameras:
    """What became of the cameras of a calibration.

    Attributes
    ----------
    cameras : CameraRig
        All cameras of the calibration, also those that were left out; changed are those that were adjusted.
    adjustment : RigAdjustment
        What `skelsplat.adjust_cameras` returned; clocks are in frames of the files.
    findings : tuple of Finding
        Warnings of the files; what was adjusted, and what is to be done about the other cameras.
    """

    cameras: sk.CameraRig
    adjustment: sk.RigAdjustment
    findings: tuple[Finding, ...]

    @property
    def adjusted(self) -> tuple[str, ...]:
        """The cameras that differ from the calibration; a clock is no part of it."""
        return tuple(one.name for one in self.adjustment.report if is_changed(one))


def is_changed(camera: sk.CameraAdjustment) -> bool:
    """Whether a camera was turned or moved, or its focal length changed."""
    return camera.status == "adjusted" and _is_placed(camera)


def _is_placed(camera: sk.CameraAdjustment) -> bool:
    """Whether more than a clock was changed, or is suspected."""
    return (camera.degrees, camera.distance, camera.focal) != (0.0, 0.0, 1.0)


def adjust_cameras(
    calibration: Path,
    detections: Path,
    *,
    read: Mapping[str, Any] | None = None,
    without: Sequence[str] = (),
    person: str = "everybody",
    free: Sequence[str] = (),
    focal: bool = False,
    clock: bool = False,
    **given: Any,
) -> AdjustedCameras:
    """Read a calibration and a recording, and adjust the cameras that were turned or moved since.

    Parameters
    ----------
    calibration, detections, read, without, person, **given
        As of `skelsplat.run.check.check_cameras`.
    free, focal, clock
        As of `skelsplat.adjust_cameras`; in names, case and separators may differ.

    Returns
    -------
    AdjustedCameras

    Raises
    ------
    DatasetError, InvalidInputError
        If a file is missing or malformed, or files and options do not fit each other; if the cameras disagree
        for another reason, such as exchanged folders or a wrong unit, with what corrects it.
    """
    check_slot(person)
    with collected_warnings() as warnings:
        opened = open_recording(calibration, detections, read=read or {}, without=without, **given)
        every, rig = opened.every, opened.rig
        chosen = cameras_called(free, rig.names, "free")
        if 2 * len(chosen) >= len(rig) > 2:
            numbers = {"moved": len(chosen), "of": len(rig)}
            warn(Finding("cameras_trusted", "warning", Subject(cameras=chosen), numbers))
        _, scene = read_scene(opened, person, given.get("offsets"))
        result = adjusted(scene, free=chosen or None, focal=focal, clock=clock)
    if isinstance(result, Finding):
        if result.numbers["fault"] == "detections_none":
            raise DatasetError(detections, "detections", "some to adjust the cameras by", "none")
        expected = "no fault besides turned or moved cameras"
        raise DatasetError(detections, "cameras", expected, f"another one: {result.numbers['why']}")
    cameras = dict(zip(rig.names, result.cameras, strict=True))
    whole = sk.CameraRig([cameras.get(n, one) for n, one in zip(every.names, every, strict=True)], every.unit)
    kept = [one for one in warnings if one.kind != "unit_implausible"]  # the person's size says more
    return AdjustedCameras(whole, result, (*kept, *findings_of(result, rig.mm_per_unit, scene.read_as)))


def read_adjusted(job: Job) -> tuple[Array, Inputs]:
    """Read everybody, and adjust the cameras by those the views agree on if the job asks for it.

    Raises
    ------
    DatasetError, InvalidInputError
        As `skelsplat.run.read.read_everybody`.

    Warns
    -----
    FindingWarning
        Of what was adjusted, and of what was not.
    """
    people, whole = read_everybody(job)
    if not job.adjust_cameras:
        return people, whole
    scene = Scene(whole.rig, people, whole.frames, whole.layout, whole.read_as)
    result = adjusted(scene)
    if isinstance(result, Finding):
        warn(result)
        return people, whole
    for finding in findings_of(result, whole.rig.mm_per_unit, scene.read_as):
        warn(finding)
    return people, replace(whole, rig=result.cameras)


@dataclass(frozen=True)
class Scene:
    """A rig, and the people (T, M, P, N, 3) that it sees in frames (T,)."""

    rig: sk.CameraRig
    people: Array
    frames: Index
    layout: sk.Layout
    read_as: ReadAs

    def check(self) -> RigReport:
        """Find what is wrong with the cameras."""
        return check_rig(self.rig, self.people, frames=self.frames, layout=self.layout, read_as=self.read_as)


def read_scene(
    opened: Opened, person: str, offsets: Mapping[str, float] | None
) -> tuple[DetectionSet, Scene]:
    """Read the detections of everybody, or of one ``person`` as of `skelsplat.run.check.check_cameras`."""
    rig, found = opened.rig, opened.detections.read()
    people, layout = found.people, found.skeleton
    if person.isdecimal() and people.shape[2] > 1:
        warn(Finding("person_of_files", "note", numbers={"person": person}))
    if person != EVERYBODY:
        people = take_people(people, pick_places(people, rig, person, layout)[0])[:, :, None]
    read_as = ReadAs(found.labels, named_offsets(opened.every, offsets or {}), found.uneven)
    return found, Scene(rig, people, found.frames, layout, read_as)


def adjusted(
    scene: Scene, *, free: Sequence[str] | None = None, focal: bool = False, clock: bool = False
) -> sk.RigAdjustment | Finding:
    """Adjust cameras; a finding if they disagree for another reason, which has to be corrected first."""
    allowed = {"recording_other"} if free else set()  # where the user knows who is wrong
    allowed |= {"image_resized"} if focal else set()
    for fault in scene.check().before_places:
        if fault.kind not in allowed:
            why = f"{fault.text} {options(fault.remedy)} corrects it." if fault.remedy else fault.text
            numbers = {"fault": fault.kind, "why": why}
            return Finding("cameras_not_adjusted", "warning", fault.subject, numbers, fault.remedy)
    return settled(scene, free=free, focal=focal, clock=clock)


def settled(
    scene: Scene, *, free: Sequence[str] | None = None, focal: bool = False, clock: bool = False
) -> sk.RigAdjustment:
    """Adjust cameras that disagree for no other reason. Clocks are in frames of the files."""
    steps = scene.frames - scene.frames[0]
    step = int(np.gcd.reduce(steps)) or 1
    places = steps // step
    people = scene.people
    if places[-1] < _MOST_EMPTY * len(places):
        people = spread(people, places)

    def solve(person: Array) -> sk.RigAdjustment:
        return sk.adjust_cameras(person, scene.rig, free=free, focal=focal, clock=clock)

    found = adjust_by_everybody(scene.rig, people, scene.layout, solve)
    report = tuple(
        replace(one, clock=one.clock * step, clock_sigma=one.clock_sigma * step) for one in found.report
    )
    return replace(found, report=report)


def findings_of(found: sk.RigAdjustment, mm_per_unit: float, read_as: ReadAs) -> Iterator[Finding]:
    """Yield what was adjusted, and what is to be done about the other cameras."""

    def option(one: sk.CameraAdjustment) -> float:
        """Return the value for --offset that sets a clock right."""
        return rounded(read_as.offsets.get(one.name, 0) - _shown_clock(one))

    for one in found.report:
        subject, numbers = Subject(cameras=(one.name,)), numbers_of(one, mm_per_unit)
        if is_changed(one):
            severity: Severity = "warning" if one.after > one.before else "note"
            numbers["left_out_frames"] = found.judged
            yield Finding("camera_adjusted", severity, subject, numbers)
        if one.status in ("late", "adjusted") and _clock_known(one):
            remedy = [Remedy("offset", f"{one.name}={option(one)}")]
            remedy += [Remedy("frames", "intersection")] if read_as.uneven else []
            yield Finding("camera_late", "warning", subject, numbers, tuple(remedy))
        if one.status == "unseen" and len(found.report) > 2:
            yield Finding("camera_unseen", "warning", subject)
    doubtful = [*found.of("doubtful"), *(one for one in found.of("late") if not _clock_known(one))]
    if doubtful:
        suspected = [{**numbers_of(one, mm_per_unit), "offset": option(one)} for one in doubtful]
        names, changed = tuple(one.name for one in doubtful), [one.name for one in found.of("adjusted")]
        placed = all(map(_is_placed, doubtful)) and 2 * (len(changed) + 1) >= len(found.report)
        besides = changed if placed else []  # a majority of places stays
        numbers = {"suspected": suspected, "besides": besides}
        yield Finding("cameras_doubtful", "warning", Subject(cameras=names), numbers)
    if len(found.report) == 2 and found.of("unseen"):
        yield Finding("cameras_two", "warning", Subject(cameras=found.cameras.names))
    if found.of("sound") and not found.of("adjusted", "late", "doubtful"):
        yield Finding("cameras_sound", "note", numbers={"cameras": len(found.of("sound"))})


def _clock_known(camera: sk.CameraAdjustment) -> bool:
    """Whether a clock is shown to be off; without an error bar from half a frame on."""
    if not np.isfinite(camera.clock_sigma):
        return round(camera.clock) != 0
    return abs(camera.clock) > _SHOWN * camera.clock_sigma


def _shown_clock(camera: sk.CameraAdjustment) -> float:
    """Return by how much a clock is off: in whole frames, unless it is shown that it is off by parts."""
    whole, rest = parted(camera.clock)
    shown = np.isfinite(camera.clock_sigma) and abs(rest) > _SHOWN * camera.clock_sigma
    return camera.clock if shown else whole


def numbers_of(camera: sk.CameraAdjustment, mm_per_unit: float) -> dict[str, Any]:
    """Return what became of a camera as numbers with units in their names; None where nothing is known."""
    numbers = {
        "degrees": camera.degrees,
        "degrees_sigma": camera.turn_sigma,
        "mm": camera.distance * mm_per_unit,
        "mm_sigma": camera.shift_sigma * mm_per_unit,
        "focal": camera.focal,
        "focal_sigma": camera.focal_sigma,
        "clock_frames": camera.clock,
        "clock_sigma_frames": camera.clock_sigma,
        "before_px": camera.before,
        "after_px": camera.after,
    }
    known = {name: float(value) if np.isfinite(value) else None for name, value in numbers.items()}
    return {"camera": camera.name, "status": camera.status, **known}
