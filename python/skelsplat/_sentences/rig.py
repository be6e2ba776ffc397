"""What a check of cameras finds: units, conventions, files and calibrations that do not fit each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from skelsplat._words import listed, options, percent, with_bar

if TYPE_CHECKING:
    from skelsplat.findings import Finding

    Numbers = Mapping[str, Any]


# A change below this part of its error bar is none.
_NOTHING = 0.01


def _px(error: float | None, digits: int = 1) -> str:
    return f"{error:.{digits}f} px" if error is not None and error < float("inf") else "too large to measure"


def _length(mm: float) -> str:
    if mm >= 1000.0:
        return f"{mm / 1000.0:.3g} m" if mm < 1e6 else f"{mm / 1000.0:,.0f} m"
    return f"{mm / 10.0:.3g} cm" if mm >= 10.0 else f"{mm:.3g} mm"


def _size(subject: str, rest: str) -> Callable[[Finding], str]:
    def sentence(finding: Finding) -> str:
        numbers = finding.numbers
        measured = (
            f"With unit {numbers['stated']}, the {subject} measures about {_length(numbers['size_mm'])}"
        )
        return measured + rest.format(**numbers)

    return sentence


def _change(numbers: Numbers) -> str:
    """Return the error before and after a correction."""
    before, after, first = _px(numbers["before_px"]), _px(numbers["after_px"]), _once(numbers)
    return f"error {before}{first}, {after} after {'this' if first else 'the'} correction"


def _once(numbers: Numbers) -> str:
    """Return a clause: the number before it holds in the scene in which earlier findings are corrected."""
    if "once_corrected" not in numbers:
        return ""
    names: Sequence[str] = numbers["once_corrected"]
    subject = f"{listed(names)} {'is' if len(names) == 1 else 'are'}" if names else "the above is"
    return f" once {subject} corrected"


def _all_cameras(finding: Finding) -> str:
    """Return a sentence on all cameras, with the error, and with other explanations."""
    numbers = finding.numbers
    text = _explanation({"kind": finding.kind, **numbers})
    error = f"error {_px(numbers['before_px'], 0)}, {_px(numbers['after_px'])} after the correction"
    others = (" and ".join(map(_explanation, rival)) for rival in numbers.get("rivals", ()))
    also = "".join(f" Almost as good an explanation: {other}." for other in others)
    return f"{text[0].upper()}{text[1:]} ({error}).{also}"


def _explanation(numbers: Numbers) -> str:
    """Return a clause on all cameras: other images, or folders that are exchanged."""
    if numbers["kind"] == "images_changed":
        return f"the detections of all cameras are {numbers['images']}"
    moved = {name: owner for name, owner in numbers["folders"].items() if owner != name}
    if len(moved) == 2:
        return f"the detections of {listed(list(moved))} are exchanged (or their calibrations are)"
    each = ", ".join(f"those of {owner} belong to {name}" for name, owner in moved.items())
    return f"the detections of {len(moved)} cameras are exchanged (or their calibrations are): {each}"


def _offset(numbers: Numbers, name: str) -> str:
    shift, (least, most) = numbers["frames"], sorted(map(abs, numbers["frames_nearly_as_good"]))
    also = f" ({least} to {most} fit almost as well)" if least < most else ""
    return (
        f"{name}'s frame numbers are {abs(shift)} too {'high' if shift > 0 else 'low'}{also}: its frame "
        f"f{shift:+d} is frame f of the others ({_change(numbers)})."
    )


def _resized(numbers: Numbers, name: str) -> str:
    return (
        f"{name}'s detections are from images of another size; multiplied by {numbers['factor']:.3g} they "
        f"fit ({_change(numbers)})."
    )


def _images(numbers: Numbers, name: str) -> str:
    return f"{name}'s images are {numbers['images']} ({_change(numbers)})."


def _sides(numbers: Numbers, name: str) -> str:
    share = percent(numbers["share_of_frames"])
    return (
        f"{name}: left and right are swapped in {share} of its frames ({_change(numbers)}). Were its "
        "images mirrored for the detector, or its joints named from the viewer's side?"
    )


def _pose(numbers: Numbers, name: str) -> str:
    text = (
        f"{name}'s calibration looks wrong: {_motion(numbers, 'the camera')} restores agreement "
        f"({_change(numbers)}). The camera was moved after calibration, or the calibration belongs to "
        "another camera or another image."
    )
    if "same_as_shift_px" in numbers:
        shift = f"{numbers['same_as_shift_px']:.0f} px"
        text += f" An image shifted by {shift} (a crop, a principal point) would look the same."
    return text


def _motion(numbers: Numbers, what: str) -> str:
    turned, moved = f"{numbers['degrees']:.1f}°", f"{numbers['mm']:.0f} mm"
    if moved == "0 mm":
        return f"rotating {what} by {'less than 0.1°' if turned == '0.0°' else turned}"
    return (
        f"moving {what} by {moved}"
        if turned == "0.0°"
        else f"rotating {what} by {turned} and moving it by {moved}"
    )


def _briefly(numbers: Numbers) -> str:
    """Return what would be changed about one camera."""
    name, kind = numbers["camera"], numbers["kind"]
    if kind == "frame_offset":
        return f"changing {name}'s frame numbers by {-numbers['frames']:+d}"
    if kind == "image_resized":
        return f"multiplying {name}'s detections by {numbers['factor']:.3g}"
    if kind == "image_changed":
        return f"treating {name}'s images as {numbers['images']}"
    if kind == "sides_swapped":
        return f"swapping left and right in {name}"
    return _motion(numbers, name)


def _one_camera(describe: Callable[[Numbers, str], str]) -> Callable[[Finding], str]:
    """Return a sentence on one camera, with other explanations, and with how few frames support it."""

    def sentence(finding: Finding) -> str:
        numbers, (name,) = finding.numbers, finding.subject.cameras
        text = describe(numbers, name)
        rivals = numbers.get("rivals", ())
        if rivals:
            ways = " or ".join(map(_briefly, rivals))
            means = " or ".join(f"{rival['mean_px']:.1f}" for rival in rivals)
            best = min(round(rival["mean_px"], 1) for rival in rivals)
            well = f"{'almost ' * (best > round(numbers['mean_px'], 1))}as well"
            text += f" {ways[0].upper() + ways[1:]} explains it {well} (mean error {means} px instead of "
            text += f"{numbers['mean_px']:.1f} px)."
        if "few_frames" in numbers:
            frames = numbers["few_frames"]
            text += f" Based on only {frames} frame{'s' * (frames != 1)}; provide more."
        return text

    return sentence


def _disagrees(finding: Finding) -> str:
    numbers, (name,) = finding.numbers, finding.subject.cameras
    return (
        f"{name} disagrees with the other cameras, and no tested cause explains it: "
        f"{percent(numbers['rejected'])} of its detections are rejected, {percent(numbers['others'])} of "
        f"theirs, and they lie {numbers['px']:.0f} px from where the others place them{_once(numbers)}. "
        "Rotating or moving it does not restore agreement, so adjusting cameras is unlikely to help. Check "
        "that its file belongs to this recording, shows the same person and stays synchronised to the end, "
        "that the camera was not moved meanwhile, and that lens and focal length are those calibrated."
    )


def _looks_away(finding: Finding) -> str:
    names = finding.subject.cameras
    return f"{listed(names)} look{'s' * (len(names) == 1)} away from where the other cameras look."


def _recording(finding: Finding) -> str:
    names = finding.subject.cameras
    return (
        "Calibration and detections probably do not belong together (another recording, another rig, or "
        f"cameras that were moved): {len(names)} of {finding.numbers['of']} cameras "
        f"({', '.join(names)}) are not where the calibration places them. It is impossible to tell which "
        "cameras are right."
    )


def _apart(finding: Finding) -> str:
    names = finding.subject.cameras
    return (
        f"{listed(names)} disagree: every 3D point is at least {finding.numbers['px']:.1f} px from their "
        "detections. "
        "With two cameras, it is impossible to tell which is wrong, and whether calibration or timing is."
    )


def _adjusted(finding: Finding) -> str:
    numbers = finding.numbers
    error = ""
    if numbers["before_px"] is not None and numbers["after_px"] is not None:
        frames = f"in {numbers['left_out_frames']} other frames"
        error = f" (error {_px(numbers['before_px'])}, {_px(numbers['after_px'])} afterwards, {frames})"
    changes = _changes({**numbers, "clock_frames": 0.0})  # which is no part of a calibration
    text = f"{numbers['camera']} was adjusted: {listed(changes or ['by next to nothing'])}{error}."
    worse = " In frames that were not used, it does not hold: do not use these cameras."
    return text + (worse if finding.severity != "note" else "")


def _changes(numbers: Numbers) -> list[str]:
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


def _late(finding: Finding) -> str:
    numbers = finding.numbers
    frames, sigma = numbers["clock_frames"], numbers["clock_sigma_frames"]
    high = f"{abs(frames):.0f}" if sigma is None else with_bar(abs(frames), sigma)
    text = f"{numbers['camera']}'s frame numbers are {high} too {'high' if frames > 0 else 'low'}"
    return f"{text}; a calibration has no clock: {options(finding.remedy)} of refine corrects it."


def _doubtful(finding: Finding) -> str:
    suspected = finding.numbers["suspected"]
    ways = [f"{one['camera']} ({listed(_changes(one) or ['no single change'])})" for one in suspected]
    if besides := finding.numbers["besides"]:
        named = " ".join(f"--move {name}" for name in (*besides, "NAME"))
        return (
            f"Another camera is wrong as well, most likely {listed(ways, 'or')}. It was not adjusted: more "
            "than half of the cameras have to stay. If you know which were moved, name all of them: "
            f"skelsplat adjust-cameras {named}."
        )
    if len(ways) == 1:
        return (
            f"{ways[0]} disagrees with the other cameras, and this recording does not tell how it is "
            "wrong: it was not adjusted. The person has to walk through more of the room."
        )
    few = "the other camera is" if len(ways) == 2 else "the others are"
    late = [one for one in suspected if not _changes({**one, "clock_frames": 0.0})]
    moved = (
        f" If you know which one was moved, name it, and {few} taken as right: skelsplat adjust-cameras "
        "--move NAME."
    )
    option = " If it is {camera}, refine with --offset {camera}={offset}."
    return (
        f"{listed(ways, 'or')} is wrong, and this recording does not tell which: none of them was adjusted."
        + (moved if len(late) < len(ways) else "")
        + "".join(option.format_map(one) for one in late)
        + " Otherwise, a recording with three or more other cameras, or in which the person walks through "
        "more of the room, can tell."
    )


def _unit_implausible(finding: Finding) -> str:
    numbers = finding.numbers
    metres = numbers["metres"]
    far = f"{1e3 * metres:.3g} mm" if metres < 1 else f"{metres:.{0 if metres >= 100 else 2}f} m"
    read = f"if it is {numbers['unit']}, the cameras are {far} apart"
    return f"{finding.subject.files[0]}: unit: {read}; {numbers['hint']}"


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "unit_implausible": _unit_implausible,
    "unit_wrong": _size("person", '. The unit of the calibration is most likely "{likely}".'),
    "unit_unknown": _size("person", ", which none of mm, cm and m explains. Was the calibration scaled?"),
    "body_size": _size("body", ". Is that the unit of the calibration?"),
    "pose_convention": (
        "The poses of all cameras appear to be {convention}: read that way, the cameras agree to "
        "{after_px:.1f} px instead of {before_px:.0f} px. Convert the calibration before using it."
    ),
    "images_changed": _all_cameras,
    "cameras_exchanged": _all_cameras,
    "frame_offset": _one_camera(_offset),
    "sides_swapped": _one_camera(_sides),
    "sides_swapped_at_times": (
        "{cameras}: left and right are swapped in {share_of_frames:.0%} of its frames, compared with the "
        "other cameras. refine swaps these detections back. Does the detector confuse the sides in this view?"
    ),
    "image_resized": _one_camera(_resized),
    "image_changed": _one_camera(_images),
    "camera_rotated": _one_camera(_pose),
    "camera_moved": _one_camera(_pose),
    "camera_unexplained": _disagrees,
    "camera_adjusted": _adjusted,
    "camera_late": _late,
    "cameras_doubtful": _doubtful,
    "camera_unseen": (
        "{cameras} sees too few of the joints that other cameras see, so it was not judged and not adjusted."
    ),
    "cameras_trusted": (
        "--move names {moved} of {of} cameras. The others are taken as right: unless they are more than half "
        "of all, the recording hardly shows if one of them is wrong."
    ),
    "cameras_two": (
        "Two cameras do not tell which of them was turned or moved, so neither was adjusted. Add a third "
        "camera, or name the one that was moved: skelsplat adjust-cameras --move NAME."
    ),
    "cameras_sound": (
        "No camera was adjusted: this recording shows no fault in the {cameras} cameras that could be judged."
    ),
    "cameras_not_adjusted": "No camera was adjusted, because another fault has to be corrected first. {why}",
    "cameras_apart": _apart,
    "recording_other": _recording,
    "detections_none": "There are no detections to check the cameras with.",
    "camera_blind": "{cameras} has no detections.",
    "detections_same": (
        "{cameras} have the same detections to the last digit, so they are those of one camera. Was a folder "
        "or a file copied or linked?"
    ),
    "detections_outside": (
        "{cameras}: {outside:.0%} of the detections lie outside its image of {width} by {height} px. Are "
        "they from images of this size, not rotated, x before y?"
    ),
    "field_of_view": (
        "{cameras}: a focal length of {focal_px:.4g} px on images of {width} by {height} px is a field of "
        "view of {degrees:.3g}°. Is this the image size of the calibration?"
    ),
    "principal_point": (
        "{cameras}: the principal point ({x:.0f}, {y:.0f}) is far from the middle of images of {width} by "
        "{height} px. Is this the image size of the calibration, width before height?"
    ),
    "pixels_not_square": (
        "{cameras}: focal lengths of {fx:.4g} and {fy:.4g} px mean pixels that are not square."
    ),
    "same_place": (
        "{one} and {other} are in the same place; two views from one place give no depth. Is one a copy of "
        "the other?"
    ),
    "all_look_away": (
        "All cameras look away from the point where their axes come closest. Are rotation and translation "
        "camera → world instead of world → camera, or does z point backwards?"
    ),
    "looks_away": _looks_away,
}
