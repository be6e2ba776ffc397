"""What is told about cameras that were found from people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

import skelsplat as sk
from skelsplat._clocks import in_step
from skelsplat._start import placed_by, rays_of
from skelsplat._words import number, percent
from skelsplat.cameras import altered
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.rig_check import ReadAs
from skelsplat.run.adjusted import findings_of, late, offset_of
from skelsplat.run.by_everybody import Scene
from skelsplat.run.findings import find_detector

# A camera disagrees if less than this share of what the others explain is explained of it; below the second,
# its clock may change.
_AGREES, _STEADY = 0.85, 0.95
# Doubts that a clock which changes may raise.
_BY_CLOCK = {"clocks", "periodic", "lenses", "moved"}
_FILM = (
    "Film a person who walks about for ten seconds: two metres or more, turning once, and raising the arms"
)


def of_moved(found: sk.RigCalibration, times: Sequence[tuple[int, str]]) -> Iterator[Finding]:
    """Name cameras in step that were moved while they recorded, in frames of these numbers and recordings."""
    several = len({name for _, name in times}) > 1
    for one in found.report:
        if one.span is None or one.status == "left_out" or "clocks" in found.doubts:
            continue
        first, end = one.span
        frame, name = times[first or end]
        of = f" of {name}" if several else ""
        part = "from there on" if first else "before"
        words = f"{one.name} was moved while it recorded, about frame {frame}{of}. It is placed where it "
        words += f"was {part}: the other part needs a calibration of its own."
        share = {"since": frame, "part": "after" if first else "before"}
        yield Finding("camera_moved", "warning", Subject((one.name,), frames=(frame,)), share, sentence=words)


def of_skipped(
    found: sk.RigCalibration, lenses: Sequence[sk.Intrinsics | sk.Camera], scene: Scene, recording: str = ""
) -> Iterator[Finding]:
    """Name cameras whose frame numbers change, as if frames were skipped, if some contradict the others.

    The ``scene`` has the people of all cameras, in frames; a ``recording`` is one of several.
    """
    cameras = {one.name: found.cameras[one.name] for one in found.report if one.status == "placed"}
    for i, one in enumerate(found.report):
        again = placed_again(found, i, lenses[i]) if one.status == "left_out" else None
        cameras |= {one.name: again} if again else {}
    usual = np.nanmedian([one.explained for one in found.report])
    agree = {one.name for one in found.report if one.explained >= _STEADY * usual and one.span is None}
    if agree >= cameras.keys() and not _BY_CLOCK & {*found.doubts}:
        return
    there = [i for i, one in enumerate(found.report) if one.name in cameras]
    rig = replace(found.cameras, cameras=[cameras[found.report[i].name] for i in there], clocks={})
    people = in_step(scene.people, {i: found.report[i].clock for i in there})  # 0 of one that was left out
    adjusted = replace(scene, rig=rig, people=people).adjust()
    of = f" of {recording}" if recording else ""
    every = findings_of(adjusted, rig.mm_per_unit, scene.read_as, place=lambda t: f"frame {t}{of}")
    yield from (one for one in every if one.kind == "clock_changes")


def placed_again(found: sk.RigCalibration, i: int, lens: sk.Intrinsics | sk.Camera) -> sk.Camera | None:
    """Return a camera that was left out where most of its detections place it; None if few agree.

    A lens that is unknown is supposed to be that of the first camera.
    """
    known = altered(lens.camera(), K=found.cameras[0].K) if isinstance(lens, sk.Intrinsics) else lens
    points = [sk.triangulate(found.synchronised(person), found.cameras) for person in found.people]
    rays = [rays_of(person[:, [i]], [known]) for person in found.people]
    placed = placed_by(np.concatenate(points), np.concatenate(rays), known)
    return placed and placed[0]


def of_clocks(found: sk.RigCalibration, recording: str = "") -> Iterator[Finding]:
    """Name cameras that are out of step; a ``recording`` is one of several."""
    for one in found.report:
        if offset_of(one, ReadAs()):
            numbers = {"camera": one.name, "clock_frames": one.clock, "clock_sigma_frames": one.clock_sigma}
            yield late(numbers, recording=recording)


def of_calibration(
    found: sk.RigCalibration,
    times: Sequence[tuple[int, str]],
    clock: bool,
    same_focal: bool,
    told: Sequence[Finding],
    layout: sk.Layout,
) -> Iterator[Finding]:
    """Yield which cameras were left out, moved or out of step, and whether the recording tells no places.

    Whether clocks were looked for, and focal lengths stated to be the same, which otherwise are remedies;
    what is ``told`` already, as of cameras that skipped frames.
    """
    skipped = [name for one in told if one.kind == "clock_changes" for name in one.subject.cameras]
    every = [*of_moved(found, times), *_of_cameras(found, clock)]
    every = [one for one in every if not {*one.subject.cameras} & {*skipped}]
    if any(one.kind in ("camera_left_out", "camera_disagrees") for one in every):
        yield from find_detector(layout)
    yield from every
    if not found.sure:
        yield _unsure(found, clock, same_focal, skipped)


def _of_cameras(found: sk.RigCalibration, clock: bool) -> Iterator[Finding]:
    """Yield which cameras were left out, out of step, or disagree."""
    if found.sure and not clock:
        yield from of_clocks(found)
    usual = np.nanmedian([one.explained for one in found.report])
    for i, one in enumerate(found.report):
        subject = Subject((one.name,))
        if one.status == "left_out":
            words = f"{one.name} was left out: it shares too little with the other cameras, or contradicts "
            words += "them. Does it see the same person at the same time, and is its image not mirrored?"
            numbers = {"error_px": one.error, "explained": one.explained}
            known = {name: float(value) if np.isfinite(value) else None for name, value in numbers.items()}
            seen = any(np.isfinite(person[:, i]).any() for person in found.people)
            remedy = (Remedy("clock", True),) if seen and not clock else ()
            yield Finding("camera_left_out", "warning", subject, known, remedy, sentence=words)
        elif found.sure and one.explained < _AGREES * usual:
            words = f"{one.name} agrees with the others in only {percent(one.explained)} of its detections. "
            words += "Does the detector confuse left and right there, was it moved while it recorded, is its "
            words += "image mirrored, or does it see somebody else?"
            numbers, remedy = {"explained": one.explained}, (Remedy("without", one.name),)
            yield Finding("camera_disagrees", "warning", subject, numbers, remedy, sentence=words)


def _unsure(found: sk.RigCalibration, clock: bool, same_focal: bool, skipped: Sequence[str]) -> Finding:
    """Say why the recording does not tell where the cameras are, and what helps."""
    placed = [one for one in found.report if one.status == "placed"]
    turn, place = (max(getattr(one, name) for one in placed) for name in ("turn_sigma", "place_sigma"))
    off = [f"{one.name} {100 * (one.zoom - 1):+.0f} %" for one in placed if one.zoom != 1.0]
    unknown = bool(np.isfinite([one.focal_sigma for one in placed]).any())
    doubt = "skipped" if skipped and found.doubts[0] in _BY_CLOCK else found.doubts[0]
    stated = "the same for all" if unknown else "those given"
    lenses = "; giving the lenses helps" if unknown else ""
    bars = f"one may be off by {number(turn)}° or {place:,.0f} mm" if turn < 90.0 else "they may be anywhere"
    why = {
        "clocks": "the cameras are out of step. Find their clocks as well",
        "periodic": f"several clocks fit, because the motion repeats itself. {_FILM}, or clap once",
        "movement": f"the person hardly moves. {_FILM}",
        "cameras": f"too few cameras agree. Do all of them see the same person at the same time? {_FILM}",
        "lenses": f"other focal lengths fit than {stated} ({', '.join(off)}). Are the lenses those of "
        "these cameras, at this zoom and image size? Without them, focal lengths are found",
        "skipped": f"the frame numbers of {' and '.join(skipped)} change. Convert the video, or leave it out",
        "moved": "a camera kept moving while it recorded",
        "places": f"{bars}. {_FILM}{lenses}",
    }
    words = f"This recording does not tell where the cameras are: {why[doubt]}."
    remedy = [Remedy("without", name) for name in skipped if doubt == "skipped"]
    if doubt == "places" and unknown and not same_focal:
        remedy.append(Remedy("same_cameras", True))
    if not clock and doubt not in ("movement", "moved", "lenses", "skipped"):
        remedy.append(Remedy("clock", True))
    numbers = {"degrees_sigma": float(turn), "mm_sigma": float(place)}
    subject = Subject(tuple(one.name for one in placed))
    return Finding("cameras_not_calibrated", "error", subject, numbers, tuple(remedy), sentence=words)
