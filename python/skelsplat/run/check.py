"""From the files of a calibration, and detections that it fits or not, to what is wrong with the cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import skelsplat as sk
from skelsplat._clocks import rounded
from skelsplat.findings import Finding, collected_warnings
from skelsplat.rig_check import RigReport, check_rig
from skelsplat.run.adjust import findings_of, read_scene
from skelsplat.run.by_everybody import Scene
from skelsplat.run.person import check_slot
from skelsplat.run.read import leave_out, open_recording, read_rig


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

    Parameters
    ----------
    calibration, detections, without
        As of `skelsplat.run.Job`; without detections only the calibration itself is checked.
    read
        The arguments of `skelsplat.run.read.read_rig`.
    person
        ``"everybody"``: all on whom three views agree; ``"consistent"``: only the person on whom the views
        agree best; ``"largest"``: the largest in each image; a number: the one at that index in each file,
        from 0.
    **given
        Further arguments of `skelsplat.io.detections.read_detections`.

    Returns
    -------
    CameraCheck
        Its report begins with the warnings of the files.

    Raises
    ------
    DatasetError, InvalidInputError
        If a file is missing or malformed, or files and options do not fit each other; the message names it.
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
                scene = read_scene(opened, person, offsets)
                return scene, scene.check()

            scene, report = look(given.get("offsets") or {})
            rig, frames, late = scene.rig, len(scene.frames), _late(scene, report)
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


def _late(scene: Scene, report: RigReport) -> dict[str, Finding]:
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
