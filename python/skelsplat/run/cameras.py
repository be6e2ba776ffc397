"""From the files of a calibration and of detections to what is wrong, and to cameras that agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._clocks import rounded
from skelsplat.association import separate_people, take_people
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject, collected_warnings, warn
from skelsplat.io.detections import cameras_called
from skelsplat.rig_check import RigReport, check_rig
from skelsplat.run.adjusted import findings_of, is_late, is_placed, numbers_of, offsets_of
from skelsplat.run.by_everybody import Scene, adjusted
from skelsplat.run.job import Job
from skelsplat.run.person import EVERYBODY, check_slot, pick_places
from skelsplat.run.read import (
    Inputs,
    Opened,
    leave_out,
    open_files,
    open_recording,
    read_everybody,
    read_rig,
    unread_in,
)
from skelsplat.run.session import Session, adjust_session, different


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
            rig, frames = read_rig(calibration, without=without, **(read or {})), None
            rig = leave_out(rig, without, unread_in(warnings))
            report = check_rig(rig)
        else:

            def look(offsets: Mapping[str, float]) -> tuple[Scene, RigReport]:
                given["offsets"] = offsets
                opened = open_recording(calibration, detections, read=read or {}, without=without, **given)
                scene = read_scene(opened, person)
                return scene, scene.check()

            scene, report = look(given.get("offsets") or {})
            rig, frames = scene.rig, len(scene.frames)
            report, late = _unsynchronised(scene, report)
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


def _unsynchronised(scene: Scene, report: RigReport) -> tuple[RigReport, dict[str, Finding]]:
    """Find the cameras whose clocks show, or are measured better, once cameras and clocks are set right.

    And a clock that changes, which no offset sets right: it is in the report, in place of one.
    """
    if len(scene.rig) < 3 or report.before_places:
        return report, {}
    findings = list(findings_of(scene.adjust(), scene.rig.mm_per_unit, scene.read_as))
    changing = [one for one in findings if one.kind == "clock_changes"]
    late = {one.subject.cameras[0]: one for one in findings if one.kind == "frame_offset"}
    if changing:
        unsteady = {one.subject.cameras for one in changing}
        kept = [one for one in report.findings if one.subject.cameras not in unsteady]
        return replace(report, findings=(*changing, *kept)), late
    clocks = [finding for finding in report.findings if finding.kind == "frame_offset"]
    if len(clocks) == 1:  # it is right unless its camera is measured otherwise
        measured = [one.remedy[0] for one in late.values()]
        if tuple(late) != clocks[0].subject.cameras or clocks[0].remedy[0] in measured:
            return report, {}
    return report, late


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
    changing = [one for one in report.findings if one.kind == "clock_changes"]
    return RigReport((*late.values(), *changing, *right.findings), tuple(rows))


@dataclass(frozen=True)
class AdjustedCameras:
    """What became of the cameras of a calibration."""

    # all, also those that were left out; changed are those that were adjusted, and clocks that all recordings
    # share
    cameras: sk.CameraRig
    session: Session
    findings: tuple[Finding, ...]  # of the files, what was adjusted, and what is to be done about the others

    @property
    def adjustment(self) -> sk.RigAdjustment:
        """What became of each camera; clocks are in its own frames in the files."""
        return self.session.found

    @property
    def adjusted(self) -> tuple[str, ...]:
        """The cameras that differ from the calibration in more than their clocks."""
        return tuple(one.name for one in self.adjustment.of("adjusted") if is_placed(one))

    @property
    def changed(self) -> tuple[str, ...]:
        """The cameras that differ from the calibration, also in clocks that all recordings share."""
        shared = self.session.shared is not None
        late = [one.name for one in self.adjustment.report if shared and is_late(one)]
        return tuple(dict.fromkeys([*self.adjusted, *late]))


def adjust_cameras(
    calibration: Path,
    detections: Path | Sequence[Path],
    *,
    read: Mapping[str, Any] | None = None,
    without: Sequence[str] = (),
    person: str = "everybody",
    free: Sequence[str] = (),
    focal: bool = False,
    clock: bool = False,
    **given: Any,
) -> AdjustedCameras:
    """Read a calibration and a recording, or several, and adjust the cameras that were turned or moved since.

    What several recordings say of the cameras adds up (`skelsplat.run.session`), while clocks are those of
    each. The files are those of `check_cameras`; ``free``, ``focal`` and ``clock`` are as of
    `skelsplat.adjust_cameras`, and in names, case and separators may differ. Raises as `check_cameras`, and a
    `DatasetError` with what corrects it if the cameras disagree for another reason, such as a wrong unit.
    """
    check_slot(person)
    paths = different(detections)

    def look(path: Path, offsets: Mapping[str, float] | None) -> tuple[sk.CameraRig, Scene]:
        asked = {**given, "offsets": offsets}
        opened = open_recording(calibration, path, read=read or {}, without=without, **asked)
        return opened.every, read_scene(opened, person)

    with collected_warnings() as warnings:
        opened = {str(path): look(path, given.get("offsets")) for path in paths}
        every, scenes = next(iter(opened.values()))[0], {name: scene for name, (_, scene) in opened.items()}
        rig = next(iter(scenes.values())).rig
        chosen = cameras_called(free, rig.names, "free")
        if 2 * len(chosen) >= len(rig) > 2:
            warn(_trusted(chosen, rig))
        session = adjust_session(
            scenes,
            lambda name, offsets: look(Path(name), offsets)[1],
            free=chosen or None,
            focal=focal,
            clock=clock,
        )
    for name, fault in session.faults.items():
        if fault.numbers["fault"] == "no_detections":
            raise DatasetError(Path(name), "detections", "some to adjust the cameras by", "none")
        settings = ", ".join(f"{one.setting}={one.value}" for one in fault.remedy)
        corrects = f" Corrected by the setting {settings}." if settings else ""
        expected = "no fault besides turned or moved cameras"
        raise DatasetError(Path(name), "cameras", expected, f"another one: {fault.numbers['why']}{corrects}")
    # the person's size says more than the unit
    kept = [one for k, one in enumerate(warnings) if one.kind != "unit_wrong" and one not in warnings[:k]]
    return AdjustedCameras(session.of(every), session, (*kept, *session.findings))


def _trusted(chosen: Sequence[str], rig: sk.CameraRig) -> Finding:
    """Return the finding on cameras that are taken as right, because half or more are named as moved."""
    sentence = f"{len(chosen)} of {len(rig)} cameras are named as moved. The others are taken as right: "
    sentence += "unless they are more than half of all, the recording hardly shows if one is wrong."
    numbers = {"moved": len(chosen), "of": len(rig)}
    return Finding("cameras_trusted", "warning", Subject(tuple(chosen)), numbers, sentence=sentence)


def read_adjusted(opened: Opened, job: Job) -> tuple[Array, Inputs]:
    """Read everybody, and adjust cameras and clocks if the job asks for it; warn of what was or was not."""
    people, whole = read_everybody(opened, job)
    if not job.adjust_cameras:
        return people, whole
    scene = Scene(whole.rig, people, whole.frames, whole.layout, whole.read_as)
    result = adjusted(scene, free=cameras_called(job.move, whole.rig.names, "move") or None)
    if isinstance(result, Finding):
        warn(result)
        return people, whole
    for finding in findings_of(result, whole.rig.mm_per_unit, whole.read_as, corrected=True):
        warn(finding)
    each = tuple(numbers_of(one, whole.rig.mm_per_unit) for one in result.report)
    if any(map(is_late, result.report)):
        job = replace(job, offsets=offsets_of(result, whole.read_as))
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
    entry = person.partition("entry:")[2]
    if entry and people.shape[2] > 1:
        sentence = f"Entry {entry} of each file need not be one person, as the order of people in a file is "
        sentence += f"arbitrary{otherwise}."
        warn(Finding("person_by_place", "note", numbers={"entry": int(entry)}, sentence=sentence))
