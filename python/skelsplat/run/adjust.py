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
from skelsplat._words import listed, px, with_bar
from skelsplat.association import take_people
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Remedy, Subject, collected_warnings, warn
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
# A change below this part of its error bar is none.
_NOTHING = 0.01


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
            warn(
                Finding(
                    "cameras_trusted",
                    "warning",
                    Subject(cameras=chosen),
                    {"moved": len(chosen), "of": len(rig)},
                    sentence=f"{len(chosen)} of {len(rig)} cameras are named as moved. The others are taken "
                    "as right: unless they are more than half of all, the recording hardly shows if one is "
                    "wrong.",
                )
            )
        _, scene = read_scene(opened, person, given.get("offsets"))
        result = adjusted(scene, free=chosen or None, focal=focal, clock=clock)
    if isinstance(result, Finding):
        if result.numbers["fault"] == "nobody_detected":
            raise DatasetError(detections, "detections", "some to adjust the cameras by", "none")
        expected = "no fault besides turned or moved cameras"
        settings = ", ".join(f"{one.setting}={one.value}" for one in result.remedy)
        corrects = f" Corrected by the setting {settings}." if settings else ""
        raise DatasetError(detections, "cameras", expected, f"another one: {result.numbers['why']}{corrects}")
    cameras = dict(zip(rig.names, result.cameras, strict=True))
    whole = sk.CameraRig([cameras.get(n, one) for n, one in zip(every.names, every, strict=True)], every.unit)
    # the person's size says more
    kept = [one for one in warnings if one.kind != "unit_wrong"]
    return AdjustedCameras(whole, result, (*kept, *findings_of(result, rig.mm_per_unit, scene.read_as)))


def read_adjusted(opened: Opened, job: Job) -> tuple[Array, Inputs]:
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
    people, whole = read_everybody(opened, job)
    if not job.adjust_cameras:
        return people, whole
    scene = Scene(whole.rig, people, whole.frames, whole.layout, whole.read_as)
    result = adjusted(scene)
    if isinstance(result, Finding):
        warn(result)
        return people, whole
    for finding in findings_of(result, whole.rig.mm_per_unit, scene.read_as):
        warn(finding)
    each = tuple(numbers_of(one, whole.rig.mm_per_unit) for one in result.report)
    return people, replace(whole, rig=result.cameras, adjusted=each)


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
        warn(
            Finding(
                "person_by_place",
                "note",
                numbers={"person": person},
                sentence=f"Person {person} is entry {person} of each file. The order of people in a file is "
                "arbitrary, so this need not be one person: without a choice, everybody counts.",
            )
        )
    if person != EVERYBODY:
        people = take_people(people, pick_places(people, rig, person, layout)[0])[:, :, None]
    read_as = ReadAs(found.labels, named_offsets(opened.every, offsets or {}), found.uneven)
    return found, Scene(rig, people, found.frames, layout, read_as)


def adjusted(
    scene: Scene, *, free: Sequence[str] | None = None, focal: bool = False, clock: bool = False
) -> sk.RigAdjustment | Finding:
    """Adjust cameras; a finding if they disagree for another reason, which has to be corrected first."""
    for fault in scene.check().before_places:
        # where the user knows who is wrong, and where a focal length may be
        if (free and fault.kind == "recording_other") or (focal and "factor" in fault.numbers):
            continue
        return Finding(
            "cameras_not_adjusted",
            "warning",
            fault.subject,
            {"fault": fault.kind, "why": fault.text},
            fault.remedy,
            sentence=f"No camera was adjusted, because another fault has to be corrected first. {fault.text}",
        )
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
    for one in found.report:
        subject, numbers = Subject(cameras=(one.name,)), numbers_of(one, mm_per_unit)
        if is_changed(one):
            yield _adjusted(subject, {**numbers, "left_out_frames": found.judged})
        if one.status in ("late", "adjusted") and _clock_known(one):
            yield _late(subject, numbers, _offset(one, read_as), read_as)
        if one.status == "unseen" and len(found.report) > 2:
            unseen = (
                f"{one.name} sees too few of the joints that other cameras see, so it was not judged and "
            )
            unseen += "not adjusted."
            yield Finding("camera_unused", "warning", subject, sentence=unseen)
    doubtful = [*found.of("doubtful"), *(one for one in found.of("late") if not _clock_known(one))]
    if doubtful:
        suspected = [{**numbers_of(one, mm_per_unit), "offset": _offset(one, read_as)} for one in doubtful]
        changed = [one.name for one in found.of("adjusted")]
        placed = all(map(_is_placed, doubtful)) and 2 * (len(changed) + 1) >= len(found.report)
        yield _doubtful(suspected, changed if placed else [])  # a majority of places stays
    if len(found.report) == 2 and found.of("unseen"):
        yield Finding(
            "cameras_doubtful",
            "warning",
            Subject(cameras=found.cameras.names),
            remedy=(Remedy("move", "NAME"),),
            sentence="Two cameras do not tell which of them was turned or moved, so neither was adjusted. "
            "Add a third camera, or name the one that was moved.",
        )
    if found.of("sound") and not found.of("adjusted", "late", "doubtful"):
        cameras = len(found.of("sound"))
        sentence = f"No camera was adjusted: this recording shows no fault in the {cameras} cameras that "
        sentence += "could be judged."
        yield Finding("cameras_not_adjusted", "note", numbers={"cameras": cameras}, sentence=sentence)


def _offset(camera: sk.CameraAdjustment, read_as: ReadAs) -> float:
    """Return the offset, in frames of the files, that sets a clock right."""
    return rounded(read_as.offsets.get(camera.name, 0) - _shown_clock(camera))


def _adjusted(subject: Subject, numbers: dict[str, Any]) -> Finding:
    """Return the finding on a camera that was adjusted."""
    before, after, error = numbers["before_px"], numbers["after_px"], ""
    known = before is not None and after is not None
    worse = known and after > before
    if known:
        error = f" (error {px(before)}, {px(after)} afterwards, in {numbers['left_out_frames']} other frames)"
    changes = _changes({**numbers, "clock_frames": 0.0})  # which is no part of a calibration
    fails = " In frames that were not used, it does not hold: do not use these cameras." if worse else ""
    return Finding(
        "camera_adjusted",
        "warning" if worse else "note",
        subject,
        numbers,
        sentence=f"{numbers['camera']} was adjusted: "
        f"{listed(changes or ['by next to nothing'])}{error}.{fails}",
    )


def _late(subject: Subject, numbers: dict[str, Any], offset: float, read_as: ReadAs) -> Finding:
    """Return the finding on a camera whose clock is off."""
    name, frames, sigma = numbers["camera"], numbers["clock_frames"], numbers["clock_sigma_frames"]
    size = f"{abs(frames):.0f}" if sigma is None else with_bar(abs(frames), sigma)
    remedy = [Remedy("offset", f"{name}={offset}")]
    remedy += [Remedy("frames", "intersection")] if read_as.uneven else []
    return Finding(
        "frame_offset",
        "warning",
        subject,
        numbers,
        tuple(remedy),
        sentence=f"{name}'s frame numbers are {size} too {'high' if frames > 0 else 'low'}; a calibration "
        "has no clock, so the offset has to be given with each recording.",
    )


def _doubtful(suspected: list[dict[str, Any]], besides: list[str]) -> Finding:
    """Return the finding on cameras of which one is wrong, perhaps ``besides`` some that were adjusted."""
    names = tuple(one["camera"] for one in suspected)
    ways = [f"{one['camera']} ({listed(_changes(one) or ['no single change'])})" for one in suspected]
    late = [one for one in suspected if not _changes({**one, "clock_frames": 0.0})]
    remedy: list[Remedy] = []
    if besides:
        remedy = [Remedy("move", name) for name in (*besides, "NAME")]
        sentence = f"Another camera is wrong as well, most likely {listed(ways, 'or')}. It was not adjusted: "
        sentence += (
            "more than half of the cameras have to stay. If you know which were moved, name all of them."
        )
    elif len(ways) == 1:
        sentence = f"{ways[0]} disagrees with the other cameras, and this recording does not tell how it is "
        sentence += "wrong: it was not adjusted. The person has to walk through more of the room."
    else:
        sentence = f"{listed(ways, 'or')} is wrong, and this recording does not tell which: none of them was "
        sentence += "adjusted. If you know, name the one that was moved, or correct the clock of the one "
        sentence += "that is late. Otherwise, a recording with three or more other cameras, or in which the "
        sentence += "person walks through more of the room, can tell."
        remedy = [Remedy("move", "NAME")] if len(late) < len(ways) else []
        remedy += [Remedy("offset", f"{one['camera']}={one['offset']}") for one in late]
    numbers = {"suspected": suspected, "besides": besides}
    return Finding(
        "cameras_doubtful", "warning", Subject(cameras=names), numbers, tuple(remedy), sentence=sentence
    )


def _changes(numbers: Mapping[str, Any]) -> list[str]:
    """Return what was changed about a camera, or is suspected, with error bars where they are known."""
    focal_sigma = None if numbers["focal_sigma"] is None else 100 * numbers["focal_sigma"]
    changes = (
        ("turned by", numbers["degrees"], numbers["degrees_sigma"], "°", ""),
        ("moved by", numbers["mm"], numbers["mm_sigma"], " mm", ""),
        ("focal length changed by", 100 * (numbers["focal"] - 1), focal_sigma, " %", "+"),
        ("frame numbers off by", numbers["clock_frames"], None, "", "+"),
    )
    return [
        f"{words} {with_bar(value, sigma, sign)}{unit}"
        for words, value, sigma, unit, sign in changes
        if not _is_nothing(value, sigma)
    ]


def _is_nothing(value: float, sigma: float | None) -> bool:
    """Whether a change is none: not allowed, the prior's, where it could not be measured, or shown as 0."""
    shown = with_bar(value, sigma).partition(" ")[0]
    return abs(value) <= _NOTHING * (sigma or 0.0) or not set(shown) & set("123456789")


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
