"""What became of cameras that were adjusted, in numbers and words, and what helps about the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._clocks import parted, rounded
from skelsplat._words import listed, px, with_bar
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.rig_check import ReadAs

_SHOWN = 4.0  # multiples of its error bar from which a clock is off
_NOTHING = 0.01  # a change below this part of its error bar is none


def findings_of(
    found: sk.RigAdjustment,
    mm_per_unit: float,
    read_as: ReadAs,
    *,
    corrected: bool = False,
    place: Callable[[int], str] = "frame {}".format,
) -> Iterator[Finding]:
    """Yield what was adjusted, and what is to be done about others, and about clocks unless ``corrected``.

    ``place`` names a frame.
    """
    for one in found.report:
        numbers = numbers_of(one, mm_per_unit)
        if one.status == "adjusted" and is_placed(one):
            yield _adjusted({**numbers, "left_out_frames": found.judged})
        if is_late(one):
            remedy = () if corrected else read_as.offset_remedy(one.name, offset_of(one, read_as))
            yield late(numbers, remedy)
        if one.since is not None:
            yield _changing(one.name, numbers, one.since, place(one.since), clock=one.status == "unsteady")
        if one.status == "unseen" and len(found.report) > 2:
            sentence = f"{one.name} was not judged and not adjusted: it sees too few of the joints that "
            sentence += "others see."
            yield Finding("camera_unused", "warning", Subject((one.name,)), sentence=sentence)
    doubtful = [*found.of("doubtful"), *(one for one in found.of("late") if not _clock_known(one))]
    if doubtful:
        suspected = [{**numbers_of(one, mm_per_unit), "offset": offset_of(one, read_as)} for one in doubtful]
        changed = [one.name for one in found.of("adjusted")]
        placed = all(map(is_placed, doubtful)) and 2 * (len(changed) + 1) >= len(found.report)
        yield _doubtful(suspected, changed if placed else [])  # a majority of places stays
    if len(found.report) == 2 and found.of("unseen"):
        sentence = "Two cameras do not tell which of them was turned or moved, so neither was adjusted. Add "
        sentence += "a third camera, or name the one that was moved."
        subject = Subject(found.cameras.names)
        remedy = tuple(Remedy("move", name) for name in found.cameras.names)
        yield Finding("cameras_not_adjusted", "warning", subject, remedy=remedy, sentence=sentence)
    sound = len(found.of("sound"))
    if sound and not found.of("adjusted", "late", "doubtful", "knocked", "unsteady"):
        sentence = f"No camera was adjusted: the {sound} cameras that could be judged agree."
        yield Finding("cameras_not_adjusted", "note", numbers={"cameras": sound}, sentence=sentence)


def offset_of(camera: sk.CameraAdjustment | sk.CalibratedCamera, read_as: ReadAs) -> float:
    """Return the offset that sets a clock right, in whole frames unless parts of one are shown."""
    whole, rest = parted(camera.clock)
    shown = np.isfinite(camera.clock_sigma) and abs(rest) > _SHOWN * camera.clock_sigma
    return rounded(read_as.offsets.get(camera.name, 0) - (camera.clock if shown else whole))


def _changing(name: str, numbers: dict[str, Any], since: int, place: str, *, clock: bool) -> Finding:
    """Return the finding on a camera whose clock or place is another from a frame on."""
    subject = Subject((name,), frames=(since,))
    if clock:
        sentence = f"{name}'s frame numbers change by {abs(numbers['clock_frames']):.0f} about {place}: were "
        sentence += "frames skipped, or is its frame rate another? Nothing was corrected."
        return Finding("clock_changes", "warning", subject, numbers, sentence=sentence)
    sentence = f"{name} was moved while it recorded, about {place}, and not adjusted: "
    sentence += "the frames before and after need a calibration each."
    return Finding("cameras_not_adjusted", "warning", subject, numbers, sentence=sentence)


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


def late(numbers: dict[str, Any], remedy: tuple[Remedy, ...] = (), *, recording: str = "") -> Finding:
    """Return the finding on a camera whose clock is off; without a remedy or recording, it was corrected."""
    name, frames, sigma = numbers["camera"], numbers["clock_frames"], numbers["clock_sigma_frames"]
    size = f"{abs(frames):.0f}" if sigma is None else with_bar(abs(frames), sigma)
    off, subject = f"{size} too {'high' if frames > 0 else 'low'}", Subject((name,))
    if remedy:
        sentence = f"{name}'s frame numbers are {off}."
        return Finding("frame_offset", "warning", subject, numbers, remedy, sentence=sentence)
    sentence = f"{name}'s frame numbers are {off} in {recording}."
    if not recording:
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
        remedy = [Remedy("move", [*besides, one["camera"]]) for one in suspected]
        sentence = f"Another camera is wrong as well, most likely {listed(ways, 'or')}. It was not adjusted: "
        sentence += "more than half of the cameras have to stay. If you know which were moved, name all of "
        sentence += "them."
    elif len(ways) == 1:
        sentence = f"{ways[0]} disagrees with the other cameras, but the detections do not tell how it is "
        sentence += "wrong: it was not adjusted. The person has to walk through more of the room."
    else:
        sentence = f"{listed(ways, 'or')} is wrong, but the detections do not tell which: none of them was "
        sentence += "adjusted. If you know, name the one that was moved, or correct the clock of the late "
        sentence += "one. Otherwise record with more cameras, or a person who walks through more of the "
        sentence += "room."
        remedy = [Remedy("move", one["camera"]) for one in suspected if one not in late]
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


def is_late(camera: sk.CameraAdjustment) -> bool:
    """Whether a clock is off, and to be corrected."""
    return camera.status in ("late", "adjusted") and _clock_known(camera)


def offsets_of(found: sk.RigAdjustment, read_as: ReadAs) -> dict[str, float]:
    """Return by camera what is to be added to its frame numbers."""
    late = {one.name: offset_of(one, read_as) for one in found.report if is_late(one)}
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


def is_placed(camera: sk.CameraAdjustment) -> bool:
    """Whether more than a clock was changed, or is suspected."""
    return (camera.degrees, camera.distance, camera.focal) != (0.0, 0.0, 1.0)
