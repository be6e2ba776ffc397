"""From the files of a calibration and of detections to what is wrong, and to cameras that agree."""

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
from skelsplat.association import separate_people, take_people
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Remedy, Subject, collected_warnings, warn
from skelsplat.io.detections import cameras_called
from skelsplat.rig_check import ReadAs, RigReport, check_rig
from skelsplat.run.by_everybody import Scene
from skelsplat.run.job import Job
from skelsplat.run.person import EVERYBODY, check_slot, pick_places
from skelsplat.run.read import Inputs, Opened, leave_out, open_files, open_recording, read_everybody, read_rig

_SHOWN = 4.0  # multiples of its error bar from which a clock is off
_NOTHING = 0.01  # a change below this part of its error bar is none


@dataclass(frozen=True)
class CameraCheck:
    """Cameras, the number of frames that they were compared by (None: without detections), and the report."""

    rig: sk.CameraRig
    frames: int | None
    report: RigReport


def check_cameras(
    calibration: Path,
    detections: Path | None = None,
    *,
    read: Mapping[str, Any] | None = None,
    without: Sequence[str] = (),
    person: str = "everybody",
    **given: Any,
) -> CameraCheck:
    """Read a calibration, and detections if there are any, and find what is wrong with the cameras.

    ``read`` are arguments of `skelsplat.run.read.read_rig`, ``given`` of `skelsplat.io.read_detections`. The
    ``person`` is ``"everybody"`` on whom three views agree, ``"consistent"`` (on whom the views agree best),
    ``"largest"`` in each image, or the place in each file. The report begins with the warnings of the files.
    A `DatasetError` or an `InvalidInputError` if files are malformed, or do not fit each other or the
    options.
    """
    check_slot(person)
    with collected_warnings() as warnings:
        if detections is None:
            rig, frames = leave_out(read_rig(calibration, **(read or {})), tuple(without)), None
            report = check_rig(rig)
        else:

            def look(offsets: Mapping[str, float]) -> tuple[Scene, RigReport]:
                given["offsets"] = offsets
                opened = open_recording(calibration, detections, read=read or {}, without=without, **given)
                scene = read_scene(opened, person)
                return scene, scene.check()

            scene, report = look(given.get("offsets") or {})
            rig, frames, late = scene.rig, len(scene.frames), _unsynchronised(scene, report)
            if late:
                offsets = {**scene.read_as.offsets, **{name: _option(one) for name, one in late.items()}}
                if given.get("frames") in (None, "strict"):
                    given["frames"] = "union"
                with collected_warnings():  # which were given
                    report = _synchronised(report, late, look(offsets)[1])
    # detections judge the unit better than cameras
    measured = any(one.kind == "unit_wrong" for one in report.findings)
    kept = [one for one in warnings if not (measured and one.kind == "unit_wrong")]
    return CameraCheck(rig, frames, replace(report, findings=(*kept, *report.findings)))


def _unsynchronised(scene: Scene, report: RigReport) -> dict[str, Finding]:
    """Find the cameras whose clocks show, or are measured better, once cameras and clocks are set right."""
    clocks = [finding for finding in report.findings if finding.kind == "frame_offset"]
    if len(scene.rig) < 3 or report.before_places:
        return {}
    findings = findings_of(scene.adjust(), scene.rig.mm_per_unit, scene.read_as)
    late = {one.subject.cameras[0]: one for one in findings if one.kind == "frame_offset"}
    if len(clocks) == 1:  # it is right unless its camera is measured otherwise
        measured = [one.remedy[0] for one in late.values()]
        if tuple(late) != clocks[0].subject.cameras or clocks[0].remedy[0] in measured:
            return {}
    return late


def _option(late: Finding) -> float:
    """Return the offset that sets a clock right, as refine takes it: NAME=FRAMES."""
    return float(late.remedy[0].value.rpartition("=")[2])


def _synchronised(report: RigReport, late: Mapping[str, Finding], right: RigReport) -> RigReport:
    """Return the cameras as they were read, with late ones, and what is wrong once those are right."""
    after = {row.name: row.best_offset_px for row in right.cameras}
    rows = []
    for row in report.cameras:
        one = late.get(row.name)
        if one is not None:
            frames, option = round(one.numbers["clock_frames"]), rounded(_option(one))
            row = replace(row, best_offset=frames, best_offset_px=after[row.name], offset_option=option)
        rows.append(row)
    return RigReport((*late.values(), *right.findings), tuple(rows))


@dataclass(frozen=True)
class AdjustedCameras:
    """What became of the cameras of a calibration."""

    # all, also those that were left out; changed are those that were adjusted, and clocks
    cameras: sk.CameraRig
    adjustment: sk.RigAdjustment  # clocks are in frames of the files
    findings: tuple[Finding, ...]  # of the files, what was adjusted, and what is to be done about the others

    @property
    def adjusted(self) -> tuple[str, ...]:
        """The cameras that differ from the calibration in more than their clocks."""
        return tuple(one.name for one in self.adjustment.of("adjusted") if _is_placed(one))

    @property
    def synchronised(self) -> tuple[str, ...]:
        """The cameras whose clocks were off."""
        return tuple(one.name for one in self.adjustment.report if _is_late(one))


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

    The files are those of `check_cameras`; ``free``, ``focal`` and ``clock`` are as of
    `skelsplat.adjust_cameras`, and in names, case and separators may differ. Raises as `check_cameras`, and a
    `DatasetError` with what corrects it if the cameras disagree for another reason, such as a wrong unit.
    """
    check_slot(person)
    with collected_warnings() as warnings:
        opened = open_recording(calibration, detections, read=read or {}, without=without, **given)
        every, rig = opened.every, opened.rig
        chosen = cameras_called(free, rig.names, "free")
        if 2 * len(chosen) >= len(rig) > 2:
            sentence = f"{len(chosen)} of {len(rig)} cameras are named as moved. The others are taken as "
            sentence += "right: unless they are more than half of all, the recording hardly shows if one is "
            sentence += "wrong."
            numbers = {"moved": len(chosen), "of": len(rig)}
            warn(Finding("cameras_trusted", "warning", Subject(chosen), numbers, sentence=sentence))
        scene = read_scene(opened, person)
        result = adjusted(scene, free=chosen or None, focal=focal, clock=clock)
    if isinstance(result, Finding):
        if result.numbers["fault"] == "no_detections":
            raise DatasetError(detections, "detections", "some to adjust the cameras by", "none")
        settings = ", ".join(f"{one.setting}={one.value}" for one in result.remedy)
        corrects = f" Corrected by the setting {settings}." if settings else ""
        expected = "no fault besides turned or moved cameras"
        raise DatasetError(detections, "cameras", expected, f"another one: {result.numbers['why']}{corrects}")
    cameras = dict(zip(rig.names, result.cameras, strict=True))
    placed = [cameras.get(name, one) for name, one in zip(every.names, every, strict=True)]
    clocks = {name: -offset for name, offset in _offsets(result, scene.read_as).items()}
    whole = sk.CameraRig(placed, every.unit, clocks)
    # the person's size says more
    kept = [one for one in warnings if one.kind != "unit_wrong"]
    found = findings_of(result, rig.mm_per_unit, scene.read_as, corrected=True)
    return AdjustedCameras(whole, result, (*kept, *found))


def read_adjusted(opened: Opened, job: Job) -> tuple[Array, Inputs]:
    """Read everybody, and adjust cameras and clocks if the job asks for it; warn of what was or was not."""
    people, whole = read_everybody(opened, job)
    if not job.adjust_cameras:
        return people, whole
    result = adjusted(Scene(whole.rig, people, whole.frames, whole.layout, whole.read_as))
    if isinstance(result, Finding):
        warn(result)
        return people, whole
    for finding in findings_of(result, whole.rig.mm_per_unit, whole.read_as, corrected=True):
        warn(finding)
    each = tuple(numbers_of(one, whole.rig.mm_per_unit) for one in result.report)
    if any(map(_is_late, result.report)):
        job = replace(job, offsets=_offsets(result, whole.read_as))
        with collected_warnings():  # which were given
            people, whole = read_everybody(open_files(job), job)
    return people, replace(whole, rig=result.cameras, adjusted=each)


def read_scene(opened: Opened, person: str) -> Scene:
    """Read the detections of everybody, or of one ``person`` as of `skelsplat.run.cameras.check_cameras`."""
    found = opened.detections.read()
    people, layout = found.people, found.skeleton
    warn_of_place(people, person, ": without a choice, everybody counts")
    if person != EVERYBODY:
        apart: Index = np.empty((1, 0, 0), dtype=np.int64)
        if person == "consistent":
            apart = separate_people(people, opened.rig, layout=layout)
        people = take_people(people, pick_places(people, person, apart)[0])[:, :, None]
    return Scene(opened.rig, people, found.frames, layout, opened.read_as)


def warn_of_place(people: Array, person: str, otherwise: str = "") -> None:
    """Note that a person (of people (T, M, P, N, 3)) who is a place in the files need not be one."""
    if person.isdecimal() and people.shape[2] > 1:
        sentence = f"Person {person} is entry {person} of each file. The order of people in a file is "
        sentence += f"arbitrary, so this need not be one person{otherwise}."
        warn(Finding("person_by_place", "note", numbers={"person": person}, sentence=sentence))


def adjusted(
    scene: Scene, *, free: Sequence[str] | None = None, focal: bool = False, clock: bool = False
) -> sk.RigAdjustment | Finding:
    """Adjust cameras; a finding if they disagree for another reason, which has to be corrected first."""
    for fault in scene.check().before_places:
        # where the user knows who is wrong, and where a focal length may be
        if (free and fault.kind == "recording_other") or (focal and "factor" in fault.numbers):
            continue
        numbers = {"fault": fault.kind, "why": fault.text}
        sentence = f"No camera was adjusted, because another fault has to be corrected first. {fault.text}"
        given = (fault.subject, numbers, fault.remedy)
        return Finding("cameras_not_adjusted", "warning", *given, sentence=sentence)
    return scene.adjust(free=free, focal=focal, clock=clock)


def findings_of(
    found: sk.RigAdjustment, mm_per_unit: float, read_as: ReadAs, *, corrected: bool = False
) -> Iterator[Finding]:
    """Yield what was adjusted, and what is to be done about others, and about clocks unless ``corrected``."""
    for one in found.report:
        numbers = numbers_of(one, mm_per_unit)
        if one.status == "adjusted" and _is_placed(one):
            yield _adjusted({**numbers, "left_out_frames": found.judged})
        if _is_late(one):
            remedy = () if corrected else read_as.offset_remedy(one.name, offset_of(one, read_as))
            yield _late(numbers, remedy)
        if one.since is not None:
            sentence = f"{one.name} was moved while it recorded, about frame {one.since}, and not adjusted: "
            sentence += "the frames before and after need a calibration each."
            subject = Subject((one.name,), frames=(one.since,))
            yield Finding("cameras_not_adjusted", "warning", subject, numbers, sentence=sentence)
        if one.status == "unseen" and len(found.report) > 2:
            sentence = f"{one.name} was not judged and not adjusted: it sees too few of the joints that "
            sentence += "others see."
            yield Finding("camera_unused", "warning", Subject((one.name,)), sentence=sentence)
    doubtful = [*found.of("doubtful"), *(one for one in found.of("late") if not _clock_known(one))]
    if doubtful:
        suspected = [{**numbers_of(one, mm_per_unit), "offset": offset_of(one, read_as)} for one in doubtful]
        changed = [one.name for one in found.of("adjusted")]
        placed = all(map(_is_placed, doubtful)) and 2 * (len(changed) + 1) >= len(found.report)
        yield _doubtful(suspected, changed if placed else [])  # a majority of places stays
    if len(found.report) == 2 and found.of("unseen"):
        sentence = "Two cameras do not tell which of them was turned or moved, so neither was adjusted. Add "
        sentence += "a third camera, or name the one that was moved."
        subject, remedy = Subject(found.cameras.names), (Remedy("move", "NAME"),)
        yield Finding("cameras_not_adjusted", "warning", subject, remedy=remedy, sentence=sentence)
    sound = len(found.of("sound"))
    if sound and not found.of("adjusted", "late", "doubtful", "knocked"):
        sentence = f"No camera was adjusted: this recording shows no fault in the {sound} cameras that could "
        sentence += "be judged."
        yield Finding("cameras_not_adjusted", "note", numbers={"cameras": sound}, sentence=sentence)


def offset_of(camera: sk.CameraAdjustment | sk.CalibratedCamera, read_as: ReadAs) -> float:
    """Return the offset that sets a clock right, in whole frames unless parts of one are shown."""
    whole, rest = parted(camera.clock)
    shown = np.isfinite(camera.clock_sigma) and abs(rest) > _SHOWN * camera.clock_sigma
    return rounded(read_as.offsets.get(camera.name, 0) - (camera.clock if shown else whole))


def _adjusted(numbers: dict[str, Any]) -> Finding:
    """Return the finding on a camera that was adjusted."""
    name, before, after, error = numbers["camera"], numbers["before_px"], numbers["after_px"], ""
    known = before is not None and after is not None
    if known:
        error = f" (error {px(before)}, {px(after)} afterwards, in {numbers['left_out_frames']} other frames)"
    worse = known and after > before
    changes = listed(_changes(numbers) or ["by next to nothing"])
    fails = " In frames that were not used, it does not hold: do not use these cameras." if worse else ""
    sentence = f"{name} was adjusted: {changes}{error}.{fails}"
    subject = Subject((name,))
    return Finding("camera_adjusted", "warning" if worse else "note", subject, numbers, sentence=sentence)


def _late(numbers: dict[str, Any], remedy: tuple[Remedy, ...]) -> Finding:
    """Return the finding on a camera whose clock is off; without a remedy, it was corrected."""
    name, frames, sigma = numbers["camera"], numbers["clock_frames"], numbers["clock_sigma_frames"]
    size = f"{abs(frames):.0f}" if sigma is None else with_bar(abs(frames), sigma)
    off, subject = f"{size} too {'high' if frames > 0 else 'low'}", Subject((name,))
    if remedy:
        sentence = f"{name}'s frame numbers are {off}."
        return Finding("frame_offset", "warning", subject, numbers, remedy, sentence=sentence)
    sentence = f"{name}'s frame numbers were {off}, which was corrected."
    return Finding("frame_offset", "note", subject, numbers, sentence=sentence)


def _doubtful(suspected: list[dict[str, Any]], besides: list[str]) -> Finding:
    """Return the finding on cameras of which one is wrong, perhaps ``besides`` some that were adjusted."""
    late = [one for one in suspected if not _changes(one)]
    ways = []
    for one in suspected:
        clock = one["clock_frames"]
        off = [] if _is_nothing(clock, None) else [f"frame numbers off by {with_bar(clock, None, '+')}"]
        ways.append(f"{one['camera']} ({listed([*_changes(one), *off] or ['no single change'])})")
    remedy: list[Remedy] = []
    if besides:
        remedy = [Remedy("move", name) for name in (*besides, "NAME")]
        sentence = f"Another camera is wrong as well, most likely {listed(ways, 'or')}. It was not adjusted: "
        sentence += "more than half of the cameras have to stay. If you know which were moved, name all of "
        sentence += "them."
    elif len(ways) == 1:
        sentence = f"{ways[0]} disagrees with the other cameras, and this recording does not tell how it is "
        sentence += "wrong: it was not adjusted. The person has to walk through more of the room."
    else:
        sentence = f"{listed(ways, 'or')} is wrong, and this recording does not tell which: none of them was "
        sentence += "adjusted. If you know, name the one that was moved, or correct the clock of the late "
        sentence += "one. Otherwise record with more cameras, or a person who walks through more of the "
        sentence += "room."
        remedy = [Remedy("move", "NAME")] if len(late) < len(ways) else []
        remedy += [Remedy("offset", f"{one['camera']}={one['offset']}") for one in late]
    subject = Subject(tuple(one["camera"] for one in suspected))
    numbers = {"suspected": suspected, "besides": besides}
    return Finding("cameras_not_adjusted", "warning", subject, numbers, tuple(remedy), sentence=sentence)


def _changes(numbers: Mapping[str, Any]) -> list[str]:
    """Return what was changed about a camera's place and lens, or is suspected, with error bars if known."""
    focal_sigma = None if numbers["focal_sigma"] is None else 100 * numbers["focal_sigma"]
    changes = (
        ("turned by", numbers["degrees"], numbers["degrees_sigma"], "°", ""),
        ("moved by", numbers["mm"], numbers["mm_sigma"], " mm", ""),
        ("focal length changed by", 100 * (numbers["focal"] - 1), focal_sigma, " %", "+"),
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


def _is_late(camera: sk.CameraAdjustment) -> bool:
    """Whether a clock is off, and to be corrected."""
    return camera.status in ("late", "adjusted") and _clock_known(camera)


def _offsets(found: sk.RigAdjustment, read_as: ReadAs) -> dict[str, float]:
    """Return by camera what is to be added to its frame numbers."""
    late = {one.name: offset_of(one, read_as) for one in found.report if _is_late(one)}
    return {**read_as.offsets, **late}


def _clock_known(camera: sk.CameraAdjustment) -> bool:
    """Whether a clock is shown to be off; without an error bar from half a frame on."""
    if not np.isfinite(camera.clock_sigma):
        return round(camera.clock) != 0
    return abs(camera.clock) > _SHOWN * camera.clock_sigma


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
