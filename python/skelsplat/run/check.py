"""From the files of a calibration, and detections that it fits or not, to what is wrong with the cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import skelsplat as sk
from skelsplat.association import take_people
from skelsplat.findings import collected_warnings
from skelsplat.io import DetectionSet
from skelsplat.rig_check import ReadAs, RigReport, check_rig
from skelsplat.run.person import EVERYBODY, check_slot, pick_places
from skelsplat.run.read import leave_out, named_offsets, open_recording, read_rig


@dataclass(frozen=True)
class CameraCheck:
    """Cameras, the detections that they were compared with (None: the calibration alone), and the report."""

    rig: sk.CameraRig
    detections: DetectionSet | None
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
    calibration, detections
        As of `skelsplat.run.Job`; without detections only the calibration itself is checked.
    read
        The arguments of `skelsplat.run.read.read_rig`.
    without
        As of `skelsplat.run.Job`.
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
            rig, found = leave_out(read_rig(calibration, **(read or {})), tuple(without)), None
            report = check_rig(rig)
        else:
            opened = open_recording(calibration, detections, read=read or {}, without=without, **given)
            rig, found = opened.rig, opened.detections.read()
            offsets = named_offsets(opened.every, given.get("offsets", {}))
            read_as = ReadAs(found.labels, offsets, found.uneven)
            people, layout = found.people, found.skeleton
            if person != EVERYBODY:  # whom `check_rig` finds on its own
                people = take_people(people, pick_places(people, rig, person, layout)[0])
            report = check_rig(rig, people, frames=found.frames, layout=layout, read_as=read_as)
    # detections judge the unit better than cameras
    measured = any(one.kind in ("unit_wrong", "unit_unknown", "body_size") for one in report.findings)
    kept = [one for one in warnings if not (measured and one.kind == "unit_implausible")]
    return CameraCheck(rig, found, replace(report, findings=(*kept, *report.findings)))
